"""What receivers of satellites say by NMEA, and what is never believed."""

import math
import random
import sys
from datetime import UTC, datetime

import pytest

from robo.errors import RunError
from robo_messages import Header, NavSatFix, NavSatStatus
from robo_services.nmea import (
    KNOT,
    MOST,
    Errors,
    NmeaLines,
    Position,
    Receiver,
    Unreadable,
    Velocity,
    as_time,
    checksum,
    nav_sat_fix,
    time_of,
)

pytest.importorskip("pynmea2", reason="the extra gps is not installed")

GGA = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"
RMC = "GPRMC,123519.25,A,4807.038,N,01131.000,E,022.4,084.4,230325,003.1,W,A"
VTG = "GPVTG,090.0,T,034.4,M,010.0,N,018.5,K,A"
GST = "GPGST,123519,0.006,0.023,0.020,273.6,0.5,0.4,1.5"

EPE = {1: 4.0, 2: 0.1, 4: 0.02, 5: 4.0, 9: 3.0}


def sentence(body: str) -> str:
    return f"${body}*{checksum(body.encode()):02X}"


def position(body: str) -> Position:
    (said,) = Receiver().take(sentence(body))
    assert isinstance(said, Position)
    return said


# -- lines -----------------------------------------------------------------------------------------


def test_the_checksum_of_a_known_sentence() -> None:
    assert sentence(GGA).endswith("*47")


@pytest.mark.parametrize("piece", [1, 3, 10, 1000])
def test_sentences_come_however_they_are_cut_and_whatever_stands_between(piece: int) -> None:
    wanted = [sentence(GGA), sentence(RMC)]
    stream = b"\xb5\x62\x01\x07\x00$GPG" + wanted[0].encode() + b"\r\n\r\n\xff\xfe\r\n" + wanted[1].encode() + b"\n"
    lines = NmeaLines()
    found = [one for at in range(0, len(stream), piece) for one in lines.feed(stream[at : at + piece])]
    assert found == wanted
    assert (lines.unread, lines.checksum_faults, lines.has_rest) == (1, 0, False)


def test_a_wrong_character_anywhere_is_found() -> None:
    good = sentence(GGA).encode()
    for at in range(len(good)):
        for bit in range(8):
            wrong = good[:at] + bytes((good[at] ^ 1 << bit,)) + good[at + 1 :]
            found = NmeaLines().feed(wrong + b"\n")
            assert all(one.upper() == good.decode() for one in found), "but for the case of the checksum's letters"


def test_without_a_checksum_nothing_is_taken() -> None:
    lines = NmeaLines()
    assert lines.feed(f"${GGA}\r\n".encode()) == []
    assert lines.unread == 1


def test_a_line_without_end_takes_no_memory() -> None:
    lines = NmeaLines()
    for _ in range(100):
        lines.feed(b"x" * 65_536)
        assert len(lines._rest) <= MOST
    assert lines.feed(b"\n" + sentence(GGA).encode() + b"\r\n") == [sentence(GGA)]


# -- sentences -------------------------------------------------------------------------------------


def test_a_position() -> None:
    said = position(GGA)
    assert (said.latitude, said.longitude) == pytest.approx((48 + 7.038 / 60, 11 + 31.0 / 60))
    assert said.altitude == pytest.approx(545.4 + 46.9), "above the ellipsoid"
    assert (said.quality, said.hdop, said.satellites, said.service) == (1, 0.9, 8, 1)
    south = position(GGA.replace(",N,", ",S,").replace(",E,", ",W,").replace("GPGGA", "GAGGA"))
    assert (south.latitude, south.longitude, south.service) == (-said.latitude, -said.longitude, 8)


def test_heights_that_are_not_said_are_not_known() -> None:
    assert math.isnan(position(GGA.replace(",46.9,M", ",,")).altitude)
    assert math.isnan(position(GGA.replace(",545.4,M", ",,")).altitude)


def test_without_a_fix_there_is_no_place() -> None:
    for body in ("GPGGA,123519,,,,,0,00,99.99,,,,,,", GGA.replace(",1,08", ",0,08"), "GPGGA,,,,,,,,,,,,,,"):
        said = position(body)
        assert said.quality == 0
        assert math.isnan(said.latitude)
        fix = nav_sat_fix(said, None, EPE, Header())
        assert fix.status.status == NavSatStatus.STATUS_NO_FIX
        assert math.isnan(fix.latitude)
        assert math.isnan(fix.longitude)


@pytest.mark.parametrize(
    "body",
    [
        GGA.replace("4807.038", "9107.038"),
        GGA.replace("4807.038", "4867.038"),
        GGA.replace("4807.038", "480"),
        GGA.replace("4807.038", "nan"),
        GGA.replace("4807.038", ""),
        GGA.replace("01131.000", "18131.000"),
        GGA.replace(",N,", ",X,"),
        GGA.replace(",N,", ",,"),
        GGA.replace("0.9", "1e3"),
        GGA.replace("0.9", "inf"),
        GGA.replace("0.9", "1_0"),
        GGA.replace("545.4", "-545454.4"),
        GGA.replace(",M,46.9", ",F,46.9"),
        GGA.replace("123519", "253519"),
        GGA.replace("123519", "12351"),
        GGA.replace(",1,08", ",x,08"),
        RMC.replace(",A,4807", ",Q,4807"),
        RMC.replace("022.4", "-22.4"),
        RMC.replace("022.4", "99999"),
        RMC.replace("084.4", "384.4"),
        RMC.replace("230325", "310225"),
        RMC.replace("230325", "2303"),
        VTG.replace(",T,", ",M,"),
        GST.replace("0.5", "-0.5"),
    ],
)
def test_what_cannot_be_is_refused_though_its_checksum_holds(body: str) -> None:
    with pytest.raises(Unreadable):
        Receiver().take(sentence(body))


def test_velocity_and_time_of_rmc() -> None:
    moment, velocity = Receiver().take(sentence(RMC))
    assert moment == datetime(2025, 3, 23, 12, 35, 19, 250_000, UTC)
    assert isinstance(moment, datetime)
    assert as_time(moment).to_seconds() == pytest.approx(moment.timestamp())
    speed, course = 22.4 * KNOT, math.radians(84.4)
    assert velocity == pytest.approx(Velocity(speed * math.sin(course), speed * math.cos(course)))
    assert Receiver().take(sentence(RMC.replace(",A,", ",V,"))) == []
    standing = RMC.replace("022.4,084.4", "0.0,")
    assert Receiver().take(sentence(standing))[1:] == [Velocity(0.0, 0.0)]
    unknown = RMC.replace("022.4,084.4", "0.5,")
    assert Receiver().take(sentence(unknown))[1:] == [], "where it goes to is not said"


def test_vtg_counts_where_there_is_no_rmc_and_a_fix() -> None:
    receiver = Receiver()
    assert receiver.take(sentence(VTG)) == []
    receiver.take(sentence(GGA))
    assert receiver.take(sentence(VTG)) == [pytest.approx(Velocity(10.0 * KNOT, 0.0))]
    receiver.take(sentence(RMC))
    assert receiver.take(sentence(VTG)) == []
    receiver.take(sentence(GGA.replace(",1,08", ",0,08")))
    assert [receiver.take(sentence(VTG)) for _ in range(10)] == [[]] * 10


def test_use_rmc() -> None:
    receiver = Receiver(use_rmc=True)
    assert receiver.take(sentence(GGA)) == []
    said = [each for each in receiver.take(sentence(RMC)) if isinstance(each, Position)]
    assert said[0].latitude == pytest.approx(48 + 7.038 / 60)
    fix = nav_sat_fix(said[0], None, EPE, Header())
    assert (fix.status.status, fix.position_covariance_type) == (NavSatStatus.STATUS_FIX, 0)
    (none,) = receiver.take(sentence(RMC.replace(",A,4807", ",V,4807")))
    assert isinstance(none, Position)
    assert none.quality == 0


def test_others_are_of_no_interest() -> None:
    receiver = Receiver()
    for body in ("GPGSV,1,1,00", "PUBX,00,1", "PGGA,1", "GPXXX", "G", "GPTXT,01,01,02,hello", "GPGGA"):
        assert receiver.take(sentence(body)) == []


@pytest.mark.parametrize("body", [GGA, RMC, VTG, GST])
@pytest.mark.parametrize("maker", ["PG", "PP", "P1"])
def test_what_makers_have_of_their_own_is_of_no_interest(body: str, maker: str) -> None:
    assert Receiver(use_rmc=True).take(sentence(maker + body[2:])) == []
    assert time_of(sentence(maker + body[2:])) is None


@pytest.mark.parametrize("talker", ["GP", "GN", "QZ", "II", "X1", ",,", "  ", "__", "--"])
@pytest.mark.parametrize("body", [GGA, RMC, VTG, GST])
def test_any_other_talker_says_something_or_is_unreadable(talker: str, body: str) -> None:
    try:
        Receiver().take(sentence(talker + body[2:]))
    except Unreadable:
        assert not talker.isalnum()


@pytest.mark.parametrize("mode", ["A", "D", "F", "P", "R", ""])
def test_modes_in_which_satellites_are_measured(mode: str) -> None:
    said = Receiver(use_rmc=True).take(sentence(f"{RMC[:-1]}{mode}"))
    assert [type(each) for each in said] == [datetime, Position, Velocity]


@pytest.mark.parametrize("mode", ["E", "M", "S", "N", "x"])
def test_what_is_reckoned_told_by_hand_or_simulated_is_no_fix_of_rmc_and_vtg(mode: str) -> None:
    (said,) = Receiver(use_rmc=True).take(sentence(f"{RMC[:-1]}{mode}"))
    assert isinstance(said, Position)
    assert (said.quality, math.isnan(said.latitude)) == (0, True)
    receiver = Receiver()
    receiver.take(sentence(GGA))
    assert receiver.take(sentence(f"{RMC[:-1]}{mode}")) == []
    for _ in range(10):
        assert receiver.take(sentence(f"{VTG[:-1]}{mode}")) == []


def test_numbers_as_receivers_write_them() -> None:
    said = position(GGA.replace(",0.9,", ",.9,").replace(",46.9,", ",+46.9,"))
    assert (said.hdop, said.altitude) == pytest.approx((0.9, 545.4 + 46.9))
    assert position(GGA.replace(",0.9,", ",100.0,")).hdop == 100.0, "a fix that is bad, and one"


def test_where_only_rmc_comes_it_knows() -> None:
    receiver = Receiver()
    for _ in range(4):
        assert not receiver.has_only_rmc
        receiver.take(sentence(RMC))
    assert receiver.has_only_rmc
    receiver.take(sentence(GGA))
    assert not receiver.has_only_rmc


def test_when_a_sentence_is() -> None:
    assert time_of(sentence(GGA)) == 12 * 3600 + 35 * 60 + 19
    assert time_of(sentence("GPGSV,1,1,00")) is None
    assert time_of(sentence("GPGGA")) is None
    assert time_of(sentence("GPGGA,9,")) is None


# -- covariance ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("quality", "status", "epe"),
    [(1, 0, 4.0), (2, 1, 0.1), (3, 0, 4.0), (4, 2, 0.02), (5, 2, 4.0), (9, 1, 3.0)],
)
def test_the_covariance_follows_from_hdop(quality: int, status: int, epe: float) -> None:
    fix = nav_sat_fix(position(GGA.replace(",1,08,0.9", f",{quality},08,1.5")), None, EPE, Header())
    assert fix.status.status == status
    assert fix.position_covariance_type == NavSatFix.COVARIANCE_TYPE_APPROXIMATED
    around, up = (1.5 * epe) ** 2, (4 * 1.5 * epe) ** 2
    assert fix.position_covariance == pytest.approx((around, 0, 0, 0, around, 0, 0, 0, up))


@pytest.mark.parametrize("quality", [6, 7, 8])
def test_what_is_reckoned_or_simulated_is_no_fix(quality: int) -> None:
    fix = nav_sat_fix(position(GGA.replace(",1,08", f",{quality},08")), None, EPE, Header())
    assert fix.status.status == NavSatStatus.STATUS_NO_FIX
    assert math.isnan(fix.latitude)


def test_what_the_receiver_says_of_its_errors_goes_before() -> None:
    receiver = Receiver()
    assert receiver.take(sentence(GST)) == []
    assert receiver.errors == Errors(0.4, 0.5, 1.5, 12 * 3600 + 35 * 60 + 19)
    fix = nav_sat_fix(position(GGA), receiver.errors, EPE, Header())
    assert fix.position_covariance_type == NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
    assert fix.position_covariance == pytest.approx((0.16, 0, 0, 0, 0.25, 0, 0, 0, 2.25))
    later = nav_sat_fix(position(GGA.replace("123519", "123530")), receiver.errors, EPE, Header())
    assert later.position_covariance_type == NavSatFix.COVARIANCE_TYPE_APPROXIMATED, "it is of another time"


@pytest.mark.parametrize("errors", ["0.0,0.4,1.5", "0.5,0.0,1.5", "0.5,0.4,0.0", ",,"])
def test_an_error_of_0_is_none_that_is_known(errors: str) -> None:
    receiver = Receiver()
    receiver.take(sentence(GST.replace("0.5,0.4,1.5", errors)))
    fix = nav_sat_fix(position(GGA), receiver.errors, EPE, Header())
    assert fix.position_covariance_type == NavSatFix.COVARIANCE_TYPE_APPROXIMATED
    assert fix.position_covariance[0] == pytest.approx((0.9 * 4.0) ** 2)


def test_without_hdop_the_covariance_is_unknown() -> None:
    fix = nav_sat_fix(position(GGA.replace(",0.9,", ",,")), None, EPE, Header())
    assert (fix.position_covariance_type, set(fix.position_covariance)) == (0, {0.0})


# -- anything --------------------------------------------------------------------------------------


def a_line(chance: random.Random) -> bytes:
    """Noise, sentences, sentences with wrong characters, and nonsense with a checksum that holds."""
    body = chance.choice([GGA, RMC, VTG, GST])
    good = sentence(chance.choice(["GP", "GN", "GA", "PG", "PQ", "P,", ",,", "\x7f1"]) + body[2:])
    fields = good[1:-3].split(",")
    fields[chance.randrange(1, len(fields))] = chance.choice(
        ["", "nan", "-1", "1e400", "9" * 30, "N", "4", "\u00e9".encode().decode("latin-1"), "0x10", "12.5", "--"]
    )
    text = ",".join(fields)
    nonsense = b"$" + text.encode("latin-1") + b"*%02X" % checksum(text.encode("latin-1"))
    cut = good.encode()[: chance.randrange(len(good))]
    at = chance.randrange(len(good))
    wrong = good.encode()[:at] + chance.randbytes(1) + good.encode()[at + 1 :]
    noise = chance.randbytes(chance.randrange(300))
    return chance.choice([good.encode(), nonsense, cut, wrong, noise]) + chance.choice([b"\r\n", b"\n", b""])


def believable(said: object, receiver: Receiver) -> None:
    match said:
        case Position(quality=0):
            assert math.isnan(said.latitude)
        case Position():
            assert -90 <= said.latitude <= 90
            assert -180 <= said.longitude <= 180
            fix = nav_sat_fix(said, receiver.errors, EPE, Header())
            assert all(map(math.isfinite, fix.position_covariance))
        case Velocity():
            assert math.hypot(*said) <= 600.1


def test_10_000_random_streams_break_nothing_and_only_what_has_its_checksum_is_taken() -> None:
    chance = random.Random(19)
    taken = 0
    for _ in range(10_000):
        lines, receiver = NmeaLines(), Receiver()
        stream = b"".join(a_line(chance) for _ in range(chance.randrange(6)))
        piece = chance.choice([1, 17, 4096])
        for begin in range(0, len(stream), piece):
            for one in lines.feed(stream[begin : begin + piece]):
                taken += 1
                assert one.encode() in stream
                assert checksum(one[1:-3].encode()) == int(one[-2:], 16)
                try:
                    for said in receiver.take(one):
                        believable(said, receiver)
                except Unreadable:
                    pass
            assert len(lines._rest) <= MOST
            assert len(lines.last_unread) <= MOST
    assert taken > 5_000


def test_pynmea2_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pynmea2", None)
    with pytest.raises(RunError, match=r"needs pynmea2, which is not installed: pip install 'robo-zenoh\[gps\]'"):
        Receiver()
