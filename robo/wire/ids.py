"""The ids of sessions: by its id a session of robo's is told from one of any other Zenoh client.

What a session of robo's has on the network it announces by tokens; only what the others have must be asked of routers,
which is not free of danger (`wire.admin`).
"""

import os

_MARK = b"robo".hex()


def new_id() -> str:
    """An id for a session of robo's, as Zenoh writes it."""
    return _MARK + os.urandom(12).hex()  # `secrets` would load OpenSSL, 4 MB for each node


def is_robos(zid: str) -> bool:
    """Whether a session's id is one of robo's."""
    return zid.startswith(_MARK)
