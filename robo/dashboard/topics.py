"""The topics that pages show: the newest message of each, as often as a page can be drawn.

Nothing runs for a single message: Zenoh keeps the newest ones of each topic, and a thread looks. Whoever asks for
topics never waits for the network: the same thread declares what is watched.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any, NamedTuple

import zenoh

from robo.dashboard import clock
from robo.dashboard.frames import Frame, read
from robo.wire import codec, keys, liveliness
from robo.wire.latched import ASK_AGAIN, kept

PERIOD = 0.05
"""How often somebody looks, s: of a quicker topic a page shows the newest one 20 times a second."""
_MOVING = ("sensor/CompressedImage", "sensor/Image")
"""Types of moving pictures: at them twice as often."""
MOST_PAYLOAD = 8_000_000
"""A larger message is not shown: a page is told that it came, bytes."""
_SLOTS = 64
"""Messages of a key that wait for a look, where all count: transforms may each be of other frames."""
_FEW_SLOTS = 2
"""Of all others the newest one counts; a key may have several publishers' encodings."""
_LATCHED_WAIT = 2.0
"""For what a latched publisher keeps, s."""
_OF_PARTS = "tf2/TFMessage"
"""Of this type the newest message is not all that holds."""
TRANSFORMS = ("tf", "tf_static")
"""The topics that have this type."""
_MOST_CHANGE = 20_000
"""Of changed parameters each message counts, unless it is longer, bytes."""
_MOST_KEPT = 32
"""Of a latched topic: it may have as many publishers."""
_LONGEST_ENCODING = 300
_logger = logging.getLogger("robo.dashboard")


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

    @property
    def each_counts(self) -> bool:
        """Whether none may be left out, though a newer one has come."""
        is_change = self.key.rpartition("/")[2] == keys.PARAMETER_EVENTS_TOPIC
        return is_change and len(self.payload) <= _MOST_CHANGE


class _Watched:
    """A topic, and the tokens of its latched publishers: each of them is asked what it has said last."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        all_count = key.rpartition("/")[2] in (*TRANSFORMS, keys.PARAMETER_EVENTS_TOPIC)
        self.key = key
        self.messages: Any = session.declare_subscriber(
            key, zenoh.handlers.RingChannel(_SLOTS if all_count else _FEW_SLOTS)
        )
        # After that, so that nothing falls between.
        tokens = keys.tokens_of_latched(key)
        channel: Any = zenoh.handlers.RingChannel(_SLOTS)
        try:
            self._tokens: Any = liveliness.hear(session, tokens, channel)
        except zenoh.ZError:
            self.messages.undeclare()
            raise
        self.heard = False
        """Whether anything has come; a token may be lost, so that until then all are asked again and again."""
        self._pauses = iter(ASK_AGAIN)
        self._pause = next(self._pauses)
        self._again = time.monotonic() + self._pause

    def due(self) -> Iterator[tuple[str, bool]]:
        """The keys that are to be asked now, and whether each is a whole topic's rather than a publisher's."""
        while (token := self._tokens.handler.try_recv()) is not None:
            if token.kind == zenoh.SampleKind.PUT:
                yield str(token.key_expr), False
        if not self.heard and time.monotonic() >= self._again:
            self._pause = next(self._pauses, self._pause)
            self._again = time.monotonic() + self._pause
            yield self.key, True

    def undeclare(self) -> None:
        """Receive no more."""
        for end in (self.messages, self._tokens):
            with suppress(zenoh.ZError):
                end.undeclare()


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
        self._anew: set[str] = set()
        """Topics that somebody watches who has heard nothing of them, though somebody else may just have left."""
        self._asked: set[str] = set()
        """Keys for which somebody is asking now."""
        self._ends: dict[str, _Watched] = {}
        self._newest: dict[str, int] = {}
        """When the newest message of a key was published that has come since it is watched, ns."""
        self._moving: set[str] = set()
        """Topics of moving pictures."""
        self._over = threading.Event()
        self._askers = ThreadPoolExecutor(4, "robo-dashboard-latched")
        self._thread = threading.Thread(target=self._run, name="robo-dashboard-topics", daemon=True)
        self._thread.start()

    def watch(self, keys: Iterable[str]) -> None:
        """Receive these, and no others, from now on. Returns at once."""
        wanted = frozenset(keys)
        with self._lock:
            self._anew |= wanted - self._wanted
            self._wanted = wanted

    def close(self) -> None:
        """Receive no more."""
        self._over.set()
        self._thread.join()
        self._askers.shutdown(wait=False, cancel_futures=True)
        for end in self._ends.values():
            end.undeclare()
        self._ends.clear()

    def _run(self) -> None:
        while not self._over.wait(PERIOD / 2 if self._moving else PERIOD):
            try:
                if self._moving:
                    self._tell(self._moving)
                    if self._over.wait(PERIOD / 2):
                        return
                self._declare()
                self._tell(self._ends.keys())
            except zenoh.ZError:
                pass  # the network has been left; it is tried again
            except Exception:  # nobody has thought of it: it is told, and tried again
                _logger.exception("the dashboard could not take in what topics say")

    def _tell(self, keys: Iterable[str]) -> None:
        """Deliver what has come of some topics."""
        found = self._look(list(keys))
        if found:
            self._deliver(found)

    def _declare(self) -> None:
        with self._lock:
            wanted, anew = self._wanted, self._anew
            self._anew = set()
        for key in self._ends.keys() - wanted | self._ends.keys() & anew:
            self._newest.pop(key, None)
            self._moving.discard(key)
            self._ends.pop(key).undeclare()
        for key in wanted - self._ends.keys():
            self._ends[key] = _Watched(self._session, key)
        for end in self._ends.values():
            for key, whole in end.due():
                if key not in self._asked:
                    self._asked.add(key)
                    self._askers.submit(self._ask, end, key, whole)

    def _look(self, keys: list[str]) -> list[Message]:
        parts: list[Message] = []
        newest: dict[str, Message] = {}
        for key in keys:
            while (sample := self._ends[key].messages.handler.try_recv()) is not None:
                self._ends[key].heard = True
                message = _message(sample)
                if message is None:
                    continue
                if message.is_of_parts or message.each_counts:
                    parts.append(message)
                else:
                    newest[message.key] = message
        for key, message in newest.items():
            if message.encoding.endswith(_MOVING):
                self._moving.add(key)
            if message.published is not None:
                self._newest[key] = min(message.published, time.time_ns())  # a stranger may say any time
        return [*parts, *newest.values()]

    def _ask(self, end: _Watched, key: str, whole: bool) -> None:
        """Deliver what latched publishers of a topic said last, but for what is older than what has come since."""
        try:
            said = [_message(sample) for sample in kept(self._session, key, _MOST_KEPT, _LATCHED_WAIT, whole=whole)]
        except zenoh.ZError:
            return  # the network has been left
        finally:
            self._asked.discard(key)
        end.heard = bool(said) or (end.heard and whole)
        found = [_latched(one) for one in said if one is not None]
        newest = self._newest.get(end.key, 0)
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
        return Message(str(sample.key_expr), encoding, published, clock.now(), payload, read(payload))
    return Message(str(sample.key_expr), encoding, published, clock.now(), payload)


def _latched(message: Message) -> Message:
    """What a publisher has kept: it is as old as the publisher says."""
    if message.published is None:
        return message
    return message._replace(arrived=message.arrived - max(0, time.time_ns() - message.published))
