"""What a node says now beside what it said: fields, tolerances, alignment, and how that is told."""

import datetime
import itertools
import math
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo import bag
from robo.bag.look.fields import number, unequal
from robo.bag.publishers import Publishers, publishers_of
from robo.bag.regression import comparing
from robo.bag.regression import report as replay_report
from robo.bag.regression.alignment import by_time, in_order
from robo.bag.regression.comparing import Extent
from robo.bag.regression.renewal import renew
from robo.bag.regression.report import Input, NodeTopics, ReplayReport, Spot, TopicReport, Trouble, Verdict, lines
from robo.bag.regression.tolerances import Tolerance, Tolerances, load, read_tolerances
from robo.bag.types import topic_of
from robo.errors import BagError, UsageError
from robo.interfaces import cdr
from robo.testing.regression import other_clocks
from robo.testing.regression.outputs import others_of, said_then
from robo.testing.regression.phase import phase, start_before
from robo.testing.regression.pictures import draw, thinned
from robo.text.svg import plot
from robo.wire.keys import LOG_TOPIC
from robo.wire.qos import QoS
from robo_messages import Duration, Header, JointState, LaserScan, Message, Odometry, String, Time, Twist, Vector3
from tests import replays
from tests.bags import MS, START

EXACT = Extent(exact=True)


def fields(a: Message, b: Message) -> list[tuple[str, Any, Any]]:
    return [tuple(found) for found in unequal(a, b)]


def test_fields_differ_bit_for_bit() -> None:
    nan = math.nan
    assert fields(Vector3(nan, 0.0, 1.0), Vector3(nan, -0.0, 1.0)) == [("y", 0.0, -0.0)]
    assert fields(Vector3(nan), Vector3(0.0))[0][0] == "x"
    assert fields(Vector3(math.inf), Vector3(math.inf)) == []
    a, b = LaserScan(ranges=[1.0, 2.0, 3.0]), LaserScan(ranges=[1.0, 2.5, 3.5])
    assert fields(a, b) == [("ranges.1", 2.0, 2.5), ("ranges.2", 3.0, 3.5)]
    assert fields(a, LaserScan(ranges=[1.0])) == [("ranges", [1.0, 2.0, 3.0], [1.0])]
    stamped = Header(Time(1, 2)), Header(Time(1, 3))
    assert fields(*stamped) == [("stamp.nanosec", 2, 3)]
    assert [one.field for one in unequal(*stamped, (Time,))] == ["stamp"]
    assert fields(JointState(name=["a"]), JointState(name=["b"])) == [("name.0", "a", "b")]


TEXT = """
time: 0.005
topics:
  r1/odom:
    time: 0.01
    fields:
      pose.pose.position: 0.001
      twist.*.linear: {relative: 1.0e-6}
      twist.twist.linear.x: {absolute: 2, relative: 0.5}
  "**":
    fields:
      "**.stamp": ignore
"""


def test_rules_hold_for_topics_and_fields_that_fit(tmp_path: Path) -> None:
    (tmp_path / "some.yaml").write_text(TEXT)
    some = load(tmp_path / "some.yaml", ["covariance", "r1/odom:frame"])
    assert (some.time_of("r1/odom"), some.time_of("r1/scan")) == (0.01, 0.005)
    assert some.of("r1/odom", "pose.pose.position.x") == Tolerance(0.001)
    assert some.of("r1/odom", "pose.pose.positions") == Tolerance()
    assert some.of("r2/odom", "pose.pose.position.x") == Tolerance()
    assert some.of("r1/odom", "twist.twist.linear.y") == Tolerance(relative=1e-6)
    assert some.of("r1/odom", "twist.twist.linear.x") == Tolerance(2.0, 0.5)
    for field in ("header.stamp", "transforms.0.header.stamp.sec", "stamp"):
        assert some.of("any/thing", field).ignored
    assert not some.of("any/thing", "header.stamps").ignored
    assert some.of("x", "covariance.3").ignored
    assert (some.of("r1/odom", "frame").ignored, some.of("x", "frame").ignored) == (True, False)
    assert some.idle(["r1/scan"]) == ["r1/odom"]
    assert load(None, ["r$*/o*:x"]).of("r1/odom", "x").ignored, "as topics are written everywhere"
    assert load(None).of("x", "y") == Tolerance()
    exact = some.only_ignored()
    assert (exact.of("r1/odom", "pose.pose.position.x"), exact.time_of("r1/odom")) == (Tolerance(), None)
    assert exact.of("x", "covariance.3").ignored


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("topics: {a: {felds: {}}}", "f:1:14: there is no key 'felds' here; did you mean fields?"),
        ("tim: 3", "f:1:1: there is no key 'tim' here; did you mean time?"),
        ("time: -1", "f:1:7: expected a number of at least 0, not -1"),
        ("time: .nan", "f:1:7: expected a number of at least 0, not nan"),
        ("topics: 3", "f:1:9: expected a map, not 3"),
        ("topics: {a: {fields: {x: no}}}", "f:1:26: expected a number of at least 0, {absolute: …, relative: …} or i"),
        ("topics: {a: {fields: {x: {absolut: 1}}}}", "f:1:27: there is no key 'absolut' here; did you mean absolute?"),
        ("a: [", "f:1:"),
        ("topics: {a//b: {}}", "f:1:10: topic 'a//b' makes no sense"),
        ("topics: {r1/od**: {time: 1}}", "f:1:10: topic 'r1/od**' makes no sense"),
    ],
)  # fmt: skip
def test_mistakes_in_tolerances_are_told_with_their_place(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=f"^{re.escape(told)}"):
        read_tolerances(text, "f")


def test_what_is_ignored_is_written_as_a_field() -> None:
    for word in ("", ":x", "r1/odom:"):
        with pytest.raises(UsageError, match="write FIELD or TOPIC:FIELD"):
            load(None, [word])
    with pytest.raises(UsageError, match="--ignore 'r1//odom:x': topic 'r1//odom' makes no sense"):
        load(None, ["r1//odom:x"])
    with pytest.raises(UsageError, match=r"no\.yaml: No such file"):
        load("no.yaml")


def test_a_tolerance_is_of_the_larger_number() -> None:
    assert Tolerance(0.1).allows(1.0, 1.1 - 1e-9)
    assert not Tolerance(0.1).allows(1.0, 1.11)
    assert Tolerance(relative=0.1).allows(90.0, 100.0)
    assert not Tolerance(relative=0.1).allows(math.inf, math.inf)
    assert not Tolerance().allows(1.0, 1.0)


def times(first: Sequence[int], second: Sequence[int], window: int = 100) -> list[tuple[int | None, int | None]]:
    pairs = by_time(first, second, int, window)
    return list(pairs)


def test_what_is_missing_makes_nothing_of_what_follows_differ() -> None:
    assert times([0, 10, 20, 30], [0, 20, 30]) == [(0, 0), (10, None), (20, 20), (30, 30)]
    assert times([0, 20, 30], [0, 10, 20, 30]) == [(0, 0), (None, 10), (20, 20), (30, 30)]
    assert times([1, 11, 21], [0, 10, 20]) == [(1, 0), (11, 10), (21, 20)]
    assert times([0, 1000], [500]) == [(0, None), (None, 500), (1000, None)]
    assert times([], [1]) == [(None, 1)]
    assert list(in_order([1, 2], [3])) == [(1, 3), (2, None)]


@given(st.lists(st.integers(0, 10_000)), st.lists(st.integers(0, 10_000)), st.integers(0, 3_000))
def test_each_message_has_its_place_once_and_in_order(first: list[int], second: list[int], window: int) -> None:
    first, second = sorted(first), sorted(second)
    pairs = times(first, second, window)
    assert [a for a, _ in pairs if a is not None] == first
    assert [b for _, b in pairs if b is not None] == second
    assert all(abs(a - b) <= window for a, b in pairs if a is not None and b is not None)


@given(st.sets(st.integers(0, 199), max_size=150), st.integers(-4, 4))
def test_whatever_is_missing_the_rest_stays_together(missing: set[int], shift: int) -> None:
    """Of a steady topic that comes a little earlier or later now."""
    whole = [10 * number for number in range(200)]
    rest = [time + shift for number, time in enumerate(whole) if number not in missing]
    pairs = times(whole, rest, 1_000)
    together = {a: b for a, b in pairs if a is not None and b is not None}
    if rest:
        assert all(b == a + shift for a, b in together.items())
        assert len(together) == len(rest)


def record(path: Path, topic: str, *messages: tuple[int, Message], qos: QoS = QoS.DEFAULT) -> Path:
    """Messages with the times when they were published, ms after the beginning."""
    with bag.Recording(path, replays.PLAIN) as recording:
        log = replays.Log(recording)
        for at, message in messages:
            log.write(topic, message, at * MS, qos)
    return path


def compared(then: Path, now: Path, *, some: Tolerances | None = None, extent: Extent = EXACT) -> TopicReport:
    with bag.open(then) as first, bag.open(now) as second:
        return comparing.compare(first, second, "r1/x", some or Tolerances(), extent)


def twist(x: float) -> Twist:
    return Twist(Vector3(x=x))


def test_a_topic_is_told_with_its_first_and_largest_difference(tmp_path: Path) -> None:
    then = record(tmp_path / "a", "r1/x", *((10 * n, twist(n)) for n in range(10)))
    now = record(tmp_path / "b", "r1/x", *((10 * n, twist(n + {4: 0.5, 7: 2.0, 8: 1.0}.get(n, 0))) for n in range(10)))
    report = compared(then, now)
    assert (report.same, report.counts, report.compared, report.differing) == (False, (10, 10), 10, 3)
    (field,) = report.fields
    assert (field.field, field.differing, field.first.index, field.first.time) == ("linear.x", 3, 4, START + 40 * MS)
    assert (field.first.expected, field.first.actual, field.first.size) == (4.0, 4.5, 0.5)
    assert field.largest is not None
    assert (field.largest.index, field.largest.size) == (7, 2.0)
    assert compared(then, now, some=load(None, ["linear"])).same
    (tmp_path / "t.yaml").write_text("topics: {r1/x: {fields: {linear.x: 1}}}")
    assert [one.first.index for one in compared(then, now, some=load(tmp_path / "t.yaml")).fields] == [7]
    assert compared(then, then).same


def test_places_in_lists_are_one_field_and_not_finite_ones_have_no_size(tmp_path: Path) -> None:
    then = record(tmp_path / "a", "r1/x", (0, LaserScan(ranges=[1.0, 2.0, math.nan, 4.0])))
    now = record(tmp_path / "b", "r1/x", (0, LaserScan(ranges=[1.5, 2.0, math.nan, math.inf])))
    (field,) = compared(then, now).fields
    assert (field.field, field.differing, field.first.field) == ("ranges.*", 2, "ranges.0")
    assert field.largest == field.first
    longer = record(tmp_path / "c", "r1/x", (0, LaserScan(ranges=[1.0])))
    (field,) = compared(then, longer).fields
    assert (field.first.expected, field.first.actual, field.first.size) == ("4 elements", "1 elements", None)


def test_stamps_are_one_value(tmp_path: Path) -> None:
    then = record(tmp_path / "a", "r1/x", (0, Header(Time(1_700_000_000, 999_999_999))))
    now = record(tmp_path / "b", "r1/x", (0, Header(Time(1_700_000_001, 1))))
    (field,) = compared(then, now).fields
    assert field.first.size == pytest.approx(2e-9)
    assert (field.first.expected, field.first.actual) == ("1700000000.999999999", "1700000001.000000001")
    (tmp_path / "t.yaml").write_text("topics: {'**': {fields: {stamp: 3.0e-9}}}")
    assert compared(then, now, some=load(tmp_path / "t.yaml")).same
    assert number(Duration(1, 500_000_000)) == 1.5


def test_missing_and_additional_messages_are_told_alone(tmp_path: Path) -> None:
    every = [(10 * n, twist(n)) for n in range(50)]
    then = record(tmp_path / "a", "r1/x", *every)
    fewer = record(tmp_path / "b", "r1/x", *every[:7], *every[8:20], (205, twist(99)), *every[20:])
    report = compared(then, fewer)
    assert (report.missing, report.additional, report.differing, report.fields) == (1, 1, 0, [])
    assert (report.first_missing, report.first_additional) == (START + 70 * MS, START + 205 * MS)
    assert compared(fewer, then).counts == (50, 50)


def test_times_are_exact_of_a_reference_and_near_of_a_live_robot(tmp_path: Path) -> None:
    then = record(tmp_path / "a", "r1/x", *((10 * n, twist(n)) for n in range(100)))
    now = record(tmp_path / "b", "r1/x", *((10 * n + 3, twist(n)) for n in range(100)))
    report = compared(then, now)
    assert (report.moved, report.first_moved, report.missing, report.differing) == (100, START, 0, 0)
    assert report.shift == pytest.approx(0.003)
    live = Extent(exact=False, begin=START, end=START + 1000 * MS)
    assert compared(then, now, extent=live).same
    (tmp_path / "t.yaml").write_text("time: 0.002")
    assert compared(then, now, some=load(tmp_path / "t.yaml"), extent=live).moved == 100


def test_the_ends_of_a_live_recording_are_cut_somewhere(tmp_path: Path) -> None:
    every = [(10 * n, twist(n)) for n in range(100)]
    live = Extent(exact=False, begin=START + 20 * MS, end=START + 1000 * MS)
    then = record(tmp_path / "a", "r1/x", *every[:98])
    now = record(tmp_path / "b", "r1/x", *every[2:])
    assert compared(then, now, extent=live).same
    assert compared(then, now).trouble == 4


def test_latched_topics_count_whenever_they_were_said(tmp_path: Path) -> None:
    then = record(tmp_path / "a", "r1/x", (0, String("a")), qos=QoS.LATCHED)
    now = record(tmp_path / "b", "r1/x", (5_000, String("a")), qos=QoS.LATCHED)
    live = Extent(exact=False, begin=START + 6_000 * MS, end=START + 10_000 * MS, latched=True)
    assert compared(then, now, extent=live).counts == (1, 1)
    assert compared(then, now, extent=live).same


def test_messages_with_stamps_belong_together_by_them(tmp_path: Path) -> None:
    def at(n: int, x: float) -> Odometry:
        odometry = Odometry(Header(Time.from_nanoseconds(START + n * 10 * MS)))
        odometry.pose.pose.position.x = x
        return odometry

    then = record(tmp_path / "a", "r1/x", *((10 * n, at(n, n)) for n in range(50) if n != 9))
    now = record(tmp_path / "b", "r1/x", *((10 * n + 37, at(n, n)) for n in range(50)))
    report = compared(then, now, extent=Extent(exact=False))
    assert (report.additional, report.missing, report.differing) == (1, 0, 0)


def test_another_type_and_a_topic_that_is_gone(tmp_path: Path) -> None:
    then = record(tmp_path / "a", "r1/x", (0, twist(1)))
    assert compared(then, record(tmp_path / "b", "r1/x", (0, String("a")))).types == ("geometry/Twist", "std/String")
    gone = compared(then, record(tmp_path / "c", "r1/y", (0, twist(1))))
    assert (gone.counts, gone.missing, gone.same) == ((1, 0), 1, False)


def test_a_phase_is_told_of_times_that_keep_their_pace() -> None:
    period = 50 * MS
    ticks = [START + 7 * MS + n * period + (n % 3) * 10_000 for n in range(100)]
    found = phase(ticks, 0.05)
    assert found is not None
    assert found[0] == pytest.approx((START + 7 * MS) % period, abs=20_000)
    assert found[1] <= 10_000
    begin = start_before(START, found[0], 0.05)
    assert START - period < begin <= START
    assert (begin - ticks[0]) % period in (*range(20_001), *range(period - 20_000, period))
    around = [n * period + (n % 2) * 2_000 - 1_000 for n in range(1, 50)]
    assert phase(around, 0.05) is not None
    assert phase(ticks[:2], 0.05) is None
    assert phase([n * 37 * MS for n in range(100)], 0.05) is None


def test_a_picture_has_both_lines_and_is_well_formed() -> None:
    first = [(0.1 * n, math.sin(n)) for n in range(50)]
    second = [(time, value + 0.1) for time, value in first[:20]] + [(2.0, math.nan), *first[21:]]
    text = plot("r1/odom <x> & y", ("recorded", "now"), first, second, 1.0)
    root = ElementTree.fromstring(text)
    assert root.tag.endswith("svg")
    assert len([one for one in root.iter() if one.tag.endswith("path")]) == 5
    ElementTree.fromstring(plot("nothing", ("a", "b"), [], [], 0.0))
    ElementTree.fromstring(plot("one", ("a", "b"), [(0.0, 1e300)], [(0.0, -1e300)], 0.0))


@given(st.integers(0, 20_000))
def test_long_lines_are_thinned_evenly(count: int) -> None:
    (kept,) = thinned((float(number), 0.0) for number in range(count))
    assert len(kept) <= 2_001
    assert len({b[0] - a[0] for a, b in itertools.pairwise(kept)}) <= 1


@given(st.integers(0, 20_000), st.integers(0, 20_000))
def test_of_two_lines_the_same_points_are_kept(first: int, second: int) -> None:
    kept = thinned(*([(float(number), 0.0) for number in range(count)] for count in (first, second)))
    assert kept[0][: len(kept[1])] == kept[1][: len(kept[0])]


def test_pictures_of_two_topics_are_two_files(tmp_path: Path) -> None:
    names = "r1/a/b_c", "r1/a_b/c"
    spot = Spot(index=0, time=START, field="linear.x", expected=0.0, actual=1.0, size=1.0)
    for name in names:
        said = record(tmp_path / name.replace("/", "-"), name, (0, twist(1)), (10, twist(2)))
        with bag.open(said) as recording:
            assert draw(tmp_path / "plots", name, spot, recording, recording) is not None
    assert len(list((tmp_path / "plots").iterdir())) == 2


def test_messages_that_are_damaged_are_compared_as_bytes(tmp_path: Path) -> None:
    """Also where the others belong together by their stamps."""

    def stamped(n: int, x: float) -> Odometry:
        odometry = Odometry(Header(Time.from_nanoseconds(START + n * 10 * MS)))
        odometry.pose.pose.position.x = x
        return odometry

    now = record(tmp_path / "b", "r1/x", *((10 * n, stamped(n, n)) for n in range(5)))
    with bag.Recording(tmp_path / "a", replays.PLAIN) as recording:
        number = recording.topic(topic_of("r1/x", Odometry))
        for n in range(5):
            data = cdr.encoder(Odometry)(stamped(n, n + 1)) if n != 3 else b"\0\1\0\0no"
            recording.write(number, data, START + 10 * n * MS, START + 10 * n * MS)
    report = compared(tmp_path / "a", now)
    assert (report.counts, report.same) == ((5, 5), False)
    assert report.differing + report.missing >= 5


def test_topics_that_differ_come_in_the_order_in_which_they_first_do(tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "a.mcap", replays.PLAIN) as recording:
        log = replays.Log(recording)
        for n in range(3):
            for topic in ("r1/c", "r1/b", "r1/a"):
                log.write(topic, String(""), n * MS, late=0)
    reports = [
        TopicReport(name="r1/a", types=("", ""), counts=(3, 3), first_missing=START + MS, first_moved=START + 2 * MS),
        TopicReport(name="r1/b", types=("", ""), counts=(3, 3), first_missing=START + MS),
        TopicReport(name="r1/c", types=("", ""), counts=(3, 3), first_additional=START + 2 * MS),
    ]
    with bag.open(tmp_path / "a.mcap") as said:
        assert [one.name for one in comparing.earliest_first(reports, said)] == ["r1/b", "r1/a", "r1/c"]


def test_clocks_of_another_run_show_something_else() -> None:
    """Another year; and days pass in a second."""
    other: Any = other_clocks._clocks()
    here = time.gmtime()
    assert other.gmtime().tm_year > here.tm_year
    assert other.localtime().tm_year > here.tm_year
    assert other.strftime("%Y") != time.strftime("%Y")
    assert other.strftime("%Y", here) == time.strftime("%Y", here)
    for name in ("time", "monotonic", "perf_counter", "process_time"):
        assert getattr(other, name)() - getattr(time, name)() > 30e6
    begin, there_then = time.monotonic_ns(), other.monotonic_ns()
    while time.monotonic_ns() < begin + MS:
        pass
    assert other.monotonic_ns() - there_then > 80 * 10**9
    assert other.clock_gettime(time.CLOCK_MONOTONIC) > time.clock_gettime(time.CLOCK_MONOTONIC) + 30e6
    assert other.sleep is time.sleep


def test_dates_of_another_run_are_true_ones() -> None:
    other: Any = other_clocks._dates()
    now, today = other.datetime.now(), other.date.today()
    assert (type(now), type(today)) == (datetime.datetime, datetime.date)
    assert (now.year, now.month) != (datetime.date.today().year, datetime.date.today().month)
    assert other.datetime.now(datetime.UTC).tzinfo is datetime.UTC
    assert abs(other.datetime.utcnow() - other.datetime.now(datetime.UTC).replace(tzinfo=None)).days < 30
    true = datetime.datetime(2020, 1, 2, 3)
    assert other.datetime(2020, 1, 2, 3) == other.datetime.fromisoformat("2020-01-02T03:00") == true
    assert type(other.datetime.strptime("2020", "%Y")) is datetime.datetime
    assert isinstance(true, other.datetime)
    assert isinstance(true, other.date)
    assert not isinstance(today, other.datetime)
    assert issubclass(datetime.datetime, other.date)

    class Own(other.datetime):  # type: ignore[misc]
        pass

    assert type(Own(2020, 1, 2)) is Own
    assert not isinstance(true, Own)


def test_only_modules_of_users_have_other_clocks() -> None:
    def is_of_users(name: str, file: str) -> bool:
        return other_clocks.is_of_users({"__name__": name, "__file__": file}, {"mine"})

    assert is_of_users("birds", "/home/me/birds.py")
    assert is_of_users("mine.nodes", "/usr/lib/python3/site-packages/mine/nodes.py")
    assert not is_of_users("numpy.core", "/usr/lib/python3/site-packages/numpy/core.py")
    assert not is_of_users("robo.node.node", "/home/me/robo/node/node.py")
    assert not is_of_users("threading", "/usr/lib/python3/threading.py")
    assert not other_clocks.is_of_users({}, {"mine"})


def test_who_else_says_a_topic() -> None:
    a, b, c = "/r1/a", "/r1/b", "/r1/c"
    of_every_node = {f"r1/{LOG_TOPIC}": {a}, "r1/a/transition_event": {a}}
    then = Publishers({a, b}, {"r1/x": {a}, "r1/y": {a, b}, "r1/z": {b}, **of_every_node})
    assert others_of(then, None, {a}) == {"r1/y": [b], "r1/z": [b]}
    assert others_of(then, {"r1/x": [c]}, {a, b}) == {"r1/x": [c]}
    assert others_of(then, None, {c}) == {"r1/y": [a, b]}  # what one said alone, may be what this one says now
    assert said_then(then, {"r1/y": [b]}, {a}) == {a: ["r1/x"]}


def test_who_said_what_stands_in_the_graph(tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "a.mcap", replays.PLAIN) as recording:
        replays.attach_graph(recording, {"r1/x": ["/r1/a"]})
        replays.attach_graph(recording, {"r1/x": ["/r1/b"], "r1/y": ["/r1/b"]})
        recording.attach("graph.json", b"", "application/json", START)
    with bag.open(tmp_path / "a.mcap") as said:
        assert publishers_of(said) == ({"/r1/a", "/r1/b"}, {"r1/x": {"/r1/a", "/r1/b"}, "r1/y": {"/r1/b"}})
    with bag.Recording(tmp_path / "b.mcap", replays.PLAIN) as recording:
        recording.attach("graph.json", b'{"nodes": 3}', "application/json", START)
    with bag.open(tmp_path / "b.mcap") as said, pytest.raises(BagError, match=r"graph\.json cannot be read: Expected"):
        publishers_of(said)


def test_a_report_is_told_in_lines(tmp_path: Path) -> None:
    then = record(tmp_path / "a", "r1/x", *((10 * n, twist(n)) for n in range(10)))
    now = record(tmp_path / "b", "r1/x", *((10 * n, twist(n * 1.01)) for n in range(9)))
    report = ReplayReport(
        bag="a.mcap",
        begin=START,
        verdict="different",
        nodes=[NodeTopics("/r1/base", "base:Base", ["r1/x"])],
        inputs=[Input("r1/in", "std/String", 1)],
        topics=[compared(then, now)],
        notes=["something"],
        runs=2,
    )
    told = [re.sub(r" \(\d\d:\d\d:\d\d\)", "", line) for line in lines(report)]
    assert told == [
        "/r1/base: 1 message of 1 topic from a.mcap, 0.0 s in 0.0 s, 2 runs",
        "note: something",
        "r1/x: 10 messages recorded, 9 now",
        "  1 message missing, the first at 0.090 s",
        "  linear.x: 8 values in 8 messages of 9",
        "    first   at 0.010 s, message 1: 1.0 recorded, 1.01 now, 0.01 apart",
        "    largest at 0.080 s, message 8: 8.0 recorded, 8.08 now, 0.08 apart",
        "DIFFERENT: r1/x",
    ]
    report.verdict = "not deterministic"
    assert replay_report.verdict_line(report).startswith(
        "NOT DETERMINISTIC: /r1/base says something else in each run, in r1/x linear.x; does it read the wall clock"
    )
    report.nodes.append(NodeTopics("/r1/other", "base:Other", ["r1/x"]))
    assert replay_report.verdict_line(report).endswith("? So then does /r1/other, and may only pass it on")
    report.nodes.pop()
    report.verdict, report.troubles = "failed", [Trouble("/r1/base", START, "raised ValueError: x")]
    assert list(lines(report))[-1] == "FAILED: /r1/base"
    verdicts: list[tuple[Verdict, str]] = [
        ("same", "SAME: /r1/base says what it said"),
        ("accepted", "ACCEPTED: b.mcap is what"),
    ]
    for verdict, told_ in verdicts:
        report.verdict, report.accepted = verdict, "b.mcap"
        assert replay_report.verdict_line(report).startswith(told_)


def test_a_renewed_recording_keeps_all_else(tmp_path: Path) -> None:
    path = replays.words(tmp_path / "old.mcap")
    now = record(tmp_path / "new.mcap", "r1/said", *((100 * n, String("b")) for n in range(3)))
    with bag.open(path) as old, bag.open(now) as new:
        assert renew(old, new, ["r1/said"], {"mark": {"a": "b"}}, path) == 43
        assert renew(old, new, ["r1/said"], {"mark": {"a": "c"}}, tmp_path / "other.mcap") == 43
        (tmp_path / "folder").mkdir()
        with pytest.raises(BagError, match="folder: it cannot be written: Is a directory"):
            renew(old, new, ["r1/said"], {}, tmp_path / "folder")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["folder", "new.mcap", "old.mcap", "other.mcap"]
    with bag.open(path) as renewed, bag.open(now) as new:
        assert [one.data for one in renewed.messages("r1/said")] == [one.data for one in new.messages("r1/said")]
        assert {name: topic.count for name, topic in renewed.topics.items()} == {
            "r1/said": 3, "r1/scan": 20, "r1/word": 20,
        }  # fmt: skip
        arrived = [one.arrived for one in renewed.messages()]
        assert arrived == sorted(arrived)
        assert renewed.metadata["mark"] == {"a": "b"}
    assert bag.check(path).findings == []
