"""A receiver of satellites on a pseudo-terminal, or in a file, and the node that reads it."""

import itertools
import math
import random
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robo import ParameterError
from robo.errors import RunError
from robo.testing.heard import Heard
from robo_messages import NavSatFix
from robo_services.nmea import checksum
from robo_services.nmea_gps import SILENT_AFTER, NmeaGps
from robo_services.pseudo_terminal import PseudoTerminal
from tests.support import PATIENCE, eventually
from tests.unit.test_nmea import a_line

pytest.importorskip("serial", reason="the extra serial is not installed")
pytest.importorskip("pynmea2", reason="the extra gps is not installed")


def epoch(second: int, quality: int = 1) -> bytes:
    """What a receiver says in a second."""
    bodies = (
        f"GNGGA,1200{second:02}.00,4807.038,N,01131.000,E,{quality},08,0.9,545.4,M,46.9,M,,",
        f"GNRMC,1200{second:02}.00,A,4807.038,N,01131.000,E,010.0,090.0,230325,,,A",
    )
    return b"".join(b"$%s*%02X\r\n" % (body.encode(), checksum(body.encode())) for body in bodies)


@pytest.fixture
def heard(robo_session: zenoh.Session) -> Iterator[Heard]:
    found = Heard(robo_session, "**")
    yield found
    found.close()


@pytest.fixture
def receiver(tmp_path: Path) -> Iterator[PseudoTerminal]:
    terminal = PseudoTerminal(tmp_path / "gps")
    yield terminal
    terminal.unplug()


def gps(session: zenoh.Session, port: Path, **parameters: Any) -> NmeaGps:
    return NmeaGps(session=session, parameters={"port": str(port), **parameters})


@pytest.fixture
def deaf(robo_session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[NmeaGps]:
    """A driver that reads nothing by itself: what has come is said by the test."""
    monkeypatch.setattr(NmeaGps, "main", lambda node: node.sleep(1e6))
    with gps(robo_session, tmp_path / "gps") as node:
        node._opened("port")
        yield node


def levels(node: NmeaGps) -> tuple[int, str]:
    health = node.has_fix()
    return health.level, health.message


def test_a_port(robo_session: zenoh.Session, receiver: PseudoTerminal, tmp_path: Path, heard: Heard) -> None:
    with gps(robo_session, tmp_path / "gps", epe_quality1=2.0) as node:
        assert levels(node) == (1, "no position so far")

        def said() -> bool:
            receiver.write(b"\x00\xff" + epoch(1))  # what comes before the port is open is lost
            return bool(heard.messages("vel"))

        eventually(said, "a fix")
        fix: NavSatFix = heard.messages("fix")[0]
        assert (fix.header.frame_id, fix.status.status) == ("gps", 0)
        assert fix.latitude == pytest.approx(48 + 7.038 / 60)
        assert fix.position_covariance[0] == pytest.approx((0.9 * 2.0) ** 2)
        velocity = heard.messages("vel")[0].twist.linear
        assert (velocity.x, velocity.y) == pytest.approx((10 * 1852 / 3600, 0.0))
        reference = heard.wait_for("time_reference", lambda _: True, PATIENCE)
        assert (reference.time_ref.sec, reference.source) == (1_742_731_201, "gps")
        assert levels(node) == (0, "")
        receiver.write(epoch(2, quality=0))
        lost = heard.wait_for("fix", lambda fix: fix.status.status == -1, PATIENCE)
        assert math.isnan(lost.latitude)
        eventually(lambda: levels(node) == (1, "no fix, 8 satellites"), "its check says so")


def test_an_unplug_is_said_and_a_replug_goes_on(
    robo_session: zenoh.Session, tmp_path: Path, heard: Heard, caplog: pytest.LogCaptureFixture
) -> None:
    first = PseudoTerminal(tmp_path / "gps")
    caplog.set_level("INFO", "robo.node")
    with gps(robo_session, tmp_path / "gps") as node:
        eventually(lambda: any("listens to" in message for message in caplog.messages), "it is open")
        first.unplug()
        eventually(lambda: levels(node)[0] == 2, "its check says so")
        second = PseudoTerminal(tmp_path / "gps")
        try:
            eventually(lambda: bool(second.write(epoch(1)) and heard.messages("fix")), "a fix")
        finally:
            second.unplug()


def test_a_position_that_is_long_gone_and_one_of_before_an_unplug_are_no_position(deaf: NmeaGps) -> None:
    fix, move = epoch(1).splitlines(keepends=True)
    deaf._read(fix)
    assert levels(deaf) == (0, "")
    deaf._said -= SILENT_AFTER + 1.0
    deaf._read(move)
    assert levels(deaf) == (1, "the last position is 4 s old")
    deaf._opened("port")
    assert levels(deaf) == (1, "no position so far")
    for _ in range(4):
        deaf._read(move)
    assert levels(deaf) == (1, "no position so far: RMC comes and no GGA; start it with use_rmc:=true")


def test_10_000_random_streams_break_no_driver(deaf: NmeaGps, monkeypatch: pytest.MonkeyPatch) -> None:
    chance, number = random.Random(23), 0
    told: list[NavSatFix] = []
    monkeypatch.setattr(deaf.fixes, "publish", told.append)
    for topic in (deaf.velocities, deaf.times):
        monkeypatch.setattr(topic, "publish", lambda _: None)
    for _ in range(10_000):
        deaf._read(b"".join(a_line(chance) for _ in range(chance.randrange(6))))
        for fix in told:
            assert math.isnan(fix.latitude) if fix.status.status < 0 else -90 <= fix.latitude <= 90
        number += len(told)
        told.clear()
    assert number > 300
    assert deaf._impossible > 500
    assert deaf._lines.checksum_faults > 1_000


@pytest.mark.parametrize("name", ["drvie.nmea", "log.txt", "a.LOG"])
def test_a_file_that_is_not_there_is_not_waited_for(robo_session: zenoh.Session, tmp_path: Path, name: str) -> None:
    with pytest.raises(ParameterError, match="there is no such file"):
        gps(robo_session, tmp_path / name).start()


def test_a_link_is_a_port_whatever_its_name(robo_session: zenoh.Session, tmp_path: Path) -> None:
    (tmp_path / "gps.log").symlink_to("/dev/pts/no_such")
    with gps(robo_session, tmp_path / "gps.log") as node:
        eventually(lambda: levels(node)[1].startswith("no port: "), "it is waited for")


def test_what_cannot_be_read_is_said_and_counted(
    robo_session: zenoh.Session,
    receiver: PseudoTerminal,
    tmp_path: Path,
    heard: Heard,
    caplog: pytest.LogCaptureFixture,
) -> None:
    wrong = epoch(1).replace(b"4807", b"4808")
    body = b"GPGGA,120001,9107.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"
    impossible = b"$%s*%02X\r\n" % (body, checksum(body))
    with gps(robo_session, tmp_path / "gps"):

        def said() -> bool:
            receiver.write(wrong + impossible)
            texts = ("for a wrong checksum; the last one: 24 47 4e", "says what cannot be, '9107.038' 'N' is no place")
            return all(any(text in message for message in caplog.messages) for text in texts)

        eventually(said, "both are said")
    assert heard.messages("fix") == []


def test_a_file_is_played_and_the_node_ends_with_it(
    robo_session: zenoh.Session, tmp_path: Path, heard: Heard, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "robo.node")
    log = tmp_path / "log.nmea"
    log.write_bytes(b"".join(map(epoch, range(50)))[:-2])
    with gps(robo_session, log, playback_rate=0.0) as node:
        assert node.wait(PATIENCE)
        for topic in ("fix", "vel"):
            heard.wait_for_count(topic, 50, PATIENCE)
    assert len(heard.messages("fix")) == len(heard.messages("vel")) == 50
    assert f"played 100 sentences of {log}" in caplog.messages


def test_a_file_is_played_as_fast_as_it_was_written(robo_session: zenoh.Session, tmp_path: Path, heard: Heard) -> None:
    log = tmp_path / "log.nmea"
    log.write_bytes(b"".join(map(epoch, range(4))))
    with gps(robo_session, log, playback_rate=10.0) as node:
        begin = node.clock.wall.monotonic()
        assert node.wait(PATIENCE)
        assert node.clock.wall.monotonic() - begin > 0.2
    stamps = [fix.header.stamp.to_seconds() for fix in heard.messages("fix")]
    assert all(later - sooner > 0.09 for sooner, later in itertools.pairwise(stamps))


@pytest.mark.usefixtures("receiver")
def test_it_ends_at_once_while_a_file_waits_and_while_nothing_comes(
    robo_session: zenoh.Session, tmp_path: Path
) -> None:
    log = tmp_path / "log.nmea"
    log.write_bytes(epoch(0) + epoch(9))
    for place in (log, tmp_path / "gps"):
        with gps(robo_session, place, loop=True):
            pass


def test_a_library_that_is_not_installed_is_said_at_the_start(
    robo_session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pynmea2", None)
    with pytest.raises(RunError, match=r"robo-zenoh\[gps\]"):
        gps(robo_session, tmp_path / "gps").start()


def test_a_parameter_that_is_wrong_is_said(robo_session: zenoh.Session) -> None:
    with pytest.raises(ParameterError, match="baud"):
        NmeaGps(session=robo_session, parameters={"baud": 1})
