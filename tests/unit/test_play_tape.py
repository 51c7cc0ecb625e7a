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
from robo.errors import DamagedBag, RoboError, UsageError
from robo.recording.play.ahead import MOST_ITEMS, Ahead
from robo.recording.play.playback import Item
from robo.recording.play.tape import BagTape, Ready, Window
from robo.recording.play.topics import Choice, select
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


@pytest.mark.parametrize(
    ("window", "begin", "end"),
    [
        (Window(), 0, 991),
        (Window(0.1), 100, 991),
        (Window(0.1, 0.5), 100, 500),
        (Window(0.1, 0.5, 0.2), 100, 300),
        (Window(0.1, None, 50.0), 100, 991),
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
    "window", [Window(-1.0), Window(float("nan")), Window(float("inf")), Window(2.0), Window(0.5, 0.1)]
)
def test_a_part_that_is_none_is_refused(window: Window, tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    with bag.open(tmp_path / "drive.mcap") as recording, pytest.raises(UsageError):
        tape_of(recording, window=window)


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
        ({"robo.about": {"robots": ""}}, None),
    ],
)
def test_which_robot_was_recorded(metadata: dict[str, dict[str, str]], expected: str | None, tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "a.mcap", bag.Options(compression="none", sync=False)) as recording:
        for name, words in metadata.items():
            recording.add_metadata(name, words)
    with bag.open(tmp_path / "a.mcap") as opened:
        assert robot_of(opened) == expected


def numbers(at: int) -> Iterator[Item[int]]:
    for number in itertools.count(at):
        yield Item(number, False, number)


def test_who_reads_ahead_keeps_the_order_and_a_bound() -> None:
    read = threading.Semaphore(0)
    last = 0

    def slow(at: int) -> Iterator[Item[int]]:
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
    def breaks(at: int) -> Iterator[Item[int]]:
        yield from itertools.islice(numbers(at), 3)
        raise DamagedBag("a part is damaged")

    with closing(Ahead(breaks, lambda _: 1)) as ahead:
        for _ in range(2):
            items = ahead.run(0)
            assert [next(items).what for _ in range(3)] == [0, 1, 2]
            with pytest.raises(DamagedBag, match="a part is damaged"):
                next(items)


def test_who_reads_ahead_ends_when_it_is_told() -> None:
    ahead = Ahead(numbers, lambda _: 1)
    items = ahead.run(0)
    next(items)
    ahead.close()
    assert len(list(items)) <= 2 * MOST_ITEMS
