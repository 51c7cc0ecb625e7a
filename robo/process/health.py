"""`robo health`: whether a router, nodes or a whole robot are well; small and quick: it runs every few seconds."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress

import msgspec
import zenoh

from robo.errors import RoboError
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire import liveliness, names, whereabouts
from robo.wire.keys import PREFIX, control_key, status_key
from robo.wire.reports import ProcessStatus, Request
from robo.wire.session import close_session, open_session
from robo.wire.targets import OF_ALL

EXAMPLES = """examples:
  robo health
  robo health --robot-name r1
  robo health /r1/position_tracker /r1/safety_monitor --timeout 1
"""

_WELL = ("ready", "standby", "completed", "stopped")
"""States of a process that are as somebody wants them: one that is stopped, or stands by, was told to."""


def command_line() -> argparse.ArgumentParser:
    """What `robo health` takes."""
    parser = argparse.ArgumentParser(
        prog="robo health",
        description="Exit code 0 if the router answers or, with NODE, if those nodes are ready and answer or, with "
        "--robot-name, if every process of that robot is ready, stands by, has completed or was told to stop; 1 if "
        "not.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("nodes", metavar="NODE", nargs="*", default=[], help="a node's full name")
    what.add_argument("--robot-name", metavar="NAME", help="all processes that `robo up` runs of this robot")
    parser.add_argument("--connect", metavar="ENDPOINT", action="append", default=[], help="or ROBO_CONNECT")
    parser.add_argument("--timeout", metavar="S", type=float, default=2.0, help="how long to wait (default 2)")
    return parser


def main(arguments: Sequence[str]) -> int:
    """Check, print what is wrong, and return the exit code."""
    options = command_line().parse_args(arguments)
    try:
        problems = check(options.nodes, options.robot_name, options.connect, options.timeout)
    except RoboError as error:
        problems = [str(error)]
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


def check(nodes: Sequence[str], robot: str | None, connect: Sequence[str], timeout: float) -> list[str]:
    """What is wrong with the network, with nodes and with a robot; nothing if all is well.

    Raises:
        InvalidName: the robot's name is none.
        NetworkError: nobody answers.
    """
    namespace = names.robot_name(robot) if robot is not None else None
    network = whereabouts.of_tool(connect, handing_over=0.0)
    session = open_session(msgspec.structs.replace(network, timeout=timeout))
    try:
        found = [problem for node in nodes for problem in _of_node(session, node, timeout)]
        return found if namespace is None else [*found, *_of_robot(session, namespace, timeout)]
    finally:
        close_session(session)


def _of_node(session: zenoh.Session, node: str, timeout: float) -> Iterator[str]:
    namespace, _, name = node.strip("/").rpartition("/")
    token = names.join(PREFIX, namespace, "node", name, "*", "*", "*")
    if next(liveliness.ask(session, token, timeout), None) is None:
        yield f"{node} is not ready"
        return
    answers = session.get(status_key(namespace, name), timeout=timeout)
    if not any(reply.ok is not None for reply in answers):
        yield f"{node} does not answer within {timeout:g} s"


def _of_robot(session: zenoh.Session, robot: str, timeout: float) -> Iterator[str]:
    """What supervisors, one on each host, say of the robot's processes: of its own run, or of its part of one."""
    told = _told(session, robot, timeout)
    if not told:
        told = [one for one in _told(session, "**", timeout) if one.name.is_within(robot)]
    if not told:
        yield f"no supervisor tells of a robot {robot} within {timeout:g} s"
    for process in told:
        if process.state not in _WELL:
            yield f"{process.node} is {process.state}{f': {process.reason}' if process.reason else ''}"


def _told(session: zenoh.Session, robot: str, timeout: float) -> list[ProcessStatus]:
    """The processes of a run. Anybody may answer: what is no list of them is left out."""
    found: list[ProcessStatus] = []
    for reply in session.get(
        control_key(robot, "ps"),
        payload=msgspec.msgpack.encode(Request()),
        timeout=timeout,
        **OF_ALL,
    ):
        if reply.ok is not None:
            with suppress(*UNREADABLE):
                found += msgspec.msgpack.decode(reply.ok.payload.to_bytes(), type=readable(list[ProcessStatus]))
    return found
