"""How the bridge joins ROS's network: as a node of ROS's does where its router is on this machine, else as a client."""

import zenoh

from robo.errors import NetworkError, ReadOnly
from robo.wire import doors, tcp
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

_LOCAL = ("127.0.0.1", "localhost", "::1")


def network_of(endpoint: str, *, patient: bool = False, timeout: float = 5.0) -> Network:
    """How ROS's network is joined.

    ROS's router passes nothing on between peers, so those of one machine link directly; from another machine only
    clients are heard.

    Args:
        endpoint: of its router.
        patient: whether the router may come at any time: a session is there without it.
        timeout: how long to wait for it else, s.
    """
    address = tcp.address_of(endpoint)
    is_local = address is not None and address[0].strip("[]") in _LOCAL
    more: dict[str, object] = {
        "timestamping": {"enabled": True},
        # As ROS's nodes do: of two that learn of each other one dials.
        "scouting": {"gossip": {"autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}}}},
    }
    if patient:
        more["connect"] = {"exit_on_failure": False, "timeout_ms": -1 if is_local else 0}
    if not is_local:
        return Network(mode="client", connect=(endpoint,), timeout=timeout, more=more)
    return Network(mode="peer", connect=(endpoint,), listen=("tcp/127.0.0.1:0",), timeout=timeout, more=more)


def join_ros(endpoint: str, *, patient: bool = False, timeout: float = 5.0) -> zenoh.Session:
    """A session in ROS's network.

    Args:
        endpoint, patient, timeout: as for `network_of`.

    Raises:
        NetworkError: its router does not answer, or there is one at which others only look; says what starts ROS's.
    """
    try:
        session = open_session(network_of(endpoint, patient=patient, timeout=timeout))
    except NetworkError as error:
        raise NetworkError(
            f"ROS 2 is not reached: {error}\n  `ros2 run rmw_zenoh_cpp rmw_zenohd` starts its router; that of a robot "
            f"that was started with --listen {endpoint} does as well"
        ) from None
    closed = None if patient else closed_to_ros(session, endpoint, timeout)
    if closed is not None:
        close_session(session)
        raise NetworkError(closed)
    return session


def closed_to_ros(session: zenoh.Session, endpoint: str, timeout: float) -> str | None:
    """Why nothing can cross where the session has come to; None where it can, as far as routers tell.

    Args:
        session: in what is taken for ROS's network.
        endpoint: that was dialled.
        timeout: how long a router may take to answer, s.
    """
    try:
        doors.check(session, "", timeout)
    except ReadOnly:
        return (
            f"at {endpoint} is no router of ROS 2 but a robot's door for others, who only look\n"
            "  start ROS's router first (`ros2 run rmw_zenoh_cpp rmw_zenohd`), for both want that port, or the robot "
            f"with --listen {endpoint}"
        )
    return None


def is_joined(session: zenoh.Session) -> bool:
    """Whether a router, or anybody else, is there."""
    return bool(session.info.routers_zid() or session.info.peers_zid())
