"""What the tools share: reaching a running robot, and printing."""

import os
import shutil
import sys
import time
from collections.abc import Iterable, Mapping, Sequence

import msgspec
import zenoh

from robo.cli.json_text import to_json
from robo.cli.reach import Reach
from robo.errors import NetworkError, NodeNotFound
from robo.text.columns import aligned, fitted
from robo.text.suggestions import suggest
from robo.text.terminal import own, visible
from robo.tools import nodes
from robo.wire import tcp
from robo.wire.keys import NodeToken
from robo.wire.network import Network, zenoh_config
from robo.wire.session import open_session


def connect_to_robot(reach: Reach) -> zenoh.Session:
    """A session as a client of the robot's router.

    Raises:
        NetworkError: no robot runs there; tells what was tried and what would start one.
    """
    network = Network.from_environment("client", reach.connect)
    zenoh_config(network)  # an endpoint that is none is told first
    begin = time.monotonic()
    wrong = unreached(network.connect, reach)
    if wrong is None:
        try:
            return open_session(msgspec.structs.replace(network, timeout=reach.open_timeout))
        except NetworkError:
            wrong = dict(tcp.tried(network.connect, 0.1))
    raise NetworkError(_nothing_there(network.connect, wrong, reach, time.monotonic() - begin))


def unreached(endpoints: Sequence[str], reach: Reach) -> dict[str, OSError | None] | None:
    """What is wrong with endpoints of which none answers; None where one may.

    An address that refuses is tried again, and not for long. One that says nothing gets longer: where packets
    are lost, the system tries again after one second and after three.
    """
    if any(tcp.address_of(endpoint) is None for endpoint in endpoints):
        return None  # not to be tried without Zenoh
    begin = time.monotonic()
    while True:
        wrong: dict[str, OSError | None] = {}
        for endpoint, error in tcp.tried(endpoints, max(begin + reach.silent_timeout - time.monotonic(), 0.05)):
            if error is None:
                return None
            wrong[endpoint] = error
        silent = len(wrong) < len(endpoints) or any(isinstance(error, TimeoutError) for error in wrong.values())
        if time.monotonic() - begin >= (reach.silent_timeout if silent else reach.refused_timeout):
            return wrong
        time.sleep(0.02)


def _nothing_there(endpoints: Sequence[str], wrong: Mapping[str, OSError | None], reach: Reach, waited: float) -> str:
    from robo.tools import logs  # what runs on this machine says where it is

    refused = all(isinstance(error, ConnectionRefusedError) for error in wrong.values()) and len(wrong) == len(
        endpoints
    )
    what = "nothing is running" if refused else "no robot can be reached"
    lines = [f"{what} at {', '.join(endpoints)} (waited {waited:.1f} s)"]
    lines += [
        f"  {endpoint}: {_what_is_wrong(endpoint, wrong.get(endpoint, TimeoutError()))}" for endpoint in endpoints
    ]
    for run in logs.live_runs():
        elsewhere = [place for place in run.info.endpoints if place not in endpoints]
        if elsewhere:
            lines.append(f"  {run.info.robot} runs on this machine at {elsewhere[0]}: --connect {elsewhere[0]}")
    robot = f" --robot-name {reach.robot}" if reach.robot is not None else ""
    lines.append(f"  `robo up{robot}` starts a robot; --connect tcp/HOST:7447 or ROBO_CONNECT names another place")
    return "\n".join(lines)


def _what_is_wrong(endpoint: str, error: OSError | None) -> str:
    if error is not None:
        return tcp.reason(error)
    match tcp.speaks_zenoh(endpoint, 0.5):
        case True:
            return "Zenoh listens there, and has not answered in time: --timeout S waits longer"
        case False:
            return "what listens there does not speak Zenoh"
        case None:
            return "what listens there does not speak Zenoh, or packets are lost"


def nodes_of(session: zenoh.Session, reach: Reach) -> list[NodeToken]:
    """The nodes of the robot that is named, or of all.

    Raises:
        NodeNotFound: the robot that is named has none; says which robots there are.
    """
    every = nodes.list_nodes(session, reach.timeout)
    found = [token for token in every if reach.covers(token.full_name)]
    if reach.robot is not None and not found:
        robots = sorted({token.namespace for token in every})
        raise NodeNotFound(f"no node of a robot {reach.robot} is on this network; {suggest(reach.robot, robots)}")
    return found


def print_line(text: str) -> None:
    """A line of data, at once; a newline in it is no way to begin another."""
    print(visible(text, keep="\t"), flush=True)


def print_lines(lines: Iterable[str]) -> None:
    """Lines of data, each as `print_line` has it."""
    for line in lines:
        print_line(line)


def print_text(text: str) -> None:
    """Data of several lines, at once."""
    print(text, flush=True)


def print_json(value: object) -> None:
    """An object as a line of JSON, at once."""
    print_text(to_json(value))


def print_table(rows: Sequence[Sequence[str]], spared: Sequence[str] = ()) -> None:
    """A table whose first row is its head; on a narrow terminal without some of the columns that are `spared`."""
    if spared and sys.stdout.isatty():
        rows = fitted(rows, shutil.get_terminal_size().columns, spared)
    for number, line in enumerate(aligned(rows)):
        print(paint(line, "1") if number == 0 else line)


def paint(text: str, code: str) -> str:
    """Text in a colour, where a terminal shows it and nobody has said NO_COLOR."""
    shows = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    return own(f"\x1b[{code}m") + text + own("\x1b[0m") if shows else text


def clear_screen() -> None:
    """Begin again at the top, on a terminal."""
    if sys.stdout.isatty():
        print(own("\x1b[H\x1b[J"), end="")


def hint(text: str) -> None:
    """Talk for people who wait, beside the data."""
    if sys.stderr.isatty():
        note(text)


def note(text: str) -> None:
    """Something to know about the data, beside them."""
    print(text, file=sys.stderr, flush=True)


def clock_time(nanoseconds: int) -> str:
    """A time of today: `18:30:00.123`."""
    stamp = time.strftime("%H:%M:%S", time.localtime(nanoseconds / 1e9))
    return f"{stamp}.{nanoseconds // 10**6 % 1000:03d}"


def amount(count: int, what: str) -> str:
    """How many of something: `1 node`, `2 nodes`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def depth_text(depth: int) -> str:
    """How much an end of a topic keeps."""
    return "keeps all" if depth == 0 else f"depth {depth}"


def data_size(size: float, unit: str = "B") -> str:
    """A number of bytes for people: `1.2 MB`, or `1.2 MB/s`."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(size) >= factor:
            return f"{size / factor:.3g} {prefix}{unit}"
    return f"{size:.3g} {unit}"
