"""What all verbs share: the tree of commands, common options, and how errors end a command."""

import functools
import importlib
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, MutableMapping
from contextlib import contextmanager
from typing import Annotated, Any, NoReturn, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group

from robo.cli import completion, ros2_words
from robo.cli.reach import Reach
from robo.errors import InvalidName, ManifestError, RoboError, UsageError
from robo.text.brief import brief_lines
from robo.text.suggestions import closest

F = TypeVar("F", bound=Callable[..., int | None])


def _refuse(text: str) -> NoReturn:
    """End because of words that make no sense."""
    typer.echo(f"error: {text}", err=True)
    raise typer.Exit(2)


class _Root(TyperGroup):
    """All verbs and groups, in help by what they are for."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        option = args[0] if args else ""
        if option.startswith("-") and option.partition("=")[0] in ("--robot-name", "--connect", "--timeout", "--json"):
            _refuse(f"{option} stands behind the verb: robo VERB {option.partition('=')[0]} …")
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] not in self.commands:
            if about := ros2_words.about_verb(args[0]):
                _refuse(f"there is no robo {args[0]}: {about}")
            if meant := _meant(args[0], self.commands):
                _refuse(f"there is no robo {args[0]}; did you mean {' or '.join(f'robo {verb}' for verb in meant)}?")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        del ctx  # all are listed, wherever it is asked
        for title, names in SECTIONS.items():
            with formatter.section(title):
                rows = [(name, self.commands[name].get_short_help_str(200)) for name in names if name in self.commands]
                if rows:
                    formatter.write_dl(rows)


SECTIONS = {
    "Start and stop": ("up", "run", "stop", "start", "restart", "down"),
    "Processes": ("ps", "why", "events", "logs"),
    "Running system": ("topic", "node", "param", "service", "interface", "top", "graph", "net", "doctor"),
    "Manifests": ("check", "schema", "export"),
    "Networks and containers": ("router", "health", "keeper"),
}
"""The verbs as help lists them."""


app = typer.Typer(
    cls=_Root,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Robots as microservices over Zenoh: start them, look at them.",
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(version("robo-zenoh"))
        raise typer.Exit


@app.callback()
def _root(
    _wanted: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Show the version."""


GROUPS = {
    "topic": "Topics: list, info, type, find, echo, pub, hz, bw, delay, loss, plot.",
    "node": "Nodes: list, info, show.",
    "param": "Parameters of running nodes: list, get, set, describe, dump, load, explain, watch.",
    "service": "Services: list, type, info, call.",
    "interface": "Message and service types: list, show.",
}
"""Groups of verbs with what they hold: they are read only when one is called."""


def _meant(word: str, verbs: Iterable[str]) -> list[str]:
    """The verbs that somebody may have meant: those of this name in a group, or one that is written alike."""
    found = [
        f"{group} {word}" for group, about in GROUPS.items() if word in re.findall(r"\w+", about.partition(":")[2])
    ]
    close = None if found else closest(word, verbs)
    return found if close is None else [close]


class _LazyGroup(TyperGroup):
    """The verbs of a group, read when one of them is called: `robo.cli.verbs.<group>` has them as `verbs`."""

    def list_commands(self, ctx: object) -> list[str]:
        del ctx  # all are listed, wherever it is asked
        return list(self._commands())

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        self._commands()
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        group = self.name or ""
        if args and args[0] not in self._commands() and (about := ros2_words.about_group_verb(group, args[0])):
            _refuse(f"there is no robo {group} {args[0]}: {about}")
        return super().resolve_command(ctx, args)

    def _commands(self) -> MutableMapping[str, Any]:
        if not self.commands:
            module = importlib.import_module(f"robo.cli.verbs.{self.name}")
            self.commands = get_group(module.verbs).commands
        return self.commands


class _Verb(TyperCommand):
    """A verb that knows what ROS 2 calls its options."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        group = ctx.parent.info_name if ctx.parent is not None else ""
        if about := ros2_words.about_option(group, self.name or "", args):
            _refuse(about)
        return super().parse_args(ctx, args)


for _name, _about in GROUPS.items():
    app.add_typer(typer.Typer(cls=_LazyGroup, no_args_is_help=True, rich_markup_mode=None, help=_about), name=_name)


RobotName = Annotated[
    str | None,
    typer.Option(
        "--robot-name",
        metavar="NAME",
        help="Namespace of the robot.",
        show_default=False,
        autocompletion=completion.robots,
    ),
]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        "--connect", metavar="ENDPOINT", help="Dial this Zenoh endpoint (or ROBO_CONNECT).", show_default=False
    ),
]
Listen = Annotated[
    list[str] | None,
    typer.Option("--listen", metavar="ENDPOINT", help="Listen here instead of tcp/127.0.0.1:7447 (or ROBO_LISTEN)."),
]
Timeout = Annotated[
    float | None,
    typer.Option(
        "--timeout",
        metavar="S",
        help="How long to wait for the network and for an answer.",
        min=0.0,
        show_default=False,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
JsonLines = Annotated[bool, typer.Option("--json", help="Print JSON Lines.")]
Watch = Annotated[bool, typer.Option("--watch", help="Again and again, until Ctrl-C.")]
Interval = Annotated[float, typer.Option("--interval", metavar="S", help="How often, with --watch.", min=0.1)]
NodeName = Annotated[
    str,
    typer.Argument(
        metavar="NODE",
        help="A node's full name, or its name where only one has it.",
        autocompletion=completion.nodes,
    ),
]
OptionalNode = Annotated[
    str | None, typer.Argument(metavar="[NODE]", help="Only this node.", autocompletion=completion.nodes)
]
TopicName = Annotated[
    str,
    typer.Argument(metavar="KEY", help="A topic's full name, for example r1/odom.", autocompletion=completion.topics),
]
TopicNames = Annotated[
    list[str],
    typer.Argument(
        metavar="KEY...", help="Full names, for example r1/odom; * and ** match.", autocompletion=completion.topics
    ),
]
TypeName = Annotated[
    str, typer.Argument(metavar="TYPE", help="For example geometry/Twist.", autocompletion=completion.types)
]

_SHARED = {
    "robot_name": (RobotName, None),
    "connect": (Connect, None),
    "timeout": (Timeout, None),
}


def keep_only(name: str) -> None:
    """Forget all but the verb or group of this name, if there is one: Typer builds each of them before it calls one."""
    commands = [command for command in app.registered_commands if command.name == name]
    groups = [group for group in app.registered_groups if group.name == name]
    if commands or groups:
        app.registered_commands, app.registered_groups = commands, groups


def verb(parent: typer.Typer, name: str, *examples: str, **settings: Any) -> Callable[[F], F]:
    """Make a function a verb. Its docstring is the help; what it returns is the exit code, None being 0.

    A function whose first parameter is `reach` gets the options --robot-name, --connect and --timeout,
    as one `Reach`; one of them that it declares itself stays its own.

    Args:
        parent: `app`, or a group.
        name: of the verb.
        examples: command lines, below the help.
        settings: more for typer.
    """

    def register(function: F) -> F:
        signature = inspect.signature(function, eval_str=True)
        own = dict(signature.parameters)
        reaches = own.pop("reach", None) is not None
        shared = {key: said for key, said in _SHARED.items() if reaches and key not in own}

        @functools.wraps(function)
        def run(**options: Any) -> None:
            given = {key: options.pop(key) for key in shared}
            with errors():
                if reaches:
                    options["reach"] = Reach.of(
                        given.get("connect") or (), given.get("robot_name"), given.get("timeout")
                    )
                code = function(**options)
            raise typer.Exit(code or 0)

        added = [
            inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)
            for key, (annotation, default) in shared.items()
        ]
        parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own.values()] + added
        run.__signature__ = signature.replace(parameters=parameters, return_annotation=None)  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        epilog = "\b\nExamples:\n" + "\n".join(f"  {line}" for line in examples) if examples else None
        settings.setdefault("short_help", re.split("[,:;.]", inspect.cleandoc(function.__doc__ or ""))[0])
        parent.command(name, cls=_Verb, epilog=epilog, **settings)(run)
        return function

    return register


@contextmanager
def errors() -> Iterator[None]:
    """Show a mistake as a message, and leave quietly on Ctrl-C and when the reader of a pipe is gone."""
    try:
        yield
    except RoboError as error:
        print(_described(error), file=sys.stderr)
        words = isinstance(error, (UsageError, InvalidName)) or (
            isinstance(error, ManifestError) and error.of_command_line
        )
        raise typer.Exit(2 if words else 1) from None
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    except BrokenPipeError:
        # What Python would still flush at exit has no reader either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None


def _described(error: RoboError) -> str:
    """An error for people; the mistakes of a manifest each with their line."""
    if not isinstance(error, ManifestError) or not hasattr(error, "faults"):
        return f"error: {brief_lines(str(error))}"
    from robo.launch.faults import as_text

    count = "1 mistake" if len(error.faults) == 1 else f"{len(error.faults)} mistakes"
    return f"{as_text(error.faults)}\n{count}; nothing is started"
