"""What is said of a topic's ends, as it works: priorities, deadlines, and what a launch says over it."""

from functools import partial

import pytest
import zenoh

from robo import KEEP_ALL, Client, ContractError, Node, Publisher, QoS, service, subscribe
from robo.node.services import ask
from robo.testing import Clock, RunNode
from robo.tools import topics
from robo.wire.discovery import tokens
from robo.wire.keys import EndpointToken
from robo.wire.qos import Quality
from robo_messages import Image, String, Trigger, Twist
from tests.plain import hear, samples
from tests.support import eventually


class Driver(Node):
    commands = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    image = Publisher(Image, "image", qos=QoS.BULK, depth=KEEP_ALL)
    notes = Publisher(String, "notes")
    stop = Client(Trigger.Request, Trigger.Response, "stop", priority="real_time")


class Base(Node):
    def on_start(self) -> None:
        self.images = 0
        self.notes: list[str] = []

    @subscribe("image", depth=KEEP_ALL)
    def on_image(self, image: Image) -> None:
        self.images += len(image.data) == 6_000_000

    def has_seen(self, images: int) -> bool:
        return self.images == images

    @subscribe("notes", deadline=0.5)
    def on_note(self, text: String) -> None:
        self.notes.append(text.data)

    @service("stop")
    def stand(self, _request: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(success=True)


def test_messages_and_calls_have_the_priority_that_is_said(session: zenoh.Session, other: zenoh.Session) -> None:
    heard = hear(other, "r1/cmd_vel")
    with Driver(namespace="r1", session=session) as driver:
        eventually(lambda: driver.commands.has_subscribers, "the plain client is seen")
        driver.commands.publish(Twist())
        assert samples(heard)[0].priority == zenoh.Priority.INTERACTIVE_HIGH
    heard.undeclare()


def test_the_answer_of_a_call_has_the_priority_of_the_call(session: zenoh.Session, other: zenoh.Session) -> None:
    with Driver(namespace="r1", session=session) as driver, Base(namespace="r1", session=other):
        assert driver.stop(Trigger.Request()).success
        sample = ask(session, "r1/stop", (b"\x80", b""), "application/msgpack", 10.0, 10.0, "real_time")
        assert sample.priority == zenoh.Priority.REAL_TIME


def test_flush_waits_for_what_goes_last_too(session: zenoh.Session, other: zenoh.Session) -> None:
    with Driver(namespace="r1", session=session) as driver, Base(namespace="r1", session=other) as base:
        eventually(lambda: driver.image.has_subscribers, "the subscription is seen")
        for number in range(1, 6):
            driver.image.publish(Image(data=memoryview(bytes(6_000_000))))
            driver.flush()
            eventually(partial(base.has_seen, number), "the image")


def test_a_silence_of_a_needed_topic_is_told_and_its_end_too(run_node: RunNode, clock: Clock) -> None:
    base = run_node(Base)
    clock.advance(5.0)
    assert not base.published("log")
    base.send("notes", String("here"))
    clock.advance(2.0)
    assert [line.msg for line in base.published("log")] == ["no message on notes within its deadline of 0.5 s"]
    base.send("notes", String("again"))
    clock.advance(0.5)
    assert [line.msg for line in base.published("log")][1:] == ["messages come again on notes"]


def test_what_a_launch_says_of_a_topic_holds_at_its_ends(session: zenoh.Session) -> None:
    driver = Driver(namespace="r1", session=session)
    driver.qualities = {"r1/notes": Quality(profile="latched"), "r1/cmd_vel": Quality(depth=3)}
    with driver:
        found = {end.topic: end.qos for end in tokens(session, 1.0) if isinstance(end, EndpointToken)}
        assert found["r1/notes"] == QoS.LATCHED
        assert found["r1/cmd_vel"] == QoS(depth=3, priority="interactive_high")
    driver.qualities = {"r1/notes": Quality(profile="latched", depth=0)}
    with pytest.raises(ContractError, match="say how many"):
        driver.start()


def test_ends_that_do_not_fit_are_told(session: zenoh.Session) -> None:
    with Driver(namespace="r1", session=session) as driver:
        driver.create_subscription(String, "notes", print, latched=True)
        told = ["/r1/driver does not latch r1/notes, and /r1/driver wants what it said before: say latched=True there"]
        assert topics.all_misfits(session) == told
        assert topics.topic_info(session, "r1/notes").misfits == told
        assert not topics.topic_info(session, "r1/image").misfits
