"""The server of the page, as a browser and others meet it."""

import gc
import math
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import zenoh

import robo_messages
from robo.dashboard.hub import Hub
from robo.dashboard.place import Settings
from robo.dashboard.server import COOKIE, Dashboard
from robo.dashboard.topics import MOST_PAYLOAD
from robo.errors import UsageError
from robo.samples.publishing import Sender
from robo.samples.stream import Stream
from robo.wire.qos import QoS
from robo_messages import Point, String, TFMessage, Transform, TransformStamped
from tests.served import TOKENS, Served, twists
from tests.support import Running, eventually, plain_environment

exceptions = pytest.importorskip("websockets.exceptions")

pytestmark = pytest.mark.timeout(30)


@pytest.fixture
def served(session: zenoh.Session) -> Iterator[Served]:
    with closing(Served(session, Settings(port=0))) as found:
        yield found


@pytest.fixture
def guarded(session: zenoh.Session) -> Iterator[Served]:
    with closing(Served(session, Settings(port=0, tokens=TOKENS))) as found:
        yield found


def test_the_page_has_all_its_files_and_loads_nothing_from_elsewhere(served: Served) -> None:
    answer = served.get("/")
    assert (answer.status, answer.headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert served.get("/panels/map.js").headers["Content-Type"] == "text/javascript; charset=utf-8"
    assert served.get("/style.css").status == 200


@pytest.mark.parametrize(
    "path", ["/../server.py", "/%2e%2e/server.py", "/panels/../../server.py", "//etc/passwd", "/panels", "/socket"]
)
def test_nothing_else_is_served(served: Served, path: str) -> None:
    assert served.get(path).status in (404, 426)


def test_a_foreign_name_and_a_foreign_page_are_refused(served: Served) -> None:
    assert served.get("/", Host="evil.example").status == 421
    with pytest.raises(exceptions.InvalidStatus) as refused, served.page(origin="http://evil.example"):
        pass
    assert refused.value.response.status_code == 403
    with served.page(origin=f"http://127.0.0.1:{served.port}") as page:
        page.hears("welcome")


def test_without_a_token_there_is_nothing(guarded: Served) -> None:
    for path in ("/", "/main.js", "/socket"):
        assert guarded.get(path).status == 401
    with pytest.raises(exceptions.InvalidStatus), guarded.page():
        pass
    answer = guarded.get(f"/?token={TOKENS.drive}")
    assert (answer.status, answer.headers["Location"]) == (303, "/")
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly; SameSite=Lax" in cookie, "a link in a mail lets in"
    assert TOKENS.drive not in cookie, "cookies go to all ports of a host"
    assert guarded.get("/main.js", Cookie=cookie.partition(";")[0]).status == 200
    assert guarded.get("/main.js", Cookie=f'prefs={{"a":1}}; {cookie.partition(";")[0]}').status == 200
    assert guarded.get("/main.js", Cookie=f"{COOKIE.format(port=guarded.port)}={TOKENS.drive}").status == 401


def test_guesses_are_slowed_down(guarded: Served) -> None:
    codes = [guarded.get(f"/?token=guess{number}").status for number in range(10)]
    assert codes == [401] * 6 + [429] * 4
    answer = guarded.get(f"/?token={TOKENS.drive}")
    assert (answer.status, answer.headers["Retry-After"]) == (429, "1")


def own_address() -> str:
    """An address of this machine that others reach; another one of loopback where it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect(("192.0.2.1", 9))  # sends nothing
        except OSError:
            return "127.0.0.2"
        return str(asking.getsockname()[0])


def test_from_another_address_there_is_nothing_without_the_token(session: zenoh.Session) -> None:
    host = own_address()
    with closing(Served(session, Settings("0.0.0.0", 0, TOKENS))) as everywhere:
        for path in ("/", "/main.js", "/socket", "/?token=wrong"):
            assert everywhere.get(path, host).status == 401
        with pytest.raises(exceptions.InvalidStatus), everywhere.page(host=host):
            pass
        cookie = everywhere.cookie(TOKENS.drive)
        assert everywhere.get("/main.js", host, **cookie).status == 200
        with everywhere.page(host=host, additional_headers=cookie) as page:
            assert page.hears("welcome")["drives"]


def test_a_foreign_page_gets_no_socket_though_the_browser_has_been_let_in(guarded: Served) -> None:
    cookie = guarded.cookie(TOKENS.drive)
    for origin in ("http://evil.example", "null", f"http://localhost:{guarded.port}", "http://127.0.0.1:1"):
        with pytest.raises(exceptions.InvalidStatus) as refused, guarded.page(origin=origin, additional_headers=cookie):
            pass
        assert refused.value.response.status_code == 403
    with guarded.page(origin=f"http://127.0.0.1:{guarded.port}", additional_headers=cookie) as page:
        page.hears("welcome")


def test_a_thousand_wrong_tokens_hold_up_who_guesses_and_nobody_else(guarded: Served) -> None:
    cookie = guarded.cookie(TOKENS.drive)
    begin = time.monotonic()
    codes = [guarded.get(f"/?token=guess{number}").status for number in range(1000)]
    # Five that cost nothing, and then one after 1, 2, 4 … s.
    assert codes.count(401) <= 6 + math.log2(2 + time.monotonic() - begin)
    assert set(codes) == {401, 429}
    assert guarded.get(f"/?token={TOKENS.drive}").status == 429
    assert guarded.get("/main.js", **cookie).status == 200, "who has been let in goes on"
    assert guarded.get(f"/?token={TOKENS.drive}", "127.0.0.2").status == 303, "somebody else is not held up"


def test_a_node_keeps_its_tokens_out_of_the_log(tmp_path: Path) -> None:
    words = ["run", "robo_services.dashboard", "-p", "host:=0.0.0.0", "-p", "port:=0", "-p", "names:=[r1.local]"]
    environment = plain_environment() | {"ROBO_MEMORY": str(tmp_path)}
    tokens = tmp_path / "dashboard.tokens"
    for _ in range(2):
        running = Running([sys.executable, "-m", "robo", *words], env=environment)
        try:
            line = running.wait_for("its tokens, a line to drive and one to look, are in")
            assert str(tokens) in line
            assert "http://r1.local:" in running.output
            drive, look = tokens.read_text().split()
            assert drive not in running.output
            assert look not in running.output
            assert tokens.stat().st_mode & 0o777 == 0o600
        finally:
            running.close()
    assert tokens.read_text().split() == [drive, look], "they outlive a restart"


def test_who_may_only_look_moves_nothing(guarded: Served, other: zenoh.Session) -> None:
    stream = Stream(other, ["r1/cmd_vel_dashboard"])
    with guarded.page(additional_headers=guarded.cookie(TOKENS.view)) as page:
        assert not page.hears("welcome")["drives"]
        page.hears("beat")
        page.drive(0.5)
        assert page.hears("refused")["reason"] == "this page may look and not drive"
        page.ask(do="call", id=1, service="r1/emergency_stop", type="std/Trigger")
        assert page.hears("refused")["id"] == 1
        page.ask(do="command", id=2, robot="r1", verb="stop", node="base")
        assert page.hears("refused")["id"] == 2
    assert not stream.waiting
    stream.close()


def test_one_drives_and_when_it_is_gone_the_robot_stands(served: Served, other: zenoh.Session) -> None:
    with closing(Stream(other, ["r1/cmd_vel_dashboard"])) as stream:
        with served.page() as page, served.page() as second:
            page.hears("beat")
            page.drive(0.5)
            assert twists(stream, 1) == [0.5]
            second.hears("drivers", lambda news: news["drivers"] == {"r1": page.name})
            second.hears("beat")
            second.drive(-1.0)
            assert second.hears("refused")["reason"] == f"{page.name} drives r1"
            page.drive(0.4)
            said = twists(stream, 2)
            while said[-2:] != [0.4, 0.0]:  # zeros may come between: commands have ceased for a moment
                assert -1.0 not in said
                said += twists(stream, 1)
        assert twists(stream, 4) == [0.0] * 4


def test_an_old_command_is_refused(served: Served, other: zenoh.Session) -> None:
    with closing(Stream(other, ["r1/cmd_vel_dashboard"])) as stream, served.page() as page:
        first = page.hears("beat")["number"]
        page.drive(0.5, heard=first + 1000)
        assert "ms old" in page.hears("refused")["reason"]
        for _ in range(8):
            page.hears("beat")
        page.drive(0.5, heard=first)
        assert "ms old" in page.hears("refused")["reason"]
        page.drive(1e9)
        assert page.hears("refused")["reason"] == "so fast drives no robot"
        page.drive(0.1)
        assert twists(stream, 1) == [0.1]


@pytest.mark.parametrize("word", ['{"do": "explode"}', "[" * 90_000, '{"do": "read", "count": -1}', "\x00"])
def test_a_word_that_is_none_ends_the_page_alone(served: Served, word: str) -> None:
    with served.page() as page, served.page() as second:
        page.socket.send(word)
        with pytest.raises(exceptions.ConnectionClosed) as closed:
            page.hears("the end")
        assert closed.value.rcvd.code == 1007
        second.hears("beat")


@pytest.mark.parametrize("robot", ["**", "*", "r1/", "/r1", "r1//x", "@robo", "r1/$*", "x" * 60_000])
def test_nobody_drives_several_robots_by_a_pattern(served: Served, other: zenoh.Session, robot: str) -> None:
    with closing(Stream(other, ["**/cmd_vel_dashboard"])) as stream, served.page() as page:
        page.hears("beat")
        page.drive(0.1, robot=robot)
        assert page.hears("refused")["reason"] == "that is no name of a robot"
        page.ask(do="call", id=1, service=f"{robot}/emergency_stop", type="std/Trigger")
        assert "is no full name" in page.hears("refused")["reason"]
        page.ask(do="publish", id=2, topic="**", type="std/Bool", message={"data": True})
        assert "is no full name" in page.hears("refused")["reason"]
        page.hears("beat")
        page.drive(0.1)  # others are driven as ever
        assert twists(stream, 1) == [0.1]


def test_who_asks_for_too_much_is_refused_and_may_stop_the_robot_all_the_same(
    served: Served, other: zenoh.Session
) -> None:
    held: list[zenoh.Query] = []
    slow = other.declare_queryable("r1/slow", held.append, complete=True)
    stop = other.declare_queryable(
        "r1/emergency_stop",
        lambda query: query.reply("r1/emergency_stop", robo_messages.encode(String("stopped"))),
        complete=True,
    )
    with served.page() as page:
        page.hears("welcome")
        for number in range(100):
            page.ask(do="call", id=number, service="r1/slow", type="std/Trigger")
        page.ask(do="call", id=1000, service="r1/emergency_stop", type="std/Trigger")
        said = [page.take() for _ in range(61)]
        answers = [one for one in said if isinstance(one, dict) and one.get("id") is not None]
        while not any(one["id"] == 1000 for one in answers):
            one = page.take()
            answers += [one] if isinstance(one, dict) and one.get("id") is not None else []
        assert next(one for one in answers if one["id"] == 1000)["answer"] == {"data": "stopped"}
        assert "too much is asked for at once" in {one.get("reason") for one in answers}
    for query in held:
        query.drop()
    slow.undeclare()
    stop.undeclare()


def test_without_tokens_no_word_of_a_visitor_comes_back(served: Served) -> None:
    answer = served.get("/?token=a%0d%0aX-Made-Up:%20yes")
    assert (answer.status, answer.headers["Set-Cookie"], answer.headers["X-Made-Up"]) == (303, None, None)
    assert served.get("//[").status == 400


def test_a_page_for_others_needs_a_token(session: zenoh.Session) -> None:
    with pytest.raises(UsageError, match="needs a token"):
        Dashboard(session, Settings("0.0.0.0"))
    with pytest.raises(UsageError, match="needs tokens"):
        Dashboard(session, Settings(names=("*",)))


def test_a_message_that_is_too_large_is_told_and_not_shown(served: Served, other: zenoh.Session) -> None:
    sender = Sender(other, "r1/image", "std/String", QoS.DEFAULT, "/r1/camera")
    with served.page() as page:
        page.ask(do="watch", keys=["r1/image"])
        sender.wait_for_subscriber()
        sender.send(bytes(MOST_PAYLOAD + 1))
        assert page.gets("r1/image") == b""
    sender.close()


def test_topics_come_as_they_are_and_latched_ones_to_each_page(served: Served, other: zenoh.Session) -> None:
    state = Sender(other, "r1/state", "std/String", QoS(latched=True), "/r1/base")
    state.send(robo_messages.encode(String("ready")))
    for _ in range(2):
        with served.page() as page:
            page.ask(do="watch", keys=["r1/state", "r1/position"])
            assert robo_messages.decode(page.gets("r1/state"), String).data == "ready"
            sender = Sender(other, "r1/position", "geometry/Point", QoS.DEFAULT, "/r1/base")
            sender.wait_for_subscriber()
            for number in range(100):
                sender.send(robo_messages.encode(Point(x=float(number))))
            while robo_messages.decode(page.gets("r1/position"), Point).x != 99.0:
                pass
            assert ("r1/state", "application/msgpack;std/String") in page.channels.values()
            sender.close()
    state.close()


def test_frames_of_all_who_say_them_come_together(served: Served, other: zenoh.Session) -> None:
    senders = [Sender(other, "r1/tf_static", "tf2/TFMessage", QoS(latched=True), f"/r1/{name}") for name in "ab"]
    for sender, child in zip(senders, ("laser", "camera"), strict=True):
        transform = TransformStamped(child_frame_id=child, transform=Transform())
        transform.header.frame_id = "base_link"
        sender.send(robo_messages.encode(TFMessage([transform])))
    for _ in range(2):
        with served.page() as page:
            page.ask(do="watch", keys=[], frames=["r1"])
            frames = page.hears("frames", lambda news: len(news["frames"]) == 2)["frames"]
            assert frames["laser"]["parent"] == frames["camera"]["parent"] == "base_link"
    for sender in senders:
        sender.close()


def test_transforms_are_messages_too_for_who_wants_them(served: Served, other: zenoh.Session) -> None:
    sender = Sender(other, "r1/tf_static", "tf2/TFMessage", QoS(latched=True), "/r1/base")
    said = robo_messages.encode(TFMessage([TransformStamped(child_frame_id="laser")]))
    sender.send(said)
    with served.page() as page:
        page.ask(do="watch", keys=[], frames=["r1"])
        page.hears("frames", lambda news: "laser" in news["frames"])
        page.ask(do="watch", keys=["r1/tf_static"], frames=["r1"])
        assert page.gets("r1/tf_static") == said
    sender.close()


def test_a_latched_publisher_that_comes_late_or_comes_again_is_heard(served: Served, other: zenoh.Session) -> None:
    with served.page() as page:
        page.ask(do="watch", keys=["r1/state"])
        page.hears("beat")
        for word in ("first", "second"):
            sender = Sender(other, "r1/state", "std/String", QoS(latched=True), "/r1/base")
            sender.send(robo_messages.encode(String(word)))
            while robo_messages.decode(page.gets("r1/state"), String).data != word:
                pass
            sender.close()


def test_of_changed_parameters_each_counts(served: Served, other: zenoh.Session) -> None:
    sender = Sender(other, "r1/parameter_events", "system/ParameterEvent", QoS.DEFAULT, "/r1/base")
    with served.page() as page:
        page.ask(do="watch", keys=["r1/parameter_events"])
        sender.wait_for_subscriber()
        for number in range(30):
            sender.send(robo_messages.encode(String(str(number))))
        found = [robo_messages.decode(page.gets("r1/parameter_events"), String).data for _ in range(30)]
        assert found == [str(number) for number in range(30)]
    sender.close()


def test_a_page_that_reads_nothing_holds_up_nobody(served: Served, other: zenoh.Session) -> None:
    sender = Sender(other, "r1/image", "std/String", QoS.DEFAULT, "/r1/camera")
    picture = robo_messages.encode(String("x" * 1_000_000))
    with served.page(max_size=None) as stalled, served.page(max_size=None) as page:
        for one in (stalled, page):
            one.ask(do="watch", keys=["r1/image"])
        sender.wait_for_subscriber()
        for _ in range(20):
            sender.send(picture)
            page.gets("r1/image")
        page.hears("beat")
    sender.close()


def test_services_are_called_and_their_refusals_told(served: Served, other: zenoh.Session) -> None:
    def answer(query: zenoh.Query) -> None:
        query.reply("r1/greet", robo_messages.encode(String("hello")), encoding="application/msgpack;std/String")

    service = other.declare_queryable("r1/greet", answer, complete=True)
    with served.page() as page:
        page.ask(do="call", id=7, service="r1/greet", type="std/Trigger")
        assert page.hears("answer") == {"kind": "answer", "id": 7, "answer": {"data": "hello"}}
        page.ask(do="parameters", id=8, node="/r1/nobody")
        assert page.hears("refused")["reason"].startswith("there is no node /r1/nobody")
        page.ask(do="publish", id=9, topic="r1/waypoints", type="nav/Path", message={"poses": 3})
        assert "poses" in page.hears("refused")["reason"]
    service.undeclare()


def test_it_ends_at_once_while_pages_are_open(session: zenoh.Session) -> None:
    served = Served(session, Settings(port=0))
    with served.page() as page:
        page.hears("beat")
        served.close()
        eventually(lambda: page.socket.state.name == "CLOSED", "the socket is closed")


def test_it_ends_without_a_word_while_a_stop_is_not_answered(
    session: zenoh.Session, other: zenoh.Session, caplog: pytest.LogCaptureFixture
) -> None:
    held: list[zenoh.Query] = []
    hangs = other.declare_queryable("r1/emergency_stop", held.append, complete=True)
    served = Served(session, Settings(port=0))
    with served.page() as page:
        page.ask(do="call", id=1, service="r1/emergency_stop", type="std/Trigger")
        eventually(lambda: bool(held), "it is asked for")
        begin = time.monotonic()
        served.close()
        assert time.monotonic() - begin < 4.0
    held.pop().drop()
    hangs.undeclare()
    eventually(
        lambda: not any(thread.name.startswith("robo-dashboard-stop") for thread in threading.enumerate()),
        "its thread has ended",
    )
    del served
    gc.collect()
    assert not [record.getMessage() for record in caplog.records if record.name == "asyncio"]


def test_beats_go_on_whatever_becomes_of_one(
    served: Served, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    beat = Hub.beat
    failures = [ValueError("nobody has thought of it")]

    def fail_once(hub: Hub) -> None:
        if failures:
            raise failures.pop()
        beat(hub)

    with served.page() as page:
        page.hears("beat")
        monkeypatch.setattr(Hub, "beat", fail_once)
        eventually(lambda: not failures, "one fails")
        page.hears("beat", lambda _: "nobody has thought of it" in caplog.text)
