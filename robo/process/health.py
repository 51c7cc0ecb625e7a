"""`robo health`: whether a router, or a node, is well; small and quick, because it runs every few seconds."""

import argparse
import sys
from collections.abc import Sequence

from robo.errors import RoboError
from robo.wire import names
from robo.wire.keys import PREFIX, status_key
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

EXAMPLES = """examples:
  robo health
  robo health /r1/position_tracker --timeout 1
"""


def command_line() -> argparse.ArgumentParser:
    """What `robo health` takes."""
    parser = argparse.ArgumentParser(
        prog="robo health",
        description="Exit code 0 if the router answers or, with NODE, if that node is ready and answers; 1 if not.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("node", metavar="NODE", nargs="?", help="a node's full name")
    parser.add_argument("--connect", metavar="ENDPOINT", action="append", default=[], help="or ROBO_CONNECT")
    parser.add_argument("--timeout", metavar="S", type=float, default=2.0, help="how long to wait (default 2)")
    return parser


def main(arguments: Sequence[str]) -> int:
    """Check, print what is wrong, and return the exit code."""
    options = command_line().parse_args(arguments)
    try:
        problem = check(options.node, options.connect, options.timeout)
    except RoboError as error:
        problem = str(error)
    if problem is not None:
        print(problem, file=sys.stderr)
    return 0 if problem is None else 1


def check(node: str | None, connect: Sequence[str], timeout: float) -> str | None:
    """What is wrong with the network, or with a node; None if nothing is.

    Raises:
        NetworkError: nobody answers.
    """
    network = Network.from_environment("client", connect)
    session = open_session(Network(mode="client", connect=network.connect, timeout=timeout))
    try:
        if node is None:
            return None
        namespace, _, name = node.strip("/").rpartition("/")
        token = names.join(PREFIX, namespace, "node", name, "*", "*", "*")
        if not any(reply.ok is not None for reply in session.liveliness().get(token, timeout=timeout)):
            return f"{node} is not ready"
        answers = session.get(status_key(namespace, name), timeout=timeout)
        if not any(reply.ok is not None for reply in answers):
            return f"{node} does not answer within {timeout:g} s"
        return None
    finally:
        close_session(session)
