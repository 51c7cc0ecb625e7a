"""`robo bag`: recordings."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json
from robo.cli.reach import Reach
from robo.cli.record_words import RecordWords
from robo.cli.tree import group
from robo.cli.verb import verb
from robo.cli.verbs import bag_files

verbs = group()


@verb(
    verbs,
    "record",
    "robo bag record --all --duration 5",
    "robo bag record odom scan --robot-name r1 --duration 3 -o drive.mcap",
    "robo bag record 'r*/odom' r1/scan --duration 3 --json | jq '.topics[] | {topic, received, lost}'",
    "robo bag record --all --exclude '**/image' --split-size 500MB --keep 10 --duration 3 -o patrol",
    "robo bag record --all --split-duration 1 --when-full drop_oldest --least-free 1GB --duration 3 -o night",
)
def bag_record(
    reach: Reach,
    words: RecordWords,
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY...]", help="Topics: r1/odom; * and ** match.", autocompletion=completion.topics),
    ] = None,
    json: Json = False,
) -> int:
    """Record topics into a file that ROS 2, Foxglove, Rerun and PlotJuggler open, until Ctrl-C or SIGTERM.

    On a terminal each topic is shown with what came, what was lost and what could not be read. What came stands in
    the file a second later at most, whatever happens then. Beside messages it holds parameters, the graph, manifests,
    and a tf made of odometry where nobody publishes it. With --robot-name, topics may be named without it.

    Exit code: 0 recorded, 1 nothing came, or nothing on a topic that was named, or the disk is full, 2 words that make
    no sense.
    """
    from robo.cli.views.bag_record import record

    return record(names, reach, words, json=json)


verbs.registered_commands += bag_files.verbs.registered_commands
