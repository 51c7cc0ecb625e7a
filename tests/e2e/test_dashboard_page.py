"""The page in a real browser, at a server of the test: what it does where no robot is seen yet, or it is not seen."""

import shutil
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest
import zenoh

import robo_messages
from robo.dashboard import state
from robo.dashboard.place import Settings
from robo.dashboard.state import Node, Picture
from robo.wire import codec
from robo_messages import DiagnosticStatus, KeyValue, String
from tests.served import Served
from tests.support import PATIENCE, eventually

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("websockets", reason="the extra dashboard is not installed")
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.timeout(60),
]


@pytest.fixture
def seen() -> threading.Event:
    """Robot r1 is seen from when this is set."""
    return threading.Event()


@pytest.fixture
def served(session: zenoh.Session, seen: threading.Event, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    def look(*_: object) -> Picture:
        seen.wait(PATIENCE)
        base = Node("/r1/base", "", "", "ready", "", None, "", None, None, None, None, None, "", "")
        return Picture(["r1"], [base], [])

    monkeypatch.setattr(state, "picture", look)
    with closing(Served(session, Settings(port=0))) as found:
        yield found
        seen.set()


@pytest.fixture
def page() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        found = browser.new_page()
        found.set_default_timeout(PATIENCE * 1000)
        yield found
        browser.close()


@pytest.fixture
def stopped(other: zenoh.Session) -> Iterator[list[str]]:
    """What robots were asked to stop."""
    found: list[str] = []

    def answer(query: zenoh.Query) -> None:
        found.append(str(query.key_expr))
        query.reply(query.key_expr, robo_messages.encode(String("stopped")))

    end = other.declare_queryable("*/emergency_stop", answer, complete=True)
    yield found
    end.undeclare()


def test_a_stop_of_the_robot_that_the_address_names_waits_for_no_look(
    page: Any, served: Served, stopped: list[str]
) -> None:
    page.goto(f"http://127.0.0.1:{served.port}/#r1")
    page.click("#stop")
    eventually(lambda: "r1/emergency_stop" in stopped, "the robot is asked to stop before it is seen")
    page.wait_for_selector("#stop:not(.pending)")
    assert "EMERGENCY STOP" not in page.inner_text("#lost")


def test_a_stop_that_is_pressed_before_a_robot_is_seen_is_sent_once_one_is(
    page: Any, seen: threading.Event, served: Served, stopped: list[str]
) -> None:
    page.goto(f"http://127.0.0.1:{served.port}/")
    page.click("#stop")
    page.locator("#lost", has_text="EMERGENCY STOP NOT SENT: no robot is seen yet").wait_for()
    page.locator("#reset:enabled", has_text="Withdraw stop").wait_for()
    assert stopped == []
    seen.set()
    eventually(lambda: "r1/emergency_stop" in stopped, "the robot is asked to stop")
    page.wait_for_selector("#stop:not(.pending)")
    assert "EMERGENCY STOP" not in page.inner_text("#lost")
    page.click("#stop")
    eventually(lambda: len(stopped) > 1, "and once more")


def test_a_stop_that_is_withdrawn_before_a_robot_is_seen_is_not_sent(
    page: Any, seen: threading.Event, served: Served, stopped: list[str]
) -> None:
    page.goto(f"http://127.0.0.1:{served.port}/")
    page.click("#stop")
    page.locator("#reset:enabled", has_text="Withdraw stop").click()
    seen.set()
    page.locator("select option", has_text="r1").wait_for(state="attached")
    page.wait_for_selector("#stop:not(.pending)")
    assert stopped == []


def test_a_robot_that_is_stopped_stays_so_though_its_simulated_time_stands(
    page: Any, seen: threading.Event, served: Served, other: zenoh.Session
) -> None:
    def is_latched(reason: str) -> bool:
        status = DiagnosticStatus(values=[KeyValue("reason", reason)])
        other.put("r1/safety_state", robo_messages.encode(status), encoding=codec.encoding_of(DiagnosticStatus))
        return bool(page.is_visible("#stop.latched"))

    seen.set()
    page.goto(f"http://127.0.0.1:{served.port}/#r1")
    page.wait_for_selector("#pad:not(.locked)")
    eventually(lambda: is_latched("emergency_stop"), "the page hears that it is stopped")
    page.locator("#stop.latched", has_text="STOPPED (said ").wait_for()
    assert page.is_enabled("#reset")
    assert "driving is locked until its reset" in page.inner_text("#drive")
    eventually(lambda: not is_latched("clear"), "and that it is not any more")
    page.wait_for_selector("#pad:not(.locked)")
    page.wait_for_selector("#reset:disabled")


@contextmanager
def busy(session: zenoh.Session, topics: int) -> Iterator[None]:
    """A robot that says something 25 times a second on each of some topics."""
    over = threading.Event()

    def say() -> None:
        while not over.wait(0.04):
            for number in range(topics):
                session.put(f"r1/t{number}", robo_messages.encode(String("x")), encoding=codec.encoding_of(String))

    thread = threading.Thread(target=say)
    thread.start()
    yield
    over.set()
    thread.join()


def test_a_page_that_nobody_sees_says_now_and_then_what_it_has_read(
    page: Any, seen: threading.Event, served: Served, other: zenoh.Session
) -> None:
    seen.set()
    page.add_init_script("""
        Object.defineProperty(document, "visibilityState", {get: () => "hidden"});
        window.said = 0;
        const send = WebSocket.prototype.send;
        WebSocket.prototype.send = function (data) { window.said++; send.call(this, data); };
    """)
    page.goto(f"http://127.0.0.1:{served.port}/#r1")
    with busy(other, 40):
        said, frames = page.evaluate("""async () => {
            const {link} = await import("/link.js");
            for (let i = 0; i < 40; i++) link.watch(`r1/t${i}`, null, () => {});
            while (link.frames < 100) await new Promise((done) => setTimeout(done, 20));
            const [said, frames] = [window.said, link.frames];
            while (link.frames < frames + 1000) await new Promise((done) => setTimeout(done, 20));
            return [window.said - said, link.frames - frames];
        }""")
    assert frames > 5 * said, "else its server closes it: it says too much"
