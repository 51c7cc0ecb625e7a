"""Driving from pages: stops, grips, leases, robots that are gone, and everybody who would spoil it."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from typing import Any

import pytest
import zenoh

import robo_messages
from robo.dashboard.place import Settings
from robo.samples.stream import Stream
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Bool, String, Twist
from tests.served import TOKENS, Held, Served, twists
from tests.support import eventually

exceptions = pytest.importorskip("websockets.exceptions", reason="the extra dashboard is not installed")
pytestmark = pytest.mark.timeout(60)


@pytest.fixture
def served(session: zenoh.Session) -> Iterator[Served]:
    with closing(Served(session, Settings(port=0))) as found:
        yield found


class Motions:
    """What is commanded on a topic, all of it."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.said: list[tuple[float, float]] = []
        self._end = session.declare_subscriber(key, self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.said.append((time.monotonic(), robo_messages.decode(sample.payload.to_bytes(), Twist).linear.x))

    def since(self, begin: float) -> list[float]:
        return [linear for at, linear in self.said if at >= begin]

    def close(self) -> None:
        self._end.undeclare()


@contextmanager
def monitor(session: zenoh.Session, robot: str, *services: str) -> Iterator[None]:
    """A robot's services that answer at once."""

    def answer(name: str, query: zenoh.Query) -> None:
        query.reply(f"{robot}/{name}", robo_messages.encode(String(name)))

    ends = [session.declare_queryable(f"{robot}/{name}", partial(answer, name), complete=True) for name in services]
    yield
    for end in ends:
        end.undeclare()


@pytest.mark.parametrize("has_monitor", [True, False])
def test_a_stop_and_a_reset_end_everybodys_grip(served: Served, other: zenoh.Session, has_monitor: bool) -> None:
    services = ("emergency_stop", "reset_emergency_stop") if has_monitor else ()
    with (
        monitor(other, "r1", *services),
        closing(Motions(other, "r1/cmd_vel_dashboard")) as motions,
        served.page() as page,
        served.page() as second,
    ):
        with closing(Held(page, 0.5)) as held:
            eventually(lambda: motions.since(0.0).count(0.5) > 2, "it is driven")
            second.ask(do="call", id=1, service="r1/emergency_stop", type="std/Trigger")
            told = second.answer(1)
            assert told == (
                "{'data': 'emergency_stop'}" if has_monitor else "NOT STOPPED: r1 has no service r1/emergency_stop"
            )
            stopped = time.monotonic()
            eventually(lambda: motions.since(0.0)[-3:] == [0.0] * 3, "it is told to stand three times")
            eventually(lambda: "it takes a new grip" in held.refusals, "who holds on is told so")
            second.ask(do="call", id=2, service="r1/reset_emergency_stop", type="std/Trigger")
            second.answer(2)
            count = len(held.refusals)
            eventually(lambda: len(held.refusals) > count + 5, "it is commanded on")
            assert 0.5 not in motions.since(stopped)
        page.hears("drivers", lambda news: news["drivers"] == {}) if page.grip == 0 else None
        page.drive(0.4)
        eventually(lambda: 0.4 in motions.since(stopped), "a new grip drives")


def test_a_grip_that_began_while_the_robot_was_stopped_ends_with_the_reset(
    served: Served, other: zenoh.Session
) -> None:
    with (
        monitor(other, "r1", "emergency_stop", "reset_emergency_stop"),
        closing(Stream(other, ["r1/cmd_vel_dashboard"])) as stream,
        served.page() as page,
    ):
        page.ask(do="call", id=1, service="r1/emergency_stop", type="std/Trigger")
        page.answer(1)
        page.hears("beat")
        held = page.grip
        page.drive(0.5)
        assert twists(stream, 1) == [0.5]
        page.ask(do="call", id=2, service="r1/reset_emergency_stop", type="std/Trigger")
        page.answer(2)
        page.hears("beat")
        page.drive(0.5, grip=held)
        assert page.hears("refused")["reason"] == "it takes a new grip"


def test_a_stop_is_said_on_the_topic_too(served: Served, other: zenoh.Session) -> None:
    with closing(Stream(other, ["r1/emergency_stop"])) as stream, served.page() as page:
        page.hears("beat")
        page.ask(do="call", id=1, service="r1/emergency_stop", type="std/Trigger")
        arrival = stream.get()
        assert arrival is not None
        assert robo_messages.decode(arrival.sample.payload.to_bytes(), Bool).data
        assert page.answer(1) == "NOT STOPPED: r1 has no service r1/emergency_stop"


def test_a_robot_that_hangs_holds_up_no_other_ones_stop(served: Served, other: zenoh.Session) -> None:
    held: list[zenoh.Query] = []
    hangs = other.declare_queryable("r1/emergency_stop", held.append, complete=True)
    with monitor(other, "r2", "emergency_stop"), served.page() as page:
        page.hears("beat")
        for number in range(30):
            page.ask(do="call", id=number, service="r1/emergency_stop", type="std/Trigger")
        begin = time.monotonic()
        page.ask(do="call", id=100, service="r2/emergency_stop", type="std/Trigger")
        assert page.answer(100) == "{'data': 'emergency_stop'}"
        assert time.monotonic() - begin < 3.0
        assert len(held) == 2
        assert page.answer(29) == "NOT CONFIRMED: r1/emergency_stop has not answered within 5 s"
    for query in held:
        query.drop()
    hangs.undeclare()


def test_two_dashboards_of_one_network_share_the_lease(served: Served, other: zenoh.Session, endpoint: str) -> None:
    own = open_session(Network(mode="client", connect=(endpoint,)))
    with (
        closing(Served(own, Settings(port=0))) as elsewhere,
        closing(Motions(other, "r1/cmd_vel_dashboard")) as motions,
        served.page() as page,
        elsewhere.page() as second,
    ):
        with closing(Held(page, 0.5)):
            eventually(lambda: 0.5 in motions.since(0.0), "the one drives")
            second.hears("drivers", lambda news: "another dashboard, /r1/dashboard_" in news["drivers"].get("r1", ""))
            second.drive(-0.5)
            assert second.hears("refused")["reason"].startswith("another dashboard, /r1/dashboard_")
        assert -0.5 not in motions.since(0.0)
        page.ask(do="release")
        with closing(Held(second, -0.5)) as held:
            eventually(lambda: -0.5 in motions.since(0.0) or len(held.refusals) > 30, "then the other one does")
            assert -0.5 in motions.since(0.0), held.refusals
    close_session(own)


@pytest.mark.parametrize("has_monitor", [True, False])
def test_a_stop_at_one_dashboard_ends_the_grip_at_another_one(
    served: Served, other: zenoh.Session, endpoint: str, has_monitor: bool
) -> None:
    own = open_session(Network(mode="client", connect=(endpoint,)))
    with (
        monitor(other, "r1", *(["emergency_stop"] if has_monitor else [])),
        closing(Served(own, Settings(port=0))) as elsewhere,
        closing(Motions(other, "r1/cmd_vel_dashboard")) as motions,
        served.page() as page,
        elsewhere.page() as second,
        closing(Held(page, 0.5)) as held,
    ):
        eventually(lambda: motions.since(0.0).count(0.5) > 2, "it is driven")
        second.ask(do="call", id=1, service="r1/emergency_stop", type="std/Trigger")
        second.answer(1)
        eventually(lambda: motions.since(0.0)[-3:] == [0.0] * 3, "it is told to stand")
        stopped = time.monotonic()
        eventually(lambda: held.refusals.count("it takes a new grip") > 5, "who holds on is told so")
        assert 0.5 not in motions.since(stopped)
    close_session(own)


@pytest.mark.parametrize(
    ("payload", "ends"), [(b"\x81\xa4data\xc3", True), (b"\x81\xa4data\xc2", False), (b"\xff", False)]
)
def test_a_stop_that_anybody_says_on_the_topic_ends_grips(
    served: Served, other: zenoh.Session, payload: bytes, ends: bool
) -> None:
    with (
        closing(Motions(other, "r1/cmd_vel_dashboard")) as motions,
        served.page() as page,
        closing(Held(page, 0.5)) as held,
    ):
        eventually(lambda: motions.since(0.0).count(0.5) > 2, "it is driven")
        other.put("r1/emergency_stop", payload)
        count = len(motions.said)
        eventually(lambda: len(held.refusals) > 3 or len(motions.said) > count + 20, "it is refused, or goes on")
        assert ("it takes a new grip" in held.refusals) == ends


@pytest.mark.parametrize(
    "type_name", ["geometry/Twist", "geometry_msgs/Twist", "geometry_msgs/msg/Twist", "", "x/Y", "nav/Path"]
)
def test_nobody_drives_by_publishing(served: Served, other: zenoh.Session, type_name: str) -> None:
    with closing(Motions(other, "r1/*")) as motions, served.page() as page:
        page.hears("beat")
        for number, topic in enumerate(("r1/cmd_vel_dashboard", "r1/cmd_vel_joy", "r1/emergency_stop")):
            message = {"linear": {"x": 9.0, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}
            page.ask(do="publish", id=number, topic=topic, type=type_name, message=message)
            assert "pages publish nothing but waypoints" in page.answer(number)
        assert motions.said == []


def test_a_waypoint_is_for_who_drives(served: Served, other: zenoh.Session) -> None:
    ends = [other.declare_subscriber(f"r1/{name}", lambda _: None) for name in ("cmd_vel_dashboard", "waypoints")]
    with served.page() as page, served.page() as second, closing(Held(page, 0.1)):
        second.hears("drivers", lambda news: news["drivers"] == {"r1": page.name})
        second.ask(do="publish", id=1, topic="r1/waypoints", type="nav/Path", message={})
        assert second.answer(1) == f"{page.name} drives r1"
        second.ask(do="publish", id=2, topic="r2/waypoints", type="nav/Path", message={})
        assert second.answer(2) == "nobody subscribes to r2/waypoints"
    for end in ends:
        end.undeclare()


def test_a_robot_that_does_not_listen_is_not_driven(served: Served, other: zenoh.Session) -> None:
    with served.page() as page, closing(Held(page, 0.5)) as held:
        eventually(lambda: bool(held.refusals), "it is told so")
        assert held.refusals[0].startswith("nobody listens to r1/cmd_vel_dashboard")
    with closing(Motions(other, "r1/cmd_vel_dashboard")) as motions, served.page() as page, closing(Held(page, 0.5)):
        eventually(lambda: motions.since(0.0).count(0.5) > 20, "it listens now, and is driven on")


def test_names_that_are_made_up_leave_room_for_the_robot(served: Served, other: zenoh.Session) -> None:
    with closing(Motions(other, "*/cmd_vel_dashboard")) as motions, served.page() as page:
        page.hears("beat")
        for number in range(100):
            page.drive(0.1, robot=f"made_up_{number}")
        page.ask(do="release")
        with closing(Held(page, 0.5)):
            eventually(lambda: 0.5 in motions.since(0.0), "the robot is driven")


def flood(served: Served, headers: dict[str, str], over: threading.Event) -> None:
    """Somebody who may only look says something again and again, as fast as he can, whatever comes of it."""
    message = b'{"do":"read","count":0}'
    frame = bytes([0x81, 0x80 | len(message), 0, 0, 0, 0]) + message
    while not over.is_set():
        try:
            with served.page(additional_headers=headers) as page:
                while not over.is_set():
                    page.socket.socket.sendall(frame * 4000)
        except (OSError, exceptions.WebSocketException):
            pass  # he has been thrown out, and comes again


def test_a_flood_of_who_may_only_look_holds_up_no_stop(session: zenoh.Session, other: zenoh.Session) -> None:
    over = threading.Event()
    with (
        closing(Served(session, Settings(port=0, tokens=TOKENS))) as served,
        monitor(other, "r1", "emergency_stop"),
        served.page(additional_headers=served.cookie(TOKENS.drive)) as page,
    ):
        page.hears("beat")
        flooder = threading.Thread(target=flood, args=(served, served.cookie(TOKENS.view), over))
        flooder.start()
        times = []
        for number in range(20):
            begin = time.monotonic()
            page.ask(do="call", id=number, service="r1/emergency_stop", type="std/Trigger")
            page.answer(number)
            times.append(time.monotonic() - begin)
        over.set()
        flooder.join(20)
        # Browser, server and flood share one interpreter here.
        assert sorted(times)[len(times) // 2] < 0.2, times


def test_a_page_that_says_too_much_is_closed(served: Served) -> None:
    with served.page() as page, served.page() as second:
        with suppress(exceptions.ConnectionClosed):
            for _ in range(100_000):
                page.ask(do="read", count=0)
        eventually(lambda: page.socket.state.name == "CLOSED", "it is closed")
        assert page.socket.close_reason in ("it says too much", "")
        second.hears("beat")


def test_connections_that_say_nothing_keep_nobody_out(served: Served) -> None:
    idle = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(300)]
    with served.page() as page:
        page.hears("beat")
    idle[0].settimeout(10)
    assert idle[0].recv(1) == b"", "who has waited longest has gone"
    for one in idle:
        one.close()


def test_those_who_look_leave_room_for_a_driver(session: zenoh.Session) -> None:
    with closing(Served(session, Settings(port=0, tokens=TOKENS))) as served:
        view, drive = served.cookie(TOKENS.view), served.cookie(TOKENS.drive)
        pages: list[Any] = [served.page(additional_headers=view) for _ in range(40)]
        opened: list[Callable[..., Any]] = []
        for one in pages:
            one.__enter__().hears("welcome")
            opened.append(one.__exit__)
        with served.page(additional_headers=view) as late, pytest.raises(exceptions.ConnectionClosed):
            late.hears("welcome")
        with served.page(additional_headers=drive) as page:
            page.hears("welcome")
        for close in opened:
            close(None, None, None)


def test_the_robot_stands_first_when_the_server_ends_though_a_page_does_not_go(
    session: zenoh.Session, other: zenoh.Session
) -> None:
    served = Served(session, Settings(port=0))
    with closing(Motions(other, "r1/cmd_vel_dashboard")) as motions, served.page() as page:
        page.hears("beat")
        page.drive(0.5)
        eventually(lambda: 0.5 in motions.since(0.0), "it is driven")
        page.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        begin = time.monotonic()
        served.close()
        first = next(at for at, linear in motions.said if linear == 0.0)
        assert first - begin < 0.5
