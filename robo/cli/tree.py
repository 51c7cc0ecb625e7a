"""The tree of commands: the root with its sections, groups that are read when one is called, and what is not there."""

import importlib
from collections.abc import Iterable, MutableMapping, Sequence
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group

from robo.cli import ros2_words
from robo.text.suggestions import closest
from robo.version import VERSION


class Section(typer.Typer):
    """Verbs and groups that help lists under one title, in the order in which they are made."""

    def __init__(self, title: str) -> None:
        super().__init__()
        self.title = title
        self.names: list[str] = []

    def group(self, name: str, about: str) -> None:
        """Add a group: `robo.cli.verbs.<name>` has its verbs, as `verbs`, and is read when one of them is called."""
        self.names.append(name)
        self.add_typer(typer.Typer(cls=_LazyGroup, no_args_is_help=True, rich_markup_mode=None, help=about), name=name)


def group() -> typer.Typer:
    """The verbs of a group."""
    return typer.Typer(rich_markup_mode=None)


def root(sections: Sequence[Section]) -> typer.Typer:
    """The command with the verbs of all sections."""
    app = typer.Typer(
        cls=_Root,
        no_args_is_help=True,
        add_completion=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"], "obj": tuple(sections)},
        help="Robots as microservices over Zenoh: start them, look at them.",
    )
    app.callback()(_root)
    for section in sections:
        app.registered_commands += section.registered_commands
        app.registered_groups += section.registered_groups
    return app


def keep_only(app: typer.Typer, name: str) -> None:
    """Forget all but the verb or group of this name, if there is one: Typer builds each of them before it calls one."""
    commands = [command for command in app.registered_commands if command.name == name]
    groups = [group for group in app.registered_groups if group.name == name]
    if commands or groups:
        app.registered_commands, app.registered_groups = commands, groups


class Verb(TyperCommand):
    """A verb that knows what ROS 2 calls its options."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Take the words of its command line apart."""
        group = ctx.parent.info_name if ctx.parent is not None else ""
        if about := ros2_words.about_option(group, self.name or "", args):
            _refuse(about)
        return super().parse_args(ctx, args)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(VERSION)
        raise typer.Exit


def _root(
    _wanted: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Show the version."""


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
            if meant := self._meant(args[0]):
                _refuse(f"there is no robo {args[0]}; did you mean {' or '.join(f'robo {verb}' for verb in meant)}?")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for section in ctx.find_root().obj:
            rows = [
                (name, self.commands[name].get_short_help_str(200)) for name in section.names if name in self.commands
            ]
            with formatter.section(section.title):
                if rows:
                    formatter.write_dl(rows)

    def _meant(self, word: str) -> list[str]:
        """The verbs that somebody may have meant: those of this name in a group, or one that is written alike."""
        groups = [command for command in self.commands.values() if isinstance(command, _LazyGroup)]
        found = [f"{group.name} {word}" for group in groups if word in group.names()]
        close = None if found else closest(word, self.commands)
        return found if close is None else [close]


class _LazyGroup(TyperGroup):
    """The verbs of a group, read when one of them is called or listed."""

    def names(self) -> Iterable[str]:
        """What its verbs are called."""
        return [str(command.name) for command in self._verbs().registered_commands]

    def get_short_help_str(self, limit: int = 45) -> str:
        del limit  # all are listed
        return f"{self.help}: {', '.join(self.names())}."

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        del ctx  # all are listed, wherever it is asked
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(self.get_short_help_str())

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
            self.commands = get_group(self._verbs()).commands
        return self.commands

    def _verbs(self) -> typer.Typer:
        verbs: typer.Typer = importlib.import_module(f"robo.cli.verbs.{self.name}").verbs
        return verbs


def _refuse(text: str) -> NoReturn:
    """End because of words that make no sense."""
    typer.echo(f"error: {text}", err=True)
    raise typer.Exit(2)
