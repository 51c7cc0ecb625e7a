"""What lidars LD06 and LD19 say, and what becomes of it."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo_messages import Header
from robo_services.ld_packets import (
    CLOCK,
    LENGTH,
    POINT_RATE,
    POINTS,
    LdDecoder,
    Packet,
    Turn,
    Turns,
    crc8,
    encode,
    laser_scan,
)

FROM_THE_MANUAL = bytes.fromhex(
    "542C6808AB7EE000E4DC00E2D900E5D500E3D300E4D000E9CD00E4CA00E2C700E9C500E5C200E5C000E5BE823A1A50"
)
"""The example of the development manual, its checksum included."""


def a_packet(start: float = 10.0, distance: float = 1.0, time: float = 1.0) -> Packet:
    return Packet(10.0, start, 8.8, time, (distance,) * POINTS, (200,) * POINTS)


def spoken(turns: float, rate: float = 10.0, distance: float = 2.0, start: float = 0.0) -> list[Packet]:
    """What a lidar says in so many turns."""
    step = rate * 360.0 / POINT_RATE
    count = math.ceil(turns * 360.0 / step / POINTS)
    return [
        Packet(
            rate,
            (start + n * POINTS * step) % 360.0,
            (POINTS - 1) * step,
            ((n + 1) * POINTS / POINT_RATE) % CLOCK,
            (distance,) * POINTS,
            (n % 256,) * POINTS,
        )
        for n in range(count)
    ]


# -- packets ---------------------------------------------------------------------------------------


def test_the_packet_of_the_manual() -> None:
    (packet,) = LdDecoder().feed(FROM_THE_MANUAL)
    assert packet.speed == pytest.approx(2152 / 360)
    assert (packet.start, packet.start + packet.span) == pytest.approx((324.27, 334.70))
    assert (packet.distances[0], packet.distances[-1]) == pytest.approx((0.224, 0.192))
    assert (packet.intensities[0], packet.intensities[-1]) == (228, 229)
    assert packet.time == pytest.approx(6.714)
    assert encode(packet) == FROM_THE_MANUAL


def test_a_packet_over_the_front_has_a_short_span() -> None:
    (packet,) = LdDecoder().feed(encode(a_packet(start=355.0)))
    assert (packet.start, packet.span) == pytest.approx((355.0, 8.8))


@given(st.integers(1, LENGTH), st.integers(0, 3), st.randoms(use_true_random=False))
@settings(max_examples=200, derandomize=True)
def test_packets_come_however_they_are_cut_and_whatever_stands_between(
    piece: int, noise: int, chance: random.Random
) -> None:
    wanted = [a_packet(start=float(n), time=n / 10) for n in range(20)]
    between = [bytes(chance.choice((0x54, 0x2C, 0x00)) for _ in range(noise)) for _ in wanted]
    # 0x54 0x2C in front of a packet may hide its beginning, but never make another one of it.
    stream = b"".join(gap + encode(packet) for gap, packet in zip(between, wanted, strict=True))
    decoder = LdDecoder()
    found = [p for at in range(0, len(stream), piece) for p in decoder.feed(stream[at : at + piece])]
    assert [round(p.start) for p in found] == list(range(20))
    assert decoder.skipped == len(stream) - 20 * LENGTH


@pytest.mark.parametrize("byte", range(2, LENGTH))
def test_a_wrong_bit_anywhere_loses_that_packet_alone(byte: int) -> None:
    for bit in range(8):
        wrong = bytearray(FROM_THE_MANUAL)
        wrong[byte] ^= 1 << bit
        decoder = LdDecoder()
        found = decoder.feed(bytes(wrong) + FROM_THE_MANUAL)
        assert len(found) == 1
        assert decoder.crc_faults >= 1
        assert (decoder.skipped, decoder.unread) == (LENGTH, bytes(wrong))


@pytest.mark.parametrize("cut", range(LENGTH))
def test_a_packet_of_which_the_end_is_missing_does_not_take_the_next_one_along(cut: int) -> None:
    found = LdDecoder().feed(FROM_THE_MANUAL[:cut] + FROM_THE_MANUAL + FROM_THE_MANUAL)
    assert len(found) == 2


def test_a_checksum_like_the_first_byte_of_a_packet_begins_none() -> None:
    raw = next(one for one in (encode(a_packet(time=n / 1000)) for n in range(30_000)) if one[-1] == 0x54)
    decoder = LdDecoder()
    for _ in range(3):
        assert len(decoder.feed(raw)) == 1
    assert decoder.skipped == 0


def resealed(at: int, value: bytes) -> bytes:
    """The packet of the manual with other bytes, and a checksum that holds."""
    body = FROM_THE_MANUAL[:at] + value + FROM_THE_MANUAL[at + len(value) : -1]
    return body + bytes((crc8(body),))


@pytest.mark.parametrize(("at", "value"), [(2, b"\xff\xff"), (4, b"\xff\xff"), (42, b"\xff\xff"), (42, b"\x00\x00")])
def test_what_no_lidar_can_mean_is_left_out_though_its_checksum_holds(at: int, value: bytes) -> None:
    decoder = LdDecoder()
    assert decoder.feed(resealed(at, value)) == []
    assert decoder.crc_faults == 1


def a_stream(chance: random.Random) -> bytes:
    """Noise, packets, packets with wrong bytes or without an end, and noise with a checksum that holds."""
    parts = []
    for _ in range(chance.randrange(8)):
        body = b"\x54\x2c" + chance.randbytes(44)
        packet = encode(a_packet(chance.uniform(0.0, 359.0), chance.uniform(0.0, 20.0), chance.uniform(0.0, CLOCK)))
        at = chance.randrange(LENGTH)
        parts.append(
            chance.choice(
                [
                    chance.randbytes(chance.randrange(120)),
                    b"\x54\x2c",
                    body + bytes((crc8(body),)),
                    packet,
                    packet[:at],
                    packet[:at] + chance.randbytes(1) + packet[at + 1 :],
                ]
            )
        )
    return b"".join(parts)


def test_10_000_random_streams_break_nothing_and_only_what_has_its_checksum_is_taken() -> None:
    chance = random.Random(19)
    taken = 0
    for _ in range(10_000):
        stream = a_stream(chance)
        decoder, turns = LdDecoder(), Turns(90)
        piece = chance.choice([1, 7, 64, 4096])
        for begin in range(0, len(stream), piece):
            for packet in decoder.feed(stream[begin : begin + piece]):
                taken += 1
                raw = encode(packet)
                assert raw in stream, "it stands there byte for byte, its checksum included"
                assert crc8(raw) == 0
                turn = turns.take(packet)
                if turn is not None:
                    laser_scan(turn, Header(), 0.02, 12.0)
            assert len(decoder._rest) < LENGTH
            assert len(decoder.unread) <= LENGTH
    assert taken > 5_000


# -- turns -----------------------------------------------------------------------------------------


def turns_of(packets: list[Packet], rays: int = 360) -> list[Turn]:
    assembly = Turns(rays)
    return [turn for packet in packets if (turn := assembly.take(packet)) is not None]


@pytest.mark.parametrize("rate", [5.0, 10.0, 12.5])
def test_turns_are_whole_and_even(rate: float) -> None:
    found = turns_of(spoken(4.2, rate))
    assert len(found) == 3, "the first one was not seen from its beginning"
    for turn in found:
        assert turn.speed == pytest.approx(rate)
        assert min(turn.distances) == max(turn.distances) == 2.0, "no ray is empty"
    assert found[1].time - found[0].time == pytest.approx(1 / rate, abs=1e-3)


@pytest.mark.parametrize(("inverted", "sense"), [(False, -1.0), (True, 1.0)])
@pytest.mark.parametrize("device_degrees", [0, 45, 90, 179, 181, 270, 359])
def test_what_stands_to_the_right_is_at_a_negative_angle_unless_the_lidar_is_upside_down(
    device_degrees: int, inverted: bool, sense: float
) -> None:
    step = 0.8
    packets = [
        packet._replace(
            distances=tuple(
                1.0 if abs(math.remainder(packet.start + i * step - device_degrees, 360)) < step / 2 + 1e-9 else 5.0
                for i in range(POINTS)
            )
        )
        for packet in spoken(2.2)
    ]
    scan = laser_scan(turns_of(packets)[0], Header(), 0.02, 12.0, inverted=inverted)
    nearest = min(range(360), key=lambda ray: scan.ranges[ray])
    angle = scan.angle_min + nearest * scan.angle_increment
    assert abs(math.remainder(angle - sense * math.radians(device_degrees), math.tau)) <= math.radians(1.0)
    assert scan.time_increment == pytest.approx(sense * 0.1 / 360)


@pytest.mark.parametrize("rays", [36, 37])
def test_upside_down_each_ray_is_at_its_negative_angle(rays: int) -> None:
    turn = Turn([1.0 + n for n in range(rays)], [float(n) for n in range(rays)], 10.0, 0.0)
    upright, inverted = (laser_scan(turn, Header(), 0.02, 100.0, inverted=each) for each in (False, True))
    for ray in range(rays):
        other = -ray % rays  # its angle is the negative, modulo a turn
        angles = (
            upright.angle_min + ray * upright.angle_increment,
            inverted.angle_min + other * inverted.angle_increment,
        )
        assert math.remainder(sum(angles), math.tau) == pytest.approx(0.0, abs=1e-9)
        assert inverted.ranges[other] == upright.ranges[ray]
        assert inverted.intensities[other] == upright.intensities[ray]


def test_a_scan_is_as_reps_103_and_117_say() -> None:
    distances = [0.0, -1.0, 0.01, 5.0, 12.5] + [1.0] * 355
    turn = Turn(distances, [7.0] * 360, 10.0, 0.0)
    scan = laser_scan(turn, Header(frame_id="base_laser"), 0.02, 12.0)
    assert scan.ranges[2:5] == [-math.inf, 5.0, math.inf]
    assert all(map(math.isnan, scan.ranges[:2]))
    assert scan.angle_min == -math.pi
    assert scan.angle_max == pytest.approx(math.pi - math.tau / 360)
    assert scan.angle_increment == pytest.approx(math.tau / 360)
    assert scan.scan_time == pytest.approx(0.1)
    assert scan.time_increment == pytest.approx(-0.1 / 360), "the first ray is measured last"
    assert len(scan.intensities) == len(scan.ranges) == 360
    free = laser_scan(turn, Header(), 0.02, 12.0, no_return="inf")
    assert free.ranges[0] == math.inf
    assert math.isnan(free.ranges[1]), "what was never heard is not free"


def test_the_nearest_of_several_points_counts() -> None:
    packets = [
        packet._replace(distances=(3.0, 0.0, 2.0, 3.0) * 3, intensities=(1, 2, 3, 4) * 3) for packet in spoken(2.2)
    ]
    (turn, *_) = turns_of(packets, rays=36)
    assert set(turn.distances) == {2.0}
    assert set(turn.intensities) == {3.0}


def test_what_is_missing_is_not_known() -> None:
    packets = spoken(3.2)
    del packets[45:48]  # 29 degrees of the first whole turn
    found = turns_of(packets)
    gaps = [sum(distance < 0 for distance in turn.distances) for turn in found]
    assert len(found) == 2
    assert 26 <= gaps[0] <= 30
    assert gaps[1] == 0


@pytest.mark.parametrize("missing", [45, 36, 20])
def test_a_turn_that_says_nothing_of_too_much_in_a_row_is_none(missing: int) -> None:
    packets = spoken(5.2)
    del packets[missing : missing + 4]
    assembly = Turns(360)
    found = [turn for packet in packets if (turn := assembly.take(packet)) is not None]
    assert assembly.incomplete == 1
    assert len(found) in (2, 3)
    assert all(min(turn.distances) == 2.0 for turn in found)


def test_many_rays_are_no_gap_where_the_lidar_measures_fewer_points() -> None:
    assert len(turns_of(spoken(4.2), rays=10_000)) == 3


def test_a_turn_of_which_a_half_is_missing_is_none() -> None:
    packets = spoken(4.2)
    assembly = Turns(360)
    del packets[45:68]
    found = [turn for packet in packets if (turn := assembly.take(packet)) is not None]
    assert (len(found), assembly.incomplete) == (1, 1), "the one behind it was not seen from its beginning"
    assert all(min(turn.distances) == 2.0 for turn in found)


def test_scattered_losses_of_more_than_a_half_make_no_scan() -> None:
    assembly = Turns(360)
    found = [assembly.take(packet) for packet in spoken(4.2)[::3]]
    assert not any(found)
    assert assembly.incomplete == 3


def test_a_lidar_whose_clock_begins_anew_is_heard_on() -> None:
    packets = [packet._replace(time=(packet.time + 29.9) % CLOCK) for packet in spoken(4.2)]
    assert len(turns_of(packets)) == 3


def test_one_that_stands_still_says_no_turn() -> None:
    assert turns_of([packet._replace(speed=0.0) for packet in spoken(3.2)]) == []
