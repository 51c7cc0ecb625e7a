"""What keys say: never more than somebody at the keys has said, and never for longer."""

import math
import re
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo_messages import DiagnosticStatus, KeyValue, LaserScan, Twist, Vector3
from robo_services.teleop import (
    ENDS,
    ESCAPE,
    MOTIONS,
    SLOWEST,
    SPEEDS,
    UNKNOWN,
    Decoder,
    Held,
    Kind,
    Operator,
    Said,
    Speeds,
    Timing,
    adjusted,
    kind_of,
    pressed,
    twist_of,
)
from robo_services.teleop_screen import (
    HELP,
    Nearest,
    View,
    bearing_text,
    drawn,
    lines_of,
    nearest_of,
    velocity_text,
)

few = settings(max_examples=200, derandomize=True)

TIMING = Timing(first=0.7, repeated=0.25)
SPEED = Speeds(linear=0.5, angular=1.0)
PERIOD = 0.05


def decoded(*pieces: bytes) -> list[str]:
    decoder = Decoder()
    keys = [key for piece in pieces for key in decoder.feed(piece)]
    return keys + decoder.flush()


# -- bytes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"w", ["w"]),
        (b"wW ", ["w", "W", " "]),
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
        (b"\x1bOA\x1bOD", ["up", "left"]),
        (b"\x1b[1;5C", ["right"]),
        (b"\x1b", [ESCAPE]),
        (b"\x1b\x1b[A", [ESCAPE, "up"]),
        (b"\x1bw", [UNKNOWN]),
        (b"\x1b[15~", [UNKNOWN]),
        (b"\x1b[1\x03", [UNKNOWN, "\x03"]),
        (b"\x1b[", [UNKNOWN]),
        (b"\x1b[" + 40 * b"1", [UNKNOWN, *10 * ["1"]]),
        ("ä".encode(), [UNKNOWN, UNKNOWN]),
        (b"\x7f\x00", [UNKNOWN, "\x00"]),
    ],
)
def test_bytes_are_keys(data: bytes, keys: list[str]) -> None:
    assert decoded(data) == keys


sequences = st.lists(st.sampled_from([b"\x1b[A", b"\x1bOB", b"\x1b", b"w", b"\x1b[1;2D", b" ", b"\xff", b"[", b"O"]))


@few
@given(sequences.map(b"".join) | st.binary(max_size=60), st.lists(st.integers(0, 60), max_size=6))
def test_it_does_not_matter_how_bytes_are_cut(data: bytes, cuts: list[int]) -> None:
    places = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
    pieces = [data[a:b] for a, b in pairwise(places)]
    assert decoded(*pieces) == decoded(data)


def test_each_key_has_one_meaning() -> None:
    assert not (MOTIONS.keys() & SPEEDS.keys() | MOTIONS.keys() & ENDS | SPEEDS.keys() & ENDS)
    assert {kind_of(key) for key in (" ", "k", ESCAPE, UNKNOWN, "W", "\x13", "\t", "7")} == {Kind.STOP}
    assert (kind_of("q"), kind_of("up"), kind_of("+")) == (Kind.END, Kind.DRIVE, Kind.SPEED)


def test_curves_lead_to_the_side_of_their_keys() -> None:
    def left(key: str) -> float:
        """Where the robot goes to within a moment, to the left: the way it drives times how it turns."""
        twist = twist_of(MOTIONS[key], SPEED)
        return twist.linear.x * twist.angular.z + twist.linear.y

    assert {key: math.copysign(1, left(key)) for key in "uom.JLUOM>"} == {
        "u": 1, "o": -1, "m": 1, ".": -1, "J": 1, "L": -1, "U": 1, "O": -1, "M": 1, ">": -1,
    }  # fmt: skip


# -- a key that is held ----------------------------------------------------------------------------


def said_by(typed: list[tuple[float, str]], end: float, timing: Timing = TIMING) -> list[tuple[float, Said]]:
    """What an operator says each PERIOD, and at once when a key comes; `typed` are times and keys."""
    operator, said = Operator(), []
    times = sorted([*(number * PERIOD for number in range(int(end / PERIOD) + 1)), *(time for time, _ in typed)])
    waiting = sorted(typed, key=lambda one: one[0])
    for now in times:
        while waiting and waiting[0][0] <= now:
            operator.take(waiting.pop(0)[1], now, timing)
        said_now = operator.say(now, timing, SPEED)
        if said_now is not None:
            said.append((now, said_now))
    return said


def typematic(
    key: str, begin: float, held: float, delay: float = 0.5, period: float = 0.033
) -> list[tuple[float, str]]:
    """What a terminal sends of a key that is held for a time, s."""
    count = int((held - delay) / period) + 1 if held >= delay else 0
    return [(begin, key), *((begin + delay + number * period, key) for number in range(count))]


def driving(said: list[tuple[float, Said]]) -> list[float]:
    return [time for time, one in said if one.twist != Twist()]


@pytest.mark.parametrize("delay", [0.25, 0.5, 0.66])
def test_a_held_key_drives_without_a_break_and_is_let_go_within_its_timeout(delay: float) -> None:
    typed = typematic("w", 1.0, 3.0, delay)
    times = driving(said := said_by(typed, 6.0))
    assert times[0] == 1.0
    assert max(b - a for a, b in pairwise(times)) < 1.5 * PERIOD
    assert times[-1] < 4.0 + TIMING.repeated
    end, last = said[-1]
    assert end == pytest.approx(times[-1], abs=1.01 * PERIOD)
    assert last == Said(Twist(), 0.0), "one 0, and silence"


def test_a_key_that_is_hit_once_drives_until_its_repetition_would_be_due() -> None:
    times = driving(said_by([(1.0, "w")], 4.0))
    assert times[0] == 1.0
    assert times[-1] == pytest.approx(1.7, abs=PERIOD)


def test_a_key_that_has_repeated_ends_sooner_than_one_that_has_gone_down() -> None:
    times = driving(said_by(typematic("w", 1.0, 0.3, delay=0.25, period=0.03), 4.0))
    assert times[-1] < 1.3 + TIMING.repeated


def test_what_repeats_is_as_old_as_the_key_and_what_has_gone_down_is_said_now() -> None:
    said = said_by([(1.0, "w"), (1.5, "w")], 4.0)
    assert {one.age for time, one in said if time < 1.5} == {0.0}
    for time, one in said:
        if time >= 1.5 and one.twist != Twist():
            assert one.age == pytest.approx(time - 1.5)


@pytest.mark.parametrize("key", [" ", "k", ESCAPE, UNKNOWN, "W", "q", "\x04"])
def test_any_other_key_stops_at_once(key: str) -> None:
    said = said_by([(1.0, "w"), (1.2, key)], 4.0)
    assert driving(said)[-1] < 1.2
    assert said[-1] == (1.2, Said(Twist(), 0.0))


def test_a_stop_is_said_to_a_robot_that_stands_for_somebody_else() -> None:
    assert said_by([(1.0, " "), (2.0, " ")], 4.0) == [(1.0, Said(Twist(), 0.0)), (2.0, Said(Twist(), 0.0))]
    assert said_by([(1.0, "+"), (2.0, "q")], 4.0) == []


def test_the_last_key_counts() -> None:
    said = said_by([(1.0, "w"), (1.2, "a")], 4.0)
    assert all(one.twist == Twist(angular=Vector3(z=1.0)) for time, one in said if 1.2 <= time < 1.85)
    assert driving(said)[-1] == pytest.approx(1.9, abs=PERIOD), "it has gone down, whatever was held before"


def test_a_key_for_the_speed_neither_stops_nor_prolongs() -> None:
    assert driving(said_by([(1.0, "w"), (1.3, "+")], 4.0)) == driving(said_by([(1.0, "w"), (1.3, "r")], 4.0))
    assert driving(said_by([(1.0, "w"), (1.3, "+")], 4.0))[-1] < 1.7


def test_a_clock_that_steps_back_ends_it() -> None:
    operator = Operator()
    operator.take("w", 10.0, TIMING)
    assert operator.say(9.0, TIMING, SPEED) is None
    operator.take("w", 10.0, TIMING)
    assert operator.say(10.1, TIMING, SPEED) == Said(Twist(Vector3(x=0.5)), 0.0)
    assert operator.say(9.0, TIMING, SPEED) == Said(Twist(), 0.0)


keys = st.sampled_from([*MOTIONS, *SPEEDS, *ENDS, " ", ESCAPE, UNKNOWN, "7"])
timings = st.builds(Timing, st.floats(0.02, 2.0), st.floats(0.02, 2.0))


@few
@given(st.lists(st.tuples(st.floats(0.0, 5.0), keys | st.sampled_from("wa")), max_size=30), timings)
def test_nobody_drives_for_longer_than_a_key_counts(typed: list[tuple[float, str]], timing: Timing) -> None:
    said = said_by(typed, 8.0, timing)
    ordered = sorted(typed, key=lambda one: one[0])
    for time, one in said:
        before = [key for at, key in ordered if at <= time and kind_of(key) is not Kind.SPEED]
        last = max((at for at, key in ordered if at <= time and kind_of(key) is not Kind.SPEED), default=-math.inf)
        if one.twist != Twist():
            assert one.twist == twist_of(MOTIONS[before[-1]], SPEED)
            assert time - last < max(timing)
        assert 0.0 <= one.age <= max(timing)
    standing = [one.twist == Twist() for _, one in said]
    stops = sum(kind_of(key) is Kind.STOP for _, key in typed)
    assert sum(a and b for a, b in pairwise(standing)) <= stops, "0 is not repeated"
    assert not said or standing[-1], "at last it stands"


@few
@given(st.none() | st.builds(Held, st.sampled_from([*MOTIONS]), st.floats(0, 9), st.booleans()), keys, st.floats(0, 9))
def test_what_is_held_is_a_key_that_drives(held: Held | None, key: str, now: float) -> None:
    after = pressed(held, key, now, TIMING)
    assert after is None or after.key in MOTIONS
    if kind_of(key) is Kind.DRIVE:
        assert after is not None
        assert (after.key, after.heard) == (key, now)
        assert not after.repeats or (held is not None and held.key == key and held.lasts(now, TIMING))


@few
@given(st.floats(0, 100), st.sampled_from([1.1, 0.9, 1.0]), st.floats(0, 100))
def test_speeds_stay_within_their_limits_and_can_always_grow(value: float, factor: float, limit: float) -> None:
    after = adjusted(min(value, limit), factor, limit)
    assert 0.0 <= after <= limit
    if factor > 1.0:
        assert after > min(value, limit) or after == limit
    if factor < 1.0:
        assert after <= min(value, limit)
        assert after >= min(SLOWEST, value, limit)


# -- the screen ------------------------------------------------------------------------------------


def view(**changes: object) -> View:
    given: dict[str, object] = {"name": "/r1/teleop", "topic": "r1/cmd_vel", "command": Twist(), "speeds": SPEED}
    return View(**{**given, **changes})  # type: ignore[arg-type]


def texts(shown: View, width: int = 80, height: int = 24) -> list[str]:
    return [line.text for line in lines_of(shown, width, height)]


def state(level: int, action: str, text: str) -> DiagnosticStatus:
    return DiagnosticStatus(level, "monitor", text, values=[KeyValue("action", action)])


def test_a_screen_says_all_that_is_known() -> None:
    shown = view(
        command=Twist(Vector3(x=0.5), Vector3(z=-1.0)),
        held=True,
        robot=Twist(Vector3(x=0.3, y=0.4), Vector3(z=-0.9)),
        robot_age=0.02,
        safety=state(1, "slow", "obstacle at 0.41 m"),
        safety_age=0.3,
        nearest=Nearest(0.41, 0.2),
        scan_age=0.1,
        notes=["12:00:00.000 WARN  r1.teleop: one", "12:00:01.000 WARN  r1.teleop: two"],
    )
    assert texts(shown) == [
        "/r1/teleop commands r1/cmd_vel",
        "",
        "  command   forward 0.50 m/s, turning right 1.00 rad/s",
        "  speeds    0.50 m/s, 1.00 rad/s",
        "  robot     0.50 m/s, -0.90 rad/s",
        "  safety    slow: obstacle at 0.41 m",
        "  nearest   0.41 m, 11 deg to the left",
        "",
        *HELP,
        "",
        *shown.notes,
    ]


def test_a_screen_says_what_is_not_known_or_old() -> None:
    assert texts(view())[2:7] == [
        "  command   stand, no key is held",
        "  speeds    0.50 m/s, 1.00 rad/s",
        "  robot     nobody tells its odometry",
        "  safety    nobody tells a safety_state",
        "  nearest   no laser scan",
    ]
    old = view(
        robot=Twist(), robot_age=9.0, safety=state(2, "stop", "no scan"), safety_age=math.inf, scan_age=3.2,
        nearest=Nearest(math.inf, 0.0),
    )  # fmt: skip
    assert texts(old)[4:7] == [
        "  robot     0.00 m/s, +0.00 rad/s (9 s ago)",
        "  safety    stop: no scan (long ago)",
        "  nearest   nothing in sight (3 s ago)",
    ]


def test_the_newest_note_goes_before_the_keys() -> None:
    shown = view(notes=[f"note {number}" for number in range(50)])
    assert texts(shown, height=9)[-2:] == ["", "note 49"]
    assert texts(shown, height=24)[-1] == "note 49"
    assert texts(shown, height=7)[-1].startswith("  nearest")


@few
@given(
    st.integers(0, 200), st.integers(0, 60), st.lists(st.text(max_size=100), max_size=30), st.text(max_size=300),
    st.floats(), st.floats(),
)  # fmt: skip
def test_a_screen_fits_and_obeys_nobody(
    width: int, height: int, notes: list[str], words: str, number: float, age: float
) -> None:
    shown = view(
        command=Twist(Vector3(x=number)), robot=Twist(Vector3(number, number), Vector3(z=number)), robot_age=age,
        safety=state(2, words, words), safety_age=age, nearest=Nearest(number, 0.0), scan_age=age, notes=notes,
    )  # fmt: skip
    lines = lines_of(shown, width, height)
    assert len(lines) <= height
    assert all(len(line.text) <= width for line in lines)
    assert not [line.text for line in lines if re.search("[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]", line.text)]
    assert "\x1b" not in drawn(lines, colour=False).replace("\x1b[H", "").replace("\x1b[K", "").replace("\x1b[J", "")


def test_colours_are_shown_where_they_are_wanted() -> None:
    lines = lines_of(view(safety=state(2, "stop", "no"), safety_age=0.0), 80, 24)
    assert "\x1b[31m" in drawn(lines, colour=True)
    assert "\x1b[31m" not in drawn(lines, colour=False)


@pytest.mark.parametrize(
    ("twist", "text"),
    [
        (Twist(), ""),
        (Twist(Vector3(x=-0.5)), "back 0.50 m/s"),
        (Twist(Vector3(y=-0.5), Vector3(z=2.0)), "sideways right 0.50 m/s, turning left 2.00 rad/s"),
    ],
)
def test_velocities_in_words(twist: Twist, text: str) -> None:
    assert velocity_text(twist) == text


@pytest.mark.parametrize(
    ("bearing", "text"),
    [(0.0, "ahead"), (-0.02, "ahead"), (math.pi / 2, "90 deg to the left"), (-3.0, "172 deg to the right"),
     (math.pi, "behind"), (-math.pi, "behind")],
)  # fmt: skip
def test_directions_in_words(bearing: float, text: str) -> None:
    assert bearing_text(bearing) == text


def scan(*ranges: float, begin: float = 0.0, step: float = math.pi / 2) -> LaserScan:
    return LaserScan(angle_min=begin, angle_increment=step, range_min=0.1, range_max=10.0, ranges=list(ranges))


@pytest.mark.parametrize(
    ("seen", "nearest"),
    [
        (scan(3.0, 1.0, 2.0), Nearest(1.0, math.pi / 2)),
        (scan(3.0, math.nan, 2.0), Nearest(2.0, math.pi)),
        (scan(3.0, -math.inf), Nearest(0.0, math.pi / 2)),
        (scan(3.0, 0.01), Nearest(0.01, math.pi / 2)),
        (scan(math.inf, 11.0), Nearest(math.inf, 0.0)),
        (scan(math.nan), None),
        (scan(), None),
        (scan(1.0, begin=math.nan), None),
        (scan(5.0, 4.0, 3.0, 2.0), Nearest(2.0, -math.pi / 2)),
    ],
)
def test_the_nearest_obstacle_of_a_scan(seen: LaserScan, nearest: Nearest | None) -> None:
    found = nearest_of(seen)
    assert found == (None if nearest is None else pytest.approx(nearest))
