"""The page of commands, from the tree of verbs."""

import argparse
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from typer.main import get_command

from docs_tools.reference.markdown import block, code, described, link, paragraphs, prose, sentence, table
from robo.cli.app import app
from robo.cli.launch import run
from robo.process import health

_SHARED_TITLE = "Which network, which robot, how long"
_SHARED = ("robot_name", "connect", "security", "timeout")
"""What a verb that looks at running robots is told: options that are described once."""

_INTRO = """\
`robo VERB --help` shows the same. Every verb ends with 0 where all is well, with 1 where something is wrong, with 2 for
words that make no sense, and with 130 after Ctrl-C; where a verb says more, it is told there."""

_HEADER = ("word", "default", "what")


def lines() -> list[str]:
    """The page's lines: in the sections of help, each verb."""
    root: Any = get_command(app)
    found = [
        *_INTRO.splitlines(),
        "",
        f"## {_SHARED_TITLE}",
        "",
        "What verbs take that look at running robots.",
        "",
        *table(_HEADER, map(_row, _shared_options(root))),
    ]  # fmt: skip
    for section in root.context_settings["obj"]:
        found += [f"## {section.title}", ""]
        for name in section.names:
            for path, command in verbs(root.get_command(None, name), (name,)):
                found += _verb(path, command)
    return found


def verbs(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """All verbs of a command, each with the words that call it."""
    if hasattr(command, "list_commands"):
        for name in command.list_commands(None):
            yield from verbs(command.get_command(None, name), (*path, name))
    else:
        yield path, command


def _shared_options(root: Any) -> list[Any]:
    """The options that most verbs have, from the first verb that has all of them."""
    return next(shared for _, command in verbs(root) if len(shared := _shared(command)) == len(_SHARED))


def _shared(command: Any) -> list[Any]:
    """The options of a verb that are as most verbs have them; none where it has but some of the three."""
    named = {one.name: one for one in command.params}
    shared = [named[name] for name in _SHARED if name in named]
    return [one for one in shared if one.default is None] if len(shared) == len(_SHARED) else []


def _verb(path: tuple[str, ...], command: Any) -> list[str]:
    title = " ".join(("robo", *path))
    own = _OF_THEIR_OWN.get(path)
    return [f"### {title}", "", *(own() if own is not None else _typer_verb(title, command))]


def _typer_verb(title: str, command: Any) -> list[str]:
    also = _shared(command)
    rows = [_row(one) for one in command.params if one not in also]
    if also:
        rows.append((", ".join(code(one.opts[-1]) for one in also), "", link(_SHARED_TITLE.lower(), _SHARED_TITLE)))
    examples = [line.strip() for line in (command.epilog or "").partition("xamples:\n")[2].splitlines()]
    return [
        *paragraphs(described(command.help or "", title)),
        block(" ".join([title, *filter(None, map(_usage, command.params)), "[OPTIONS]"]), "text"),
        "",
        *table(_HEADER, rows),
        *_examples(examples),
    ]


def _examples(examples: Iterable[str]) -> list[str]:
    return [block("\n".join(examples), "sh"), ""] if examples else []


def _usage(parameter: Any) -> str:
    if parameter.param_type_name != "argument":
        return ""
    name = _metavar(parameter)
    return name if parameter.required or name.startswith("[") else f"[{name}]"


def _row(parameter: Any) -> tuple[str, str, str]:
    is_argument = parameter.param_type_name == "argument"
    names = [_metavar(parameter)] if is_argument else list(parameter.opts)
    if not is_argument and not parameter.is_flag:
        names[-1] += f" {_metavar(parameter)}"
    about = described(parameter.help or "", f"{parameter.name} of a verb")
    notes = [_limits(parameter.type), "May be repeated" if not is_argument and parameter.multiple else ""]
    extra = ". ".join(note for note in notes if note)
    return (
        ", ".join(map(code, names)),
        "" if parameter.default in (None, False, (), []) else code(parameter.default),
        prose(about) + (f" {extra}." if extra else ""),
    )


def _metavar(parameter: Any) -> str:
    if parameter.metavar:
        return str(parameter.metavar)
    choices = getattr(parameter.type, "choices", None)
    return "|".join(choices) if choices else str(parameter.name).upper()


def _limits(kind: Any) -> str:
    low, high = getattr(kind, "min", None), getattr(kind, "max", None)
    if low is None and high is None:
        return ""
    if low is None or high is None:
        return f"At least {low:g}" if high is None else f"At most {high:g}"
    return f"{low:g} to {high:g}"


def _run() -> list[str]:
    usage, _, rest = run.USAGE.partition("\n\n")
    about, _, examples = rest.partition("Examples:\n")
    return [
        *paragraphs(about.strip()),
        block("\n".join(line.strip() for line in usage.removeprefix("Usage: ").splitlines()), "text"),
        "",
        *_examples([line.strip() for line in examples.splitlines()]),
    ]


def _health() -> list[str]:
    parser = health.command_line()
    actions = [action for action in parser._actions if not isinstance(action, argparse._HelpAction)]
    return [
        *paragraphs(described(parser.description or "", "robo health")),
        block("robo health [NODE]... [OPTIONS]", "text"),
        "",
        *table(_HEADER, map(_argparse_row, actions)),
        *_examples([line.strip() for line in health.EXAMPLES.splitlines()[1:]]),
    ]


def _argparse_row(action: argparse.Action) -> tuple[str, str, str]:
    name = " ".join([*action.option_strings, str(action.metavar)])
    about = re.sub(r" \(default .*\)$", "", described(action.help or "", f"robo health {name}"))
    return code(name), "" if action.default in (None, []) else code(action.default), prose(sentence(about))


_OF_THEIR_OWN: Final[Mapping[tuple[str, ...], Any]] = {("run",): _run, ("health",): _health}
"""Verbs that do without the library of the command line, and what makes their lines."""
