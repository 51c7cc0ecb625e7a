"""Courses are checked before anybody drives them."""

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo_messages import Header, Point, Pose, PoseStamped, Quaternion
from robo_services.courses import (
    MOST,
    Course,
    CourseError,
    Orientations,
    Waypoint,
    course_of_poses,
    load,
    waypoints_of_rows,
)
from robo_services.planar import quaternion_from_yaw

CONFIG = Path(__file__).parents[2] / "config"


def pose(x: float = 0.0, y: float = 0.0, turn: Quaternion | None = None, frame: str = "") -> PoseStamped:
    return PoseStamped(Header(frame_id=frame), Pose(Point(x, y), turn or Quaternion()))


def written(path: Path, text: str) -> str:
    (path / "c.yaml").write_text(text)
    return str(path / "c.yaml")


def test_a_file_of_all_forms(tmp_path: Path) -> None:
    text = "frame: map\nwaypoints:\n  - [1, 2]\n  - [1, 2.5, -1.57]\n  - {x: 1, y: 3, speed: 0.1, tolerance: 0.05}\n"
    assert load(written(tmp_path, text), 3) == Course(
        (Waypoint(1, 2), Waypoint(1, 2.5, -1.57), Waypoint(1, 3, None, 0.1, 0.05)), "map", 3
    )


@pytest.mark.parametrize(
    ("text", "mistakes"),
    [
        (
            "waypoints:\n  - [1, 2]\n  - [1]\n  - [1, two]\n  - {x: 1}\n  - {x: 1, y: 2, sped: 3, yau: 1}\n"
            "  - {x: 1, y: .nan}\n  - {x: 1, y: 2, speed: -1}\n  - 7\n  - [1, .inf]\n  - [true, 1]\n  - [1, 2e6]\n"
            "frame: 3\nlaps: 2\n",
            [
                "3:5: waypoints[1]: expected [x, y] or [x, y, yaw]",
                "4:5: waypoints[2]: expected a number, not 'two'",
                "5:5: waypoints[3]: object missing required field y",
                "6:18: waypoints[4]: unknown key 'sped'; a waypoint has x, y, yaw, speed, tolerance",
                "6:27: waypoints[4]: unknown key 'yau'; a waypoint has x, y, yaw, speed, tolerance",
                "7:15: waypoints[5].y: expected a finite number",
                "8:25: waypoints[6]: speed: expected float > 0.0",
                "9:5: waypoints[7]: expected [x, y] or [x, y, yaw]",
                "10:5: waypoints[8]: expected a finite number, not inf",
                "11:5: waypoints[9]: expected a number, not 'True'",
                "12:5: waypoints[10]: y: expected float <= 1000000.0",
                "13:8: frame: expected a name, not 3",
                "14:1: unknown key 'laps'; a course has waypoints, frame",
            ],
        ),
        ("- [1, 2]", ["1:1: expected a map with waypoints"]),
        ("waypoints: 5", ["1:12: waypoints: expected a list, not 5"]),
        ("frame: map", ["1:1: expected waypoints: a list of [x, y] or [x, y, yaw]"]),
        ("", ["1:1: expected waypoints: a list of [x, y] or [x, y, yaw]"]),
    ],
)
def test_all_mistakes_of_a_file_have_their_places(tmp_path: Path, text: str, mistakes: list[str]) -> None:
    path = written(tmp_path, text)
    with pytest.raises(CourseError) as error:
        load(path)
    assert str(error.value).splitlines() == [f"{path}:{mistake}" for mistake in mistakes]


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(CourseError, match=r"course file nowhere\.yaml cannot be read: No such file"):
        load("nowhere.yaml")
    with pytest.raises(CourseError, match=r"c\.yaml:1:\d+: not valid YAML"):
        load(written(tmp_path, "waypoints: [[1, 2"))
    with pytest.raises(CourseError, match=r"course file .*c\.yaml: a course needs a waypoint"):
        load(written(tmp_path, "waypoints: []"))


@pytest.mark.parametrize(("rows", "said"), [
    ([[1.0]], r"waypoints\[0\]: expected \[x, y\]"),
    ([[0.0, 0.0], [math.nan, 1.0], [1.0, math.inf]], r"waypoints\[1\].*nan\nwaypoints\[2\].*inf"),
    ([[0.0, 0.0, 0.0, 0.0]], r"waypoints\[0\]"),
    ([[1e300, 0.0]], "1000000"),
])  # fmt: skip
def test_rows_that_are_no_waypoints(rows: list[list[float]], said: str) -> None:
    with pytest.raises(CourseError, match=said):
        waypoints_of_rows(rows)


def test_courses_that_cannot_be_driven() -> None:
    here = (Waypoint(1, 1), Waypoint(1, 1))
    for wrong, said in (
        ({"waypoints": ()}, "needs a waypoint"),
        ({"waypoints": here, "laps": 0}, "more than one place"),
        ({"waypoints": here, "first": 2}, "no waypoint 2: they are numbered from 0 to 1"),
        ({"waypoints": here * MOST}, "at most 10,000"),
    ):
        with pytest.raises(CourseError, match=said):
            Course(**wrong)
    assert Course(here).laps == 1


@pytest.mark.parametrize(
    ("orientations", "yaws"), [("ignore", [None, None]), ("goal", [None, -1.0]), ("all", [2.0, -1.0])]
)
def test_poses_say_how_to_stand_where_that_is_asked_for(orientations: Orientations, yaws: list[float | None]) -> None:
    course = course_of_poses(
        [pose(1, 2, quaternion_from_yaw(2.0)), pose(3, 4, quaternion_from_yaw(-1.0))], "map", orientations
    )
    assert [(one.x, one.y) for one in course.waypoints] == [(1, 2), (3, 4)]
    assert [one.yaw if one.yaw is None else round(one.yaw, 9) for one in course.waypoints] == yaws
    assert course.frame == "map"


def test_poses_that_are_no_course() -> None:
    nothing = Quaternion(0, 0, 0, 0)
    assert course_of_poses([pose(turn=nothing)], "", "all").waypoints[0].yaw is None
    assert course_of_poses([pose(frame="/map"), pose(1, frame="map")], "odom", "goal").frame == "map"
    for poses, said in (
        ([], "needs a waypoint"),
        ([pose(math.nan), pose(0, math.inf)], r"poses\[0\].*nan\nposes\[1\].*inf"),
        ([pose(turn=Quaternion(w=math.nan))], r"poses\[0\]: its orientation is not finite"),
        ([pose(frame="map"), pose(frame="odom")], "in one frame, and these are in map, odom"),
        ([pose()] * (MOST + 1), "at most"),
    ):
        with pytest.raises(CourseError, match=said):
            course_of_poses(poses, "", "all")


anything: Any = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["x", "y", "yaw", "speed"]), inner),
    max_leaves=10,
)


@settings(max_examples=60, derandomize=True)
@given(st.lists(anything, max_size=4))
def test_rows_are_waypoints_or_mistakes(rows: list[object]) -> None:
    found: tuple[Waypoint, ...] = ()
    with suppress(CourseError):
        found = waypoints_of_rows(rows)
        assert len(found) == len(rows)
    assert all(math.isfinite(one.x) and math.isfinite(one.y) for one in found)


@pytest.mark.parametrize(("name", "count"), [("course.yaml", 20), ("dock.yaml", 3)])
def test_the_courses_that_ship(name: str, count: int) -> None:
    assert len(load(str(CONFIG / name)).waypoints) == count
