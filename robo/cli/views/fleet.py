"""`robo ps --fleet`: a line a robot."""

import time
from collections.abc import Iterator, Sequence

from robo.cli.connection import connect_to_robot
from robo.cli.link import watched
from robo.cli.printing import clear_screen, note, paint, print_json, print_line, print_table
from robo.cli.reach import Reach
from robo.errors import RunError
from robo.text import colours
from robo.text.durations import duration
from robo.text.suggestions import suggest
from robo.tools import fleet
from robo.tools.fleet import Robot

_HEAD = (
    "ROBOT", "STATE", "NODES", "HEALTH", "HOST", "ROBO", "MANIFEST", "UPTIME", "SEEN", "TROUBLE",
)  # fmt: skip
_SPARED = ("MANIFEST", "ROBO", "HOST", "UPTIME", "HEALTH", "SEEN")
"""What a narrow terminal does without, from the first on."""
_COLOURS = {"ready": colours.GREEN, "not ready": colours.YELLOW, "silent": colours.RED, "offline": colours.RED}


def print_fleet(reach: Reach, *, json: bool, watch: bool, interval: float) -> None:
    """Print a line for each robot, once or again and again.

    Raises:
        RunError: there is no robot, or none of the name.
    """
    with connect_to_robot(reach) as session, watched(session, reach) as link:
        network, seen = fleet.Watch(session, reach.timeout), fleet.Fleet()
        while True:
            robots = seen.look(network.look())
            found = [robot for robot in robots if reach.robot in (None, robot.robot)]
            if not found and not watch:
                raise RunError(_nobody(reach, robots))
            if watch and not json:
                clear_screen()
            if json:
                for robot in found:
                    print_json(robot)
            elif not found:
                note(link.lost or _nobody(reach, robots))
            else:
                print_table([_HEAD, *_rows(found, time.time_ns())], _SPARED)
                _print_sum(found)
            if not watch:
                return
            time.sleep(interval)


def _nobody(reach: Reach, robots: Sequence[Robot]) -> str:
    if reach.robot is None:
        return "no robot is on this network: none was started here with `robo up`"
    return f"there is no robot {reach.robot}; {suggest(reach.robot, [robot.robot for robot in robots])}"


def _rows(found: Sequence[Robot], now: int) -> Iterator[tuple[str, ...]]:
    for robot in found:
        health = (robot.health or "-") if robot.state != "offline" else "-"
        yield (
            robot.robot,
            paint(robot.state, _COLOURS[robot.state]),
            f"{robot.ready}/{robot.nodes}" if robot.state != "offline" else "-",
            paint(health, colours.YELLOW) if health in ("warn", "error", "stale") else health,
            ",".join(robot.hosts) or "-",
            robot.version or "-",
            f"{robot.manifest} {robot.digest}".strip() or "-",
            "-" if robot.uptime is None else duration(robot.uptime),
            "now" if robot.state in ("ready", "not ready") else _ago(robot, now),
            robot.trouble if robot.state != "offline" else "",
        )


def _ago(robot: Robot, now: int) -> str:
    since = time.strftime("%H:%M:%S", time.localtime(robot.last_seen / 1e9))
    return f"{since}, {duration(max(0.0, (now - robot.last_seen) / 1e9))} ago"


def _print_sum(found: Sequence[Robot]) -> None:
    """How many there are of each state, and what is not the same everywhere."""
    states = [robot.state for robot in found]
    counted = ", ".join(f"{states.count(state)} {state}" for state in _COLOURS if state in states)
    note(f"{len(found)} robots: {counted}" if len(found) > 1 else f"1 robot: {counted}")
    for difference in fleet.differences(found):
        print_line(f"{paint('!!', colours.YELLOW)}  {difference}")
