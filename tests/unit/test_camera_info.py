"""Calibrations of cameras, as ROS's camera_calibration writes them."""

from pathlib import Path

import pytest

from robo_services import camera_info
from robo_services.camera_info import CalibrationError

CALIBRATION = """\
image_width: 640
image_height: 480
camera_name: head
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0, 320, 0, 501, 240, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [510, 0, 321, 0, 0, 511, 241, 0, 0, 0, 1, 0]
"""


def test_a_calibration_of_ros(tmp_path: Path) -> None:
    file = tmp_path / "a b.yaml"
    file.write_text(CALIBRATION)
    info = camera_info.load(str(file))
    assert (info.width, info.height, info.distortion_model) == (640, 480, "plumb_bob")
    assert (info.k[0], info.k[4], info.d[1], info.r[0], info.p[5]) == (500.5, 501, -0.2, 1, 511)
    assert camera_info.load(file.as_uri()) == info


def test_what_it_does_not_say_is_that_of_a_single_camera(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(CALIBRATION.partition("rectification")[0])
    info = camera_info.load(str(file))
    assert info.r == pytest.approx((1, 0, 0, 0, 1, 0, 0, 0, 1))
    assert info.p == pytest.approx((500.5, 0, 320, 0, 0, 501, 240, 0, 0, 0, 1, 0))


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("image_width: 640", "", "image_width"),
        ("image_width: 640", "image_width: wide", r"1:14.*expected int"),
        (
            "rows: 3\n  cols: 3\n  data: [500.5",
            "rows: 3\n  cols: 2\n  data: [500.5",
            "camera_matrix has to have 3 rows",
        ),
        ("[500.5, 0, 320", "[500.5, 320", "camera_matrix has to have 3 rows"),
        ("[500.5,", "[.nan,", "NaN or infinite"),
        ("[0.1, -0.2", "[0.1, .inf", "NaN or infinite"),
        ("data: [510, ", "data: [", "projection_matrix has to have 3 rows"),
        ("cols: 5", "cols: 4", "distortion_coefficients has 5 data and 1 x 4"),
    ],
)
def test_mistakes_of_a_calibration_are_said(tmp_path: Path, old: str, new: str, text: str) -> None:
    file = tmp_path / "a.yaml"
    assert old in CALIBRATION
    file.write_text(CALIBRATION.replace(old, new, 1))
    with pytest.raises(CalibrationError, match=text):
        camera_info.load(str(file))


@pytest.mark.parametrize("url", ["none.yaml", "package://a/b.yaml", "file://elsewhere/a.yaml", "."])
def test_a_calibration_that_cannot_be_read_is_said(url: str) -> None:
    with pytest.raises(CalibrationError):
        camera_info.load(url)


def test_a_file_that_is_no_map_is_said(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    for text in ("", "[1, 2]", "{", "hello"):
        file.write_text(text)
        with pytest.raises(CalibrationError):
            camera_info.load(str(file))
