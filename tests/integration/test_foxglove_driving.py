"""Driving and stopping from viewers of the bridge: whatever else viewers, links and robots do."""

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import msgspec
import pytest
import zenoh

import robo_messages
from robo import Node, ServiceError, service
from robo.samples import publishing
from robo.samples.stream import Stream
from robo.web.access import Tokens
from robo.wire import codec
from robo.wire.keys import parameters_key
from robo_messages import Bool, DiagnosticStatus, KeyValue, SetBool, Trigger, Twist, TwistStamped
from tests.support import eventually

viewers = pytest.importorskip("tests.viewers", reason="the extra foxglove is not installed")

from robo.bridges.foxglove.drivers import PAUSE  # noqa: E402
from robo.bridges.foxglove.server import Settings  # noqa: E402 (its library may be missing)

pytestmark = pytest.mark.timeout(60)
TOKENS = Tokens(view="look-look-look", drive="drive-drive-drive")
TOPIC = "/r1/cmd_vel_joy"
NOTHING = b"\x00\x01\x00\x00"


class Safety(Node):
    """Stops, and does something that takes a while."""

    @service("emergency_stop")
    def stop(self, _: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(True, "stopped")

    @service("reset_emergency_stop")
    def reset(self, _: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(True, "released")

    @service("lights")
    def lights(self, _: SetBool.Request) -> SetBool.Response:
        raise ServiceError("there are none")


@pytest.fixture
def safety(other: zenoh.Session) -> Iterator[Safety]:
    with Safety(namespace="r1", session=other) as node:
        yield node


@pytest.fixture
def served(session: zenoh.Session) -> Iterator[Any]:
    with closing(viewers.Served(session)) as found:
        yield found


@pytest.fixture
def commands(other: zenoh.Session) -> Iterator[Stream]:
    with closing(Stream(other, [TOPIC[1:]])) as stream:
        yield stream


def twist(x: float, schema: str = "geometry_msgs/Twist") -> bytes:
    linear = {"linear": {"x": x}}
    stamped = {"header": {"stamp": {"sec": 5}}, "twist": linear}
    return struct.pack("<BI", 1, 5) + msgspec.json.encode(stamped if "Stamped" in schema else linear)


def offer(viewer: Any, schema: str = "geometry_msgs/Twist", topic: str = TOPIC) -> None:
    viewer.ask("advertise", channels=[{"id": 5, "topic": topic, "encoding": "json", "schemaName": schema}])


def speed(stream: Stream, patience: float = 30.0) -> float | None:
    """The next command's; None where none comes within so many seconds."""
    arrival = stream.get(time.monotonic() + patience)
    return None if arrival is None else robo_messages.decode(arrival.sample.payload.to_bytes(), Twist).linear.x


def begin(viewer: Any, stream: Stream, x: float = 0.1) -> None:
    """Drive until the robot hears of it: on a busy machine the first commands may be refused as too old."""
    offer(viewer)
    heard = threading.Event()

    def command() -> None:
        while not heard.is_set():
            viewer.send(twist(x))
            heard.wait(0.05)

    thread = threading.Thread(target=command)
    thread.start()
    try:
        while speed(stream) != x:
            pass  # a zero of before
    finally:
        heard.set()
        thread.join()


def zeros(stream: Stream) -> int:
    """So many zeros follow on commands that still come."""
    while speed(stream):
        pass
    count = 1
    while (found := speed(stream, 0.4)) is not None:
        assert found == 0.0
        count += 1
    return count


def test_an_emergency_stop_waits_for_no_question_of_any_viewer(
    session: zenoh.Session, other: zenoh.Session, safety: Safety
) -> None:
    del safety
    held = list[zenoh.Query]()  # which are never answered
    stuck = other.declare_queryable(parameters_key("r1", "stuck", "describe"), held.append)
    with (
        closing(viewers.Served(session, Settings(port=0, tokens=TOKENS))) as served,
        served.viewer(f"/?token={TOKENS.drive}") as viewer,
        served.viewer(f"/?token={TOKENS.view}") as looker,
        served.viewer(f"/?token={TOKENS.drive}") as second,
    ):
        viewer.call("/r1/emergency_stop", NOTHING)
        viewer.answer()
        for asking, count in ((looker, 12), (second, 40)):
            for _ in range(count):
                asking.ask("getParameters", parameterNames=["/r1/stuck.x"], id="x")
        eventually(lambda: len(held) > 10, "the bridge asks")
        begun = time.monotonic()
        viewer.call("/r1/emergency_stop", NOTHING)
        viewer.answer()
        took = time.monotonic() - begun
        assert "wait for an answer already" in looker.hears("status", lambda one: one["level"] == 2)["message"]
        for _ in range(40):
            second.hears("parameterValues")
    stuck.undeclare()
    assert took < 0.7


def test_a_robot_whose_stop_hangs_is_in_the_way_of_no_other_and_is_told_by_its_topic(
    served: Any, other: zenoh.Session, safety: Safety
) -> None:
    del safety
    let_go = threading.Event()

    class Hanging(Node):
        @service("emergency_stop")
        def stop(self, _: Trigger.Request) -> Trigger.Response:
            let_go.wait(30)
            return Trigger.Response(True, "late")

    with (
        Hanging(namespace="r2", session=other),
        closing(Stream(other, ["r2/emergency_stop"])) as topic,
        served.viewer() as viewer,
    ):
        for number in range(8):
            viewer.call("/r2/emergency_stop", NOTHING, call=number)
        viewer.call("/r1/emergency_stop", b"{}", "json", call=9)
        call, _, data = viewer.answer()
        assert (call, msgspec.json.decode(data)) == (9, {"success": True, "message": "stopped"})
        said = topic.get(time.monotonic() + 20)
        assert said is not None
        assert robo_messages.decode(said.sample.payload.to_bytes(), Bool) == Bool(True)
        let_go.set()
        assert {viewer.answer()[0] for _ in range(8)} == {*range(8)}


def test_what_waits_for_the_network_is_in_the_way_of_no_stop_and_is_not_sent_once_the_viewer_is_gone(
    served: Any, safety: Safety, monkeypatch: pytest.MonkeyPatch
) -> None:
    del safety
    gate, sent = threading.Event(), list[float]()

    def send(_: object, payload: bytes) -> None:
        """As where the link is held up."""
        gate.wait(30)
        sent.append(robo_messages.decode(payload, Twist).linear.x)

    monkeypatch.setattr(publishing.Sender, "send", send)
    with contextlib.closing(served), served.viewer() as viewer:
        offer(viewer)
        for _ in range(150):
            viewer.send(twist(0.5))
        assert "held up" in viewer.hears("status")["message"]
        viewer.call("/r1/emergency_stop", NOTHING)
        viewer.answer()
        viewer.socket.close()
        eventually(lambda: any("is gone" in line for line in served.told), "the bridge lets it go")
        gate.set()
    assert [x for x in sent if x] in ([0.5], [])  # the one that had begun
    assert sent[1:] == [0.0] * len(sent[1:])


def test_commands_that_a_link_has_kept_are_refused_and_zeros_pass(served: Any, commands: Stream) -> None:
    with proxy(served.port) as (port, hold):
        address = f"ws://127.0.0.1:{port}/"
        with viewers.client.connect(address, subprotocols=[viewers.SDK], max_size=None) as found:
            viewer = viewers.Viewer(found)
            begin(viewer, commands)
            zeros(commands)
            hold.set()
            for _ in range(10):
                viewer.send(twist(0.5))
            viewer.send(twist(0.0))
            time.sleep(1.0)  # so old they become; nothing tells of it
            hold.clear()
            assert speed(commands) == 0.0
            assert "too late" in viewer.hears("status")["message"]
            begin(viewer, commands)


@contextlib.contextmanager
def proxy(port: int) -> Iterator[tuple[int, threading.Event]]:
    """A link that passes nothing on while the event is set."""
    hold = threading.Event()
    ends: list[socket.socket] = []
    threads: list[threading.Thread] = []

    def pump(taken: socket.socket, given: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := taken.recv(65536):
                while hold.is_set():
                    time.sleep(0.01)
                given.sendall(data)
            given.shutdown(socket.SHUT_WR)

    def accept(listener: socket.socket) -> None:
        taken, given = listener.accept()[0], socket.create_connection(("127.0.0.1", port))
        ends.extend((taken, given))
        for pair in ((taken, given), (given, taken)):
            threads.append(threading.Thread(target=pump, args=pair))
            threads[-1].start()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threads.append(threading.Thread(target=accept, args=(listener,)))
        threads[0].start()
        try:
            yield listener.getsockname()[1], hold
        finally:
            hold.clear()
            for end in ends:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
            for thread in threads:
                thread.join()
            for end in ends:
                end.close()


def test_a_pad_that_is_let_go_stops_the_robot_and_a_viewer_that_goes_later_says_nothing(
    served: Any, commands: Stream
) -> None:
    with served.viewer() as viewer:
        begin(viewer, commands)
        assert zeros(commands) >= 3
    eventually(lambda: any("is gone" in line for line in served.told), "the bridge lets it go")
    assert speed(commands, 0.5) is None


def press(viewer: Any, _: zenoh.Session) -> None:
    viewer.call("/r1/emergency_stop", NOTHING)
    viewer.answer()


def release(viewer: Any, _: zenoh.Session) -> None:
    viewer.call("/r1/reset_emergency_stop", NOTHING)
    viewer.answer()


def ask_by_topic(_: Any, other: zenoh.Session) -> None:
    other.put("r1/emergency_stop", robo_messages.encode(Bool(True)), encoding=codec.encoding_of(Bool))


def tell_by_state(_: Any, other: zenoh.Session) -> None:
    state = DiagnosticStatus(values=[KeyValue("reason", "emergency_stop")])
    other.put("r1/safety_state", robo_messages.encode(state), encoding=codec.encoding_of(DiagnosticStatus))


@pytest.mark.parametrize("stop", [press, release, ask_by_topic, tell_by_state])
def test_a_pad_that_is_held_drives_no_more_after_a_stop_until_it_was_let_go(
    served: Any, other: zenoh.Session, safety: Safety, commands: Stream, stop: Callable[[Any, zenoh.Session], None]
) -> None:
    del safety
    with served.viewer() as viewer:
        with holding(viewer):
            while speed(commands) != 0.1:
                pass
            # Neither of these stops it.
            other.put("r1/emergency_stop", robo_messages.encode(Bool(False)), encoding=codec.encoding_of(Bool))
            other.put("r2/emergency_stop", robo_messages.encode(Bool(True)), encoding=codec.encoding_of(Bool))
            other.put("r1/emergency_stop", b"?")
            for _ in range(5):
                while speed(commands) != 0.1:
                    pass  # a zero, where the machine was busy
            stop(viewer, other)
            assert "let go" in viewer.hears("status", lambda one: "grip" in one["message"])["message"]
            assert zeros(commands) >= 3
            assert speed(commands, 0.5) is None

        def takes_hold_anew() -> bool:
            time.sleep(PAUSE + 0.5)  # nothing tells of a hand that is let go
            with holding(viewer):
                return speed(commands, 0.5) == 0.1

        assert any(takes_hold_anew() for _ in range(8))


@contextlib.contextmanager
def holding(viewer: Any) -> Iterator[None]:
    """A hand that holds the pad."""
    offer(viewer)
    let_go = threading.Event()

    def command() -> None:
        while not let_go.is_set():
            viewer.send(twist(0.1))
            let_go.wait(0.05)

    thread = threading.Thread(target=command)
    thread.start()
    try:
        yield
    finally:
        let_go.set()
        thread.join()


def test_two_viewers_do_not_drive_in_turns(served: Any, commands: Stream) -> None:
    with served.viewer() as viewer, served.viewer() as second:
        offer(second)
        begin(viewer, commands, 0.1)
        second.send(twist(0.7))
        assert "viewer 1 drives" in second.hears("status")["message"]
        assert zeros(commands) >= 3
        eventually(lambda: drives(second, commands), "the first one drives no more")


def drives(viewer: Any, stream: Stream) -> bool:
    viewer.send(twist(0.7))
    return bool(speed(stream, 0.1))


def test_a_zero_with_a_time_has_that_of_now(served: Any, other: zenoh.Session) -> None:
    schema = "geometry_msgs/msg/TwistStamped"
    with closing(Stream(other, ["r1/cmd_vel"])) as stream, served.viewer() as viewer:
        offer(viewer, schema, "/r1/cmd_vel")
        while True:
            viewer.send(twist(0.5, schema))
            if (arrival := stream.get(time.monotonic() + 0.1)) is not None:
                break
        while (said := robo_messages.decode(arrival.sample.payload.to_bytes(), TwistStamped)).twist != Twist():
            assert said.header.stamp.sec == 5
            arrival = stream.get()
            assert arrival is not None
        assert abs(said.header.stamp.sec - time.time()) < 60


def test_a_call_that_fails_is_answered_where_the_answer_can_say_so(served: Any, safety: Safety) -> None:
    """Lichtblick waits for an answer for ever where it is told of a failure: its button would be dead."""
    del safety
    with served.viewer() as viewer:
        viewer.call("/r1/lights", b'{"data": true}', "json", call=9)
        call, _, data = viewer.answer()
        said = msgspec.json.decode(data)
        assert (call, said["success"]) == (9, False)
        assert "there are none" in said["message"]
        assert "there are none" in viewer.hears("status", lambda one: one["level"] == 2)["message"]


def test_a_stop_that_is_just_gone_is_answered(served: Any, other: zenoh.Session) -> None:
    with served.viewer() as viewer:
        with Safety(namespace="r1", session=other):
            viewer.until(lambda: viewer.services.get("/r1/emergency_stop"))
        viewer.hears("unadvertiseServices")
        viewer.call("/r1/emergency_stop", b"{}", "json")
        assert "not there any more" in msgspec.json.decode(viewer.answer()[2])["message"]
