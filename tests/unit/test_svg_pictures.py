"""Pictures of curves, graphs and maps: what is in them, and that nothing lies on anything else."""

import math
import struct
import zlib
from itertools import combinations, pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo import bag
from robo.bag.look.series import series
from robo.bag.types import topic_of
from robo.errors import UsageError
from robo.interfaces import cdr
from robo.interfaces.units import unit_of
from robo.text.canvas import Canvas
from robo.text.graph import Edge, GraphNode, build
from robo.text.graph_svg import graph_svg
from robo.text.layers import Box, layout
from robo.text.png import png
from robo.text.svg import Curve, Panel, Theme, curves, labels, shortened, ticks
from robo.text.thinning import Thinned
from robo.wire.qos import QoS
from robo_messages import LaserScan, Message, Odometry, PoseStamped, Twist, Vector3
from robo_messages.sensor import BatteryState, NavSatFix
from tests import bags

SVG = "{http://www.w3.org/2000/svg}"


def texts(svg: str) -> list[str]:
    return [element.text or "" for element in ElementTree.fromstring(svg).iter(f"{SVG}text")]


@pytest.mark.parametrize(
    ("type_", "path", "unit"),
    [
        (Odometry, "pose.pose.position.x", "m"),
        (Odometry, "pose.pose.orientation.z", ""),
        (Odometry, "pose.covariance[0]", ""),
        (Odometry, "twist.twist.linear.x", "m/s"),
        (Odometry, "twist.twist.angular.z", "rad/s"),
        (Odometry, "header.stamp", "s"),
        (LaserScan, "ranges[3]", "m"),
        (LaserScan, "angle_min", "rad"),
        (Twist, "linear.x", "m/s"),
        (BatteryState, "voltage", "V"),
        (NavSatFix, "altitude", "m"),
        (BatteryState, "percentage", ""),
        (PoseStamped, "pose.position.y", "m"),
        (Twist, "no.such", ""),
    ],
)
def test_the_unit_of_a_field_is_what_its_type_says(type_: type[Message], path: str, unit: str) -> None:
    assert unit_of(type_, path) == unit


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=300), st.integers(2, 40))
def test_thinned_lines_keep_their_peaks(values: list[float], most: int) -> None:
    line = Thinned(most)
    for time, value in enumerate(values):
        line.add(float(time), value)
    kept = line.points
    assert len(kept) <= 3 * most
    assert [time for time, _ in kept] == sorted(time for time, _ in kept)
    finite = [value for value in values if math.isfinite(value)]
    shown = [value for _, value in kept if math.isfinite(value)]
    assert (min(finite, default=0), max(finite, default=0)) == (min(shown, default=0), max(shown, default=0))
    assert line.count == len(values)


@given(st.floats(-1e300, 1e300), st.floats(0, 1e300))
def test_ticks_are_few_and_within(low: float, size: float) -> None:
    found = ticks(low, low + size)
    assert 1 <= len(found) <= 8
    assert all(low - size * 1e-6 <= one <= low + size * (1 + 1e-6) or one in (low, low + size) for one in found)


@pytest.mark.parametrize("theme", ["auto", "light", "dark"])
def test_curves_have_names_units_and_times(theme: Theme) -> None:
    line = Curve("r1/odom <b>x</b>", [(0.0, 1.0), (1.0, math.nan), (2.0, 3.0), (3.0, 2.0)])
    svg = curves("a & b\x00\x1b", [Panel([line], "m/s"), Panel([Curve("none", [])])], "s since then", theme=theme)
    assert {"a & b��", "m/s", "r1/odom <b>x</b>", "none", "s since then"} <= {*texts(svg)}
    path, dot = ElementTree.fromstring(svg).iter(f"{SVG}path")
    assert path.get("d", "").count("M") == 1  # after the gap
    assert dot.get("d", "").endswith("h0")  # a point alone is seen
    assert ".dot{stroke-width:4}" in svg
    assert ("prefers-color-scheme" in svg) == (theme == "auto")
    assert "http" not in svg.replace("http://www.w3.org/2000/svg", "")


@given(st.floats(-1e300, 1e300), st.floats(0, 1e300), st.integers(4, 8))
def test_no_two_marks_of_an_axis_say_the_same(low: float, size: float, most: int) -> None:
    marks = ticks(low, low + size, most)
    assert len({*labels(marks)}) == len({*marks})


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [
        (48.137154, 48.137163, ["48.137155", "48.137160"]),
        (5412345.2, 5412348, ["5412346", "5412347", "5412348"]),
        (1.764e9, 1.764e9 + 9, ["1764000000", "1764000005"]),
        (100000, 100000.49, ["100000.0", "100000.2", "100000.4"]),
        (-1, 1, ["-1.0", "-0.5", "0", "0.5", "1.0"]),
        (0, 30, ["0", "10", "20", "30"]),
        (0, 3e-29, ["0", "1e-29", "2e-29", "3e-29"]),
        (5, 5, ["5"]),
    ],
)
def test_marks_of_an_axis_have_the_digits_that_tell_them_apart(low: float, high: float, wanted: list[str]) -> None:
    assert labels(ticks(low, high, 4)) == wanted


def test_one_point_stands_in_the_middle() -> None:
    svg = curves("t", [Panel([Curve("a", [(3.0, 1.0)])])], "s")
    assert {"2.5", "3.0", "3.5"} <= {*texts(svg)} or {"2.6", "3.0", "3.4"} <= {*texts(svg)}
    (dot,) = ElementTree.fromstring(svg).iter(f"{SVG}path")
    assert dot.get("d", "").startswith("M490.0 ")


def test_long_numbers_and_wide_letters_have_room() -> None:
    svg = curves("t", [Panel([Curve("速度速度速度", [(0.0, 1.7e9), (1.0, 1.7e9 + 3e-6)]), Curve("b", [])])], "s")
    root = ElementTree.fromstring(svg)
    for one in root.iter(f"{SVG}text"):
        if one.get("text-anchor") == "end" and (one.text or "").startswith("1.7"):
            assert float(one.get("x", "0")) > 7 * len(one.text or "")
    first, second = (float(one.get("x", "0")) for one in root.iter(f"{SVG}text") if one.text in ("速度速度速度", "b"))
    assert second - first > 6 * 13  # each is as wide as it is high
    assert shortened("速度速度", 6) == "速度…"


def test_values_of_any_size_are_drawn() -> None:
    svg = curves("t", [Panel([Curve("a", [(0.0, -1.7e308), (1.0, 1.7e308)])])], "s")
    assert "nan" not in svg
    assert "inf" not in svg


def test_series_of_a_recording(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    with bag.open(tmp_path / "drive.mcap") as recording:
        names = ["r1/cmd_vel", "r1/odom"]
        found = series(recording, names, []).series
        assert [(one.topic, one.field, one.unit) for one in found] == [
            ("r1/cmd_vel", "linear.x", "m/s"),
            ("r1/odom", "pose.pose.position.x", "m"),
        ]
        assert found[0].values == 100
        assert found[0].points[-1] == pytest.approx((0.99, 9.9))
        (ranges,) = series(recording, ["r1/scan"], ["ranges[1]", "ranges[1]"]).series
        (last,) = series(recording, ["r1/scan"], ["ranges[-2]"]).series
        assert last.points == ranges.points
        assert {value for _, value in ranges.points} == {2.0}
        half = recording.begin + 500 * bags.MS
        (part,) = series(recording, ["r1/cmd_vel"], ["linear.x"], begin=half).series
        assert part.points[0][0] == pytest.approx(0.0, abs=0.011)
        for fields, told in ((["lin.x"], "did you mean linear.x"), (["linear"], "no number"), (["a b"], "write names")):
            with pytest.raises(UsageError, match=told):
                series(recording, ["r1/cmd_vel"], fields)


def test_series_of_messages_that_lack_something(tmp_path: Path) -> None:
    second = 10**9
    with bag.Recording(tmp_path / "odd.mcap", bag.Options(compression="none", sync=False)) as recording:
        scans = recording.topic(topic_of("r1/scan", LaserScan, QoS.DEFAULT))
        simulated = recording.topic(topic_of("r1/cmd_vel", Twist, QoS.DEFAULT))
        for step in range(5):
            at = bags.START + step * second
            data = cdr.encoder(LaserScan)(LaserScan(ranges=[float(step)] * step))
            recording.write(scans, data if step != 3 else b"\0\1\0\0\xff", at, at, 0, "node")
            recording.write(simulated, cdr.encoder(Twist)(Twist(Vector3(x=step))), at, step * second + 1, 0, "node")
    with bag.open(tmp_path / "odd.mcap") as opened:
        found = series(opened, ["r1/scan"], ["ranges[0]"])
        assert [(one.field, one.points) for one in found.series] == [
            ("ranges[0]", [(1.0, 1.0), (2.0, 2.0), (4.0, 4.0)])
        ]
        (told,) = found.readable.notes()
        assert told.startswith("1 message could not be read; the first: ")
        with pytest.raises(UsageError, match=r"ranges has 0 items, no \[99\]"):
            series(opened, ["r1/scan"], ["ranges[99]"])
        other = series(opened, ["r1/cmd_vel"], ["linear.x"])
        assert other.by_arrival == ["r1/cmd_vel"]
        assert other.series[0].points == [(float(step), float(step)) for step in range(5)]


def overlap(a: Box, b: Box) -> bool:
    return a.x < b.x + b.width and b.x < a.x + a.width and a.y < b.y + b.height and b.y < a.y + a.height


@given(st.data())
def test_no_box_lies_on_another_and_no_arrow_crosses_one(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 14))
    sizes = {name: (data.draw(st.integers(40, 300)), data.draw(st.integers(20, 60))) for name in range(count)}
    ends = st.integers(0, count - 1)
    arrows = data.draw(st.lists(st.tuples(ends, ends), max_size=30))
    placed = layout({name: (float(w), float(h)) for name, (w, h) in sizes.items()}, arrows)
    for a, b in combinations(placed.boxes.values(), 2):
        assert not overlap(a, b)
    assert len(placed.arrows) == len(arrows)
    for route in placed.arrows:
        for (x, y), (to_x, to_y) in list(pairwise(route))[1::2]:  # where it passes boxes
            assert y == to_y
            passage = Box(min(x, to_x), y - 0.5, abs(to_x - x), 1.0)
            assert not any(overlap(passage, box) for box in placed.boxes.values())
    # Else two arrows looked like one with two heads.
    assert {route[-1] for route in placed.arrows}.isdisjoint(route[0] for route in placed.arrows)


def test_a_graph_says_all_and_what_is_wrong() -> None:
    nodes = [GraphNode("/r1/a", "m:A"), GraphNode("/r1/b", "m:B")]
    edges = [
        Edge("/r1/a", "pub", "r1/odom", "nav/Odometry"),
        Edge("/r1/b", "sub", "r1/odom", "nav/Odometry"),
        Edge("/r1/b", "pub", "r1/lost", "std/Bool"),
        Edge("/r1/b", "pub", "r1/back", "std/Bool"),
        Edge("/r1/a", "sub", "r1/back", "std/Bool"),
        Edge("/r1/a", "srv", "r1/reset", "std/Trigger"),
        Edge("zenoh:<1>", "cli", "r1/reset", "std/Trigger"),
    ]
    svg = graph_svg(build(nodes, edges), "r1 <graph>")
    wanted = {"/r1/a", "A", "r1/odom", "nav/Odometry", "nobody subscribes it", "r1/reset", "zenoh:<1>", "r1 <graph>"}
    assert wanted <= {*texts(svg)}
    drawn = [one for one in ElementTree.fromstring(svg).iter(f"{SVG}path") if "arrow " in one.get("class", "")]
    assert len(drawn) == 7
    ElementTree.fromstring(graph_svg(build([], []), "nothing"))


def test_a_png_has_its_pixels() -> None:
    canvas = Canvas(7, 3)
    canvas.block(-2, 1, 5, 9, 1)
    canvas.lines([(4.0, 0.0), (6.0, 0.0), (1e9, 0.0)], 1, 2)
    data = png(7, 3, canvas.pixels, [(255, 255, 255, 255), (0, 0, 0, 255), (9, 9, 9, 128)])
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, found = 8, {}
    while at < len(data):
        (size,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        assert struct.unpack(">I", data[at + 8 + size : at + 12 + size])[0] == zlib.crc32(kind + body)
        found[kind] = body
        at += 12 + size
    rows = zlib.decompress(found[b"IDAT"])
    assert rows == b"\0\0\0\0\0\2\2\2" + b"\0\1\1\1\0\0\0\0" * 2
    assert (len(found[b"PLTE"]), found[b"tRNS"]) == (9, bytes([255, 255, 128]))


def test_a_canvas_writes_numbers() -> None:
    canvas = Canvas(40, 10)
    canvas.text(0, 0, "5 m", 1, size=1)
    assert 10 < sum(canvas.pixels) < 60
