"""Whether somebody answers at an endpoint, over TCP or a unix socket, without a word of Zenoh's."""

from collections.abc import Iterator, Sequence

from robo.wire import meeting, tcp


def can_be_tried(endpoint: str) -> bool:
    """Whether an endpoint is of a kind that is known here."""
    return meeting.path_of(endpoint) is not None or tcp.address_of(endpoint) is not None


def tried(endpoints: Sequence[str], within: float) -> Iterator[tuple[str, OSError | None]]:
    """Try to connect to some endpoints, to all at once.

    Yields each with what is wrong, or None if somebody answers, in the order in which it turns out. One of which
    nothing is known in time is left out, and so is one that cannot be tried.

    Args:
        endpoints: in Zenoh's form.
        within: how long to wait for all of them, s.
    """
    for endpoint in endpoints:
        path = meeting.path_of(endpoint)
        if path is not None:
            yield endpoint, meeting.knock(path, within)
    yield from tcp.tried(endpoints, within)


def answering(endpoints: Sequence[str], within: float) -> Iterator[str]:
    """Those of some endpoints where somebody answers in time; as `tried`."""
    return (endpoint for endpoint, wrong in tried(endpoints, within) if wrong is None)
