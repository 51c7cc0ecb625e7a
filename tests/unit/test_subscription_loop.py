"""How a subscription takes messages in, without a network: its channel is one in memory."""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import msgpack
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from robo.node import loops
from robo.node.loops import SubscriptionLoop
from robo.node.message_info import MessageInfo
from robo.node.turn import Turn, taking
from robo.wire.codec import Decoder
from robo.wire.qos import KEEP_ALL
from robo_messages import String
from tests.support import PATIENCE, eventually


class Payload:
    def __init__(self, data: bytes) -> None:
        self._data = data

    def to_bytes(self) -> bytes:
        return self._data


class Sample:
    """A message on its way."""

    def __init__(self, payload: bytes, encoding: str = "zenoh/bytes") -> None:
        self.payload = Payload(payload)
        self.encoding = encoding


class Channel:
    """Zenoh's channel and its subscriber in one: samples in order, and an error once it is undeclared and empty."""

    key_expr = "r1/in"

    def __init__(self) -> None:
        self._samples: deque[Sample] = deque()
        self._changed = threading.Condition()
        self._open = True
        self.handler = self

    def put(self, *samples: Sample) -> None:
        with self._changed:
            self._samples += samples
            self._changed.notify_all()

    def recv(self) -> Sample:
        with self._changed:
            assert self._changed.wait_for(lambda: self._samples or not self._open, PATIENCE)
            return self._next()

    def try_recv(self) -> Sample | None:
        with self._changed:
            return self._next() if self._samples or not self._open else None

    def undeclare(self) -> None:
        with self._changed:
            self._open = False
            self._changed.notify_all()

    def _next(self) -> Sample:
        if not self._samples:
            raise zenoh.ZError("the channel is closed")
        return self._samples.popleft()


class Receiver:
    """A subscription loop, all that comes out of it, and a callback that can be held up."""

    def __init__(self, depth: int = 10, examine: Callable[[Any], MessageInfo | None] | None = None) -> None:
        self._depth = depth
        self.channel = Channel()
        self.turn = Turn()
        self.got: list[str] = []
        self.infos: list[MessageInfo] = []
        self.errors: list[BaseException] = []
        self.malformed: list[str] = []
        self.stopped: list[bool] = []
        self.entered = threading.Semaphore(0)
        self.going_on = threading.Event()
        self.going_on.set()
        subscriber: Any = self.channel
        self.loop = SubscriptionLoop(
            subscriber,
            Decoder(String),
            depth,
            self.turn,
            self._on_text if examine is None else self._on_informed,
            self.errors.append,
            lambda reason, _: self.malformed.append(reason),
            examine,
        )

    def _on_text(self, text: String) -> Any:
        self.entered.release()
        self.going_on.wait(PATIENCE)
        self.got.append(text.data)
        if text.data == "stop":
            self.stopped.append(self.loop.stop(PATIENCE))
        if text.data == "raise":
            raise ValueError("asked to")
        if text.data == "exit":
            raise SystemExit(3)
        return _later() if text.data == "coroutine" else None

    def _on_informed(self, text: String, info: MessageInfo) -> None:
        self.infos.append(info)
        self._on_text(text)

    def receive(self, *samples: Sample) -> list[str]:
        """What the callback has got of all these, once the subscription has ended."""
        self.channel.put(*samples)
        self.loop.start()
        if self._depth != KEEP_ALL:  # with KEEP_ALL the end alone has to drain it
            eventually(lambda: not self.channel._samples, "all is taken in")
        assert self.loop.stop(PATIENCE)
        return self.got


async def _later() -> None:
    """Do nothing that anybody waits for."""


def texts(*data: str) -> list[Sample]:
    return [Sample(msgpack.packb({"data": text})) for text in data]


def test_messages_come_in_order_and_are_counted() -> None:
    receiver = Receiver()
    assert receiver.receive(*texts("a", "b"), Sample(b'{"data": "c"}'), *texts("d")) == ["a", "b", "c", "d"]
    assert (receiver.loop.received, receiver.loop.malformed, receiver.loop.dropped) == (4, 0, 0)


def test_what_cannot_be_read_is_told_and_holds_up_nothing() -> None:
    receiver = Receiver()
    garbage = [Sample(b""), Sample(b"\xc1"), Sample(msgpack.packb({"data": 5})), Sample(b"{nope")]
    assert receiver.receive(*texts("a"), *garbage, *texts("b")) == ["a", "b"]
    assert (receiver.loop.received, receiver.loop.malformed) == (2, 4)
    assert len(receiver.malformed) == 4
    assert receiver.errors == []


@pytest.mark.parametrize("text", ["raise", "exit"])
@pytest.mark.parametrize("as_json", [False, True])
def test_a_callback_that_raises_is_told_from_a_payload_that_cannot_be_read(text: str, as_json: bool) -> None:
    receiver = Receiver()
    sample = Sample(f'{{"data": "{text}"}}'.encode()) if as_json else texts(text)[0]
    assert receiver.receive(sample, *texts("after")) == [text, "after"]
    (error,) = receiver.errors
    assert isinstance(error, ValueError if text == "raise" else SystemExit)
    assert (receiver.loop.received, receiver.malformed) == (2, [])


def test_a_coroutine_that_nobody_awaits_is_an_error_of_the_callback() -> None:
    receiver = Receiver()
    receiver.receive(*texts("coroutine", "after"))
    (error,) = receiver.errors
    assert "returned a coroutine, which nobody awaits" in str(error)
    assert receiver.got == ["coroutine", "after"]


def held_up(receiver: Receiver, count: int, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What comes of so many messages that pile up while the callback runs for a second of the test's own clock."""
    time = [0.0]
    monkeypatch.setattr(loops, "monotonic", lambda: time[0])
    receiver.going_on.clear()
    receiver.loop.start()
    receiver.channel.put(*texts("first"))
    assert receiver.entered.acquire(timeout=PATIENCE)
    receiver.channel.put(*texts(*map(str, range(count))))
    time[0] += 1.0
    receiver.going_on.set()
    eventually(lambda: not receiver.channel._samples and len(receiver.got) > 1, "it has caught up")
    assert receiver.loop.stop(PATIENCE)
    return receiver.got


@pytest.mark.parametrize("depth", [1, 3])
def test_a_callback_that_fell_behind_goes_on_with_the_newest(depth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    receiver = Receiver(depth)
    assert held_up(receiver, 100, monkeypatch) == ["first", *map(str, range(100 - depth, 100))]
    assert receiver.loop.dropped == 100 - depth
    assert receiver.loop.received == 1 + depth


def test_who_asked_for_every_message_gets_every_message(monkeypatch: pytest.MonkeyPatch) -> None:
    receiver = Receiver(KEEP_ALL)
    assert held_up(receiver, 100, monkeypatch) == ["first", *map(str, range(100))]
    assert receiver.loop.dropped == 0


def test_a_stop_with_keep_all_drains_what_has_come() -> None:
    receiver = Receiver(KEEP_ALL)
    assert receiver.receive(*texts(*map(str, range(1000)))) == [*map(str, range(1000))]


def test_quick_callbacks_lose_nothing_though_much_piles_up() -> None:
    receiver = Receiver(depth=1)
    receiver.channel.put(*texts(*map(str, range(50))))
    receiver.turn.acquire()  # another callback runs
    receiver.loop.start()
    eventually(lambda: bool(receiver.turn.waiting), "it waits for its turn")
    receiver.turn.release()
    eventually(lambda: not receiver.channel._samples, "all is taken in")
    assert receiver.loop.stop(PATIENCE)
    assert receiver.got[-1] == "49"
    assert receiver.loop.dropped == 50 - len(receiver.got)


def test_between_two_messages_others_get_their_turn() -> None:
    receiver, order = Receiver(KEEP_ALL), []
    receiver.going_on.clear()
    receiver.channel.put(*texts(*map(str, range(5))))
    receiver.loop.start()
    assert receiver.entered.acquire(timeout=PATIENCE)

    def other() -> None:
        with taking(receiver.turn, "other"):
            order.append(len(receiver.got))

    thread = threading.Thread(target=other)
    thread.start()
    eventually(lambda: bool(receiver.turn.waiting), "the other waits")
    receiver.going_on.set()
    thread.join(PATIENCE)
    assert receiver.loop.stop(PATIENCE)
    assert order == [1], "it came after the message that was being handled, before those that waited"
    assert len(receiver.got) == 5


def test_who_holds_up_the_node_is_named_while_it_runs() -> None:
    receiver = Receiver()
    receiver.going_on.clear()
    receiver.loop.start()
    receiver.channel.put(*texts("a"))
    assert receiver.entered.acquire(timeout=PATIENCE)
    assert receiver.turn.running == "_on_text"
    receiver.going_on.set()
    assert receiver.loop.stop(PATIENCE)
    assert receiver.turn.running == ""
    assert receiver.turn.try_acquire(False), "its turn is free"


def test_a_stop_does_not_wait_for_ever_for_a_callback_that_is_stuck() -> None:
    receiver = Receiver()
    receiver.going_on.clear()
    receiver.loop.start()
    receiver.channel.put(*texts("a"))
    assert receiver.entered.acquire(timeout=PATIENCE)
    assert not receiver.loop.stop(0.01)
    receiver.going_on.set()


def test_one_that_was_never_started_and_one_that_stops_itself_are_not_waited_for() -> None:
    assert Receiver().loop.stop(PATIENCE)
    receiver = Receiver()
    receiver.channel.put(*texts("stop"))
    receiver.loop.start()
    eventually(lambda: receiver.stopped == [True], "it has stopped itself from its own callback")


def test_a_message_that_does_not_count_is_not_decoded_and_not_counted() -> None:
    def examine(sample: Sample) -> MessageInfo | None:
        return None if sample.encoding == "foreign" else MessageInfo(0.5, "/r1/monitor")

    receiver = Receiver(examine=examine)
    foreign = Sample(b"garbage", "foreign")
    assert receiver.receive(foreign, *texts("a"), foreign, Sample(b'{"data": "b"}')) == ["a", "b"]
    assert receiver.infos == [MessageInfo(0.5, "/r1/monitor")] * 2, "JSON has its information too"
    assert (receiver.loop.received, receiver.loop.malformed) == (2, 0)


messages = st.lists(st.sampled_from(["plain", "raise", "json", "garbage", "coroutine"]), max_size=30)


@given(messages)
def test_whatever_comes_is_counted_once_and_ends_nothing(kinds: Sequence[str]) -> None:
    made = {
        "plain": texts("plain"),
        "raise": texts("raise"),
        "coroutine": texts("coroutine"),
        "json": [Sample(b'{"data": "json"}')],
        "garbage": [Sample(b"\xc1")],
    }
    receiver = Receiver(KEEP_ALL)
    got = receiver.receive(*(sample for kind in kinds for sample in made[kind]))
    assert got == [kind for kind in kinds if kind != "garbage"]
    assert receiver.loop.received == len(got)
    assert receiver.loop.malformed == kinds.count("garbage")
    assert len(receiver.errors) == kinds.count("raise") + kinds.count("coroutine")
