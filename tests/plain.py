"""A plain Zenoh client, for tests of what stands on the wire: keys, encodings, attachments, bytes."""

import time
from typing import Any

import zenoh

from robo.wire.codec import unpack_attachment
from tests.support import PATIENCE


def hear(session: zenoh.Session, keys: str) -> Any:
    """A subscriber that keeps all that comes until it is asked for it."""
    return session.declare_subscriber(keys, zenoh.handlers.FifoChannel(100_000))


def samples(heard: Any, count: int = 1) -> list[zenoh.Sample]:
    """The next samples of a subscriber with a channel, once so many have come."""
    found: list[zenoh.Sample] = []
    end = time.monotonic() + PATIENCE
    while len(found) < count:
        sample = heard.try_recv()
        if sample is not None:
            found.append(sample)
            continue
        assert time.monotonic() < end, f"{len(found)} samples on {heard.key_expr} within {PATIENCE} s, not {count}"
        time.sleep(0.002)
    return found


def so_far(heard: Any) -> list[zenoh.Sample]:
    """All that has come to a subscriber with a channel and was not asked for yet."""
    found: list[zenoh.Sample] = []
    while (sample := heard.try_recv()) is not None:
        found.append(sample)
    return found


def sent(sample: zenoh.Sample) -> int:
    """When a node has sent it, ns since the epoch."""
    assert sample.attachment is not None
    stamp = unpack_attachment(sample.attachment.to_bytes())
    assert stamp is not None
    return stamp.source_time
