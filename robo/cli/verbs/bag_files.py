"""`robo bag` on recordings that are there: looked at, cut, put together, in other forms."""

from enum import StrEnum
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import HowThemed, Json, JsonLines, Theme
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()


class Compressed(StrEnum):
    """How a new recording is compressed."""

    ZSTD = "zstd"
    NONE = "none"


BagFile = Annotated[
    str,
    typer.Argument(metavar="BAG", help="A file, or the folder of one in parts.", autocompletion=completion.recordings),
]
NewFile = Annotated[
    str, typer.Option("-o", "--output", metavar="FILE", help="The new file.", autocompletion=completion.recordings)
]
Force = Annotated[bool, typer.Option("--force", help="Write over a file of this name.")]
HowCompressed = Annotated[Compressed, typer.Option("--compression", help="Of the new file.")]
Without = Annotated[
    list[str] | None,
    typer.Option("--exclude", metavar="TOPIC", help="Without these; may be repeated.", show_default=False),
]


@verb(
    verbs,
    "info",
    "robo bag info drive.mcap",
    "robo bag info drive.mcap --json | jq '.topics[] | select(.lost > 0)'",
    "robo bag info recordings/ --quick",
)
def bag_info(
    bags: Annotated[
        list[str],
        typer.Argument(
            metavar="BAG...", help="Files, or folders of such in parts.", autocompletion=completion.recordings
        ),
    ],
    quick: Annotated[bool, typer.Option("--quick", help="Look at no message: counts and times of the whole.")] = False,
    json: JsonLines = False,
) -> int:
    """Print what is in recordings: times, topics, rates, gaps, losses, sizes.

    RATE is that of publishing, with what was lost; GAP the longest time between two arrivals, and AT when it began,
    from the beginning; LOST what did not come, by the recorder's count or the sequence numbers; DELAY the mean time
    from publishing to arrival, where clocks agree. A file that is cut is told as far as it can be read. Of several the
    others are told where one cannot be read; it ends with 1 then.
    """
    from robo.cli.views.bag_info import print_info

    return print_info(bags, quick=quick, json=json)


@verb(
    verbs,
    "check",
    "robo bag check drive.mcap",
    "robo bag check drive.mcap --strict",
    "robo bag check drive.mcap --json | jq '.findings[].text'",
)
def bag_check(
    bag: BagFile,
    strict: Annotated[bool, typer.Option("--strict", help="End with 1 whatever was found.")] = False,
    json: Json = False,
) -> int:
    """Print what is wrong with a recording.

    Every byte is looked at: whether the file is cut or damaged, a part missing, its summary true, each message one of
    its type; whether topics were silent for long, messages lost or out of order, clocks set or never set. Ends with 1
    where the file itself is damaged: cut, a part missing, bytes or messages that make no sense, a summary that is not
    true. What it tells of a robot that lost messages is no such thing; --strict ends with 1 for that too.
    """
    from robo.cli.views.bag_check import print_check

    return print_check(bag, strict=strict, json=json)


@verb(
    verbs,
    "cut",
    "robo bag cut drive.mcap -o part.mcap --start 0.2 --end 0.6",
    "robo bag cut drive.mcap -o last.mcap --start -0.5",
)
def bag_cut(
    bag: BagFile,
    output: NewFile,
    start: Annotated[
        str | None, typer.Option("--start", metavar="TIME", help="From then on.", show_default=False)
    ] = None,
    end: Annotated[str | None, typer.Option("--end", metavar="TIME", help="Before then.", show_default=False)] = None,
    compression: HowCompressed = Compressed.ZSTD,
    force: Force = False,
) -> None:
    """Make a recording of a part of the time of another.

    TIME counts arrivals: seconds from the beginning (12.5) or from the end (-5), a time of the clock here (18:30:00),
    a date (2026-11-23T18:30:00, or with a zone), or s or ns since the epoch, as --json prints them. What latched topics
    had said before stands at the beginning.
    """
    from robo.cli.views.bag_edit import cut

    cut(bag, output, start, end, compression.value, force=force)


@verb(
    verbs,
    "filter",
    "robo bag filter drive.mcap 'r1/*' -o r1.mcap",
    "robo bag filter drive.mcap -o small.mcap --exclude '**/scan' --exclude '**/image*'",
)
def bag_filter(
    bag: BagFile,
    output: NewFile,
    topics: Annotated[
        list[str] | None,
        typer.Argument(metavar="[TOPIC]...", help="Topics that stay; * and ** match.", show_default=False),
    ] = None,
    exclude: Without = None,
    compression: HowCompressed = Compressed.ZSTD,
    force: Force = False,
) -> None:
    """Make a recording of some topics of another.

    In a name * stands for one part between slashes, or some letters of it, ** for any number of parts. The namespace of
    the robot that was recorded may be left out.
    """
    from robo.cli.views.bag_edit import keep

    keep(bag, output, topics or [], exclude or [], compression.value, force=force)


@verb(verbs, "merge", "robo bag merge drive.mcap other.mcap -o both.mcap")
def bag_merge(
    bags: Annotated[
        list[str],
        typer.Argument(metavar="BAG...", help="Two files or folders, or more.", autocompletion=completion.recordings),
    ],
    output: NewFile,
    compression: HowCompressed = Compressed.ZSTD,
    force: Force = False,
) -> None:
    """Make one recording of several, in the order of arrivals."""
    from robo.cli.views.bag_edit import merge

    merge(bags, output, compression.value, force=force)


@verb(
    verbs,
    "diff",
    "robo bag diff drive.mcap again.mcap",
    "robo bag diff drive.mcap again.mcap --json | jq '.topics[] | select(.same | not)'",
)
def bag_diff(
    first: BagFile,
    second: Annotated[str, typer.Argument(metavar="BAG", help="The other one.", autocompletion=completion.recordings)],
    json: Json = False,
) -> int:
    """Print how two recordings differ.

    Messages of a topic stand beside each other by their order; the first one that differs is told with its field.
    PUBLISHED and ARRIVED are by how much the times of a message differ at most; arrivals count from the beginning.
    Ends with 1 where topics, types, counts or messages differ, whatever their times.
    """
    from robo.cli.views.bag_diff import print_diff

    return print_diff(first, second, json=json)


@verb(verbs, "recover", "robo bag recover cut.mcap -o whole.mcap")
def bag_recover(
    bag: Annotated[
        str,
        typer.Argument(
            metavar="CUT",
            help="The file, or the folder of one in parts, which stays.",
            autocompletion=completion.recordings,
        ),
    ],
    output: NewFile,
    force: Force = False,
) -> None:
    """Make a whole file of one that is cut or damaged, or a whole folder of one in parts.

    After a power cut, or where a disk has failed: what can be read is copied as it is, index and summary are made
    anew, and what is left out is told.
    """
    from robo.cli.views.bag_edit import recover

    recover(bag, output, force=force)


@verb(
    verbs,
    "convert",
    "robo bag convert run.log.gz -o run.mcap --robot-name r1",
    "robo bag convert drive.mcap r1/odom -o odom.csv",
    "robo bag convert drive.mcap -o drive_csv --to csv",
    "robo bag convert drive.mcap -o drive.jsonl",
    "robo bag convert drive.jsonl -o again.mcap --force",
    "robo bag convert drive.mcap r1/cmd_vel -o - | jq .message.linear.x",
)
def bag_convert(
    source: Annotated[
        str,
        typer.Argument(
            metavar="FROM",
            help="A recording, a log of CARMEN, JSON Lines, CSV or a folder of it; - for standard input.",
            autocompletion=completion.recordings,
        ),
    ],
    output: Annotated[
        str,
        typer.Option(
            "-o",
            "--output",
            metavar="TO",
            help="The new file or folder; - for standard output.",
            autocompletion=completion.recordings,
        ),
    ],
    topics: Annotated[
        list[str] | None,
        typer.Argument(metavar="[TOPIC]...", help="Only these; * and ** match.", show_default=False),
    ] = None,
    exclude: Without = None,
    from_: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="FORM", help="mcap, carmen, csv or jsonl; else its name says so.", show_default=False
        ),
    ] = None,
    to: Annotated[
        str | None,
        typer.Option("--to", metavar="FORM", help="mcap, csv or jsonl; else its name says so.", show_default=False),
    ] = None,
    robot_name: Annotated[
        str | None,
        typer.Option("--robot-name", metavar="NAME", help="Whose a log of CARMEN is.", show_default=False),
    ] = None,
    compression: HowCompressed = Compressed.ZSTD,
    force: Force = False,
) -> None:
    """Write a recording in another form, or make one of it.

    JSON Lines are those of `robo topic echo --json`, which `robo topic pub -` reads; with the bytes of messages whose
    types are not known, and back without a loss but for attachments and metadata. CSV is for pandas and spreadsheets:
    a file for each topic, or for the one that is named; columns time and arrived in ns, key, type, sequence_number, and
    one for each single value (pose.pose.position.x). A list is one cell, as JSON: pandas.read_csv(FILE,
    converters={"ranges": json.loads}) has numbers in it. Back from CSV each field needs its column; which topics are
    latched is lost. Of a log of CARMEN come the topics of carmen_player: odom, scan, tf, tf_static. What a form cannot
    hold is told.
    """
    from robo.cli.views.bag_convert import Conversion, convert
    from robo.wire.names import robot_name as checked

    namespace = checked(robot_name) if robot_name is not None else ""
    convert(Conversion(source, output, topics or [], exclude or [], from_, to, namespace, compression.value, force))


@verb(
    verbs,
    "plot",
    "robo bag plot drive.mcap cmd_vel --field linear.x -o speed.svg",
    "robo bag plot drive.mcap odom cmd_vel --field pose.pose.position.x --field linear.x -o both.svg",
    "robo bag plot drive.mcap odom --start 0.2 --end 0.6 -o part.svg",
    "robo bag plot drive.mcap odom -o odom.svg --json | jq '.curves[].unit'",
)
def bag_plot(
    bag: BagFile,
    topics: Annotated[
        list[str], typer.Argument(metavar="TOPIC...", help="Topics; * and ** match.", show_default=False)
    ],
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="FILE", help="The picture, .svg; - for standard output.")
    ],
    field: Annotated[
        list[str] | None,
        typer.Option(
            "--field", metavar="PATH", help="pose.pose.position.x, ranges[0]; may be repeated.", show_default=False
        ),
    ] = None,
    start: Annotated[
        str | None, typer.Option("--start", metavar="TIME", help="From then on.", show_default=False)
    ] = None,
    end: Annotated[str | None, typer.Option("--end", metavar="TIME", help="Before then.", show_default=False)] = None,
    theme: HowThemed = Theme.AUTO,
    json: Json = False,
) -> None:
    """Draw numbers of a recording over time, as a picture in SVG.

    Of each topic those fields are drawn that it has; without --field all of its numbers that change. What has one unit
    stands in one panel. Of many messages each peak is still seen. TIME is as for `robo bag cut`; it counts arrivals,
    and the picture shows when messages were published. JSON: file, curves with topic, field, unit, values (how many).
    """
    from robo.cli.views.bag_plot import Fields, plot

    plot(bag, topics, Fields(field or [], start, end), output, theme.value, json=json)
