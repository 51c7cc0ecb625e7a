"""A recording as it is played: in order, from anywhere, read ahead by a thread; damaged ones are errors of robo's."""

import itertools
import random
import threading
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robo_messages
from robo import bag
from robo.bag.of_robot import robot_of
from robo.bag.read.reader import Order
from robo.bag.read.topics import BagMessage
from robo.bag.types import topic_of
from robo.cli.views.bag_edit import cut
from robo.errors import DamagedBag, RoboError, UsageError
from robo.interfaces import cdr
from robo.recording.play.ahead import MOST_ITEMS, Ahead, Wanted
from robo.recording.play.playback import Item
from robo.recording.play.tape import BagTape, Converter, Ready, Window
from robo.recording.play.topics import Choice, select
from robo.wire.qos import QoS
from robo_messages import Header, String, TFMessage, TransformStamped, Twist
from tests import bags
from tests.bags import MS, START


def tape_of(recording: bag.Bag, choice: Choice | None = None, window: Window | None = None) -> BagTape:
    chosen = select(recording.topics, choice or Choice(), recording.path)
    return BagTape(recording, chosen.played, window=window)


@pytest.mark.parametrize(("start", "count"), [(0.0, 122), (0.5, 2 + 60), (0.99, 2 + 1)])
def test_from_anywhere_with_what_was_said_before(start: float, count: int, tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    with bag.open(tmp_path / "drive.mcap") as recording:
        tape = tape_of(recording)
        items = list(tape.run(START + round(start * 1e9)))
        assert len(items) == count
        assert [item.time for item in items] == sorted(item.time for item in items)
        static = [item for item in items if item.before]
        assert len(static) == (2 if start else 0)
        assert {item.what.part for item in static} == ({0, 1} if start else set()), "each node says its own frames"
        whole = [message.value for message in recording.messages(begin=START + round(start * 1e9))]
        played = [item.what.payload for item in items if not item.before]
        assert played == [robo_messages.encode(value) for value in whole if not isinstance(value, bytes)]


@pytest.mark.parametrize("order", ["arrived", "published"])
def test_static_transforms_of_ros_are_those_of_all_nodes(order: Order, tmp_path: Path) -> None:
    said = [(0, at, at, bags.transform(frame)) for at, frame in enumerate(("base", "laser", "imu", "laser"))]
    bags.of_ros(tmp_path / "ros.mcap", topic_of("tf_static", TFMessage, QoS.LATCHED), said, publishers=3)
    with bag.open(tmp_path / "ros.mcap") as recording:
        tape = BagTape(recording, select(recording.topics, Choice(), recording.path).played, order)
        before = [item.what for item in tape.run(START + 50) if item.before]
        assert len(before) == len({one.part for one in before}) == 3


@pytest.mark.parametrize(
    ("window", "begin", "end"),
    [
        (Window(), 0, 991),
        (Window("0.1"), 100, 991),
        (Window("0.1", "0.5"), 100, 500),
        (Window("0.1", "0.5", 0.2), 100, 300),
        (Window("0.1", "", 50.0), 100, 991),
        (Window("-0.1", "-0.05"), 891, 941),
        (Window(f"{START + 7 * MS}", "1700000000.5"), 7, 500),
        (Window("1970-01-01T00:00:00Z"), 0, 991),
    ],
)
def test_a_part_of_it(window: Window, begin: int, end: int, tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    with bag.open(tmp_path / "drive.mcap") as recording:
        tape = tape_of(recording, window=window)
        assert (tape.begin, tape.end) == (START + begin * MS, START + end * MS)
        times = [item.time for item in tape.run(tape.begin) if not item.before]
        assert START + begin * MS <= min(times) <= max(times) <= START + end * MS


@pytest.mark.parametrize(
    ("window", "text"),
    [
        (Window("soon"), "--start 'soon' is no time"),
        (Window(end="nan"), "--end 'nan' is no time"),
        (Window("2"), "nothing is there after --start 2: it begins 2023-11-1.* and lasts 0.991 s"),
        (Window(end="-5"), "nothing is there before --end -5: "),
        (Window("0.5", "0.1"), "--end 0.1 is not after --start 0.5"),
        (Window("0.5", "0.5"), "--end 0.5 is not after --start 0.5"),
        (Window(duration=-1.0), "--duration -1"),
        (Window(duration=0.0), "--duration 0"),
        (Window(duration=float("nan")), "--duration nan"),
        (Window(duration=float("inf")), "--duration inf"),
    ],
)
def test_a_part_that_is_none_is_refused(window: Window, text: str, tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    with bag.open(tmp_path / "drive.mcap") as recording, pytest.raises(UsageError, match=text):
        tape_of(recording, window=window)


def test_the_part_that_is_played_is_the_one_that_is_cut(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    chance = random.Random(7)
    for number in range(20):
        a, b = sorted(chance.randrange(-200, 1200) / 1000 for _ in range(2))
        start, end = f"{START + round(a * 1e9)}", f"{START + round(b * 1e9)}"
        output = str(tmp_path / f"{number}.mcap")
        try:
            cut(str(tmp_path / "drive.mcap"), output, start, end, "none", force=False)
        except RoboError:
            with bag.open(tmp_path / "drive.mcap") as recording, suppress(UsageError):
                tape = tape_of(recording, window=Window(start, end))
                assert [item for item in tape.run(tape.begin) if not item.before] == []
            continue
        with bag.open(tmp_path / "drive.mcap") as recording, bag.open(output) as part:
            tape = tape_of(recording, window=Window(start, end))
            names = [topic.name for topic in recording.topics.values()]
            played = [(names[item.what.number], item.what.payload) for item in tape.run(tape.begin)]
            there = [(one.topic.name, robo_messages.encode(one.value)) for one in part.messages()]  # type: ignore[arg-type]
            assert played == there


def test_where_nobody_says_when_a_message_was_published_it_was_when_it_came(tmp_path: Path) -> None:
    path = tmp_path / "ros1.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False, chunk_size=500)) as recording:
        number = recording.topic(topic_of("r1/cmd_vel", Twist))
        for count in range(50):
            at = START + count * 10 * MS
            recording.write(number, bags.twist(count), at, at - 3 * MS if count % 7 else 0, count + 1)
    with bag.open(path) as opened:
        tape = BagTape(opened, select(opened.topics, Choice(), "").played, "published")
        assert (tape.begin, tape.end) == (START, START + 490 * MS)
        times = [item.time for item in tape.run(tape.begin)]
        assert len(times) == 50
        assert times == sorted(times)
        assert times[7] == START + 70 * MS


def test_who_is_stopped_reads_no_more_of_what_was_latched(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        number = recording.topic(topic_of("r1/floor", String, QoS.LATCHED))
        for count in range(10_000):
            recording.write(number, cdr.encoder(String)(String(f"{count}")), START + count * MS, START, count + 1)
    with bag.open(path) as opened:
        tape = tape_of(opened)
        looks = 0

        def wanted() -> bool:
            nonlocal looks
            looks += 1
            return looks < 3

        assert next(tape.run(tape.end, wanted)).before
        assert looks == 3


def test_what_two_nodes_say_of_what_stands_still_stays_that_of_two(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap", count=1)
    with bag.open(tmp_path / "drive.mcap") as recording:
        topic = recording.topics["r1/tf_static"]
    converter = Converter(select({"tf_static": topic}, Choice(), "").played)

    def part(*frames: str) -> int:
        message = TFMessage([TransformStamped(Header(), frame) for frame in frames])
        ready = converter.ready(BagMessage(topic, 1, 1, 0, cdr.encoder(TFMessage)(message)))
        assert ready is not None
        return ready.part

    assert [part("a"), part("b"), part("a", "c"), part("a", "c", "d"), part("b"), part("a")] == [0, 1, 0, 0, 1, 2]
    assert {part(f"x{number}") for number in range(10_000)} == set(range(3, 64))
    assert sum(map(len, converter._parts.values())) == 64


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32))
def test_damaged_recordings_are_played_or_refused_and_nothing_else(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("hostile")
    chance = random.Random(seed)
    bags.drive(folder / "drive.mcap", bag.Options(compression="none", sync=False, chunk_size=700), count=20)
    (folder / "drive.mcap").write_bytes(bags.damaged((folder / "drive.mcap").read_bytes(), chance))
    with suppress(RoboError), bag.open(folder / "drive.mcap") as recording:
        tape = tape_of(recording, Choice(robot="r2"))
        for at in (tape.begin, (tape.begin + tape.end) // 2):
            for item in itertools.islice(tape.run(at), 10_000):
                assert isinstance(item.what, Ready)


@pytest.mark.parametrize(
    ("metadata", "expected"),
    [
        ({}, None),
        ({"robo.about": {"robots": "r1 r1/arm", "host": "h"}}, "r1"),
        ({"robo.about": {"robots": "r1 r12"}}, None),
        ({"robo.about": {"robots": "fleet/r1 fleet/r1/arm"}}, "fleet/r1"),
        ({"robo.about": {"robots": ""}}, None),
    ],
)
def test_which_robot_was_recorded(metadata: dict[str, dict[str, str]], expected: str | None, tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "a.mcap", bag.Options(compression="none", sync=False)) as recording:
        for name, words in metadata.items():
            recording.add_metadata(name, words)
    with bag.open(tmp_path / "a.mcap") as opened:
        assert robot_of(opened) == expected


def test_what_takes_long_to_read_hears_that_nobody_wants_it() -> None:
    begun, over = threading.Semaphore(0), threading.Event()

    def endless(at: int, wanted: Wanted) -> Iterator[Item[int]]:
        if at < 0:
            begun.release()
            while wanted():
                over.wait(0.001)
        yield from numbers(at)

    with closing(Ahead(endless, lambda _: 1)) as ahead:
        ahead.run(-1)
        assert begun.acquire(timeout=20)
        assert next(ahead.run(5)).what == 5
        waiting = ahead.run(-1)
        assert begun.acquire(timeout=20)
        ahead.stop()
        assert list(waiting) == []


def numbers(at: int) -> Iterator[Item[int]]:
    for number in itertools.count(at):
        yield Item(number, False, number)


def test_who_reads_ahead_keeps_the_order_and_a_bound() -> None:
    read = threading.Semaphore(0)
    last = 0

    def slow(at: int, _: Wanted) -> Iterator[Item[int]]:
        nonlocal last
        for item in numbers(at):
            last = item.time
            read.release()
            yield item

    with closing(Ahead(slow, lambda _: 1)) as ahead:
        items = ahead.run(5)
        assert [next(items).what for _ in range(3)] == [5, 6, 7]
        for _ in range(MOST_ITEMS):
            assert read.acquire(timeout=20)
        assert last < 5 + 4 * MOST_ITEMS, "it waits for whoever takes them"
        other = ahead.run(1_000_000)
        assert [next(other).what for _ in range(10_000)] == list(range(1_000_000, 1_010_000))
        assert next(items, None) in (None, *(Item(n, False, n) for n in range(8, 20_000))), (
            "it is over, but for what was taken"
        )


def test_who_reads_ahead_tells_what_went_wrong_in_its_place() -> None:
    def breaks(at: int, _: Wanted) -> Iterator[Item[int]]:
        yield from itertools.islice(numbers(at), 3)
        raise DamagedBag("a part is damaged")

    with closing(Ahead(breaks, lambda _: 1)) as ahead:
        for _ in range(2):
            items = ahead.run(0)
            assert [next(items).what for _ in range(3)] == [0, 1, 2]
            with pytest.raises(DamagedBag, match="a part is damaged"):
                next(items)


def test_who_reads_ahead_ends_when_it_is_told() -> None:
    ahead = Ahead(lambda at, _: numbers(at), lambda _: 1)
    items = ahead.run(0)
    next(items)
    ahead.close()
    assert len(list(items)) <= 2 * MOST_ITEMS
