"""What the tools share: reaching a running robot, and printing."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress

import msgspec
import zenoh

from robo.cli.endpoints import check_endpoints
from robo.cli.printing import note
from robo.cli.reach import Reach
from robo.cli.secured import name_in_force
from robo.errors import NetworkError, NodeNotFound, NotLetIn, ReadOnly, RoboError, SecurityError, UsageError
from robo.text.suggestions import suggest
from robo.tools import gathering, nodes
from robo.wire import doors, knocking, meeting, tcp, whereabouts
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
    before = _refused(session)
    try:
        yield session
    except BaseException as error:
        if _may_be_of_a_refusal(error) and (refused := _since(before, session)):
            error.args = (f"refused: {'; '.join(refused)}", *error.args[1:])
        with suppress(zenoh.ZError):  # what went wrong before is to be told
            session.close()
        raise
    for sentence in _since(before, session):
        note(f"refused: {sentence}")
    try:
        session.close()
    except zenoh.ZError as error:
        raise NetworkError(f"the robot's router has not taken what was said last: {error}") from None


@contextmanager
def connect_to_supervisors(reach: Reach) -> Iterator[zenoh.Session]:
    """As `connect_to_robot`, for what asks supervisors: one that is just linking to the router is waited for."""
    with connect_to_robot(reach) as session:
        gathering.wait_for_supervisors(session, reach.timeout)
        yield session


def _may_be_of_a_refusal(error: BaseException) -> bool:
    """Whether an error can be that nobody has answered what a router has refused: then the refusal is told instead."""
    return isinstance(error, RoboError) and not isinstance(error, (ReadOnly, SecurityError, UsageError))


def _since(before: Mapping[str, int], session: zenoh.Session) -> list[str]:
    """What routers have refused to this command, with security on: to who has sent it, Zenoh does not say so."""
    return [sentence for sentence, count in _refused(session).items() if count > before.get(sentence, 0)]


def _refused(session: zenoh.Session) -> dict[str, int]:
    name = name_in_force()
    if not name or not any(str(link.dst).startswith("tls/") for link in session.info.links()):
        return {}  # who comes by his own socket is refused nothing
    from robo.tools import refusals

    try:
        return refusals.of_name(session, name, _TELLS_WITHIN)
    except zenoh.ZError:  # it is closed already
        return {}


_MOST_TOLD = 8
"""Runs of this machine that are named where nothing is found."""
_TELLS_WITHIN = 1.0
"""How long routers may take to tell what they have refused, s."""


def see_that_it_obeys(session: zenoh.Session, reach: Reach, name: str = "", *, robot: str = "") -> None:
    """Before something is done with a robot: see that it is not one of another user's, who lets others look.

    Nothing tells a publisher that what it says is passed on to nobody, and who asks a question gets no answer.

    Args:
        session: the network.
        reach: says which robot is meant, if it says one.
        name: the full name or key of what is meant there, if that is known.
        robot: what the run is called, if it is a run that is meant.

    Raises:
        ReadOnly: it is; says whose.
    """
    of_name = name.strip("/").rpartition("/")[0].partition("/")[0]
    doors.check(session, reach.robot or robot or (of_name if "*" not in of_name else ""), reach.timeout)


def tell_where_it_is_read_only(session: zenoh.Session, reach: Reach) -> None:
    """Say on stderr that what can be looked at can not be driven, for what does both."""
    try:
        see_that_it_obeys(session, reach)
    except ReadOnly as error:
        note(f"{error}; all that is not looking comes to nothing")


def join_robot(reach: Reach) -> zenoh.Session:
    """A session as a client of the robot's router.

    Raises:
        UsageError: a word is not a valid endpoint.
        NetworkError: no robot runs there; tells what was tried and what would start one.
    """
    check_endpoints(reach.connect)
    network = whereabouts.of_tool(reach.connect, reach.refused_timeout)
    zenoh_config(network)  # what the environment says is told as soon
    if (owner := whereabouts.whose(network, reach.connect)) is not None:
        note(f"no robot of yours runs here; looking at what user {owner} runs at {', '.join(network.connect)}")
    begin = time.monotonic()
    wrong = unreached(network.connect, reach)
    if wrong is None:
        try:
            session = _open(network, reach.open_timeout)
        except NetworkError:
            wrong = dict(knocking.tried(network.connect, 0.1))
        else:
            if network.connect == (meeting.endpoint(),):
                gathering.wait_for_others(session, reach.timeout)
            return session
    raise NetworkError(_nothing_there(network.connect, wrong, reach, time.monotonic() - begin))


def _open(network: Network, timeout: float) -> zenoh.Session:
    """A session; where a router refuses this name, its reason, and no further tries.

    Raises:
        NetworkError: nobody answers.
        NotLetIn: a router answers and refuses this name.
    """
    if network.security:
        try:
            return open_session(msgspec.structs.replace(network, timeout=min(_LETS_IN_WITHIN, timeout)))
        except NetworkError:
            from robo.wire import tls

            said = {one: tls.refused(one, network.security, 1.0) for one in network.connect}
            if all(said.values()):
                lines = [f"{one}: {reason}" for one, reason in said.items()]
                raise NotLetIn("\n  ".join([f"{name_in_force()} is not let in", *lines])) from None
    return open_session(msgspec.structs.replace(network, timeout=timeout))


_LETS_IN_WITHIN = 0.7
"""How long a router takes to let somebody in, on a machine that is busy, s; after that it is asked why not."""


def unreached(endpoints: Sequence[str], reach: Reach) -> dict[str, OSError | None] | None:
    """What is wrong with endpoints of which none answers; None where one may.

    An address that refuses is tried again, and not for long. One that says nothing gets longer: where packets
    are lost, the system tries again after one second and after three.
    """
    if not all(map(knocking.can_be_tried, endpoints)):
        return None  # not to be tried without Zenoh
    begin = time.monotonic()
    while True:
        wrong: dict[str, OSError | None] = {}
        for endpoint, error in knocking.tried(endpoints, max(begin + reach.silent_timeout - time.monotonic(), 0.05)):
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
    if not whereabouts.is_told(reach.connect) and refused:
        door = whereabouts.door_of(Network.from_environment("client"))
        lines = [f"no robot of yours is running here, and nobody listens at {door} (waited {waited:.1f} s)"]
    else:
        lines = [f"{what} at {', '.join(endpoints)} (waited {waited:.1f} s)"]
        lines += [
            f"  {endpoint}: {_what_is_wrong(endpoint, wrong.get(endpoint, TimeoutError()))}" for endpoint in endpoints
        ]
    elsewhere = {
        run.info.robot: places[0]
        for run in logs.live_runs()
        if (places := [place for place in run.info.endpoints if place not in endpoints])
    }
    for name, place in [*elsewhere.items()][:_MOST_TOLD]:
        lines.append(f"  {name} runs on this machine at {place}: --connect {place}")
    if len(elsewhere) > _MOST_TOLD:
        lines.append(f"  and {len(elsewhere) - _MOST_TOLD} more run on this machine: `robo logs --list` names them")
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
            return "what listens there does not speak Zenoh; where security is on, say --security DIR"
        case None:
            return "what listens there does not speak Zenoh, or packets are lost"


def nodes_of(session: zenoh.Session, reach: Reach, *, inactive: bool = False, of_ros: bool = False) -> list[NodeToken]:
    """The nodes of the robot that is named, or of all.

    Args:
        session: the network.
        reach: says which robot.
        inactive, of_ros: as for `list_nodes`.

    Raises:
        NodeNotFound: the robot that is named has none; says which robots there are.
    """
    every = nodes.list_nodes(session, reach.timeout, inactive=inactive, of_ros=of_ros)
    found = [token for token in every if reach.covers(token.full_name)]
    if reach.robot is not None and not found:
        robots = sorted({token.namespace for token in every})
        raise NodeNotFound(f"no node of a robot {reach.robot} is on this network; {suggest(reach.robot, robots)}")
    return found
