"""The topics that pages show: the newest message of each, as often as a page can be drawn.

Nothing runs for a single message: Zenoh keeps the newest ones of each topic, and a thread looks. Whoever asks for
topics never waits for the network: the same thread declares what is watched.
"""

import threading
import time
from collections.abc import Callable, Collection, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import NamedTuple

import zenoh

from robo.dashboard import clock
from robo.dashboard.frames import Frame, read
from robo.wire import codec
from robo.wire.latched import kept

PERIOD = 0.05
"""How often somebody looks, s: of a quicker topic a page shows the newest one 20 times a second."""
_MOVING = ("sensor/CompressedImage", "sensor/Image")
"""Types of moving pictures: at them twice as often."""
MOST_PAYLOAD = 8_000_000
"""A larger message is not shown: a page is told that it came, bytes."""
_SLOTS = 64
"""Messages of a key that wait for a look. Transforms count all: each may be of other frames."""
_FEW_SLOTS = 2
"""Of all others the newest one counts; a key may have several publishers' encodings."""
_LATCHED_WAIT = 0.5
"""For what latched publishers keep, s."""
_OF_PARTS = "tf2/TFMessage"
"""Of this type the newest message is not all that holds."""
_TRANSFORMS = ("tf", "tf_static")
"""The topics that have this type."""
_MOST_KEPT = 32
"""Of a latched topic: it may have as many publishers."""
_LONGEST_ENCODING = 300


class Message(NamedTuple):
    """A message as it came."""

    key: str
    encoding: str
    published: int | None
    """ns since the epoch, by the publisher's clock; None where it has not said."""
    arrived: int
    """ns since the epoch, by the server's time."""
    payload: bytes
    """Empty where it is too large."""
    frames: dict[str, Frame] | None = None
    """What a message of transforms says, read by the thread that has received it; None for all others."""

    @property
    def is_of_parts(self) -> bool:
        """Whether others of the same topic hold beside it."""
        return self.frames is not None


class Topics:
    """Receives what is watched."""

    def __init__(self, session: zenoh.Session, deliver: Callable[[list[Message]], None]) -> None:
        """
        Args:
            session: the network.
            deliver: gets what has come, by threads, some 20 times a second; the next look is after it has returned.
        """
        self._session = session
        self._deliver = deliver
        self._lock = threading.Lock()
        self._wanted: frozenset[str] = frozenset()
        self._again: set[str] = set()
        """Keys of which it is wanted what latched publishers said last."""
        self._asked: set[str] = set()
        """Those of them for which somebody is asking now."""
        self._ends: dict[str, zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]] = {}
        self._newest: dict[str, int] = {}
        """When the newest message of a key was published that has come since it is watched, ns."""
        self._moving: set[str] = set()
        """Topics of moving pictures."""
        self._over = threading.Event()
        self._askers = ThreadPoolExecutor(4, "robo-dashboard-latched")
        self._thread = threading.Thread(target=self._run, name="robo-dashboard-topics", daemon=True)
        self._thread.start()

    def watch(self, keys: Iterable[str], again: Collection[str] = ()) -> None:
        """Receive these, and no others, from now on. Returns at once.

        Args:
            keys: of topics.
            again: those of them of which is wanted what latched publishers said last, though it has come before:
                somebody looks who has not heard it.
        """
        with self._lock:
            self._wanted = frozenset(keys)
            self._again.update(again)

    def close(self) -> None:
        """Receive no more."""
        self._over.set()
        self._thread.join()
        self._askers.shutdown(wait=False, cancel_futures=True)
        for end in self._ends.values():
            with suppress(zenoh.ZError):
                end.undeclare()
        self._ends.clear()

    def _run(self) -> None:
        while not self._over.wait(PERIOD / 2 if self._moving else PERIOD):
            if self._moving:
                self._tell(self._moving)
                if self._over.wait(PERIOD / 2):
                    return
            with suppress(zenoh.ZError):  # the network has been left; it is tried again
                self._declare()
            self._tell(self._ends.keys())

    def _tell(self, keys: Iterable[str]) -> None:
        """Deliver what has come of some topics."""
        found = self._look(list(keys))
        if found:
            self._deliver(found)

    def _declare(self) -> None:
        with self._lock:
            wanted, again = self._wanted, self._again
            self._again = set()
        for key in self._ends.keys() - wanted:
            self._newest.pop(key, None)
            self._moving.discard(key)
            self._ends.pop(key).undeclare()
        for key in wanted - self._ends.keys():
            slots = _SLOTS if key.rpartition("/")[2] in _TRANSFORMS else _FEW_SLOTS
            self._ends[key] = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(slots))
            again.add(key)  # after that, so that nothing falls between
        for key in again & wanted - self._asked:
            self._asked.add(key)
            self._askers.submit(self._ask, key)

    def _look(self, keys: list[str]) -> list[Message]:
        parts: list[Message] = []
        newest: dict[str, Message] = {}
        for key in keys:
            while (sample := self._ends[key].handler.try_recv()) is not None:
                message = _message(sample)
                if message is None:
                    continue
                if message.is_of_parts:
                    parts.append(message)
                else:
                    newest[message.key] = message
        for key, message in newest.items():
            if message.encoding.endswith(_MOVING):
                self._moving.add(key)
            if message.published is not None:
                self._newest[key] = min(message.published, time.time_ns())  # a stranger may say any time
        return [*parts, *newest.values()]

    def _ask(self, key: str) -> None:
        """Deliver what latched publishers of a key said last, but for what is older than what has come since."""
        try:
            said = [_message(sample) for sample in kept(self._session, key, _MOST_KEPT, _LATCHED_WAIT)]
        except zenoh.ZError:
            return  # the network has been left
        finally:
            self._asked.discard(key)
        found = [_latched(one) for one in said if one is not None]
        newest = self._newest.get(key, 0)
        fresh = [one for one in found if one.is_of_parts or one.published is None or one.published >= newest]
        if fresh and not self._over.is_set():
            self._deliver(sorted(fresh, key=lambda one: one.published or 0))


def _message(sample: zenoh.Sample) -> Message | None:
    if sample.kind != zenoh.SampleKind.PUT:
        return None
    encoding = str(sample.encoding)
    if len(encoding) > _LONGEST_ENCODING:
        return None
    stamp = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
    published = stamp.source_time if stamp is not None else None
    payload = sample.payload.to_bytes() if len(sample.payload) <= MOST_PAYLOAD else b""
    if encoding.endswith(_OF_PARTS):
        return Message(str(sample.key_expr), encoding, published, clock.now(), b"", read(payload))
    return Message(str(sample.key_expr), encoding, published, clock.now(), payload)


def _latched(message: Message) -> Message:
    """What a publisher has kept: it is as old as the publisher says."""
    if message.published is None:
        return message
    return message._replace(arrived=message.arrived - max(0, time.time_ns() - message.published))
