"""The page in a real browser: what it shows and asks for, and that a robot which it drives stands when it must."""

import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import psutil
import pytest
import zenoh

import robo_messages
from robo.samples.publishing import Sender
from robo.testing import Launch, Robot
from robo.wire.keys import log_key
from robo.wire.network import Network
from robo.wire.qos import QoS
from robo.wire.reports import LogRecord
from robo.wire.session import close_session, open_session
from robo_messages import Image, Odometry, Twist
from tests.npm import file_of
from tests.proxy import Proxy
from tests.served import Held, browsing
from tests.support import PATIENCE, Running, eventually, plain_environment

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("websockets", reason="the extra dashboard is not installed")
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.timeout(180),
]

COMMAND_TIMEOUT = 0.5
"""Of the reference base, s: so long after the last command it stands."""
SLACK = 0.3
"""Braking, and what a busy machine takes for a look at the clock, s."""
SOON = 5.0
"""For how long a grip is given to show what it does, before it begins anew, s."""
LISTEN = ("--listen", "127.0.0.1:0", "--json")
PANELS = ["Map", "Drive", "Nodes", "Log", "Plots", "Parameters", "Topics", "Camera", "Graph", "Events"]


class Served:
    """`robo dashboard` for a robot, as a process."""

    def __init__(self, endpoint: str, *words: str) -> None:
        self.running = Running(
            [sys.executable, "-m", "robo", "dashboard", "--connect", endpoint, *LISTEN, *words],
            env=plain_environment(),
        )
        self.address: str = msgspec.json.decode(self.running.wait_for('"drive"'))["drive"]

    def signal(self, number: signal.Signals) -> None:
        self.running.process.send_signal(number)

    def close(self) -> None:
        self.signal(signal.SIGCONT)
        self.running.close()


class Driven:
    """What a robot was told by pages, and what its base did, with the time at which this process has heard of it."""

    def __init__(self, robot: Robot) -> None:
        self._session = open_session(Network(mode="client", connect=(robot.endpoint,)))
        self.commands: list[tuple[float, float, float]] = []
        self.speeds: list[tuple[float, float]] = []
        self._ends = [
            self._session.declare_subscriber(f"{robot.name}/cmd_vel_dashboard", self._command),
            self._session.declare_subscriber(f"{robot.name}/odom", self._odometry),
        ]

    def _command(self, sample: zenoh.Sample) -> None:
        twist = robo_messages.decode(sample.payload.to_bytes(), Twist)
        self.commands.append((time.monotonic(), twist.linear.x, twist.angular.z))

    def _odometry(self, sample: zenoh.Sample) -> None:
        twist = robo_messages.decode(sample.payload.to_bytes(), Odometry).twist.twist
        self.speeds.append((time.monotonic(), abs(twist.linear.x) + abs(twist.angular.z)))

    @property
    def moves(self) -> bool:
        return bool(self.speeds) and self.speeds[-1][1] > 0.05

    @property
    def last(self) -> float:
        """When the last command came that moves the robot."""
        return max((at for at, linear, angular in self.commands if linear or angular), default=0.0)

    def has_driven(self, within: float) -> None:
        """Wait until the robot drives, by a command of a page, for at most so long, s."""
        eventually(lambda: self.moves and time.monotonic() - self.last < 1.0, "the robot drives", within)

    def has_stood(self) -> None:
        """Wait until it stands, and see that it did in time, and has not moved since."""
        eventually(lambda: not self.moves and time.monotonic() - self.last > 1.5, "the robot stands")
        moved = max(at for at, speed in self.speeds if speed >= 0.001)
        assert moved - self.last <= COMMAND_TIMEOUT + SLACK

    def zeros(self) -> int:
        """How often it was told to stand after the last command."""
        return sum(1 for at, linear, angular in self.commands if at > self.last and linear == angular == 0.0)

    def close(self) -> None:
        for end in self._ends:
            end.undeclare()
        close_session(self._session)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def robot(launch: Launch) -> Robot:
    """The reference robot, which does nothing by itself."""
    return launch("robot.yaml", demo="none")


@pytest.fixture
def served(robot: Robot) -> Iterator[Served]:
    with closing(Served(robot.endpoint)) as found:
        yield found


@pytest.fixture
def driven(robot: Robot) -> Iterator[Driven]:
    with closing(Driven(robot)) as found:
        yield found


@contextmanager
def opened(chromium: Any, address: str) -> Iterator[Any]:
    """A page that is open, in a browser profile of its own, and drawn once."""
    context = chromium.new_context(viewport={"width": 1360, "height": 860})
    page = context.new_page()
    page.set_default_timeout(PATIENCE * 1000)
    faults: list[str] = []
    page.on("requestfailed", lambda request: faults.append(f"{request.url}: {request.failure}"))
    page.on("console", lambda said: faults.append(said.text))
    page.goto(address)
    try:
        page.wait_for_selector("#map canvas[data-drawn]")
        page.wait_for_selector("#pad:not(.locked)")
    except sync_api.TimeoutError as error:
        raise AssertionError(f"the page did not come up: {faults}\n{page.inner_text('body')}") from error
    try:
        yield page
    finally:
        with suppress(sync_api.Error):  # its browser may have been killed
            context.close()


def grip(page: Any, forwards: int = 1) -> None:
    """Hold the joystick, pushed forwards; with -1 pulled backwards."""
    box = page.locator("#pad").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0], middle[1] - forwards * (box["height"] / 2 - 10))


def hold_keys(page: Any, key: str = "ArrowUp") -> None:
    page.focus("#pad")
    page.keyboard.down(key)


def let_go(page: Any) -> None:
    """Hold neither the joystick nor a key."""
    page.mouse.up()
    page.keyboard.up("ArrowUp")
    page.keyboard.up("w")


def says(page: Any, selector: str, words: str, within: float = PATIENCE) -> None:
    page.locator(selector, has_text=words).first.wait_for(timeout=within * 1000)


def begin_until(page: Any, begin: Callable[[Any], None], seen: Callable[[], None], what: str) -> None:
    """Hold the joystick or a key until something is seen that this shows; `seen` raises where it is not.

    Where the page is held up, as on a busy machine, a grip ends at once, or is none: then it begins anew.
    """

    def is_seen() -> bool:
        begin(page)
        with suppress(AssertionError, sync_api.TimeoutError):
            seen()
            return True
        let_go(page)
        return False

    eventually(is_seen, what)


def drive_off(
    page: Any, driven: Driven, begin: Callable[[Any], None] = grip, seen: Callable[[], None] = lambda: None
) -> None:
    """Begin until the robot drives, and something else is seen meanwhile."""

    def drives() -> None:
        driven.has_driven(SOON)
        seen()

    begin_until(page, begin, drives, "the robot drives, and what is looked for meanwhile is seen")


def test_the_page_is_complete_and_asks_no_other_host(chromium: Any, served: Served) -> None:
    context = chromium.new_context()
    page = context.new_page()
    asked: list[str] = []
    faults: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("websocket", lambda socket: asked.append(socket.url))
    page.on("console", lambda said: faults.append(said.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(served.address)
    page.wait_for_selector("#map canvas[data-drawn]")
    says(page, "#nodes td", "safety_monitor")
    says(page, "#topics td", "odom")
    says(page, "#log li", "twist_mux")
    says(page, "#events li", "ready")
    page.wait_for_selector("#parameters .field input")
    page.wait_for_selector("#graph rect")
    assert page.locator("section h2").all_inner_texts() == PANELS
    assert {urlsplit(url).netloc for url in asked} == {urlsplit(served.address).netloc}
    assert len(asked) > 10
    # Every control has a name, and the keyboard comes to it.
    controls = page.locator("button, input, select, canvas[tabindex], #pad").all()
    names = [one.aria_snapshot() for one in controls if one.is_visible() and one.is_enabled()]
    assert len(names) > 30
    assert [name for name in names if '"' not in name] == []
    reached = set()
    page.evaluate("document.body.focus()")
    for _ in range(len(controls) + 20):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.textContent"))
    assert {"stop", "pad", "follow", "fast", "turn"} <= reached
    assert page.evaluate("import('./link.js').then(({link}) => link.failures)") == 0
    assert faults == []
    context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_is_for_everybody(chromium: Any, served: Served, scheme: str) -> None:
    axe = file_of("axe-core/axe.min.js").read_text(encoding="utf-8")
    context = chromium.new_context(color_scheme=scheme)
    page = context.new_page()
    page.goto(served.address)
    says(page, "#nodes td", "safety_monitor")
    page.wait_for_selector("#parameters .field input")
    page.wait_for_selector("#graph rect")
    page.evaluate(axe)
    found = page.evaluate("axe.run()")["violations"]
    serious = [(one["id"], one["nodes"][0]["html"]) for one in found if one["impact"] in ("serious", "critical")]
    assert serious == []
    context.close()


def test_joystick_and_keys_drive_until_they_are_let_go(chromium: Any, served: Served, driven: Driven) -> None:
    with opened(chromium, served.address) as page:
        endings: list[tuple[Callable[[Any], None], Callable[[], None]]] = [
            (grip, page.mouse.up),
            (hold_keys, lambda: page.keyboard.up("ArrowUp")),
            (hold_keys, lambda: page.focus("#stop")),
            (grip, lambda: page.evaluate("window.dispatchEvent(new Event('blur'))")),
            (grip, lambda: page.evaluate("document.getElementById('pad').releasePointerCapture(1)")),
        ]
        for begin, end in endings:
            drive_off(page, driven, begin, lambda: says(page, "#drive .told", "m/s", SOON))
            end()
            driven.has_stood()
            assert driven.zeros() >= 3
            let_go(page)
        # A key that was down when it was made to stand drives no more by itself.
        drive_off(page, driven, hold_keys)
        page.evaluate("window.dispatchEvent(new Event('blur'))")
        page.keyboard.down("ArrowUp")  # as a key does that is held: again and again
        driven.has_stood()
        page.keyboard.up("ArrowUp")


def test_one_drives_and_no_other_one_takes_over(chromium: Any, served: Served, driven: Driven) -> None:
    with opened(chromium, served.address) as page, browsing(urlsplit(served.address).netloc) as other:
        with closing(Held(other, 0.3)):
            driven.has_driven(PATIENCE)
            says(page, "#drive .told", f"{other.name} drives")

            def is_refused() -> None:
                says(page, "#drive .told", f"refused: {other.name} drives r1", SOON)

            begin_until(page, lambda page: grip(page, -1), is_refused, "a grip is refused")
            assert all(linear >= 0.0 for _, linear, _ in driven.commands)
            let_go(page)
        driven.has_stood()
        drive_off(page, driven, hold_keys)
        page.keyboard.up("ArrowUp")
        driven.has_stood()


def test_a_robot_that_is_gone_locks_driving_and_comes_back_without_a_grip(
    chromium: Any, served: Served, driven: Driven, robot: Robot
) -> None:
    with opened(chromium, served.address) as page:
        drive_off(page, driven, hold_keys)
        robot.pause("diff_drive_sim")
        page.wait_for_selector("#pad.locked:not(.held)")
        says(page, "#lost", "it cannot be driven")
        robot.resume("diff_drive_sim")
        page.wait_for_selector("#pad:not(.locked)")
        count = len(driven.commands)
        page.keyboard.down("ArrowUp")  # as a key does that is held: again and again
        driven.has_stood()
        assert all(linear == angular == 0.0 for _, linear, angular in driven.commands[count:])
        page.keyboard.up("ArrowUp")
        drive_off(page, driven, hold_keys)
        page.keyboard.up("ArrowUp")
        # One that never was is not driven either.
        page.goto(f"{served.address}#nobody")
        says(page, "#lost", "Nothing runs of nobody")
        hold_keys(page)
        says(page, "#drive .told", "driving is locked")
        assert page.locator("#pad.locked:not(.held)").count() == 1
        page.keyboard.up("ArrowUp")


def test_a_key_that_is_let_go_while_another_one_hides_it_drives_no_more(
    chromium: Any, served: Served, driven: Driven
) -> None:
    with opened(chromium, served.address) as page:
        drive_off(page, driven, lambda page: hold_keys(page, "w"))
        page.keyboard.down("Meta")
        driven.has_stood()
        page.keyboard.up("Meta")
        page.keyboard.up("w")


def close_tab(page: Any, served: Served) -> None:
    del served
    page.close()


def kill_dashboard(page: Any, served: Served) -> None:
    del page
    served.signal(signal.SIGKILL)


def end_dashboard(page: Any, served: Served) -> None:
    del page
    served.signal(signal.SIGINT)


@pytest.mark.parametrize("end", [close_tab, kill_dashboard, end_dashboard])
def test_the_robot_stands_when_the_page_or_its_server_is_gone(
    chromium: Any, served: Served, driven: Driven, end: Callable[[Any, Served], None]
) -> None:
    with opened(chromium, served.address) as page:
        drive_off(page, driven)
        end(page, served)
        driven.has_stood()


def test_the_robot_stands_when_the_browser_is_killed(chromium: Any, served: Served, driven: Driven) -> None:
    before = {one.pid for one in psutil.Process().children(recursive=True)}
    browser = chromium.browser_type.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
    with opened(browser, served.address) as page:
        started = [one for one in psutil.Process().children(recursive=True) if one.pid not in before]
        drive_off(page, driven)
        for process in started:
            if "chrom" in process.name():
                process.kill()
        driven.has_stood()
    browser.close()


def test_a_cut_of_five_seconds_stops_the_robot_until_somebody_grips_anew(
    chromium: Any, served: Served, driven: Driven
) -> None:
    with opened(chromium, served.address) as page:
        drive_off(page, driven)
        served.signal(signal.SIGSTOP)
        cut = time.monotonic()
        driven.has_stood()
        says(page, "#lost", "nothing can be driven")
        page.wait_for_selector("#pad.locked")
        eventually(lambda: time.monotonic() - cut > 5.0, "the cut is over")
        count = len(driven.commands)
        served.signal(signal.SIGCONT)
        page.wait_for_selector("#pad:not(.locked)")
        page.mouse.move(200, 200)
        # What was said during the cut, and a hand that has never let go, move nothing.
        driven.has_stood()
        assert all(linear == angular == 0.0 for _, linear, angular in driven.commands[count:])
        page.mouse.up()
        drive_off(page, driven)
        page.mouse.up()
        driven.has_stood()


def stood_since(driven: Driven, begin: float) -> None:
    """For two seconds more it does not move, whatever was said before."""
    eventually(lambda: driven.speeds[-1][0] > begin + 2.0, "the robot tells how it moves")
    assert [speed for at, speed in driven.speeds if at > begin + SLACK and speed > 0.001] == []


def moves_nothing_after_a_cut(page: Any, proxy: Proxy, driven: Driven, where: str, words: str) -> None:
    """Drive, and hold on through a cut of five seconds: the robot stands, and moves after a new grip alone.

    Args:
        page: shows the robot.
        proxy: has the link that is cut.
        driven: the robot.
        where: on the page it is told.
        words: what is told.
    """
    drive_off(page, driven)
    proxy.cut()
    cut = time.monotonic()
    driven.has_stood()
    page.wait_for_selector("#pad.locked")
    says(page, where, words)
    eventually(lambda: time.monotonic() - cut > 5.0, "the cut is over")
    mended = time.monotonic()
    proxy.mend()
    page.wait_for_selector("#pad:not(.locked)")
    page.mouse.move(200, 200)
    stood_since(driven, mended)
    page.mouse.up()
    drive_off(page, driven)
    page.mouse.up()
    driven.has_stood()


def test_a_link_to_the_browser_that_is_cut_for_five_seconds_moves_nothing_afterwards(
    chromium: Any, served: Served, driven: Driven
) -> None:
    with (
        closing(Proxy(urlsplit(served.address).port or 0)) as proxy,
        opened(chromium, f"http://127.0.0.1:{proxy.port}/") as page,
    ):
        moves_nothing_after_a_cut(page, proxy, driven, "#lost", "nothing can be driven")


def test_a_link_to_the_robot_that_is_cut_for_five_seconds_moves_nothing_afterwards(
    chromium: Any, robot: Robot, driven: Driven
) -> None:
    with (
        closing(Proxy(int(robot.endpoint.rpartition(":")[2]))) as proxy,
        closing(Served(f"tcp/127.0.0.1:{proxy.port}")) as served,
        opened(chromium, served.address) as page,
    ):
        moves_nothing_after_a_cut(page, proxy, driven, "#drive .told", "driving is locked")


def test_a_hand_that_never_lets_go_moves_nothing_after_a_stop_and_its_reset(
    chromium: Any, served: Served, driven: Driven
) -> None:
    with opened(chromium, served.address) as page, opened(chromium, served.address) as second:
        drive_off(page, driven)
        second.click("#stop")
        driven.has_stood()
        says(page, "#drive .told", "emergency stop")
        second.click("#reset")
        page.wait_for_selector("#stop:not(.latched)")
        page.wait_for_selector("#pad:not(.locked)")
        reset = time.monotonic()
        page.mouse.move(200, 200)
        stood_since(driven, reset)
        page.mouse.up()
        drive_off(page, driven)
        page.mouse.up()


def test_a_robot_brings_its_dashboard_along(chromium: Any, launch: Launch) -> None:
    robot = launch("robot.yaml", demo="none", dashboard=True, options=["-p", "dashboard.port:=0"])
    address = robot.wait_for_line("the dashboard is at").rpartition(" ")[2]
    with closing(Driven(robot)) as driven, opened(chromium, address) as page:
        says(page, "#nodes td", "dashboard")
        drive_off(page, driven, hold_keys)
        page.keyboard.up("ArrowUp")
        driven.has_stood()


def test_the_emergency_stop_holds_until_it_is_reset(chromium: Any, served: Served, driven: Driven) -> None:
    with opened(chromium, served.address) as page:
        drive_off(page, driven)
        page.mouse.up()
        page.click("#stop")
        page.wait_for_selector("#stop.latched")
        count = len(driven.speeds)
        hold_keys(page)
        eventually(lambda: len(driven.speeds) > count + 100, "two seconds are over")
        assert not driven.moves
        page.keyboard.up("ArrowUp")
        page.click("#reset")
        page.wait_for_selector("#stop:not(.latched)")
        drive_off(page, driven, hold_keys)
        page.keyboard.up("ArrowUp")


@pytest.mark.parametrize("cut", [2.0, 6.0])
def test_an_emergency_stop_that_did_not_arrive_is_asked_for_again(
    chromium: Any, served: Served, driven: Driven, cut: float
) -> None:
    with opened(chromium, served.address) as page:
        says(page, "#bar .safety", "no command")
        served.signal(signal.SIGSTOP)
        begin = time.monotonic()
        says(page, "#lost", "No link")
        page.click("#stop")
        says(page, "#stop", "STOPPING")
        says(page, "#lost", "NOT CONFIRMED")
        says(page, "#bar dd.stale", "ago: ")
        eventually(lambda: time.monotonic() - begin > cut, "the cut is over")
        served.signal(signal.SIGCONT)
        page.wait_for_selector("#stop.latched")
        page.wait_for_selector("#lost", state="hidden")
        count = len(driven.speeds)
        hold_keys(page)
        eventually(lambda: len(driven.speeds) > count + 50, "a second is over")
        assert not driven.moves
        page.keyboard.up("ArrowUp")


def test_parameters_keep_their_ranges_and_two_editors_see_each_other(
    chromium: Any, served: Served, robot: Robot
) -> None:
    with opened(chromium, served.address) as page, opened(chromium, served.address) as second:
        for one in (page, second):
            one.select_option("#parameters select", label="velocity_smoother")
            one.wait_for_selector("[id='parameter-linear.max_velocity']")
        field = "[id='parameter-linear.max_velocity']"
        page.fill(field, "0.6")
        page.press(field, "Enter")
        sync_api.expect(second.locator(field)).to_have_value("0.6", timeout=PATIENCE * 1000)
        own = page.locator(".field", has=page.locator(field)).locator(".refusal")
        sync_api.expect(own).to_be_empty()
        second.fill(field, "-5")
        second.press(field, "Enter")
        refusal = second.locator(".field", has=second.locator(field)).locator(".refusal")
        sync_api.expect(refusal).not_to_be_empty(timeout=PATIENCE * 1000)
        sync_api.expect(second.locator(field)).to_have_value("0.6")
        sync_api.expect(page.locator(field)).to_have_value("0.6")
        sync_api.expect(own).to_be_empty()
        # Several changes that follow one another at once are all seen.
        wanted = {"linear.max_velocity": 0.55, "angular.max_velocity": 0.77, "velocity_timeout": 0.44}
        for name, value in wanted.items():
            robot.set("velocity_smoother", **{name: value})
        for name, value in wanted.items():
            for one in (page, second):
                sync_api.expect(one.locator(f"[id='parameter-{name}']")).to_have_value(str(value))


def test_what_robots_say_is_shown_as_text(chromium: Any, served: Served, robot: Robot) -> None:
    hostile = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>\x1b[31m\u202e"
    session = open_session(Network(mode="client", connect=(robot.endpoint,)))
    with opened(chromium, served.address) as page:
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        record = LogRecord(time=time.time_ns(), node=hostile, message=hostile, level="ERROR")
        session.put(log_key(robot.name), msgspec.msgpack.encode(record))
        says(page, "#log li", "<img src=x onerror")
        assert "\\x1b[31m\\u202e" in page.locator("#log li", has_text="<img").first.inner_text()
        pose = {"x": float("nan"), "y": float("inf"), "z": 0.0}
        for key, type_, message in (
            ("odom", "nav/Odometry", {"pose": {"pose": {"position": pose, "orientation": pose | {"w": 1.0}}}}),
            ("odom", "nav/Odometry", hostile),
            ("scan", "sensor/LaserScan", {"ranges": {"a": 1}, "header": {"frame_id": "base_link"}}),
            ("map", "nav/OccupancyGrid", {"info": {"width": 2**31, "height": 2**31, "resolution": 1.0}, "data": b""}),
            ("safety_zones", "visualization/MarkerArray", {"markers": [{"ns": hostile, "id": 1, "type": 4}]}),
            ("path", "nav/Path", {"poses": None}),
            ("path", "nav/Path", {"header": {"frame_id": "odom"}, "poses": [{"pose": {}}]}),
            ("scan", "sensor/LaserScan", {"ranges": [1.0]}),
            ("safety_zones", "visualization/MarkerArray", {"markers": [{"ns": "x", "id": 2, "type": 4, "action": 0}]}),
            ("safety_state", "diagnostic/DiagnosticStatus", {"level": 0, "message": 5, "values": []}),
            ("mux_state", "diagnostic/DiagnosticStatus", {"level": {}, "message": [], "values": [{"key": "driver"}]}),
        ):
            for payload in (msgspec.msgpack.encode(message), b"\xc1", b"\xdd\xff\xff\xff\xff", b"\x91" * 100_000):
                session.put(f"{robot.name}/{key}", payload, encoding=f"application/msgpack;{type_}")
        session.put(f"{robot.name}/odom", b"{", encoding=f"application/msgpack;{hostile[:100]}")
        drawn = int(page.get_attribute("#map canvas", "data-drawn"))
        page.wait_for_selector(f"#map canvas:not([data-drawn='{drawn}'])")
        says(page, "#map .told", "heading")
        # The bar, too, goes on: it says that the link is lost, and that it is back.
        served.signal(signal.SIGSTOP)
        says(page, "#lost", "No link")
        served.signal(signal.SIGCONT)
        page.wait_for_selector("#lost", state="hidden")
        assert page.title() == "robo"
        assert page.locator("img, #panels script").count() == 0
        assert faults == []
    close_session(session)


def test_without_the_token_there_is_nothing(chromium: Any, robot: Robot, tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text("drive-drive-drive\nlook-look-look\n")
    with closing(Served(robot.endpoint, "--token-file", str(tokens))) as served:
        place = urlsplit(served.address)._replace(query="").geturl()
        context = chromium.new_context()
        page = context.new_page()
        assert page.goto(place).status == 401
        assert "needs a token" in page.inner_text("body")
        page.goto(f"{place}?token=look-look-look")
        page.wait_for_selector("#map canvas[data-drawn]")
        assert page.url.partition("#")[0] == place, "the token does not stay in the address"
        page.wait_for_selector("#stop:disabled")
        says(page, "#drive .told", "may look and not drive")
        # Another page's script gets neither data nor a socket.
        stranger = chromium.new_context().new_page()
        stranger.goto("data:text/html,<p>another page</p>")
        script = """(url) => new Promise((done) => {
            const socket = new WebSocket(url);
            socket.onopen = () => done("open");
            socket.onerror = () => done("refused");
        })"""
        assert stranger.evaluate(script, place.replace("http", "ws") + "socket") == "refused"
        context.close()


def failing(failed: list[str]) -> Callable[[Any], None]:
    """What lets no file through until two have failed: a module is asked for again where its preload has."""

    def answer(route: Any) -> None:
        if len(failed) < 2:
            failed.append(route.request.url)
            route.abort()
        else:
            route.continue_()

    return answer


def test_a_file_that_fails_once_is_loaded_again(chromium: Any, served: Served) -> None:
    for file in ("main.js", "style.css", "panels/map.js"):
        context = chromium.new_context()
        page = context.new_page()
        page.set_default_timeout(PATIENCE * 1000)
        failed: list[str] = []
        page.route(f"**/{file}", failing(failed))
        page.goto(served.address)
        page.wait_for_selector("#map canvas[data-drawn]")
        page.wait_for_selector("#loading", state="detached")
        assert failed
        for _ in range(100):
            if page.evaluate("getComputedStyle(document.querySelector('header')).position") == "sticky":
                break
            page.wait_for_timeout(100)
        else:
            raise AssertionError(f"without its style after {file} has failed")
        context.close()


def test_a_camera_shows_no_picture_of_another_one(chromium: Any, served: Served, robot: Robot) -> None:
    session = open_session(Network(mode="client", connect=(robot.endpoint,)))
    senders = [Sender(session, f"{robot.name}/cam_{one}", "sensor/Image", QoS.DEFAULT, "/r1/cams") for one in "ab"]
    picture = Image(height=30, width=40, encoding="mono8", step=40, data=memoryview(bytes(1200)))
    with opened(chromium, served.address) as page:
        page.wait_for_selector("#camera option >> nth=1", state="attached")
        page.locator("#camera").scroll_into_view_if_needed()
        page.select_option("#camera select", f"{robot.name}/cam_a")
        eventually(lambda: senders[0].wait_for_subscriber(0.1), "the page looks")

        def is_shown() -> bool:
            senders[0].send(robo_messages.encode(picture))
            shown: bool = page.locator("#camera canvas").is_visible()
            return shown

        eventually(is_shown, "the picture of the chosen camera")
        page.select_option("#camera select", f"{robot.name}/cam_b")
        page.wait_for_selector("#camera canvas", state="hidden")
        says(page, "#camera .told", "no picture yet from r1/cam_b")
    for sender in senders:
        sender.close()
    close_session(session)


def test_transforms_and_what_is_latched_are_shown_as_messages(chromium: Any, served: Served) -> None:
    with opened(chromium, served.address) as page:
        for topic in ("tf", "tf_static", "safety_zones"):
            page.click(f"#topics button.link:text-is('{topic}')")
            says(page, "#topics .message", "frame_id")
        # A row that goes takes the focus of no other one.
        assert page.evaluate("document.activeElement.textContent") == "safety_zones"
