"""`robo bag`: recordings."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json, JsonLines
from robo.cli.play_words import PlayWords
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
    short_help="Record topics into a file that ROS 2's tools open.",
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


@verb(
    verbs,
    "play",
    "robo bag play drive.mcap --robot-name r2",
    "robo bag play drive.mcap --topics scan --remap scan:=scan_before --rate 0",
    "robo bag play drive.mcap --robot-name r2 --start 0.2 --duration 0.5 --clock",
    "robo bag play drive.mcap --robot-name r2 --loop --rate 2 --exclude 'cmd_*'",
)
def bag_play(
    reach: Reach,
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="A recording in MCAP, or a folder of its files.",
            autocompletion=completion.recordings,
        ),
    ],
    words: PlayWords,
    json: JsonLines = False,
) -> int:
    """Publish what a recording holds, as it came: as robo's messages where their types are known, else as bytes.

    Messages have the time of now beside them and the stamps of then within. What was latched is latched again, and said
    first, after each jump too. With --robot-name the recorded robot's topics become those of that robot; topics may
    be named without it. A topic that somebody publishes already is refused, unless --beside is said. What nodes say of
    themselves, such as log, is played where --topics names it.

    TIME counts as --order says: seconds from the beginning (12.5) or from the end (-5), a time of the clock here
    (18:30:00), a date (2026-11-23T18:30:00, or with a zone), or s or ns since the epoch, as --json prints them.

    On a terminal: space pauses, . steps, n goes to the next message, arrows and pages jump, + and - change the rate, q
    ends. Much the same as services: bag_player/pause, resume, toggle_paused, step, seek, set_rate, get_rate, is_paused,
    stop.

    Exit code: 0 played, 1 something could not be read or a topic has a publisher, 2 words that make no sense.
    """
    from robo.cli.views.bag_play import play

    return play(file, reach, words, json=json)


# -- snapshot ----------------------------------------------------------------------------------------------------------


@verb(
    verbs,
    "snapshot",
    "robo bag snapshot",
    "robo bag snapshot --robot-name r1 --reason 'it turned left'",
    "robo bag snapshot --json | jq -r .file",
)
def bag_snapshot(
    reach: Reach,
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="Why, for the file and its name.", show_default=False)
    ] = "",
    json: Json = False,
) -> None:
    """Have a robot's flight recorder write the last seconds, and the next ones, and print the file.

    It is written on the robot's machine, once the time after has passed as well. A robot has a flight recorder where
    its manifest has the node robo_services.flight_recorder; the ones that ship take flight_recorder:=true.
    """
    from robo.cli.views.bag_snapshot import take_snapshot

    take_snapshot(reach, reason, json=json)


verbs.registered_commands += bag_files.verbs.registered_commands
