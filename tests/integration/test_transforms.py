"""Nodes that say where frames stand, and nodes that look it up."""

import math
import threading

import pytest
import zenoh

from robo import KEEP_ALL, Node, subscribe
from robo.errors import InTheFuture, InvalidTransform, UnknownFrame
from robo.testing import Clock, RunNode
from robo.tf import StaticTransformBroadcaster, Transform3, TransformBroadcaster, TransformListener
from robo_messages import Header, String, TFMessage, Time, Transform, TransformStamped, Vector3
from tests.support import PATIENCE, eventually


def moved(x: float, stamp: float, parent: str = "odom", child: str = "base_link") -> TransformStamped:
    time = Time.from_nanoseconds(round(stamp * 1e9))
    return TransformStamped(Header(time, parent), child, Transform(Vector3(x=x)))


class Base(Node):
    frames = TransformBroadcaster()
    fixed_frames = StaticTransformBroadcaster()


class Looker(Node):
    transforms = TransformListener()
    found: Transform3 | None = None
    error: Exception | None = None

    @subscribe("look", depth=KEEP_ALL)
    def on_look(self, when: String) -> None:
        stamp, _, timeout = when.data.partition(" ")
        try:
            time = Time.from_nanoseconds(round(float(stamp) * 1e9))
            self.found = self.transforms.lookup("odom", "base_link", time, timeout=float(timeout or 0.0))
        except Exception as error:
            self.error = error


def test_a_listener_looks_up_what_it_hears(run_node: RunNode) -> None:
    looker = run_node(Looker, namespace="r1")
    for stamp in (1.0, 2.0):
        looker.send("tf", TFMessage([moved(stamp, stamp)]))
    looker.send("tf_static", TFMessage([moved(0.25, 0.0, "base_link", "laser")]), source="/r1/base")
    looker.send("look", String("1.5"))
    assert looker.node.found == pytest.approx(Transform3(x=1.5), abs=1e-12)
    transforms = looker.node.transforms
    assert transforms.lookup("odom", "laser").x == 2.25
    assert {info.child: info.source for info in transforms.buffer.frames()}["laser"] == "/r1/base"
    with pytest.raises(UnknownFrame, match="there is no frame nowhere"):
        transforms.lookup("odom", "nowhere")


def test_a_lookup_waits_for_what_comes_while_other_callbacks_run(run_node: RunNode, clock: Clock) -> None:
    looker = run_node(Looker, namespace="r1")
    looker.send("tf", TFMessage([moved(1.0, 1.0)]))
    looker.send("look", String("1.5 1.0"))
    clock.advance(0.5)
    assert looker.node.found is None
    looker.send("tf", TFMessage([moved(2.0, 2.0)]))
    looker.send("look", String("2.5 1.0"))
    clock.advance(0.9)
    assert looker.node.found == pytest.approx(Transform3(x=1.5), abs=1e-12)
    looks = [looker.node.error]
    clock.advance(0.2)
    looks.append(looker.node.error)
    assert [type(error) for error in looks] == [type(None), InTheFuture]


def test_it_hears_while_a_callback_computes(session: zenoh.Session, other: zenoh.Session) -> None:
    entered, free = threading.Event(), threading.Event()

    class Busy(Node):
        transforms = TransformListener()

        @subscribe("work")
        def on_work(self, _: String) -> None:
            entered.set()
            free.wait(PATIENCE)

    with Busy(namespace="r1", session=session) as busy, Base(namespace="r1", session=other) as base:
        try:
            work = base.create_publisher(String, "work")
            eventually(lambda: work.has_subscribers and base.frames.tf.has_subscribers, "they have met")
            work.publish(String())
            assert entered.wait(PATIENCE)
            base.frames.send(moved(1.0, 1.0), moved(2.0, 2.0))
            eventually(lambda: busy.transforms.buffer.can_transform("odom", "base_link"), "it has come")
            assert busy.transforms.lookup("odom", "base_link").x == 2.0
        finally:
            free.set()


def test_who_comes_later_gets_all_fixed_frames(session: zenoh.Session, other: zenoh.Session) -> None:
    with Base(namespace="r1", session=session) as base:
        base.fixed_frames.send(moved(0.1, 0.0, "base_link", "laser"))
        base.fixed_frames.send(moved(0.2, 0.0, "base_link", "camera"), moved(0.3, 0.0, "base_link", "laser"))
        with Looker(namespace="r1", session=other) as late:
            found = late.transforms.lookup("camera", "laser", timeout=PATIENCE)
            assert found.x == pytest.approx(0.1, abs=1e-12)
            assert {info.source for info in late.transforms.buffer.frames()} == {"/r1/base"}


@pytest.mark.parametrize(
    "wrong",
    [moved(math.nan, 1.0), moved(1.0, 1.0, "", "base_link"), moved(1.0, 1.0, "odom", ""), moved(1.0, 1.0, "a", "a")],
)
def test_what_is_no_transform_is_refused_where_it_is_sent(run_node: RunNode, wrong: TransformStamped) -> None:
    base = run_node(Base, namespace="r1")
    for send in (base.node.frames.send, base.node.fixed_frames.send):
        with pytest.raises(InvalidTransform):
            send(moved(1.0, 1.0), wrong)
    assert base.published("tf") == base.published("tf_static") == []


def test_what_is_not_right_with_transforms_is_told(run_node: RunNode) -> None:
    looker = run_node(Looker, namespace="r1")
    for stamp in range(1, 6):
        for source in ("/r1/base", "/r1/filter"):
            looker.send("tf", TFMessage([moved(1.0, stamp + (source == "/r1/filter") * 0.5)]), source=source)
    told = [record.msg for record in looker.published("log")]
    assert any("base_link" in text and "/r1/base" in text and "/r1/filter" in text for text in told), told
    assert len(told) < 5
