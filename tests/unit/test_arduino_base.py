"""A base and its board, played: what comes of speeds that are said over a wire that spoils lines."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo_messages import Header
from robo_services import arduino_protocol as protocol
from robo_services.arduino_base import ArduinoBase, BoardError, BoardSilent, NotABoard, Settings
from robo_services.arduino_protocol import Done, Encoders, Invalid, Number, Reader, Unread
from robo_services.board import Board, BoardSpec, Wire
from robo_services.drives import DiffDrive, Wheels
from robo_services.kinematics import Twist2
from robo_services.tick_odometry import TickOdometry
from robo_services.wheel_speed import WheelLimits, WheelSpeed

DRIVE = DiffDrive(wheel_separation=0.3, wheel_radius=0.05, max_wheel_velocity=20.0)
PER_REVOLUTION = 1440.0
LATENCY = 0.002
FASTEST_SEEN = 20.0 * 1.5 * 10
"""rad/s: as far as a wheel turns in 0.1 s, in a window of 0.01 s."""


class Played:
    """A base and its board with a wire between them, and time that passes as it is told to."""

    def __init__(
        self,
        spec: BoardSpec | None = None,
        settings: Settings | None = None,
        wire: Wire | None = None,
        down: Wire | None = None,
    ) -> None:
        self.board = Board(spec or BoardSpec(), seed=3)
        self.odometry = TickOdometry(DRIVE, self.board.spec.per_revolution, bits=self.board.spec.bits)
        self.base = ArduinoBase(settings or Settings(), self.odometry)
        self.wire, self.down = wire or Wire(), down or Wire()
        self.now = 100.0
        self.plugged = True
        self.base.begin(self.now)

    def run(self, seconds: float, twist: Twist2 = Twist2()) -> None:  # noqa: B008 - it cannot be changed
        end = self.now + seconds
        while self.now < end:
            self._to(self.board_time(end))
            said = self.base.say(self.now, DRIVE.wheels(twist))
            if said and self.plugged:
                self._to(self.now + LATENCY)
                self.board.receive(self.down.passes(said))
                heard = self.wire.passes(self.board.said())
                self._to(self.now + LATENCY)
                self.base.feed(heard, self.now)

    def run_unheard(self, seconds: float) -> None:
        """Nobody talks to the board."""
        self._to(self.now + seconds)

    def board_time(self, end: float) -> float:
        return min(end, max(self.base.due, self.now + 0.001))

    def _to(self, now: float) -> None:
        self.board.advance(now - self.now)
        self.now = now

    @property
    def error(self) -> float:
        """Between where odometry has it and where it is, m."""
        pose, true = self.odometry.track.pose, self.board.pose
        return math.hypot(pose.x - true.x, pose.y - true.y)


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.2, -0.3, 0.5, 0.9])
@pytest.mark.parametrize("gains", ["", "20:0:0:20"])
def test_commanded_speeds_arrive_as_ticks(speed: float, gains: str) -> None:
    played = Played(BoardSpec(noise=0.05), Settings(gains=gains))
    played.run(3.0, Twist2(speed))
    before = played.board.encoders
    played.run(10.0, Twist2(speed))
    after = played.board.encoders
    wanted = speed / 0.05 * PER_REVOLUTION / math.tau * 10.0
    for old, new in zip(before, after, strict=True):
        assert new - old == pytest.approx(wanted, rel=0.02)


def test_odometry_is_true_over_100_m() -> None:
    played = Played(BoardSpec(noise=0.05), wire=Wire(garbled=0.01, cut=0.01))
    for leg in range(20):
        played.run(8.0, Twist2(0.6))
        played.run(2.0, Twist2(0.1, 0.8 if leg % 3 else -0.8))
    played.run(1.0)
    assert played.board.way > 95.0
    assert played.wire.spoiled > 50
    assert played.error < 0.01 * played.board.way
    assert ticks(played.odometry) == played.board.encoders, "no tick is lost"
    assert played.odometry.resets == 0
    assert played.base.counts.unread > 50


@pytest.mark.parametrize("seed", [2, 3, 5])
def test_commands_that_are_garbled_lose_no_tick_and_do_not_make_it_race(seed: int) -> None:
    wires = Wire(garbled=0.01, cut=0.01, seed=seed), Wire(garbled=0.01, cut=0.01, seed=seed + 10)
    played = Played(BoardSpec(noise=0.05), Settings(battery_pin=0), *wires)
    played.run(1.0)
    fastest = 0.0
    for _ in range(1200):
        played.run(0.1, Twist2(0.3))
        fastest = max(fastest, abs(played.board.twist.linear))
    played.run(1.0)
    assert min(wires[0].spoiled, wires[1].spoiled) > 50
    assert fastest < 0.6, "for one period, as it understood"
    assert played.board.way == pytest.approx(0.3 * 120.0, rel=0.03), "some of what it understood is to stand"
    assert (ticks(played.odometry), played.odometry.resets) == (played.board.encoders, 0)
    assert played.error < 0.01 * played.board.way
    assert played.base.battery == 791
    assert played.base.counts.invalid > 5


def ticks(odometry: TickOdometry) -> Encoders:
    left, right, _ = odometry.turned
    return Encoders(round(left * odometry.per_radian), round(right * odometry.per_radian))


@pytest.mark.parametrize("bits", [16, 32])
def test_counters_wrap_around(bits: int) -> None:
    played = Played(BoardSpec(bits=bits))
    played.run(0.5)
    played.run(20.0, Twist2(0.9))
    assert played.board.pose.x > 15.0
    assert (played.board.encoders.left < 30_000) == (bits == 16)
    played.run(1.0)
    assert played.error < 0.01


@pytest.mark.parametrize("driven", [0.1, 0.4, 1.0, 5.0])
@pytest.mark.parametrize("starting", [0.0, 0.2, 1.5])
@pytest.mark.parametrize("speed", [0.1, 0.5, -0.5])
def test_a_board_that_begins_anew_makes_no_jump(driven: float, starting: float, speed: float) -> None:
    played = Played(BoardSpec(starting=starting), Settings(silence_limit=10.0))
    played.run(0.5)
    played.run(driven, Twist2(speed))
    played.board.reset()
    for _ in range(round((starting + 0.3) / 0.01)):
        before = played.odometry.track.pose
        played.run(0.01, Twist2(speed))
        assert abs(played.odometry.track.pose.x - before.x) < 0.06
    lost = played.error
    assert lost < 0.02 + abs(speed) * 0.1, "what it coasted while nobody counted"
    played.run(3.0, Twist2(speed))
    played.run(0.5)
    assert played.error < lost + 0.01, "it goes on from there"
    assert played.odometry.resets <= 1


@pytest.mark.parametrize("turned", [0, 4, 50, 500])
@pytest.mark.parametrize("away", [0.6, 3.0, 600.0])
def test_a_board_that_was_without_power_makes_no_jump(turned: int, away: float) -> None:
    played = Played()
    played.run(0.5)
    played.run(3.0, Twist2(0.4))
    played.run(1.0)
    stood = played.odometry.track.pose
    played.run_unheard(away)
    played.board.reset()
    played.board.turn_by_hand(*[(turned + 0.5) / played.odometry.per_radian] * 2)
    played.base.begin(played.now)
    played.run(1.0)
    assert played.odometry.track.pose == stood
    assert (played.odometry.resets, len(played.base.resets)) == (1, 1), "and it is told"
    played.run(1.0, Twist2(0.4))
    assert played.odometry.track.pose.x > stood.x + 0.3


def test_a_board_that_kept_its_power_has_counted_on() -> None:
    played = Played()
    played.run(0.5)
    played.run(3.0, Twist2(0.4))
    played.run_unheard(5.0)  # it coasts, and its watchdog stops it
    played.base.begin(played.now)
    played.run(1.0)
    assert (ticks(played.odometry), played.odometry.resets) == (played.board.encoders, 0)


@pytest.mark.parametrize(
    ("per_revolution", "most"), [(20.0, 2.0), (20.0, 4.0), (48.0, 0.8), (12.0, 3.0), (1440.0, 0.02)]
)
def test_an_encoder_that_counts_seldom_is_followed(per_revolution: float, most: float) -> None:
    drive = DiffDrive(wheel_separation=0.3, wheel_radius=0.05, max_wheel_velocity=most)
    odometry, turned = TickOdometry(drive, per_revolution), 0.0
    for step in range(1000):
        odometry.take(Encoders(int(turned), int(turned)), step * 0.033)
        turned += 0.8 * most * 0.033 * odometry.per_radian
    count = int(turned - 0.8 * most * 0.033 * odometry.per_radian)
    assert ticks(odometry) == Encoders(count, count)
    assert (odometry.resets, odometry.refused, odometry.track.left_out) == (0, 0, 0)
    assert odometry.track.pose.x == pytest.approx(count / odometry.per_radian * 0.05)


def test_a_wheel_that_is_jolted_is_followed() -> None:
    odometry = TickOdometry(DRIVE, PER_REVOLUTION)
    for step in range(20):
        odometry.take(Encoders(10_000, 10_000), 100.0 + step * 0.033)
    assert odometry.take(Encoders(10_400, 10_000), 100.7) == "asks"
    assert odometry.take(Encoders(10_400, 10_002), 100.705) == "moves"
    assert odometry.turned.left == pytest.approx(400 / odometry.per_radian)
    assert odometry.refused == odometry.resets == 0


def test_a_number_that_was_garbled_moves_nothing() -> None:
    odometry = TickOdometry(DRIVE, PER_REVOLUTION)
    for step in range(20):
        odometry.take(Encoders(10_000 + 30 * step, 10_000 + 30 * step), 100.0 + step * 0.033)
    assert odometry.take(Encoders(19_600, 10_600), 100.66) == "asks"
    assert odometry.take(Encoders(10_602, 10_601), 100.665) == "moves"
    assert odometry.turned.left == pytest.approx(602 / odometry.per_radian)
    assert (odometry.refused, odometry.resets) == (1, 0)


def test_a_base_that_drives_back_through_where_it_was_started_has_not_begun_anew() -> None:
    played = Played()
    played.run(0.5)
    for speed in (0.4, -0.4, -0.4, 0.4):
        played.run(2.0, Twist2(speed))
    played.run(1.0)
    assert (played.odometry.resets, ticks(played.odometry)) == (0, played.board.encoders)


@pytest.mark.parametrize("speed", [0.05, 0.1, -0.3, 0.9])
@pytest.mark.parametrize("gains", ["", "20:0:0:20"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_wheel_that_does_not_count_does_not_race_for_long(speed: float, gains: str, side: str) -> None:
    played = Played(BoardSpec(noise=0.05), Settings(gains=gains))
    played.run(3.0, Twist2(speed))
    assert played.base.fault == ""
    played.board.fail_encoder(side)
    played.run(2.5, Twist2(speed))
    assert played.base.fault == f"the {side} wheel does not count: encoder, wires, motor or its power"
    assert played.board.rates == Wheels(0.0, 0.0)
    played.run(1.0, Twist2(-speed))
    assert played.board.rates == Wheels(0.0, 0.0), "until it is told to stand"
    played.run(0.1)
    assert played.base.fault == ""
    played.board.fail_encoder("none")
    played.run(3.0, Twist2(speed))
    assert played.board.twist.linear == pytest.approx(speed, rel=0.05)


def test_a_wheel_that_counts_backwards_does_not_race_for_long() -> None:
    played = Played()
    roll = played.board._left.roll
    played.board._left.roll = lambda way: roll(-way)  # type: ignore[method-assign]
    played.run(2.5, Twist2(0.1))
    assert played.base.fault.startswith("the left wheel counts backwards: exchange the wires of its motor")
    played.run(0.2, Twist2(0.1))
    assert played.board.rates == Wheels(0.0, 0.0)


@pytest.mark.parametrize("per_revolution", [20.0, 60.0, 1440.0])
@pytest.mark.parametrize("friction", [12.0, 80.0])
@pytest.mark.parametrize("gains", ["", "50:0:0:50"])
def test_a_wheel_that_was_held_does_not_race_when_it_is_let_go(
    per_revolution: float, friction: float, gains: str
) -> None:
    spec = BoardSpec(per_revolution=per_revolution, friction=friction)
    played = Played(spec, Settings(gains=gains))
    played.run(0.5)
    motors = played.board._left, played.board._right
    for motor in motors:
        motor.turn = lambda *_: None  # type: ignore[method-assign]
    played.run(8.0, Twist2(0.3))
    assert "does not count" in played.base.fault
    for motor in motors:
        del motor.turn
    for _ in range(50):
        played.run(0.02, Twist2(0.3))
        assert played.board.rates == Wheels(0.0, 0.0)


@pytest.mark.parametrize(("per_revolution", "gains"), [(200.0, ""), (60.0, "50:0:0:50"), (20.0, "50:0:0:50")])
@pytest.mark.parametrize("friction", [12.0, 80.0])
def test_a_wheel_that_counts_few_ticks_drives_all_the_same(per_revolution: float, gains: str, friction: float) -> None:
    played = Played(BoardSpec(per_revolution=per_revolution, friction=friction), Settings(gains=gains))
    for speed in (0.3, -0.3, 0.6):
        played.run(8.0, Twist2(speed))
        before = played.board.pose.x
        played.run(10.0, Twist2(speed))
        assert (played.board.pose.x - before) / 10.0 == pytest.approx(speed, rel=0.2)
        assert played.base.fault == ""


@pytest.mark.parametrize("per_revolution", [20.0, 1440.0])
def test_no_wheel_is_told_to_turn_faster_than_it_may(per_revolution: float) -> None:
    fastest = 20.0 * per_revolution / math.tau * 0.033
    wheel = WheelSpeed(WheelLimits(period=0.033, loop_period=0.033, trim=10.0, fastest=fastest, gain=0.4))
    for wanted in (fastest, -fastest):
        told = [wheel.ticks(wanted, 0.9 * wanted) for _ in range(300)]
        assert abs(sum(told)) <= fastest * len(told) + 1.0
        assert sum(told) == pytest.approx(wanted * len(told), rel=0.01)


def test_the_wheels_stand_by_the_boards_own_watchdog() -> None:
    played = Played()
    played.run(2.0, Twist2(0.9))
    played.plugged = False
    played.run(0.3, Twist2(0.9))
    assert played.board.rates == Wheels(0.0, 0.0)
    assert played.board.stood - played.board.commanded < 0.3
    with pytest.raises(BoardSilent, match=r"no answer for 0\.5 s; last it said b?'"):
        played.run(1.0)
    played.plugged = True
    played.base.begin(played.now)
    played.run(1.0, Twist2(0.5))
    played.run(0.5)
    assert ticks(played.odometry) == played.board.encoders, "what it coasted unheard is counted too"


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (b"", "it says nothing; is the firmware on it"),
        (b"$GPGGA,092750.000,5321.6802,N,00630.3372,W\r\n", "it does not answer as a board does.*GPGGA"),
        (b"\x54\x2c\x68\x08\xab\x7e", r"it does not answer as a board does.*T,h\\x08"),
        (b"Invalid Command\r\n", "it has the firmware, but knows no encoders: build it with USE_BASE"),
    ],
)
def test_what_does_not_answer_as_a_board_is_refused_with_its_bytes(said: bytes, why: str) -> None:
    base = ArduinoBase(Settings(), TickOdometry(DRIVE, PER_REVOLUTION))
    base.begin(100.0)
    words = set()

    def talk() -> None:
        for step in range(200):
            words.add(base.say(100.0 + step * 0.1, Wheels(5.0, 5.0)))
            base.feed(said, 100.05 + step * 0.1)

    with pytest.raises(NotABoard, match=why):
        talk()
    assert words <= {b"\re\r", b"e\r", b""}, "nothing moves until it is known who is there"


def test_who_says_numbers_unasked_is_no_board() -> None:
    base = ArduinoBase(Settings(), TickOdometry(DRIVE, PER_REVOLUTION))
    base.begin(100.0)

    def talk() -> None:
        for step in range(200):
            base.say(100.0 + step * 0.01, Wheels(0.0, 0.0))
            base.feed(b"12 34\r\n" * 3, 100.0 + step * 0.01)

    with pytest.raises(NotABoard, match="nobody asked"):
        talk()
    assert not base.is_known, "so nothing that moves was said"


def test_what_is_garbled_is_asked_for_again_at_once_and_once() -> None:
    played = Played()
    played.run(1.0, Twist2(0.2))
    base, now = played.base, played.now
    said = base.say(max(base.due, now), Wheels(4.0, 4.0))
    assert (said[:2], said[-2:]) == (b"m ", b"e\r")
    base.feed(b"12x34 5\r\n", now := base.due - 0.02)
    assert base.unread.pop() == b"12x34 5"
    assert base.say(now, Wheels(4.0, 4.0)) == b"e\r"
    base.feed(b"12x34 5\r\n" * 5, now)
    assert base.say(now, Wheels(4.0, 4.0)) == b"", "who floods the line is not flooded"
    base.feed(b"12x34 5\r\n" * 100, now)
    with pytest.raises(BoardSilent, match=r"most of what it says cannot be read; last it said .*12x34 5"):
        base.say(now, Wheels(4.0, 4.0))


def introduced(base: ArduinoBase, now: float) -> float:
    """Ask a board until it is known, at 1000 1000. Returns when that is, s."""
    base.begin(now)
    while not base.is_known:
        now = max(now, base.due)
        assert base.say(now, Wheels(4.0, 4.0)) == b"\re\r"
        now += LATENCY
        base.feed(b"Invalid Command\r\n1000 1000\r\n", now)
    return now


def test_a_board_is_known_by_two_answers_after_a_silence() -> None:
    base = ArduinoBase(Settings(), TickOdometry(DRIVE, PER_REVOLUTION))
    assert introduced(base, 100.0) - 100.0 < 0.25
    assert base.counts.invalid == 0, "what it was asked with is no command"


def test_two_readings_that_do_not_go_together_are_no_boards() -> None:
    base = ArduinoBase(Settings(), TickOdometry(DRIVE, PER_REVOLUTION))
    base.begin(now := 100.0)
    for line in (b"1 1", b"5 3", b"90000 7", b"1 -44444", b"12x 4", b"12 4"):
        assert not base.is_known
        base.say(now, Wheels(4.0, 4.0))
        base.feed(line + b"\r\n", now)
        now = max(base.due, now + LATENCY)
    base.say(now, Wheels(4.0, 4.0))
    base.feed(b"12 6\r\n", now)
    assert base.is_known


@pytest.mark.parametrize("wait", [0.3, 1.0, 2.5])
def test_a_board_that_answers_late_what_it_was_asked_while_it_started_is_one(wait: float) -> None:
    base = ArduinoBase(Settings(), TickOdometry(DRIVE, PER_REVOLUTION))
    base.begin(now := 100.0)
    asked = 0
    while now < 100.0 + wait:
        asked += base.say(now, Wheels(4.0, 4.0)).count(b"e")
        now += 0.01
    for _ in range(asked):
        base.feed(b"Invalid Command\r\n0 0\r\n", now)
    while not base.is_known and now < 104.0:
        if base.say(now, Wheels(4.0, 4.0)):
            base.feed(b"Invalid Command\r\n0 0\r\n", now + LATENCY)
        now += 0.01
    assert base.is_known


@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 15.0, 20.0, 30.0, 100.0])
@pytest.mark.parametrize("begin", [0.0, 0.013, 0.05, 0.099, 0.17])
def test_who_streams_numbers_unasked_is_told_no_speed(rate: float, begin: float) -> None:
    base = ArduinoBase(Settings(), TickOdometry(DRIVE, PER_REVOLUTION))
    base.begin(100.0)

    def talk() -> None:
        due = begin
        for step in range(2000):
            assert base.say(100.0 + step * 0.005, Wheels(5.0, 5.0)) in (b"", b"\re\r")
            while due <= step * 0.005:
                due += 1.0 / rate
                base.feed(b"12 %d\r\n" % (34 + step % 7), 100.0 + step * 0.005)

    with pytest.raises(NotABoard, match=r"nobody asked|does not answer as a board"):
        talk()


@pytest.mark.parametrize("size", [1, 2, 3, 7, 100])
def test_answers_come_in_any_pieces(size: int) -> None:
    said = b"OK\r\n-12 2147483647\r\nInvalid Command\r\n57600\r\n\r\n007 5\r\n-0 1\r\n1 2 3\r\n2147483648 0\r\n"
    reader, found = Reader(), []
    for place in range(0, len(said), size):
        found += reader.feed(said[place : place + size])
    assert found == [
        *(Done(), Encoders(-12, 2147483647), Invalid(), Number(57600)),
        *(Unread(b"007 5"), Unread(b"-0 1"), Unread(b"1 2 3"), Unread(b"2147483648 0")),
    ]


def test_a_line_without_an_end_is_not_kept() -> None:
    reader = Reader()
    assert reader.feed(b"1" * 100) == [Unread(b"1" * 64)]
    assert [*(one for _ in range(1000) for one in reader.feed(b"1" * 1000)), *reader.feed(b"7 8\n9 9\n")] == [
        Encoders(9, 9)
    ]


@pytest.mark.parametrize(
    "data", [b"\r", b"m\r", b"m x y\r", b"u 1:2\r", b"u 1:1:1:0\rm 9 9\r", b"o 999 -999\r", b"m 99999 1\r"]
)
def test_a_board_lives_with_whatever_it_hears(data: bytes) -> None:
    board = Board(BoardSpec())
    board.receive(data)
    board.advance(1.0)
    assert board.said().count(b"\r\n") == data.count(b"\r")


def test_ten_thousand_random_commands() -> None:
    dice, board = random.Random(4), Board(BoardSpec())
    for _ in range(10_000):
        board.receive(bytes(dice.choices(b"aebmoru0123456789 :-\r", k=20)) + dice.randbytes(3))
        board.advance(0.001)
        board.said()
    assert all(map(math.isfinite, board.pose))


def test_duty_moves_without_the_loop_and_r_counts_from_0() -> None:
    board = Board(BoardSpec())
    board.receive(protocol.duty(100, 50))
    board.advance(0.15)
    assert board.encoders.left > board.encoders.right > 0
    board.receive(protocol.RESET_ENCODERS + protocol.ASK_ENCODERS + protocol.ASK_BAUD)
    assert board.said() == b"OK\r\nOK\r\n0 0\r\n57600\r\n"


def test_gains_are_said_once_and_again_to_a_board_that_begins_anew() -> None:
    played = Played(settings=Settings(gains="20:0:0:20"))
    said = []
    received = played.board.receive
    played.board.receive = lambda data: (said.append(data), received(data))[1]  # type: ignore[func-returns-value, method-assign]
    played.run(3.0, Twist2(0.5))
    assert sum(b"u 20:0:0:20" in line for line in said) == 1
    played.board.reset()
    played.run(1.0, Twist2(0.5))
    assert sum(b"u 20:0:0:20" in line for line in said) == 2


def test_gains_are_said_again_while_it_stands_for_a_board_may_have_forgotten_them() -> None:
    played = Played(settings=Settings(gains="20:0:0:20"))
    played.run(2.0)
    played.board.reset()  # at 0 0: nobody sees it
    played.run(1.5)
    assert played.odometry.resets == 0
    assert played.board._gains == (20, 0, 0, 20)


def test_the_battery_is_asked_for_once_a_second() -> None:
    played = Played(settings=Settings(battery_pin=0))
    found = []
    for seconds in (1.0, 1.5):
        played.run(seconds)
        found.append(played.base.battery)
    assert found == [None, 791], "once may be anything"
    assert Played().base.battery is None


def test_what_is_left_of_a_garbled_line_is_no_voltage() -> None:
    base = ArduinoBase(Settings(battery_pin=0, silence_limit=10.0), TickOdometry(DRIVE, PER_REVOLUTION))
    now = introduced(base, 100.0)
    for voltage in (b"800", b"810", b"805"):
        now = max(base.due, now + 1.0)
        assert b"a 0\r" in base.say(now, Wheels(0.0, 0.0))
        base.feed(b"OK\r\n1000 1000\r\n" + voltage + b"\r\n1000 1000\r\n", now)
        base.feed(b"812\r345\r\n", now)
    assert base.battery == 805
    assert base.counts.unread == 6
    assert b"a 0\r" in base.say(now + 1.0, Wheels(0.0, 0.0))
    base.feed(b"812\r345\r\n", now + 1.0)
    assert base.battery == 812, "one that can be true"
    assert b"a 0\r" in base.say(now + 2.0, Wheels(0.0, 0.0))
    base.feed(b"12\r\n", now + 2.0)
    assert base.battery == 812


def test_a_board_that_was_known_is_asked_anew_and_not_told_that_it_has_no_firmware() -> None:
    base = ArduinoBase(Settings(), TickOdometry(DRIVE, PER_REVOLUTION))
    now = introduced(base, 100.0)
    with pytest.raises(BoardSilent, match=r"no answer for 0\.5 s"):
        base.say(now := now + 0.6, Wheels(1.0, 1.0))
    base.begin(now, again=True)
    assert base.say(now, Wheels(1.0, 1.0)) == b"\re\r"
    with pytest.raises(BoardError, match=r"^it has not answered for 4 s$") as error:
        base.say(now + 4.1, Wheels(1.0, 1.0))
    assert not isinstance(error.value, NotABoard | BoardSilent)


def test_whose_lines_are_lost_may_not_talk_unasked_for_ever() -> None:
    base = ArduinoBase(Settings(silence_limit=10.0), TickOdometry(DRIVE, PER_REVOLUTION))
    now = introduced(base, 100.0)
    for _ in range(200):  # none of them is answered
        base.say(now := max(base.due, now), Wheels(0.0, 0.0))
    base.feed(b"1000 1000\r\n" * 50, now)
    with pytest.raises(NotABoard, match="nobody asked"):
        base.say(now, Wheels(0.0, 0.0))


STREAMS = st.lists(
    st.one_of(
        st.binary(max_size=200),
        st.tuples(st.integers(-(2**40), 2**40), st.integers(-(2**40), 2**40)).map(lambda two: b"%d %d\r\n" % two),
        st.sampled_from([b"OK\r\n", b"Invalid Command\r\n", b"0 0\r\n", b"7 ", b"\n", b"A" * 5000]),
    ),
    max_size=40,
)


def check_a_stream(stream: list[bytes], *, known: bool) -> None:
    base = ArduinoBase(Settings(battery_pin=0), odometry := TickOdometry(DRIVE, PER_REVOLUTION))
    now = 100.0
    if known:
        now = introduced(base, now)
        base.say(now := base.due, Wheels(0.0, 0.0))
        base.feed(b"OK\r\n1000 1000\r\n", now)
    else:
        base.begin(now)
    for data in stream:
        before, heard = odometry.track.pose, base.measured
        try:
            said = base.say(now, Wheels(1.0, 1.0))
        except BoardError:
            base.begin(now)
        else:
            # A stream can happen to answer as a board does: then it is one.
            assert base.is_known or b"m" not in said, "no speed is said to what is not known"
        moved = base.feed(data, now)
        pose = odometry.track.pose
        assert all(map(math.isfinite, (*pose, *odometry.track.covariance)))
        # In so short a time no wheel turns further, whatever the line says.
        elapsed = min(max(now - heard, 0.1), 1.0) + 0.1 * data.count(b" ")
        assert math.hypot(pose.x - before.x, pose.y - before.y) <= 20.0 * 1.5 * elapsed * 0.05
        assert moved or pose == before
        check_what_is_told(base, odometry, now)
        assert len(base._said) <= 80
        assert len(base._reader._line) <= 64
        assert len(base.unread) <= 8
        now += 0.01


def check_what_is_told(base: ArduinoBase, odometry: TickOdometry, now: float) -> None:
    """Nothing that cannot be true; the battery is believed when it has said the same twice, 1 s apart."""
    assert base.battery is None or now > 101.0
    twist = odometry.message(Header(), "base_link").twist.twist
    for rate in (*odometry.rates[:2], twist.linear.x / 0.05, twist.angular.z * 0.15 / 0.05):
        assert math.isfinite(rate)
        assert abs(rate) <= FASTEST_SEEN


@settings(max_examples=500, deadline=None)
@given(STREAMS, st.booleans())
def test_whatever_comes_is_no_wrong_value(stream: list[bytes], known: bool) -> None:
    check_a_stream(stream, known=known)


def test_ten_thousand_random_streams() -> None:
    dice = random.Random(19)
    letters = b"0123456789 -\r\n\r\nOKe"
    for number in range(10_000):
        stream = []
        for _ in range(dice.randrange(12)):
            length = dice.randrange(60)
            near_a_boards = dice.random() < 0.5
            stream.append(bytes(dice.choices(letters, k=length)) if near_a_boards else dice.randbytes(length))
        check_a_stream(stream, known=number % 2 == 0)
