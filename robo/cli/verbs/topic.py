"""`robo topic`: looking at topics, measuring them, publishing on them."""

import inspect
from typing import Annotated, Literal

import typer

from robo.cli import completion
from robo.cli.options import (
    HowThemed,
    Interval,
    Json,
    JsonLines,
    SvgFile,
    Theme,
    TopicName,
    TopicNames,
    TypeName,
    Watch,
    only_one,
)
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

Count = Annotated[int | None, typer.Option("--count", metavar="N", help="End after N messages.", min=1)]
Windows = Annotated[int | None, typer.Option("--count", metavar="N", help="End after N windows.", min=1)]
Duration = Annotated[float | None, typer.Option("--duration", metavar="S", help="End after S seconds.", min=0.0)]
Window = Annotated[float, typer.Option("--window", metavar="S", help="Length of a window.", min=0.05)]
Fields = Annotated[
    list[str] | None,
    typer.Option("--field", metavar="PATH", help="Only this part: pose.pose.position.x, ranges[0]. May be repeated."),
]


@verb(
    verbs,
    "list",
    "robo topic list",
    "robo topic list -v --robot-name r1",
    "robo topic list --json | jq -r 'select(.publishers == []).key'",
    "robo topic list --watch",
)
def topic_list(
    reach: Reach,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Name the nodes at both ends.")] = False,
    json: JsonLines = False,
    watch: Watch = False,
    interval: Interval = 1.0,
) -> None:
    """List topics: type, how many publish and subscribe, messages a second where supervisors know."""
    from robo.cli.views.topic import print_topics

    print_topics(reach, verbose=verbose, json=json, watch=watch, interval=interval)


@verb(verbs, "info", "robo topic info r1/odom", "robo topic info odom --robot-name r1 --json")
def topic_info(reach: Reach, key: TopicName, json: Json = False) -> None:
    """Print all about one topic: its type, who publishes and subscribes it, and how much they keep."""
    from robo.cli.views.topic import print_info

    print_info(key, reach, json=json)


@verb(verbs, "type", "robo topic type r1/odom", 'robo interface show "$(robo topic type r1/odom)"')
def topic_type(reach: Reach, key: TopicName, json: Json = False) -> None:
    """Print the type of a topic."""
    from robo.cli.views.topic import print_type

    print_type(key, reach, json=json)


@verb(verbs, "find", "robo topic find geometry/Twist", "robo topic find sensor/LaserScan --json")
def topic_find(reach: Reach, type_name: TypeName, json: JsonLines = False) -> int:
    """Print the topics of a type. Exit code 1 where there are none."""
    from robo.cli.views.topic import print_topics_of

    return print_topics_of(type_name, reach, json=json)


@verb(
    verbs,
    "echo",
    "robo topic echo r1/odom",
    "robo topic echo r1/odom --field pose.pose.position.x --field pose.pose.position.y --csv > path.csv",
    "robo topic echo r1/cmd_vel --filter 'linear.x > 0.4 or angular.z != 0'",
    "robo topic echo 'r*/odom' r1/scan --truncate",
    "robo topic echo '**' --duration 10 --json > log.jsonl",
    "robo topic echo r1/odom --json | robo topic pub r9/odom nav/Odometry -",
)
def topic_echo(
    reach: Reach,
    keys: TopicNames,
    field: Fields = None,
    filter_: Annotated[
        str | None,
        typer.Option("--filter", metavar="EXPR", help="Only messages for which this holds: 'linear.x > 0.1'."),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="End after one message.")] = False,
    count: Count = None,
    duration: Duration = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON Lines: key, type, time (ns), sequence_number, message.")
    ] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print a table, a line for each message.")] = False,
    yaml: Annotated[bool, typer.Option("--yaml", help="Print YAML documents that hold every byte.")] = False,
    truncate: Annotated[bool, typer.Option("--truncate", help="Cut long lists, texts and bytes short.")] = False,
) -> int:
    """Print messages as they come.

    In JSON and CSV, NaN and infinities are "nan", "inf" and "-inf", bytes are base64. `robo topic pub KEY TYPE -`
    publishes such lines again, byte for byte.

    Exit code: 0 fine, 1 the --duration was over before --count messages, or any, were printed, 2 words that make no
    sense.
    """
    from robo.cli.views.echo import EchoOptions, print_messages

    form = only_one(json=json, csv=csv, yaml=yaml) or "text"
    options = EchoOptions(form=form, fields=field or (), condition=filter_, truncate=truncate)
    return print_messages(keys, reach, options, count=1 if once else count, duration=duration)


@verb(
    verbs,
    "pub",
    "robo topic pub r1/cmd_vel_key geometry/Twist '{linear: {x: 0.2}}' -r 10",
    "robo topic pub r1/chatter std/String '{data: hello}' --once --wait-for-subscriber",
    "robo topic pub r1/goal geometry/PoseStamped '{header: {stamp: now, frame_id: map}, pose: {position: {x: 1}}}'",
    "robo topic pub r1/floor std/String '{data: second}' --latched",
    "robo topic pub - < log.jsonl",
    "robo topic echo r1/odom --json | robo topic pub r9/odom nav/Odometry -",
)
def topic_pub(
    reach: Reach,
    key: Annotated[
        str,
        typer.Argument(
            metavar="KEY", help="A topic's full name; - for lines that name it.", autocompletion=completion.topics
        ),
    ],
    type_name: Annotated[
        str | None, typer.Argument(metavar="TYPE", help="For example geometry/Twist.", autocompletion=completion.types)
    ] = None,
    data: Annotated[
        str | None, typer.Argument(metavar="DATA", help="YAML or JSON; - reads JSON Lines from standard input.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option("-r", "--rate", metavar="HZ", help="So many a second.", min=1e-3)
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Publish once; the default without -r.")] = False,
    times: Annotated[int | None, typer.Option("--times", metavar="N", help="Publish N times.", min=1)] = None,
    wait_for_subscriber: Annotated[
        bool, typer.Option("--wait-for-subscriber", help="Publish nothing before somebody listens.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Also where nodes know the topic as another type.")] = False,
    beside: Annotated[bool, typer.Option("--beside", help="Also where somebody publishes the topic already.")] = False,
    latched: Annotated[
        bool, typer.Option("--latched", help="Whoever comes later gets the last one, until Ctrl-C.")
    ] = False,
    priority: Annotated[
        str | None,
        typer.Option("--priority", metavar="PRIORITY", help="What goes first on a full link: data, or data_high, …"),
    ] = None,
) -> int:
    """Publish messages: one, several at a rate, or those of JSON Lines.

    A Time may be written `now`, a Header `auto`. With -r it goes on until Ctrl-C or --times. Lines are messages, or
    what `robo topic echo --json` prints. A topic that somebody publishes already is refused, unless --beside is said:
    its receivers would get both in turns.

    Exit code: 0 published, 1 the data or a line are no message of the type or the topic has a publisher, 2 words that
    make no sense.
    """
    from robo.cli.views.pub import PubOptions, publish

    options = PubOptions(rate, times, once, wait_for_subscriber, force, beside, latched, priority)
    return publish(key, type_name, data, reach, options)


_FEW = "Exit code 1 where the --duration was over before --count windows, or any, had messages."


def _measuring(measure: Literal["hz", "bw", "delay", "loss"], about: str, *examples: str) -> None:
    """Make a verb of a measure: they all take the same words."""

    def figures(
        reach: Reach,
        keys: TopicNames,
        count: Windows = None,
        duration: Duration = None,
        window: Window = 1.0,
        json: JsonLines = False,
    ) -> int:
        from robo.cli.views.measure import print_figures

        return print_figures(measure, keys, reach, count=count, duration=duration, window=window, json=json)

    figures.__doc__ = f"{inspect.cleandoc(about)}\n\n{_FEW}"
    verb(verbs, measure, *examples)(figures)


_measuring(
    "hz",
    """Measure how often messages are published, and how evenly.

    Rates come from the publishers' own times and sequence numbers, so they are exact even where messages are lost
    on the way. Times are those between two messages; jitter is their mean change. JSON: key, rate (Hz), count, min,
    max, std, jitter (s), lost.
    """,
    "robo topic hz r1/odom",
    "robo topic hz 'r1/*' --duration 5 --json",
)
_measuring(
    "bw",
    """Measure how many bytes come: payload only, without what the network adds.

    JSON: key, rate (Hz), bandwidth (B/s), count, min, max, mean, std (bytes a message).
    """,
    "robo topic bw r1/scan",
    "robo topic bw '**' --json --count 1",
)
_measuring(
    "delay",
    """Measure how long messages take from their publisher to here.

    Between machines their clocks have to agree. JSON: key, rate (Hz), count, min, max, mean, std, jitter (s).
    """,
    "robo topic delay r1/odom",
    "robo topic delay 'r1/*' --json",
)
_measuring(
    "loss",
    """Count messages that were published and did not come, by the gaps in their sequence numbers.

    JSON: key, rate (Hz), count, lost, loss (0 to 1), min, max, std (lost at a stretch), and since the beginning
    total_count, total_lost.
    """,
    "robo topic loss r1/scan",
    "robo topic loss '**' --duration 60 --json",
)


@verb(
    verbs,
    "plot",
    "robo topic plot r1/odom --field twist.twist.linear.x",
    "robo topic plot r1/cmd_vel --field linear.x --field angular.z --window 30",
    "robo topic plot r1/odom --field twist.twist.linear.x --duration 3 --svg speed.svg",
)
def topic_plot(
    reach: Reach,
    key: TopicName,
    field: Fields = None,
    window: Annotated[float, typer.Option("--window", metavar="S", help="How far back it shows.", min=0.5)] = 10.0,
    duration: Duration = None,
    svg: SvgFile = None,
    theme: HowThemed = Theme.AUTO,
) -> int:
    """Plot numbers of a topic over time in the terminal.

    Without --field, all of its numbers that are not in lists. Where the output is no terminal, one picture of what
    came within the window, or within --duration. With --svg all that came is drawn at the end, however that is told:
    by --duration, Ctrl-C, or a terminal that goes. Exit code 1 where nothing came.
    """
    from robo.cli.views.plot import Asked, plot

    return plot(key, field or [], reach, Asked(window, duration, svg, theme.value))
