"""Data that people write: messages, or every mistake in them."""

import math

import pytest

import robo_messages
from robo.errors import MessageError
from robo.interfaces.message_input import message_of, restored
from robo_messages import (
    DiagnosticStatus,
    Image,
    LaserScan,
    OccupancyGrid,
    Odometry,
    Path,
    PoseStamped,
    Range,
    Time,
    Twist,
    Vector3,
)


def test_data_become_a_message() -> None:
    assert message_of(Twist, {"linear": {"x": 1}}) == Twist(linear=Vector3(x=1.0))
    assert message_of(LaserScan, {"ranges": [1, "inf", "-inf", "nan"]}).ranges[:3] == [1.0, math.inf, -math.inf]  # type: ignore[attr-defined]
    image = message_of(Image, {"data": "AAE="})
    assert isinstance(image, Image)
    assert bytes(image.data) == b"\x00\x01"
    assert message_of(Image, {"data": [0, 1]}) == image


def test_exponents_are_numbers_although_yaml_takes_them_for_text() -> None:
    assert message_of(Vector3, {"x": "1e-3"}) == Vector3(x=0.001)


def test_now_and_auto_are_the_time_of_now() -> None:
    before = Time.now()
    pose = message_of(PoseStamped, {"header": {"stamp": "now", "frame_id": "map"}})
    assert isinstance(pose, PoseStamped)
    assert before <= pose.header.stamp <= Time.now()
    assert pose.header.frame_id == "map"
    other = message_of(PoseStamped, {"header": "auto"})
    assert isinstance(other, PoseStamped)
    assert other.header.stamp >= before


def test_signed_bytes_may_be_said_as_numbers() -> None:
    grid = message_of(OccupancyGrid, {"data": [-1, 0, 100]})
    assert isinstance(grid, OccupancyGrid)
    assert bytes(grid.data) == b"\xff\x00\x64"


@pytest.mark.parametrize(
    ("type_", "data", "mistakes"),
    [
        (
            Twist,
            {"linear": {"x": "fast", "q": 1}, "anglar": {}},
            [
                "geometry/Twist.linear.x: expected float, got str 'fast'",
                "geometry/Twist.linear has no field 'q'; it has x, y, z",
                "geometry/Twist has no field 'anglar'; did you mean angular?",
            ],
        ),
        (Twist, 3, ["geometry/Twist: expected geometry/Twist {linear: geometry/Vector3, angular: geometry/Vector3}, "]),
        (
            Twist,
            {"linear": [1, 2]},
            ["geometry/Twist.linear: expected geometry/Vector3 {x: float, y: float, z: float}"],
        ),
        (Vector3, {"x": True}, ["geometry/Vector3.x: expected float, got bool True"]),
        (Vector3, {"x": None}, ["geometry/Vector3.x: expected float, got NoneType None"]),
        (Odometry, {"pose": {"covariance": [1, 2]}}, ["nav/Odometry.pose.covariance: expected 36 numbers, got 2"]),
        (Path, {"poses": [{}, {"pose": 1}]}, ["nav/Path.poses[1].pose: expected geometry/Pose {"]),
        (Path, {"poses": {}}, ["nav/Path.poses: expected a list of geometry/PoseStamped, got dict {}"]),
        (Range, {"radiation_type": 300}, ["sensor/Range.radiation_type: expected int from 0 to 255, got int 300"]),
        (DiagnosticStatus, {"level": 1.5}, ["diagnostic/DiagnosticStatus.level: expected int from 0 to 3, got float"]),
        (Image, {"data": "*"}, ["sensor/Image.data: expected bytes, as base64 or a list of numbers from 0 to 255"]),
        (Image, {"data": [256]}, ["sensor/Image.data: expected bytes"]),
        (Image, {"data": [-1]}, ["sensor/Image.data: expected bytes"]),
        (
            OccupancyGrid,
            {"data": [128]},
            ["nav/OccupancyGrid.data: expected bytes, as base64 or a list of numbers from -128 to 127, got list [128]"],
        ),
        (Time, "later", ["std/Time: expected std/Time {sec: int from"]),
        (Vector3, {3: 1}, ["geometry/Vector3 has no field '3'"]),
    ],
)
def test_every_mistake_is_told(type_: type[robo_messages.Message], data: object, mistakes: list[str]) -> None:
    with pytest.raises(MessageError) as caught:
        message_of(type_, data)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(mistakes)
    for line, mistake in zip(lines, mistakes, strict=True):
        assert line.startswith(mistake)


def test_nothing_is_added_to_restored_data() -> None:
    assert restored(Twist, {"angular": {"z": 1}}) == {"angular": {"z": 1}}
