"""Whether a session has come to a robot as others do, who only look, and what is to be said where it may do nothing."""

import zenoh

from robo.errors import ReadOnly
from robo.wire import access, admin, discovery

_LOOPBACK = ("tcp/127.", "tcp/[::1]:")
"""Where routers have a door for others; elsewhere nobody is asked."""


def check(session: zenoh.Session, robot: str, timeout: float, *, joins: bool = False) -> None:
    """See that a session may do something with a robot, as far as the routers tell that it is linked to.

    Args:
        session: a client or a peer.
        robot: the namespace that is meant; empty for any.
        timeout: how long a router may take to answer, s.
        joins: whether the robot is one that wants to be there, and not one that is.

    Raises:
        ReadOnly: it is another user's, and for others to look at.
    """
    for zid in {str(link.zid) for link in session.info.links() if str(link.dst).startswith(_LOOPBACK)}:
        door = admin.door_of(session, zid, timeout)
        if door is not None:
            mine = door.owner == discovery.user()
            refusal = access.refusal(door.owner, door.shared, robot, mine=mine, joins=joins)
            if refusal is not None:
                raise ReadOnly(refusal)
