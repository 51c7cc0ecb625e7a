"""Messages in another frame, and laser scans as points."""

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import InTheFuture, InvalidTransform, UnknownFrame
from robo.tf import (
    Buffer,
    Transform3,
    scan_array,
    scan_points,
    transform_point,
    transform_pose,
    transform_vector,
)
from robo_messages import (
    Header,
    LaserScan,
    Point,
    PointStamped,
    Pose,
    PoseStamped,
    Quaternion,
    Time,
    Vector3,
    Vector3Stamped,
)
from robo_messages.scans import LaserScanArray

LEFT = Quaternion(0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
LASER = Transform3.from_rpy(0.2, 0.0, 0.3, 0.1, -0.2, 3.0)


@pytest.fixture
def buffer() -> Buffer:
    """A robot that drives 1 m/s to the north, seen from odom, and has a laser."""
    made = Buffer()
    for second in range(5):
        base = Transform3.planar(0.0, float(second), math.pi / 2)
        made.insert(base.to_stamped(Header(Time(second), "odom"), "base_link"))
    made.insert(LASER.to_stamped(Header(Time(), "base_link"), "laser"), static=True)
    return made


def header(frame: str = "base_link") -> Header:
    return Header(Time(2, 500_000_000), frame)


def test_messages_are_taken_into_another_frame_at_their_time(buffer: Buffer) -> None:
    point = transform_point(buffer, PointStamped(header(), Point(1.0, 0.0, 0.5)), "odom")
    assert point.header == header("odom")
    assert (point.point.x, point.point.y, point.point.z) == pytest.approx((0.0, 3.5, 0.5))
    vector = transform_vector(buffer, Vector3Stamped(header(), Vector3(1.0, 0.0, 0.5)), "odom")
    assert vector.header == header("odom")
    assert (vector.vector.x, vector.vector.y, vector.vector.z) == pytest.approx((0.0, 1.0, 0.5))
    pose = transform_pose(buffer, PoseStamped(header(), Pose(Point(1.0, 0.0, 0.5), LEFT)), "odom")
    assert pose.header == header("odom")
    assert Transform3.from_message(pose)[:3] == pytest.approx((0.0, 3.5, 0.5))
    assert abs(pose.pose.orientation.z) == pytest.approx(1.0)


def test_what_cannot_be_taken_there_is_told(buffer: Buffer) -> None:
    with pytest.raises(UnknownFrame, match="there is no frame map"):
        transform_point(buffer, PointStamped(header()), "map")
    with pytest.raises(InvalidTransform, match="the source frame has an empty name"):
        transform_vector(buffer, Vector3Stamped(Header(Time(1))), "odom")
    with pytest.raises(InTheFuture):
        transform_pose(buffer, PoseStamped(Header(Time(9), "base_link")), "odom")
    with pytest.raises(InvalidTransform, match="is no rotation"):
        transform_pose(buffer, PoseStamped(header(), Pose(orientation=Quaternion(w=0.0))), "odom")
    for points in (scan_points, scan_array):
        with pytest.raises(InTheFuture):
            points(buffer, LaserScan(Header(Time(9), "laser")), "odom")


def test_a_scan_is_the_points_that_were_hit(buffer: Buffer) -> None:
    ranges = [1.0, math.inf, math.nan, -math.inf, 0.05, 40.0, 2.0]
    scan = LaserScan(header("base_link"), -math.pi / 2, angle_increment=math.pi / 6, range_min=0.1, range_max=30.0)
    scan.ranges = ranges
    points = scan_points(buffer, scan, "odom")
    assert [(round(x, 9), round(y, 9), z) for x, y, z in points] == [(1.0, 2.5, 0.0), (-2.0, 2.5, 0.0)]
    assert scan_points(buffer, scan, "base_link")[1] == pytest.approx((0.0, 2.0, 0.0))


@given(
    st.lists(st.floats(0.0, 50.0) | st.sampled_from([math.nan, math.inf, -math.inf]), max_size=30),
    st.floats(-7.0, 7.0),
    st.floats(-0.5, 0.5),
    st.sampled_from([30.0, math.inf]),
)
def test_as_an_array_it_is_the_same(ranges: list[float], first: float, step: float, most: float) -> None:
    made = Buffer()
    made.insert(LASER.to_stamped(Header(Time(), "base_link"), "laser"), static=True)
    plain = LaserScan(
        Header(frame_id="laser"), first, angle_increment=step, range_min=0.1, range_max=most, ranges=ranges
    )
    packed = LaserScanArray(plain.header, first, angle_increment=step, range_min=0.1, range_max=most)
    packed.ranges = ranges
    points = scan_points(made, plain, "base_link")
    for scan in (plain, packed):
        array = scan_array(made, scan, "base_link")
        assert array.shape == (len(points), 3)
        assert array.dtype == np.float64
        assert array == pytest.approx(np.reshape(points, (-1, 3)), abs=1e-12)
    for (x, y, z), distance in zip(points, (r for r in ranges if 0.1 <= r <= most and r < math.inf), strict=True):
        assert math.dist((x, y, z), LASER[:3]) == pytest.approx(distance)


def test_without_numpy_a_scan_is_a_list_and_the_array_names_the_extra() -> None:
    script = """
import sys
sys.modules["numpy"] = None
from robo.tf import Buffer, Transform3, scan_array, scan_points
from robo_messages import Header, LaserScan
buffer = Buffer()
buffer.insert(Transform3(x=1.0).to_stamped(Header(frame_id="base_link"), "laser"), static=True)
scan = LaserScan(Header(frame_id="laser"), range_max=9.0, ranges=[2.0])
print(scan_points(buffer, scan, "base_link"))
try:
    scan_array(buffer, scan, "base_link")
except ModuleNotFoundError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert run.stdout.splitlines() == [
        "[(3.0, 0.0, 0.0)]",
        "scan_array needs numpy, which is not installed: pip install 'robo-zenoh[numpy]'; scan_points needs none",
    ]
