"""What pages are told of robots."""

import re

import pytest

import robo_messages
from robo.dashboard.files import ROOM
from robo.dashboard.frames import Frames, read
from robo.dashboard.place import Settings
from robo.dashboard.state import Line, Node, Told, newest, robots_of
from robo.errors import UsageError
from robo_messages import TFMessage, TransformStamped


def node(name: str, robot: str = "") -> Node:
    return Node(name, robot, "", "ready", "", None, "", None, None, None, None, None, "", "")


@pytest.mark.parametrize(
    ("nodes", "topics", "robots"),
    [
        ([("/r1/base", "r1")], ["r1/odom"], ["r1"]),
        ([("/r1/base", "r1"), ("/r1/arm/joint", "r1")], ["r1/odom"], ["r1"]),
        ([("/f/r1/base", "f"), ("/f/r2/base", "f")], ["f/r1/odom", "f/r2/odom"], ["f/r1", "f/r2"]),
        ([("/a/b/c/base", "a/b/c")], [], ["a/b/c"]),
        ([("/r1/base", "r1"), ("/r2/base", ""), ("/r2/arm/joint", "")], [], ["r1", "r2"]),
        ([("/base", "")], ["odom"], [""]),
        ([("/r1/base", "r1")], ["made_up/odom"], ["r1"]),
        ([], [], []),
    ],
)  # fmt: skip
def test_robots_are_found_by_runs_and_namespaces(
    nodes: list[tuple[str, str]], topics: list[str], robots: list[str]
) -> None:
    assert robots_of([node(*one) for one in nodes], topics) == robots


def test_of_a_flood_of_lines_the_newest_are_shown_and_the_rest_is_counted() -> None:
    lines = [Line("r1", number, "base", "INFO", str(number)) for number in range(1_000)]
    shown = newest(lines)
    assert shown[0].message.startswith("800 lines or more were left out")
    assert [line.message for line in shown[1:]] == [str(number) for number in range(800, 1_000)]
    assert newest(lines[:10]) == lines[:10]


def test_what_is_of_the_past_and_has_come_already_is_told_once() -> None:
    seen = Told[int]()
    assert seen.new([1, 2, 2]) == [1, 2, 2]
    assert seen.new([2, 3]) == [3]
    assert seen.new(range(10, 20_000)) == list(range(10, 20_000))
    assert seen.new([19_999]) == []
    assert seen.new([1]) == [1], "so long ago that it is remembered no more"


def test_the_page_names_all_its_modules_that_they_are_loaded_at_once() -> None:
    text = (ROOM / "index.html").read_text(encoding="utf-8")
    named = re.findall(r'modulepreload" href="([^"]+)"', text)
    there = {path.relative_to(ROOM).as_posix() for path in ROOM.rglob("*.js")} - {"start.js"}
    assert sorted(named) == sorted(there)


def told(frames: Frames, robot: str, *names: str) -> None:
    transforms = [TransformStamped(child_frame_id=name) for name in names]
    frames.take(robot, read(robo_messages.encode(TFMessage(transforms))))


def test_a_robot_that_makes_up_frames_hides_no_other_one() -> None:
    frames = Frames()
    told(frames, "r1", *(f"frame_{number}" for number in range(1_000)), "x" * 1_000)
    told(frames, "r2", "base_link")
    assert len(frames.of("r1")) == 500
    assert list(frames.of("r2")) == ["base_link"]
    frames.keep({"r2"})
    assert frames.of("r1") == {}
    assert read(b"\xc1") == {}
    assert read(bytes(1_000_000)) == {}


def test_addresses_are_ones_that_can_be_opened() -> None:
    assert Settings.of("127.0.0.1", 0, None, []).addresses(1234) == {"drive": "http://127.0.0.1:1234/"}
    assert Settings.of("::1", 0, None, []).addresses(1234) == {"drive": "http://[::1]:1234/"}
    found = Settings.of("0.0.0.0", 0, None, ["r1.local"]).addresses(1234)
    assert all(address.startswith("http://r1.local:1234/?token=") for address in found.values())
    assert len(set(found.values())) == 2
    assert Settings.of("0.0.0.0", 0, None, ["r1.local"]).place(1234) == "http://r1.local:1234/"


@pytest.mark.parametrize("name", ["r1.local:8080", "[::1]:8080", "http://r1.local", "r1/x", ""])
def test_a_name_is_a_name_and_no_address(name: str) -> None:
    with pytest.raises(UsageError, match="without a port"):
        Settings.of("127.0.0.1", 0, None, [name])
    assert Settings.of("127.0.0.1", 0, None, ["R1.local", "*", "fe80::1"]).names[0] == "R1.local"


def test_a_page_is_at_some_address() -> None:
    with pytest.raises(UsageError, match="host is empty"):
        Settings.of("", 0, None, [])
