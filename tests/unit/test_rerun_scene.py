"""What of messages is drawn in Rerun, and how often: without Rerun."""

import math
import sys
from typing import cast

import pytest

from robo.bridges.rerun.feed import Feed
from robo.bridges.rerun.frames import WORLD
from robo.bridges.rerun.marks import Axes, Encoded, Grid, Mark, Moved, Numbers, Picture, Points, Said, Strips
from robo.bridges.rerun.pace import Pace
from robo.bridges.rerun.scene import Scene
from robo.bridges.rerun.sink import Sink, import_rerun
from robo.errors import RunError
from robo_messages import (
    Header,
    LaserScan,
    Log,
    MapMetaData,
    OccupancyGrid,
    Odometry,
    Path,
    Point,
    PoseStamped,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Twist,
    Vector3,
)
from robo_messages.diagnostic import DiagnosticStatus
from robo_messages.sensor import BatteryState, CompressedImage, Image
from robo_messages.visualization import Marker, MarkerArray

S = 10**9


def stands(parent: str, child: str, x: float = 0.0) -> TFMessage:
    return TFMessage([TransformStamped(Header(frame_id=parent), child, Transform(Vector3(x=x)))])


def kinds(marks: list[Mark]) -> list[str]:
    return [type(mark).__name__ for mark in marks]


def test_frames_of_all_robots_stand_in_one_world() -> None:
    scene = Scene()
    first = scene.take("r1/tf", stands("odom", "base_link"))
    assert kinds(first) == ["Moved", "Moved", "Axes"]
    moved, root, axes = first
    assert isinstance(moved, Moved)
    assert (moved.path, moved.parent, moved.child) == ("r1/tf/base_link", "r1/odom", "r1/base_link")
    assert not moved.always
    assert isinstance(root, Moved)
    assert (root.parent, root.child) == (WORLD, "r1/odom")
    assert axes == Axes("r1/base", "r1/base_link", 0.3)
    assert kinds(scene.take("r1/tf", stands("odom", "base_link"))) == ["Moved"]
    (other, world, _) = scene.take("r2/tf", stands("odom", "base_link"))
    assert isinstance(other, Moved)
    assert isinstance(world, Moved)
    assert (other.parent, world.child) == ("r2/odom", "r2/odom")
    (static, *_) = scene.take("r1/tf_static", stands("base_link", "laser"))
    assert isinstance(static, Moved)
    assert static.always


def test_a_frame_that_gets_a_parent_stands_in_the_world_no_more() -> None:
    scene = Scene()
    scene.take("tf", stands("odom", "base_link"))
    found = scene.take("tf", stands("map", "odom"))
    assert [(mark.parent, mark.child) for mark in found if isinstance(mark, Moved)] == [("map", "odom"), (WORLD, "map")]
    assert {mark.path for mark in found if isinstance(mark, Moved)} == {"robot/tf/odom", "robot/tf/map"}


def test_the_trail_goes_on_where_the_base_has_moved() -> None:
    scene = Scene()
    for x in (0.0, 0.01, 0.06, 0.12, 5.0, 5.1):
        found = scene.take("r1/tf", stands("odom", "base_link", x))
        strips = [mark.strips for mark in found if isinstance(mark, Strips)]
        wanted = {0.06: [(0.0, 0.06)], 0.12: [(0.06, 0.12)], 5.1: [(5.0, 5.1)]}.get(x, [])
        assert [(a[0], b[0]) for ((a, b),) in strips] == wanted
    assert scene.trails == ["r1/trail"]


def test_odometry_moves_the_base_where_no_transform_does() -> None:
    odometry = Odometry(Header(frame_id="odom"), "base_link")
    alone, both = Scene(), Scene()
    assert kinds(alone.take("r1/odom", odometry)) == ["Moved", "Moved", "Axes", "Numbers"]
    assert kinds(alone.take("r1/odom", odometry)) == ["Moved", "Numbers"]
    both.take("r1/tf", stands("odom", "base_link"))
    assert kinds(both.take("r1/odom", odometry)) == ["Numbers"]


def odometry(x: float, child: str = "base_link") -> Odometry:
    found = Odometry(Header(frame_id="odom"), child)
    found.pose.pose.position.x = x
    return found


def frame_of_scan(scene: Scene, key: str) -> str:
    (points,) = scene.take(key, LaserScan(Header(frame_id="laser"), ranges=[1.0], range_max=2.0))
    assert isinstance(points, Points)
    return points.frame


def strips_of(marks: list[Mark]) -> list[Strips]:
    return [mark for mark in marks if isinstance(mark, Strips)]


def test_a_frame_belongs_to_the_nearest_transforms_above_its_topic() -> None:
    scene = Scene()
    assert frame_of_scan(scene, "r1/front/scan") == "r1/front/laser"  # nobody says transforms yet
    scene.take("r1/tf", stands("odom", "base_link"))
    assert frame_of_scan(scene, "r1/front/scan") == "r1/laser"
    assert frame_of_scan(scene, "r1/scan") == "r1/laser"
    scene.take("r1/arm/tf_static", stands("base", "hand"))
    assert frame_of_scan(scene, "r1/arm/wrist/scan") == "r1/arm/laser"
    assert frame_of_scan(scene, "r10/front/scan") == "r10/front/laser"
    usual = Scene(["lidar/scan", "tf"])  # of a recording, whose topics are known before
    assert frame_of_scan(usual, "lidar/scan") == "laser"
    usual.take("odometry/filtered", odometry(1.0))
    assert usual.trails == ["robot/trail"]


def test_the_base_that_goes_through_the_world_leaves_the_trail() -> None:
    scene = Scene()
    found: list[Mark] = scene.take("r1/tf_static", stands("base_footprint", "base_link", 0.1))
    assert kinds(found) == ["Moved", "Moved", "Axes"]
    for x in (0.5, 0.56, 0.62):
        both = stands("odom", "base_footprint", x)
        both.transforms += stands("base_footprint", "base_link", 0.1).transforms
        found += scene.take("r1/tf", both)
    assert [(one.frame, one.strips) for one in strips_of(found)] == [
        ("r1/odom", [[(0.5, 0, 0), (0.56, 0, 0)]]),
        ("r1/odom", [[(0.56, 0, 0), (0.62, 0, 0)]]),
    ]
    assert len([mark for mark in found if isinstance(mark, Axes)]) == 1


def test_odometry_that_came_first_leaves_the_base_to_the_transforms() -> None:
    scene = Scene()
    scene.take("r1/odom", odometry(0.0))
    parents = []
    for step in range(1, 4):
        for found in (
            scene.take("r1/tf", stands("map", "base_link", 10 + step * 0.1)),
            scene.take("r1/odom", odometry(step * 0.1)),
        ):
            parents += [mark.parent for mark in found if isinstance(mark, Moved) and mark.child == "r1/base_link"]
            assert {one.frame for one in strips_of(found)} <= {"r1/map"}
    assert parents == ["r1/map"] * 3


def test_one_odometry_of_several_moves_the_base() -> None:
    scene, later = Scene(), Scene()
    found: list[Mark] = []
    for step in range(4):
        found += scene.take("r1/odom", odometry(step * 0.1))
        found += scene.take("r1/odom_filtered", odometry(step * 0.1 + 0.5))
    assert [one.strips[0][1][0] for one in strips_of(found)] == pytest.approx([0.1, 0.2, 0.3])
    later.take("r1/ekf", odometry(0.5))
    assert kinds(later.take("r1/odom", odometry(0.0))) == ["Moved", "Numbers"]  # without a stroke from one to the other
    assert kinds(later.take("r1/ekf", odometry(0.6))) == ["Numbers"]


def test_what_is_no_angle_no_turn_and_no_place_ends_nothing() -> None:
    scene = Scene()
    scan = LaserScan(Header(frame_id="laser"), angle_min=math.inf, ranges=[1.0], range_max=2.0)
    (points,) = scene.take("r1/scan", scan)
    assert isinstance(points, Points)
    assert points.places == []
    unturned = odometry(0.0)
    unturned.pose.pose.orientation = Quaternion(0.0, 0.0, 0.0, 0.0)
    moved = scene.take("r1/odom", unturned)[0]
    assert isinstance(moved, Moved)
    assert moved.turned == (0.0, 0.0, 0.0, 1.0)
    assert scene.take("tf", stands("odom", "base_link", 1e308)) == []


def test_one_message_that_cannot_be_drawn_ends_the_view_of_no_other() -> None:
    drawn: list[Mark] = []

    class Paper:
        def lay_out(self, pictures: list[str], trails: list[str]) -> None: ...

        def draw(self, marks: list[Mark], time: int) -> None:
            assert time == S
            if any(isinstance(mark, Grid) for mark in marks):
                raise TypeError("a list is no buffer")
            drawn.extend(marks)

    feed = Feed(cast(Sink, Paper()), Pace(0.0))
    grid = OccupancyGrid(info=MapMetaData(resolution=0.1, width=2, height=1), data=memoryview(b"\0\x64"))
    for key, message in (("map", grid), ("r1/cmd_vel", Twist())):
        feed.take(key, message, S)
    assert (feed.unreadable, feed.drawn, kinds(drawn)) == (1, 1, ["Numbers"])


def test_numbers_that_are_none_move_nothing() -> None:
    scene = Scene()
    assert scene.take("tf", stands("odom", "base_link", math.nan)) == []
    assert scene.take("tf", stands("odom", "odom")) == []


def test_rays_that_hit_are_points() -> None:
    scan = LaserScan(
        Header(frame_id="laser"), angle_increment=math.pi / 2, range_min=0.1, range_max=9.0,
        ranges=[1.0, math.inf, math.nan, 2.0, 9.5, 0.05],
    )  # fmt: skip
    (points,) = Scene().take("r1/scan", scan)
    assert isinstance(points, Points)
    assert (points.path, points.frame) == ("r1/scan", "r1/laser")
    assert [tuple(round(part, 9) for part in place) for place in points.places] == [(1.0, 0.0, 0.0), (0.0, -2.0, 0.0)]


def test_what_else_is_drawn() -> None:
    scene = Scene()
    (path,) = scene.take("r1/path", Path(Header(frame_id="odom"), [PoseStamped(), PoseStamped()]))
    assert isinstance(path, Strips)
    assert len(path.strips[0]) == 2
    (gone,) = scene.take("r1/path", Path(Header(frame_id="odom"), []))
    assert isinstance(gone, Strips)
    assert gone.strips == []
    grid = OccupancyGrid(info=MapMetaData(resolution=0.1, width=2, height=1), data=memoryview(b"\0\x64"))
    assert isinstance(scene.take("map", grid)[0], Grid)
    assert scene.take("map", OccupancyGrid(info=MapMetaData(width=9, height=9))) == []
    assert isinstance(scene.take("r1/camera", Image())[0], Picture)
    assert scene.take("r1/jpeg", CompressedImage(format="jpeg", data=memoryview(b"x"))) == [
        Encoded("r1/jpeg", b"x", "image/jpeg")
    ]
    assert scene.pictures == ["r1/camera", "r1/jpeg"]
    assert scene.take("r1/log", Log(level=Log.WARN, name="/r1/a", msg="<b>")) == [Said("log/r1/a", "<b>", "WARN")]
    (speed,) = scene.take("r1/cmd_vel", Twist(Vector3(x=1.0)))
    assert speed == Numbers("plots/speed/r1/cmd_vel", {"linear.x": 1.0, "angular.z": 0.0})
    (place,) = scene.take("r1/current_position", Point(1.0, 2.0, 3.0))
    assert place == Numbers("plots/values/r1/current_position", {"x": 1.0, "y": 2.0, "z": 3.0})
    (battery,) = scene.take("r1/battery", BatteryState(voltage=12.0))
    assert isinstance(battery, Numbers)
    assert battery.values["voltage"] == 12.0


def test_status_is_a_line_where_it_changes() -> None:
    scene = Scene()
    said = [scene.take("r1/safety_state", DiagnosticStatus(level=level, message=str(level))) for level in (0, 0, 2)]
    assert said == [[Said("log/r1/safety_state", "0", "INFO")], [], [Said("log/r1/safety_state", "2", "ERROR")]]


def test_outlines_are_lines_where_their_pose_puts_them() -> None:
    marker = Marker(Header(frame_id="base_link"), ns="zone", type=Marker.LINE_STRIP, points=[Point(1.0), Point(2.0)])
    marker.scale.x, marker.color.r, marker.color.a = 0.02, 1.0, 1.0
    marker.pose.position.x = 10.0
    marker.pose.orientation.z, marker.pose.orientation.w = math.sin(math.pi / 4), math.cos(math.pi / 4)
    gone = Marker(action=Marker.DELETEALL)
    (strips,) = Scene().take("r1/zones", MarkerArray([gone, marker]))
    assert isinstance(strips, Strips)
    assert (strips.path, strips.colour) == ("r1/zones/zone/0", (255, 0, 0))
    assert strips.strips[0][0] == pytest.approx((10.0, 1.0, 0.0))


def test_markers_that_are_deleted_are_gone() -> None:
    scene = Scene()

    def take(*markers: Marker) -> list[tuple[str, str]]:
        return [(type(mark).__name__, mark.path) for mark in scene.take("r1/zones", MarkerArray([*markers]))]

    def cube(ns: str, number: int) -> Marker:
        return Marker(Header(frame_id="base_link"), ns=ns, id=number, type=Marker.CUBE)

    def delete(ns: str, number: int) -> Marker:
        return Marker(action=Marker.DELETE, ns=ns, id=number)

    everything = Marker(action=Marker.DELETEALL)
    take(cube("a", 0), cube("a", 1), cube("b", 0))
    assert take(delete("a", 1), delete("c", 7)) == [("Gone", "r1/zones/a/1")]
    # What is sent anew after all was deleted, as of zones, was never gone.
    assert take(everything, cube("a", 0)) == [("Gone", "r1/zones/b/0"), ("Points", "r1/zones/a/0")]
    take(cube("b", 0), cube("b", 1))
    assert take(Marker(action=Marker.DELETEALL, ns="b")) == [("Gone", "r1/zones/b/0"), ("Gone", "r1/zones/b/1")]
    assert take(everything) == [("Gone", "r1/zones/a/0")]
    assert take(everything) == []
    pace = Pace(1.0)
    assert all(pace.draws("r1/zones", MarkerArray([everything]), n) for n in range(3))


def test_as_many_are_drawn_as_somebody_sees() -> None:
    pace = Pace()
    drawn = [pace.draws("r1/scan", LaserScan(), n * S // 100) for n in range(100)]
    assert 9 <= sum(drawn) <= 11  # 100 Hz become 10
    lines = [pace.draws("r1/log", Log(), n) for n in range(100)]
    assert all(lines)
    every, one = Pace(0.0), Pace(1.0)
    assert all(every.draws("r1/scan", LaserScan(), n) for n in range(100))
    assert sum(one.draws("r1/scan", LaserScan(), n * S // 10) for n in range(100)) == 10


def test_transforms_of_other_frames_take_no_turns() -> None:
    pace = Pace()
    assert pace.draws("tf", stands("odom", "base_link"), S)
    assert pace.draws("tf", stands("map", "odom"), S)
    assert not pace.draws("tf", stands("map", "odom"), S + 1)
    assert all(pace.draws("r1/tf_static", stands("a", "b"), n) for n in range(10))


def test_fewer_are_drawn_while_the_viewer_is_too_slow_and_a_clock_may_be_set_back() -> None:
    pace = Pace()
    for n in range(200):
        pace.draws("r1/scan", LaserScan(), n, late=2.0)
    assert pace.slower == 32.0
    for n in range(1000):
        pace.draws("r1/scan", LaserScan(), n, late=0.0)
    assert pace.slower == 1.0
    assert pace.draws("r1/scan", LaserScan(), 100 * S)
    assert pace.draws("r1/scan", LaserScan(), 1 * S)


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(RunError, match=r"pip install 'robo-zenoh\[rerun\]'"):
        import_rerun()
