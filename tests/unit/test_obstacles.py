"""Points out of scans, ranges and clouds, and how the base has moved since."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import LaserScan, PointCloud2, PointField, Range
from robo_services.contact import Velocity
from robo_services.kinematics import Pose2
from robo_services.obstacles import NEAREST, REMEMBERED, Place, Track, from_cloud, from_range, from_scan, moved_by

HEIGHTS, RANGES = (0.05, 2.0), (0.0, 100.0)


def test_a_scan_follows_rep_117_and_stands_where_its_laser_does() -> None:
    ranges = [1.0, math.inf, math.nan, -math.inf, 20.0, 0.02, -3.0]
    scan = LaserScan(angle_min=0.0, angle_increment=0.5, range_min=0.05, range_max=10.0, ranges=ranges)
    place = Pose2(0.1, 0.2, math.pi / 2)
    found = {(round(p.x, 6), round(p.y, 6)) for p in from_scan(scan, place)}

    def at(angle: float, distance: float) -> tuple[float, float]:
        angle += math.pi / 2
        return round(0.1 + distance * math.cos(angle), 6), round(0.2 + distance * math.sin(angle), 6)

    # What is too near to be measured may be anywhere from the laser to where it begins to measure.
    ends = {at(1.5, 0.05), at(1.5, NEAREST), at(2.5, 0.05), at(2.5, 0.02), at(3.0, 0.05), at(3.0, NEAREST)}
    assert found == {at(0.0, 1.0)} | ends
    assert {round(p.distance, 3) for p in from_scan(scan, Pose2(), min_range=0.1)} == {1.0, NEAREST}, "-inf counts"
    assert len(from_scan(scan, Pose2(), max_range=0.5)) == 6


@given(st.lists(st.floats(), max_size=50), st.floats(-10, 10), st.floats(-10, 10), st.floats(), st.floats())
def test_whatever_a_scan_holds_its_points_are_numbers(
    ranges: list[float], start: float, step: float, range_min: float, range_max: float
) -> None:
    scan = LaserScan(angle_min=start, angle_increment=step, range_min=range_min, range_max=range_max, ranges=ranges)
    points = from_scan(scan, Pose2())
    assert all(math.isfinite(p.x) and math.isfinite(p.y) for p in points) or max(map(abs, ranges)) > 1e100
    assert points == sorted(points)


def test_a_range_is_an_arc_across_its_cone() -> None:
    reading = Range(field_of_view=0.4, min_range=0.02, max_range=3.0, range=1.0)
    points = from_range(reading, Pose2(0.2, 0.0, math.pi))
    assert all(math.hypot(p.x - 0.2, p.y) == pytest.approx(1.0) for p in points)
    assert min(p.y for p in points) == pytest.approx(-math.sin(0.2))
    assert len(points) > 20
    for nothing in (math.inf, 5.0):
        assert from_range(Range(field_of_view=0.4, max_range=3.0, range=nothing), Pose2()) == []
    assert from_range(Range(field_of_view=math.nan, min_range=0.02, max_range=3.0, range=-math.inf), Pose2())


@pytest.mark.parametrize("reading", [-math.inf, 0.0, 0.1])
def test_what_is_too_near_for_a_range_sensor_is_at_the_sensor_too(reading: float) -> None:
    sonar = Range(field_of_view=0.4, min_range=0.3, max_range=3.0, range=reading)
    points = {(round(p.x, 6), round(p.y, 6)) for p in from_range(sonar, Pose2(0.2, 0.0, 0.0))}
    assert (0.2, 0.0) in points
    assert max(x for x, _ in points) == pytest.approx(0.5, abs=1e-3)
    assert bool(from_range(sonar, Pose2(), min_range=0.4)) == (reading == -math.inf), "the robot itself is measured"


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_cloud_in_either_byte_order_with_padding(order: str) -> None:
    kind = np.dtype({"names": ["x", "y", "z"], "formats": [f"{order}f4"] * 3, "offsets": [4, 8, 16], "itemsize": 32})
    rows = np.zeros((2, 3), kind)
    rows["x"], rows["y"], rows["z"] = [[1, 2, 3], [4, math.nan, 1.0]], 0.5, [[0.5, 0.5, 9.0], [0.5, 0.5, 0.0]]
    padded = b"".join(row.tobytes() + bytes(8) for row in rows)
    fields = [PointField(name, offset, PointField.FLOAT32, 1) for name, offset in (("x", 4), ("y", 8), ("z", 16))]
    cloud = PointCloud2(
        height=2,
        width=3,
        fields=fields,
        is_bigendian=order == ">",
        point_step=32,
        row_step=104,
        data=memoryview(padded),
    )
    points = from_cloud(cloud, Place.planar(Pose2(1.0, 0.0, 0.0)), HEIGHTS, RANGES)
    assert [(p.x, p.y) for p in points] == [(2.0, 0.5), (3.0, 0.5), (5.0, 0.5)]


def test_a_cloud_of_nothing_but_nan_says_nothing() -> None:
    fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate("xyz")]

    def cloud(rows: list[list[float]]) -> PointCloud2:
        data = np.array(rows, "<f4").tobytes()
        return PointCloud2(
            height=1, width=len(rows), fields=fields, point_step=12, row_step=12 * len(rows), data=memoryview(data)
        )

    place = Place.planar(Pose2())
    with pytest.raises(ValueError, match="none of its points is a number"):
        from_cloud(cloud([[math.nan] * 3] * 4), place, HEIGHTS, RANGES)
    assert from_cloud(cloud([]), place, HEIGHTS, RANGES) == []
    assert len(from_cloud(cloud([[math.nan] * 3, [1.0, 0.0, 0.5]]), place, HEIGHTS, RANGES)) == 1


def test_a_dense_cloud_has_few_points_and_counts_all_of_them() -> None:
    rng = np.random.default_rng(1)
    many = np.column_stack((rng.uniform(1.0, 1.2, 50_000), rng.uniform(-0.1, 0.1, 50_000), np.full(50_000, 0.5)))
    points = from_cloud(PointCloud2.from_array(many.astype(np.float32)), Place.planar(Pose2()), HEIGHTS, RANGES)
    assert sum(p.points for p in points) == 50_000
    assert len(points) <= 21 * 22
    assert points[0].distance < 1.01


def test_a_cloud_without_coordinates_is_refused() -> None:
    for cloud in (PointCloud2(), PointCloud2(height=1, width=9, point_step=12, row_step=108)):
        with pytest.raises(ValueError, match=r"x, y and z|PointCloud2"):
            from_cloud(cloud, Place.planar(Pose2()), HEIGHTS, RANGES)


def test_a_sensor_that_is_tilted_has_no_place_in_the_plane() -> None:
    assert Place.planar(Pose2(1.0, 2.0, 0.5)).pose == pytest.approx((1.0, 2.0, 0.5))
    upside_down = Place((1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.3))
    assert upside_down.pose is None


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 3), st.floats(0.05, 1.5))
def test_a_track_says_where_the_base_is_now(x: float, y: float, turn: float, age: float) -> None:
    track, velocity = Track(), Velocity(x, y, turn)
    for i in range(101):
        track.add(10.0 + i * 0.02, velocity)
    moved = track.moved(12.04 - age, 12.04)
    expected = moved_by(Pose2(), velocity, age)
    assert (moved.x, moved.y) == pytest.approx((expected.x, expected.y), abs=2e-3)
    assert math.remainder(moved.yaw - expected.yaw, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_a_track_forgets_and_survives_time_that_steps_back() -> None:
    track = Track()
    assert track.moved(0.0, 5.0) == Pose2()
    for i in range(1000):
        track.add(i * 0.1, Velocity(1.0))
    assert track.moved(0.0, 99.9).x == pytest.approx(REMEMBERED, abs=0.2), "before that it is not known"
    track.add(99.85, Velocity(-5.0))
    assert track.velocity == Velocity(1.0), "it came late"
    track.add(3.0, Velocity(0.5))
    assert track.moved(3.0, 4.0).x == pytest.approx(0.5)
