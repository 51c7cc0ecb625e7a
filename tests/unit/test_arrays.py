"""Messages as numpy arrays, and back."""

import math
import subprocess
import sys
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from robo_messages import (
    Header,
    Image,
    LaserScan,
    MapMetaData,
    OccupancyGrid,
    PointCloud2,
    PointField,
    decode,
    decode_json,
    encode,
    encode_json,
    find_type,
    type_name,
)
from robo_messages.scans import LaserScanArray

PICTURES = {
    "mono8": ((4, 5), "u1"),
    "mono16": ((4, 5), "u2"),
    "bayer_rggb8": ((4, 6), "u1"),
    "rgb8": ((4, 5, 3), "u1"),
    "bgra16": ((4, 5, 4), "u2"),
    "16UC1": ((4, 5), "<u2"),
    "16SC2": ((4, 5, 2), ">i2"),
    "32FC1": ((4, 5), ">f4"),
    "64FC3": ((4, 5, 3), "f8"),
    "8UC": ((4, 5), "u1"),
    "yuv422": ((4, 6, 2), "u1"),
}


def numbers(shape: tuple[int, ...], kind: str) -> NDArray[Any]:
    return np.arange(math.prod(shape)).reshape(shape).astype(kind)


@pytest.mark.parametrize("encoding", PICTURES)
def test_a_picture_comes_back_as_it_was(encoding: str) -> None:
    picture = numbers(*PICTURES[encoding])
    image = Image.from_array(picture, encoding, Header(frame_id="camera"))
    assert (image.height, image.width) == picture.shape[:2]
    assert np.shares_memory(image.array, picture)
    again = decode(encode(image), Image)
    assert again.header.frame_id == "camera"
    assert again.array.dtype == picture.dtype
    assert (again.array == picture).all()
    assert not again.array.flags.writeable


def test_a_row_may_be_longer_than_its_pixels() -> None:
    image = Image(height=2, width=2, encoding="mono8", step=3, data=memoryview(b"ab-cd"))
    with pytest.raises(ValueError, match=r"^Image.data has 5 bytes, and 2 rows of 3 bytes are 6$"):
        _ = image.array
    image.data = memoryview(b"ab-cd-")
    assert image.array.tobytes() == b"abcd"


def test_a_part_of_a_picture_is_copied_and_an_empty_one_is_empty() -> None:
    picture = numbers((4, 5), "u1")
    assert (Image.from_array(picture[1:3, ::2], "mono8").array == picture[1:3, ::2]).all()
    assert Image.from_array(picture[:0], "mono8").array.shape == (0, 5)
    assert decode(encode(Image.from_array(picture[:, :0], "mono8")), Image).array.shape == (4, 0)


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (Image(encoding="nv12"), "encoding 'nv12': an array can be made of mono8"),
        (Image(encoding="64UC1"), "encoding '64UC1'"),
        (Image(encoding="rgb8", height=1, width=3, step=8), "Image.step is 8: a row of 3 pixels rgb8 takes 9 bytes"),
    ],
)
def test_a_picture_that_is_no_array_says_why(image: Image, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        _ = image.array


@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 4), (4,)])
def test_an_array_that_does_not_fit_its_encoding_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"^rgb8 takes an array \(height, width, 3\) of uint8, not "):
        Image.from_array(np.zeros(shape, np.uint8), "rgb8")


def test_a_cloud_comes_back_as_it_was() -> None:
    points = np.zeros(5, [("x", "f4"), ("rgb", "u1", (3,)), ("t", "f8")])
    points["x"] = range(5)
    points["rgb"][2] = (1, 2, 3)
    cloud = PointCloud2.from_array(points, Header(frame_id="lidar"))
    assert np.shares_memory(cloud.array, points)
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        ("x", 0, PointField.FLOAT32, 1),
        ("rgb", 4, PointField.UINT8, 3),
        ("t", 7, PointField.FLOAT64, 1),
    ]
    again = decode(encode(cloud), PointCloud2)
    assert again.is_dense
    assert again.header.frame_id == "lidar"
    assert (again.array == points).all()


def test_a_cloud_of_rows_and_of_bare_numbers() -> None:
    places = numbers((4, 2, 3), ">f8")
    places[3, 1, 2] = math.nan
    cloud = PointCloud2.from_array(places)
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (4, 2, 24, 48)
    assert cloud.is_bigendian
    assert not cloud.is_dense
    assert PointCloud2.from_array(places, is_dense=True).is_dense
    assert (cloud.array["y"] == places[..., 1]).all()
    assert PointCloud2.from_array(places[:0]).array.shape == (0, 2)


def test_bytes_between_fields_and_rows_are_left_out() -> None:
    fields = [PointField("a", 1, PointField.UINT8, 1), PointField("", 2, 0, 1), PointField("b", 3, PointField.INT8, 0)]
    cloud = PointCloud2(
        height=2, width=1, fields=fields, point_step=4, row_step=5, data=memoryview(b"-\1-\2|-\3-\4|"), is_dense=True
    )
    assert cloud.array.tolist() == [[(1, 2)], [(3, 4)]]


@pytest.mark.parametrize(
    ("cloud", "said"),
    [
        (PointCloud2(fields=[PointField("a", 0, 0, 1)], point_step=4), "a has datatype 0; it is 1 to 8"),
        (PointCloud2(fields=[PointField("a", 2, 7, 1)], point_step=4), "a point_step of 4 bytes"),
        (
            PointCloud2(height=1, width=2, fields=[PointField("a", 0, 7, 1)], point_step=4, row_step=4),
            "row_step is 4: 2 points take 8 bytes",
        ),
        (
            PointCloud2(height=2, width=1, fields=[PointField("a", 0, 7, 1)], point_step=4, row_step=4),
            "PointCloud2.data has 0 bytes, and 2 rows of 4 bytes are 8",
        ),
    ],
)
def test_a_cloud_that_is_no_array_says_why(cloud: PointCloud2, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        _ = cloud.array


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros(2, [("a", "i8")]), "and a is int64"),
        (np.zeros(2, [("a", "<f4"), ("b", ">f4")]), "one byte order"),
        (np.zeros((2, 4)), "with a last axis of 3|x, y and z"),
        (np.zeros((1, 2, 2), [("a", "f4")]), "rows, points"),
    ],
)
def test_an_array_that_makes_no_cloud_is_refused(array: NDArray[Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        PointCloud2.from_array(array)


def test_a_map_comes_back_as_it_was() -> None:
    cells = np.array([[0, 100, -1], [-1, 50, 0]])
    grid = OccupancyGrid.from_array(cells, 0.05, header=Header(frame_id="map"))
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (3, 2, 0.05)
    assert (decode(encode(grid), OccupancyGrid).array == cells).all()
    small = cells.astype(np.int8)
    assert np.shares_memory(OccupancyGrid.from_array(small, 0.05).array, small)
    with pytest.raises(ValueError, match="-128 to 127, and these are 0 to 200"):
        OccupancyGrid.from_array(np.array([[0, 200]]), 0.05)
    with pytest.raises(ValueError, match=r"not \(2,\) of float64"):
        OccupancyGrid.from_array(np.zeros(2), 0.05)
    with pytest.raises(ValueError, match="data has 0 bytes, and 2 x 3 cells are 6"):
        _ = OccupancyGrid(info=MapMetaData(width=3, height=2)).array


RANGES = st.lists(st.floats(width=32) | st.integers(-1000, 1000), max_size=40)


@given(RANGES)
def test_ranges_as_a_list_are_read_as_an_array(ranges: list[float]) -> None:
    read = decode(encode(LaserScan(ranges=ranges)), LaserScanArray)
    np.testing.assert_array_equal(read.ranges, ranges)


@given(RANGES, st.sampled_from(["f4", "f8", ">f4"]))
def test_ranges_as_an_array_are_read_as_a_list(ranges: list[float], kind: str) -> None:
    scan = LaserScanArray(range_max=5.0)
    scan.ranges = np.array(ranges, kind)
    scan.intensities = ranges
    read = decode(encode(scan), LaserScan)
    assert read.range_max == 5.0
    np.testing.assert_array_equal(read.ranges, np.array(ranges, kind))
    np.testing.assert_array_equal(read.intensities, ranges)
    again = decode(encode(scan), LaserScanArray)
    np.testing.assert_array_equal(again.ranges, np.array(ranges, kind))
    if ranges:
        assert again.ranges.dtype == (np.float32 if kind == "f4" else np.float64)
        assert again.intensities.dtype == np.float64


@pytest.mark.parametrize("count", [0, 15, 16, 2**16 - 1, 2**16])
def test_ranges_of_any_number(count: int) -> None:
    scan = LaserScanArray()
    scan.ranges = np.arange(count, dtype=np.float32)
    assert decode(encode(scan), LaserScan).ranges == list(range(count))
    assert len(decode(encode(LaserScan(ranges=[0.5] * count)), LaserScanArray).ranges) == count


def test_an_integer_that_takes_as_many_bytes_as_a_float_is_read_as_itself() -> None:
    payload = msgspec.msgpack.encode({"ranges": [1.0, 2**63, -(2**62), 2.0]})
    assert decode(payload, LaserScanArray).ranges.tolist() == [1.0, 2.0**63, -(2.0**62), 2.0]


def test_a_scan_in_json_is_read_too() -> None:
    scan = LaserScan(ranges=[1.0, math.inf, 2.0], angle_increment=0.5)
    read = decode_json(encode_json(scan), LaserScanArray)
    assert read.ranges.tolist() == [1.0, math.inf, 2.0]
    assert read.angles().tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("ranges", [4, ["a"], [[1.0]], None, {}])
def test_what_is_no_array_of_numbers_is_malformed(ranges: object) -> None:
    payload = msgspec.msgpack.encode({"ranges": ranges})
    with pytest.raises(msgspec.ValidationError, match="array of numbers"):
        decode(payload, LaserScanArray)
    with pytest.raises(ValueError, match="one row"):
        LaserScanArray().ranges = np.zeros((2, 2))


def test_both_scans_are_one_type_of_the_same_fields() -> None:
    assert type_name(LaserScanArray) == type_name(LaserScan) == "sensor/LaserScan"
    assert find_type("sensor/LaserScan") is LaserScan
    assert LaserScanArray.__struct_encode_fields__ == LaserScan.__struct_encode_fields__
    assert encode(LaserScanArray()) == encode(LaserScan())


def test_without_numpy_an_array_names_the_extra_and_messages_work() -> None:
    script = """
import sys
sys.modules["numpy"] = None
from robo_messages import Image, decode, encode
image = decode(encode(Image(encoding="mono8")), Image)
try:
    image.array
except ModuleNotFoundError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert run.stdout == "messages as arrays need numpy, which is not installed: pip install 'robo-zenoh[numpy]'\n"
