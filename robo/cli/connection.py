"""What the tools share: reaching a running robot, and printing."""

import sys
from collections.abc import Sequence

import msgspec

from robo.codec import jsonable
from robo.session import Network, open_session

import zenoh  # isort: skip  (after robo.session, which sets how Zenoh starts its threads)

TIMEOUT = 0.8
"""How long to look for a running robot, s."""


def connect_to_robot(connect: Sequence[str]) -> zenoh.Session:
    """A session as a client of the robot's router.

    Raises:
        NetworkError: no robot runs there.
    """
    network = Network.from_environment("client", connect)
    return open_session(msgspec.structs.replace(network, timeout=TIMEOUT))


def print_line(text: str) -> None:
    """A line of data, at once."""
    print(text, flush=True)


def print_json(value: object) -> None:
    """An object as a line of JSON."""
    print_line(msgspec.json.encode(jsonable(msgspec.to_builtins(value))).decode())


def print_table(rows: Sequence[Sequence[str]]) -> None:
    """A table whose first row is its head."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)]
    for number, row in enumerate(rows):
        line = "  ".join(cell.ljust(width) for cell, width in zip(row, [*widths, 0], strict=True)).rstrip()
        print(f"\x1b[1m{line}\x1b[0m" if number == 0 and sys.stdout.isatty() else line)


def hint(text: str) -> None:
    """Talk for people, beside the data."""
    if sys.stderr.isatty():
        print(text, file=sys.stderr)
