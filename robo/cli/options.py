"""The options and arguments that several verbs have, and options as words again."""

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple, get_args, get_type_hints

import typer
from typer.models import OptionInfo

from robo.cli import completion
from robo.errors import UsageError

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
    typer.Option("--listen", metavar="ENDPOINT", help="Listen here, for all who come (or ROBO_LISTEN)."),
]
Security = Annotated[
    str | None,
    typer.Option(
        "--security",
        metavar="DIR",
        help="Be this name on a secured network: TLS, and no other (or ROBO_SECURITY).",
        show_default=False,
    ),
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


class Theme(StrEnum):
    """The colours of a picture."""

    AUTO = "auto"
    LIGHT = "light"
    DARK = "dark"


HowThemed = Annotated[
    Theme, typer.Option("--theme", help="Colours of the picture; auto is as whoever looks at it has their screen.")
]
SvgFile = Annotated[
    Path | None, typer.Option("--svg", metavar="FILE", help="Write it as a picture, too.", show_default=False)
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
NodeNames = Annotated[
    str,
    typer.Argument(
        metavar="NODE",
        help="A node's full name, its name where only one has it, or a pattern: 'r*/base'.",
        autocompletion=completion.nodes,
    ),
]
OptionalNode = Annotated[
    str | None,
    typer.Argument(
        metavar="[NODE]", help="Only this node, or those that a pattern matches.", autocompletion=completion.nodes
    ),
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
NetworkConfig = Annotated[
    Path | None,
    typer.Option(
        "--network-config", metavar="FILE", help="More of Zenoh's settings for the router: down-sampling, TLS, access."
    ),
]


def words_of(given: NamedTuple) -> Iterator[str]:
    """The words of a command line that say options: each field that is one, and that is not as it is by default."""
    for name, annotation in get_type_hints(type(given), include_extras=True).items():
        value = getattr(given, name)
        declared = next((about for about in get_args(annotation) if isinstance(about, OptionInfo)), None)
        if declared is None or value is None or value is False:
            continue
        # Within Annotated, typer keeps the first of an option's names as if it were the default.
        option = next(word for word in (str(declared.default), *(declared.param_decls or ())) if word[:2] == "--")
        if value is True:
            yield option
        else:
            yield from (f"{option}={one}" for one in (value if isinstance(value, list) else [value]))


def only_one(**switches: bool) -> str | None:
    """Which of some switches that exclude each other is on.

    Raises:
        UsageError: two are.
    """
    on = [name for name, is_on in switches.items() if is_on]
    if len(on) > 1:
        *others, last = (f"--{name.replace('_', '-')}" for name in switches)
        raise UsageError(f"choose one of {', '.join(others)} and {last}")
    return on[0] if on else None
