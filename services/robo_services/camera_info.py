"""How a camera sees, from a calibration file as ROS's camera_calibration writes it."""

import math
from pathlib import Path
from typing import Annotated
from urllib.parse import unquote, urlsplit

import msgspec
from msgspec import Meta

from robo import RoboError
from robo.errors import UnreadableFile
from robo.process import lean
from robo.text.files import read_text
from robo_messages import CameraInfo


class CalibrationError(RoboError):
    """A calibration file is missing or has mistakes; names all of them."""


class Matrix(msgspec.Struct, frozen=True):
    """A matrix, row by row."""

    rows: Annotated[int, Meta(ge=0, le=100)]
    cols: Annotated[int, Meta(ge=0, le=100)]
    data: list[float]


class Calibration(msgspec.Struct, frozen=True):
    """A calibration file. Keys that are not here, such as `avg_reprojection_error`, are nobody's mistake."""

    image_width: Annotated[int, Meta(gt=0, le=100_000)]
    image_height: Annotated[int, Meta(gt=0, le=100_000)]
    camera_matrix: Matrix
    distortion_coefficients: Matrix
    camera_name: str = ""
    distortion_model: str = "plumb_bob"
    rectification_matrix: Matrix = Matrix(3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    projection_matrix: Matrix | None = None


def load(url: str) -> CameraInfo:
    """What a calibration file says, without a header.

    Args:
        url: a path, or file:///…

    Raises:
        CalibrationError: the file is missing, unreadable or has a mistake; says where.
    """
    lean.import_yaml()
    from robo.text.tree import Map, Problem, convert
    from robo.text.yaml_tree import parse  # a node without a calibration carries no YAML

    path = path_of(url)
    try:
        text = read_text(path)
    except UnreadableFile as error:
        raise CalibrationError(f"calibration {path} cannot be read: {error}") from None
    problems: list[Problem] = []
    tree = parse(text, str(path), problems)
    read: Calibration | None = None
    if isinstance(tree, Map):
        read = convert(tree, Calibration, problems)
    elif not problems:
        raise CalibrationError(f"calibration {path} is no map with camera_matrix, distortion_coefficients, …")
    if problems or read is None:
        raise CalibrationError("\n".join(map(str, problems)))
    return _info(read, path)


def path_of(url: str) -> Path:
    """The path of a URL.

    Raises:
        CalibrationError: it is none of a file of this machine.
    """
    if "://" not in url:
        return Path(url)
    parts = urlsplit(url)
    if parts.scheme != "file" or parts.netloc not in ("", "localhost"):
        raise CalibrationError(f"camera_info_url {url}: use a path, or file:///…")
    return Path(unquote(parts.path))


def _info(read: Calibration, path: Path) -> CameraInfo:
    k = read.camera_matrix.data
    projection = read.projection_matrix or Matrix(3, 4, [*k[:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0])
    wanted = {
        "camera_matrix": (read.camera_matrix, (3, 3)),
        "rectification_matrix": (read.rectification_matrix, (3, 3)),
        "projection_matrix": (projection, (3, 4)),
    }
    for name, (matrix, shape) in wanted.items():
        if (matrix.rows, matrix.cols) != shape or len(matrix.data) != shape[0] * shape[1]:
            raise CalibrationError(f"{path}: {name} has to have {shape[0]} rows, {shape[1]} cols and as many data")
    d = read.distortion_coefficients
    if d.rows * d.cols != len(d.data):
        raise CalibrationError(f"{path}: distortion_coefficients has {len(d.data)} data and {d.rows} x {d.cols}")
    every = [*k, *d.data, *read.rectification_matrix.data, *projection.data]
    if not all(map(math.isfinite, every)):
        raise CalibrationError(f"{path}: a number is NaN or infinite")
    return CameraInfo(
        height=read.image_height,
        width=read.image_width,
        distortion_model=read.distortion_model,
        d=d.data,
        k=tuple(k),
        r=tuple(read.rectification_matrix.data),
        p=tuple(projection.data),
    )
