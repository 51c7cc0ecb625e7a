"""What the tools share: reaching a running robot, and printing."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress

import msgspec
import zenoh

from robo.cli.endpoints import check_endpoints
from robo.cli.reach import Reach
from robo.errors import NetworkError, NodeNotFound
from robo.text.suggestions import suggest
from robo.tools import nodes
from robo.wire import tcp
from robo.wire.keys import NodeToken
from robo.wire.network import Network, zenoh_config
from robo.wire.session import open_session


@contextmanager
def connect_to_robot(reach: Reach) -> Iterator[zenoh.Session]:
    """While this goes on, a session as a client of the robot's router.

    Raises:
        UsageError: a word is not a valid endpoint.
        NetworkError: no robot runs there; tells what was tried and what would start one. Or the router, in the end,
            has not taken what was said last.
    """
    session = join_robot(reach)
    try:
        yield session
    except BaseException:
        with suppress(zenoh.ZError):  # what went wrong before is to be told
            session.close()
        raise
    try:
        session.close()
    except zenoh.ZError as error:
        raise NetworkError(f"the robot's router has not taken what was said last: {error}") from None


def join_robot(reach: Reach) -> zenoh.Session:
    """A session as a client of the robot's router.

    Raises:
        UsageError: a word is not a valid endpoint.
        NetworkError: no robot runs there; tells what was tried and what would start one.
    """
    check_endpoints(reach.connect)
    network = Network.from_environment("client", reach.connect)
    zenoh_config(network)  # what the environment says is told as soon
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


def nodes_of(session: zenoh.Session, reach: Reach, *, inactive: bool = False) -> list[NodeToken]:
    """The nodes of the robot that is named, or of all; with managed ones that are not active, where these count too.

    Raises:
        NodeNotFound: the robot that is named has none; says which robots there are.
    """
    every = nodes.list_nodes(session, reach.timeout, inactive=inactive)
    found = [token for token in every if reach.covers(token.full_name)]
    if reach.robot is not None and not found:
        robots = sorted({token.namespace for token in every})
        raise NodeNotFound(f"no node of a robot {reach.robot} is on this network; {suggest(reach.robot, robots)}")
    return found
