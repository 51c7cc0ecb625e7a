"""`robo tf`: the coordinate frames of a running robot."""

from typing import Annotated

import typer

from robo.cli.options import Interval, Json, JsonLines
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

Listen = Annotated[float, typer.Option("--duration", metavar="S", help="How long to listen.", min=0.1)]


@verb(verbs, "tree", "robo tf tree", "robo tf tree --robot-name r1", "robo tf tree --json | jq '.[].child'")
def tf_tree(reach: Reach, duration: Listen = 1.0, json: Json = False) -> None:
    """Print which frame stands in which, how often that is said, how old it is, and by whom.

    What is not right with them is told below: a frame that two nodes tell of, or that has two parents.
    """
    from robo.cli.views.tf import print_tree

    print_tree(reach, duration, json=json)


@verb(
    verbs,
    "echo",
    "robo tf echo odom base_link",
    "robo tf echo odom base_laser --robot-name r1 --once",
    "robo tf echo odom base_link --once --json",
)
def tf_echo(
    reach: Reach,
    target: Annotated[str, typer.Argument(metavar="TARGET", help="In which frame.")],
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="Which frame stands there.")],
    interval: Annotated[float, typer.Option("--interval", metavar="S", help="How often.", min=0.01)] = 1.0,
    once: Annotated[bool, typer.Option("--once", help="Print it once, and end.")] = False,
    duration: Annotated[float | None, typer.Option("--duration", metavar="S", help="End after S seconds.")] = None,
    json: JsonLines = False,
) -> int:
    """Print where a frame stands in another one, again and again, until Ctrl-C.

    TARGET and SOURCE are as in ROS: what has coordinates in SOURCE is taken to those in TARGET. Where it is not known,
    it is said once why not. Ends with 1 where the time was over before it was ever known.
    """
    from robo.cli.views.tf import echo

    return echo(target, source, reach, interval=interval, once=once, duration=duration, json=json)


@verb(verbs, "monitor", "robo tf monitor", "robo tf monitor --robot-name r1 --interval 0.5")
def tf_monitor(reach: Reach, interval: Interval = 1.0, json: JsonLines = False) -> None:
    """Watch the frames of a robot live, as `robo tf tree` shows them, until Ctrl-C."""
    from robo.cli.views.tf import monitor

    monitor(reach, interval=interval, json=json)
