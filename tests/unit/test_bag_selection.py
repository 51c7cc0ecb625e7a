"""Topics by patterns, times as people write them, and recordings side by side."""

import random
import re
import time
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from robo import bag
from robo.bag.look import pairing
from robo.bag.look.comparison import Diff
from robo.bag.look.pairing import Pairing
from robo.bag.moments import moment
from robo.bag.types import topic_of
from robo.errors import InvalidName, UsageError
from robo.text.patterns import chosen, matcher
from robo.wire import names
from robo_messages import Twist
from tests import bags
from tests.bags import MS, START

PLAIN = bag.Options(compression="none", sync=False)
SECOND = 10**9
NAMES = ["r1/odom", "r1/scan", "r1/camera_left/image", "r2/scan", "tf"]

parts = st.lists(
    st.sampled_from(["a", "b", "ab", "*", "**", "a*", "*b", "a$*b", "a**", "$**", ""]), min_size=1, max_size=5
)
topics = st.lists(st.sampled_from(["a", "b", "ab", "aab"]), min_size=1, max_size=5).map("/".join)


@settings(max_examples=500)
@given(parts.map("/".join), topics)
def test_patterns_are_those_of_key_expressions(pattern: str, name: str) -> None:
    """What somebody types means the same of a recording as of what runs."""
    try:
        expression = zenoh.KeyExpr(names.key_of(pattern))
    except InvalidName:
        with pytest.raises(UsageError, match="makes no sense"):
            matcher([pattern])
    else:
        assert matcher([pattern])(name) == expression.intersects(zenoh.KeyExpr(name))


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("odom", ["r1/odom"]),
        ("*", ["r1/odom", "r1/scan", "tf"]),
        ("/*", ["tf"]),
        ("/r1/odom/", ["r1/odom"]),
        ("camera_*/**", ["r1/camera_left/image"]),
        ("r1/scan", ["r1/scan"]),
        ("scan", ["r1/scan"]),
    ],
)
def test_the_robot_that_was_recorded_may_be_left_out(pattern: str, found: list[str]) -> None:
    assert list(filter(chosen(NAMES, [pattern], robot="r1"), NAMES)) == found
    left = list(filter(chosen(NAMES, [], [pattern], robot="r1"), NAMES))
    assert left == [name for name in NAMES if name not in found]


@pytest.mark.parametrize(
    ("wanted", "excluded", "found"),
    [
        (["r1/*"], [], ["r1/odom", "r1/scan"]),
        (["**/scan"], [], ["r1/scan", "r2/scan"]),
        (["/r1/odom", "tf"], [], ["r1/odom", "tf"]),
        (["r1/camera_*/image"], [], ["r1/camera_left/image"]),
        (["r1/camera_$*/**"], [], ["r1/camera_left/image"]),
        (["r1/**"], ["**/scan"], ["r1/odom", "r1/camera_left/image"]),
        ([], ["r1/**", "nothing/*"], ["r2/scan", "tf"]),
        (["*.*"], [], None),
    ],
)
def test_topics_are_chosen(wanted: list[str], excluded: list[str], found: list[str] | None) -> None:
    if found is None:
        with pytest.raises(UsageError, match=r"a\.mcap: it has no topic \*\.\*; it has r1/odom, "):
            chosen(NAMES, wanted, excluded, "a.mcap")
    else:
        assert list(filter(chosen(NAMES, wanted, excluded), NAMES)) == found


def test_patterns_that_make_no_sense_are_told() -> None:
    for pattern in ("", "a//b", "/", "a/b**"):
        with pytest.raises(UsageError, match=re.escape(f"topic '{pattern}' makes no sense")):
            matcher([pattern])
    with pytest.raises(UsageError, match="no topic is left"):
        chosen(NAMES, ["r1/*"], ["**"])
    with pytest.raises(UsageError, match=r"a\.mcap: --exclude r1/odm: no topic matches; did you mean r1/odom\?"):
        chosen(NAMES, [], ["r1/odm"], "a.mcap")
    with pytest.raises(UsageError, match="--topics r1/odm: no topic matches"):
        chosen(NAMES, ["r1/odm"], options=("--topics", "--exclude"))


def test_no_pattern_takes_long() -> None:
    began = time.process_time()
    assert not matcher(["/".join(["**", "a"] * 20) + "/" + "*a" * 30])("/".join(["a" * 200] * 200))
    assert time.process_time() - began < 10


BEGIN = int(datetime(2026, 11, 23, 23, 59, 30).astimezone().timestamp()) * SECOND + 250 * MS
END = BEGIN + 90 * SECOND


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("0", 0.0),
        ("12.5", 12.5),
        ("+1", 1.0),
        (".5", 0.5),
        ("-5", 85.0),
        ("-0", 90.0),
        ("23:59:40", 9.75),
        ("23:59:40.25", 10.0),
        ("00:00", 29.75),
        ("0:00:10.000000001", 39.750000001),
        ("2026-11-24T00:00:10", 39.75),
        ("2026-11-24 00:00:10.5", 40.25),
        (str(BEGIN + 7), 7e-9),
        (f"{BEGIN // SECOND + 1}.25", 1.0),
        ("99999999", 99999999.0),
    ],
)
def test_times_are_what_people_write(text: str, seconds: float) -> None:
    assert moment(text, BEGIN, END) == BEGIN + round(seconds * SECOND)


def test_a_date_may_have_its_zone() -> None:
    assert moment("1970-01-01T00:00:02Z", BEGIN, END) == moment("1970-01-01T01:00:02+01:00", BEGIN, END) == 2 * SECOND


@pytest.mark.parametrize("text", ["", "soon", "25:00", "1e3", "nan", "--5", "2026-13-01", "9" * 200, "12:61", "1_0"])
def test_what_is_no_time_is_told(text: str) -> None:
    with pytest.raises(UsageError, match=r"--start .* is no time: write seconds from the beginning"):
        moment(text, BEGIN, END, "--start")


def test_times_stay_what_a_file_can_hold() -> None:
    assert moment("-1000", 0, SECOND) == 0
    assert moment(str(2**64), 0, SECOND) == 2**64 - 1


def diff_of(first: Path, second: Path) -> Diff:
    return bag.diff(first, second)


def written(path: Path, chance: random.Random, topics: list[str]) -> None:
    """A few messages on topics, each at its own times."""
    with bag.Recording(path, PLAIN) as recording:
        for name in topics:
            number = recording.topic(topic_of(name, Twist))
            at = START + chance.randrange(3) * SECOND
            for count in range(chance.randrange(1, 20)):
                at += chance.randrange(100) * MS
                recording.write(number, bags.twist(count + (chance.random() < 0.1)), at, at, count + 1)


@pytest.mark.parametrize("seed", range(10))
def test_topics_come_out_alike_however_little_may_wait(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = random.Random(seed)
    written(tmp_path / "a.mcap", chance, ["a", "b", "c"])
    written(tmp_path / "b.mcap", chance, ["b", "c", "d"])
    wide = diff_of(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert [topic.name for topic in wide.topics] == ["a", "b", "c", "d"]
    for most in (0, 500, 2_000):
        monkeypatch.setattr(pairing.Pairing.__init__, "__defaults__", (most,))
        assert diff_of(tmp_path / "a.mcap", tmp_path / "b.mcap") == wide


def test_each_recording_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bags.drive(tmp_path / "a.mcap")
    calls = []
    original = bag.Bag.messages

    def messages(self: bag.Bag, *args: object, **more: object) -> Iterator[bag.BagMessage]:
        calls.append(args)
        return original(self, *args, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(bag.Bag, "messages", messages)
    assert diff_of(tmp_path / "a.mcap", tmp_path / "a.mcap").same
    assert len(calls) == 2


def test_little_waits(tmp_path: Path) -> None:
    bags.drive(tmp_path / "a.mcap")
    with bag.open(tmp_path / "a.mcap") as one, bag.open(tmp_path / "a.mcap") as other:
        paired = Pairing(one.topics)
        for _ in paired.pairs(one.messages(), other.messages(), (one.begin, other.begin)):
            assert paired._size < 2_000
    assert not paired.left
