"""Publishing from outside of any node."""

import pytest
import zenoh

from robo.errors import InvalidName
from robo.samples.publishing import Sender

pytestmark = pytest.mark.timeout(30)


@pytest.mark.parametrize(
    ("key", "type_name", "node", "what"),
    [
        ("r1/" + "a" * 60_000, "std/String", "/r1/base", "topic"),
        ("r1/a", "std/" + "S" * 60_000, "/r1/base", "type"),
        ("r1/a", "std/String", "/r1/" + "a" * 60_000, "node"),
    ],
)
def test_what_is_too_long_to_be_announced_is_refused(
    session: zenoh.Session, key: str, type_name: str, node: str, what: str
) -> None:
    """Zenoh would end the process."""
    with pytest.raises(InvalidName, match=f"… is no {what}: it has more than 500 characters"):
        Sender(session, key, type_name, node=node)
    longest = Sender(session, "a" * 500, "std/String", node="/r1/base")
    longest.send(b"\xc0")
    longest.close()
