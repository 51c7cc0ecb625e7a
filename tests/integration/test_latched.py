"""Latched topics: whoever comes later gets the last messages, and never an old one after a newer one."""

import threading
from functools import partial

import msgpack
import pytest
import zenoh
from zenoh import ext

from robo import KEEP_ALL, MessageInfo, Node, Publisher, QoS, subscribe
from robo.testing import Clock, RunNode
from robo.wire.latched import Inflow, Order
from robo_messages import Image, String
from tests.plain import hear, samples
from tests.support import eventually


class Source(Node):
    state = Publisher(String, "state", latched=True)
    steps = Publisher(String, "steps", latched=True, depth=3)
    image = Publisher(Image, "image", latched=True)


class Reader(Node):
    def on_start(self) -> None:
        self.states: list[str] = []
        self.steps: list[str] = []
        self.infos: list[MessageInfo] = []

    @subscribe("state", latched=True)
    def on_state(self, text: String) -> None:
        self.states.append(text.data)

    @subscribe("steps", qos=QoS.LATCHED, depth=KEEP_ALL)
    def on_step(self, text: String, info: MessageInfo) -> None:
        self.steps.append(text.data)
        self.infos.append(info)


@pytest.fixture
def source(session: zenoh.Session) -> Source:
    return Source(namespace="r1", session=session)


@pytest.fixture
def reader(other: zenoh.Session) -> Reader:
    return Reader(namespace="r1", session=other)


class Plain(Node):
    state = Publisher(String, "state")


def test_who_wants_what_was_said_before_gets_all_that_is_said_by_who_keeps_nothing(
    session: zenoh.Session, reader: Reader, other: zenoh.Session
) -> None:
    advanced: list[zenoh.Sample] = []
    subscriber = ext.declare_advanced_subscriber(other, "r1/state", advanced.append, history=ext.HistoryConfig())
    with Plain(namespace="r1", session=session) as plain, reader:
        eventually(lambda: plain.state.has_subscribers, "somebody listens")
        for number in range(50):
            plain.state.publish(String(str(number)))
        eventually(lambda: reader.states[-1:] == ["49"], "the last one")
        eventually(lambda: len(advanced) == 50, "all of them, by Zenoh's own subscriber too")
    subscriber.undeclare()
    assert len(reader.states) > 1


def test_whoever_comes_later_gets_the_last_one_or_the_last_few(source: Source, reader: Reader) -> None:
    with source:
        for number in range(5):
            source.state.publish(String(str(number)))
            source.steps.publish(String(str(number)))
        with reader:
            eventually(lambda: reader.states == ["4"] and reader.steps == ["2", "3", "4"], "what was said before")
            source.state.publish(String("now"))
            source.steps.publish(String("now"))
            eventually(lambda: reader.states[1:] == ["now"] and reader.steps[3:] == ["now"], "what is said now")
            assert [info.sequence_number for info in reader.infos] == [3, 4, 5, 6]
            assert {info.source_id for info in reader.infos} == {source.steps.id}
            assert all(0 <= info.age < 1000 for info in reader.infos)


def test_a_publisher_that_comes_later_or_again_is_asked_as_well(
    session: zenoh.Session, source: Source, reader: Reader
) -> None:
    with reader:
        with source:
            source.state.publish(String("first"))
            eventually(lambda: reader.states == ["first"], "it has come")
        with Source(namespace="r1", session=session) as again:
            again.state.publish(String("second"))
            eventually(lambda: reader.states == ["first", "second"], "the new one has come")


def test_what_ends_with_its_publisher_is_told_to_nobody(source: Source, reader: Reader, other: zenoh.Session) -> None:
    with source:
        source.state.publish(String("gone"))
    with reader, Source(namespace="r1", session=other) as present:
        present.steps.publish(String("there"))
        eventually(lambda: reader.steps == ["there"], "the present one is heard")
        assert reader.states == []


def test_a_late_reader_of_a_busy_topic_sees_each_message_once_and_in_order(
    source: Source, other: zenoh.Session
) -> None:
    stop = threading.Event()

    def speak() -> None:
        number = 0
        while not stop.wait(0.001):
            source.steps.publish(String(str(number)))
            number += 1

    with source:
        speaker = threading.Thread(target=speak)
        speaker.start()
        try:
            for _ in range(10):
                with Reader(namespace="r1", session=other) as reader:
                    seen = reader.steps
                    eventually(partial(_has, seen, 10), "some have come")
                numbers = [int(text) for text in seen]
                assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        finally:
            stop.set()
            speaker.join()


def _has(seen: list[str], count: int) -> bool:
    return len(seen) >= count


def test_plain_clients_read_and_write_latched_topics(source: Source, reader: Reader, other: zenoh.Session) -> None:
    heard = hear(other, "r1/state")
    with source, reader:
        eventually(lambda: source.state.has_subscribers, "the plain client is seen")
        source.state.publish(String("it"))
        assert [msgpack.unpackb(sample.payload.to_bytes()) for sample in samples(heard)] == [{"data": "it"}]
        eventually(lambda: reader.states == ["it"], "what the node says")  # of two publishers the order is not promised
        other.put("r1/state", msgpack.packb({"data": "plain"}))
        eventually(lambda: reader.states == ["it", "plain"], "what a plain client says")
    heard.undeclare()


def test_any_zenoh_client_with_its_extensions_may_be_the_late_one(source: Source, other: zenoh.Session) -> None:
    with source:
        source.state.publish(String("it"))
        late = ext.declare_advanced_subscriber(
            other, "r1/state", zenoh.handlers.FifoChannel(8), history=ext.HistoryConfig(max_samples=1)
        )
        assert msgpack.unpackb(late.recv().payload.to_bytes()) == {"data": "it"}
        late.undeclare()


def test_a_large_message_is_kept_as_well(source: Source, other: zenoh.Session) -> None:
    seen: list[Image] = []
    with source, Node(name="late", namespace="r1", session=other) as late:
        source.image.publish(Image(data=memoryview(bytes(6_000_000))))
        late.create_subscription(Image, "image", seen.append, qos=QoS.LATCHED)
        eventually(lambda: len(seen) == 1, "the image")
        assert len(seen[0].data) == 6_000_000


def test_a_test_of_a_node_sees_latched_topics(run_node: RunNode, clock: Clock) -> None:
    source = run_node(Source)
    source.node.state.publish(String("before"))
    reader = run_node(Reader)
    clock.advance(0.1)
    assert reader.node.states == ["before"]
    source.node.state.publish(String("after"))
    clock.advance(0.1)
    assert reader.node.states == ["before", "after"]
    assert [message.data for message in source.published(Source.state)] == ["before", "after"]
    reader.send("state", String("by hand"))
    assert reader.node.states[-1] == "by hand"


def test_what_a_former_publisher_of_a_node_says_after_the_present_one_is_old() -> None:
    order = Order()
    for publisher, node in (("old", "/r1/monitor"), ("other", "/r1/base"), ("new", "/r1/monitor")):
        order.follow(publisher)
        order.meet(publisher, node)
    assert order.admits("old", 1, 10)
    assert order.admits("new", 1, 20)
    assert not order.admits("old", 2, 15), "it was cut off, and is back"
    assert order.admits("other", 1, 5), "each node has its own last word"
    assert order.admits("stranger", 1, 1), "it is not latched, or nobody knows whose it is"
    assert order.admits("old", 3, 30)
    order.part("old")
    assert order.admits("new", 2, 20), "a clock that was set back does not silence who comes again"


def test_what_comes_twice_or_late_is_left_out() -> None:
    order = Order()
    order.follow("here")
    assert [order.admits("here", number, number) for number in (1, 3, 2, 3, 4)] == [True, True, False, False, True]
    assert all(order.admits("stranger", number, number) for number in (1, 3, 2, 3))
    order.follow("stranger")
    assert not order.admits("stranger", 3, 3), "it has spoken before its token came"
    assert order.admits("stranger", 4, 4)


def test_a_latched_reader_hears_publishers_that_are_not(reader: Reader, session: zenoh.Session) -> None:
    with reader, Node(name="source", namespace="r1", session=session) as source:
        plain = source.create_publisher(String, "state")
        eventually(lambda: plain.has_subscribers, "the reader is seen")
        for number in range(3):
            plain.publish(String(str(number)))
        eventually(lambda: reader.states == ["0", "1", "2"], "each of its messages")


def test_who_has_heard_nothing_asks_again() -> None:
    asked: list[str] = []
    inflow = Inflow(lambda key, publisher: asked.append(f"{key} {publisher}"), "r1/state", 8, waits=False)
    eventually(lambda: inflow.try_recv() is None and len(asked) >= 2, "it has asked twice")
    assert set(asked) == {"r1/state "}
    inflow.close()
    with pytest.raises(zenoh.ZError):
        inflow.recv()


def test_what_is_older_than_a_lifespan_does_not_reach_the_callback(source: Source, other: zenoh.Session) -> None:
    seen: list[str] = []
    with source, Node(name="late", namespace="r1", session=other) as late:
        source.state.publish(String("old"), 30.0)
        states = late.create_subscription(
            String, "state", lambda text: seen.append(text.data), latched=True, lifespan=5
        )
        eventually(lambda: states.dropped == 1, "it is too old")
        source.state.publish(String("new"))
        eventually(lambda: seen == ["new"], "the new one")
        assert states.received == 1
