"""A lidar on a pseudo-terminal: the node that plays it, and the one that reads it."""

import math
import os
import random
import re
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robo import Node, ParameterError, Publisher
from robo.errors import RunError
from robo.testing.heard import Heard
from robo_messages import LaserScan, Odometry, Point, Pose, PoseWithCovariance, Trigger
from robo_services.emulated_lidar import EmulatedLidar
from robo_services.ld_lidar import STALE_AFTER, LdLidar
from robo_services.ld_packets import LENGTH, encode
from robo_services.pseudo_terminal import PseudoTerminal
from tests.support import PATIENCE, eventually
from tests.unit.test_ld_packets import a_stream, spoken

pytest.importorskip("serial", reason="the extra serial is not installed")

WORLD = """\
walls: [[-3, -3, 3, -3], [3, -3, 3, 3], [3, 3, -3, 3], [-3, 3, -3, -3]]
circles: [{center: [0, 1], radius: 0.2}]
"""


@pytest.fixture
def heard(robo_session: zenoh.Session) -> Iterator[Heard]:
    found = Heard(robo_session, "**")
    yield found
    found.close()


@pytest.fixture
def port(tmp_path: Path) -> Path:
    return tmp_path / "lidar"


def emulated(session: zenoh.Session, port: Path, **parameters: Any) -> EmulatedLidar:
    world = port.with_name("world.yaml")
    world.write_text(WORLD)
    values = {"port": str(port), "world": str(world), "range_noise": 0.0, **parameters}
    return EmulatedLidar(session=session, parameters=values)


def driver(session: zenoh.Session, port: Path, **parameters: Any) -> LdLidar:
    return LdLidar(session=session, parameters={"port": str(port), **parameters})


@pytest.fixture
def deaf(robo_session: zenoh.Session, port: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LdLidar]:
    """A driver that reads nothing by itself: what has come is said by the test."""
    monkeypatch.setattr(LdLidar, "main", lambda node: node.sleep(1e6))
    with driver(robo_session, port) as node:
        node._opened("port")
        yield node


def whole(scan: LaserScan) -> bool:
    return not any(map(math.isnan, scan.ranges))


def seen_at(scan: LaserScan, angle: float) -> float:
    """The range at an angle, counter-clockwise from the front, rad."""
    return scan.ranges[round((angle - scan.angle_min) / scan.angle_increment) % len(scan.ranges)]


def check_of(node: LdLidar) -> tuple[int, str]:
    health = node.is_heard()
    return health.level, health.message


def test_what_stands_in_the_world_is_where_it_is(robo_session: zenoh.Session, port: Path, heard: Heard) -> None:
    with emulated(robo_session, port), driver(robo_session, port, frame_id="laser") as node:
        scan: LaserScan = heard.wait_for("scan", whole, PATIENCE)
        assert seen_at(scan, 0.0) == pytest.approx(3.0, abs=0.01)
        assert seen_at(scan, math.pi / 2) == pytest.approx(0.8, abs=0.01), "the circle is to the left"
        assert seen_at(scan, -math.pi / 2) == pytest.approx(3.0, abs=0.01)
        assert seen_at(scan, math.pi / 4) == pytest.approx(3.0 * math.sqrt(2), abs=0.06)
        assert scan.header.frame_id == "laser"
        assert scan.scan_time == pytest.approx(0.1, rel=0.02)
        assert len(scan.ranges) == len(scan.intensities) == 360
        assert 0.0 <= node.now().to_seconds() - scan.header.stamp.to_seconds() < PATIENCE
        assert node._decoder.crc_faults == 0
        assert check_of(node) == (0, "")


def test_of_one_that_hangs_upside_down_left_and_right_are_changed_back(
    robo_session: zenoh.Session, port: Path, heard: Heard
) -> None:
    with emulated(robo_session, port), driver(robo_session, port, inverted=True):
        scan: LaserScan = heard.wait_for("scan", whole, PATIENCE)
        assert seen_at(scan, -math.pi / 2) == pytest.approx(0.8, abs=0.01), (
            "an emulated one that stands upright, so it is the other way round"
        )
        assert scan.time_increment > 0.0


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"range_min": 5.0, "range_max": 5.0}, "range_min = 5 has to be less than range_max = 5"),
        ({"range_max": 0.5}, "range_max"),
        ({"rays": 35}, "rays"),
    ],
)
def test_a_lidar_that_sees_nothing_is_refused(
    robo_session: zenoh.Session, port: Path, values: dict[str, Any], text: str
) -> None:
    with pytest.raises(ParameterError, match=text):
        driver(robo_session, port, **values)


class Mover(Node):
    """Says where the base is."""

    moves = Publisher(Odometry, "ground_truth")


def test_it_moves_as_the_odometry_says_that_it_follows(robo_session: zenoh.Session, port: Path, heard: Heard) -> None:
    lidar = emulated(robo_session, port, follow="ground_truth")
    with lidar, driver(robo_session, port), Mover(session=robo_session) as mover:
        heard.wait_for("scan", lambda scan: seen_at(scan, 0.0) == pytest.approx(3.0, abs=0.01), PATIENCE)
        eventually(lambda: mover.moves.has_subscribers, "it listens")
        mover.moves.publish(Odometry(pose=PoseWithCovariance(Pose(Point(1.0, 0.0)))))
        heard.wait_for("scan", lambda scan: seen_at(scan, 0.0) == pytest.approx(2.0, abs=0.01), PATIENCE)


def test_garbled_packets_are_counted_and_leave_only_holes(
    robo_session: zenoh.Session, port: Path, heard: Heard, caplog: pytest.LogCaptureFixture
) -> None:
    with emulated(robo_session, port, garbled=0.05, lost=0.05), driver(robo_session, port) as node:
        eventually(lambda: node._decoder.crc_faults >= 10, "checksums are wrong")
        heard.wait_for_count("scan", 5, PATIENCE)
        for scan in heard.messages("scan"):
            measured = [distance for distance in scan.ranges if not math.isnan(distance)]
            assert len(measured) > 180
            assert 0.79 < min(measured) <= max(measured) < 3.01 * math.sqrt(2), "no wrong range"
        eventually(lambda: any("were no packet" in message for message in caplog.messages), "it is said, with bytes")


def test_a_cable_that_garbles_much_is_a_warning(deaf: LdLidar) -> None:
    chance = random.Random(19)
    packets = [bytearray(encode(packet)) for packet in spoken(30.0)]
    for packet in packets:
        packet[20] ^= chance.random() < 0.15
    later = deaf.clock.wall.monotonic() + 1000.0  # and no silence meanwhile
    assert check_of(deaf) == (0, "")
    deaf._take(b"".join(packets), later)
    level, message = check_of(deaf)
    assert level == 1
    assert re.fullmatch(r"1\d% of what it says cannot be read: look at the cable", message)
    deaf._take(b"".join(map(encode, spoken(30.0))), later)
    assert check_of(deaf) == (0, "")


def test_10_000_random_streams_break_no_driver(deaf: LdLidar, monkeypatch: pytest.MonkeyPatch) -> None:
    chance, number = random.Random(23), 0
    told: list[LaserScan] = []
    monkeypatch.setattr(deaf.scans, "publish", lambda scan, _age: told.append(scan))
    whole_turns = b"".join(map(encode, spoken(2.2)))
    for n in range(10_000):
        deaf._take(a_stream(chance) + (whole_turns if n % 100 == 0 else b""), deaf.clock.wall.monotonic())
        for scan in told:
            assert all(not each < 0.02 or each == -math.inf for each in scan.ranges)
            assert all(not each > 12.0 or each == math.inf for each in scan.ranges)
        number += len(told)
        told.clear()
        assert len(deaf._decoder._rest) < LENGTH
    assert number >= 100
    assert deaf._decoder.crc_faults > 1_000


def test_an_unplug_is_said_and_a_replug_goes_on(
    robo_session: zenoh.Session, port: Path, heard: Heard, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "robo.node")
    with emulated(robo_session, port) as lidar, driver(robo_session, port) as node:
        heard.wait_for_count("scan", 1, PATIENCE)
        lidar.unplug(Trigger.Request())
        eventually(lambda: any(message.startswith("the port is gone") for message in caplog.messages), "it is said")
        eventually(lambda: check_of(node)[0] == 2, "its check says so")
        assert check_of(node)[1].startswith("no port: ")
        assert not port.is_symlink()
        heard.clear()
        lidar.replug(Trigger.Request())
        heard.wait_for("scan", whole, PATIENCE)
        eventually(lambda: check_of(node) == (0, ""), "all is well")


def test_a_port_that_is_not_there_is_said_once_and_waited_for(
    robo_session: zenoh.Session,
    port: Path,
    heard: Heard,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("robo_services.serial_feed.RETRY", 0.02)
    with driver(robo_session, port):
        text = f"no port: {port}: No such file or directory; it is waited for"
        eventually(lambda: text in caplog.messages, "it is said")
        with emulated(robo_session, port):
            heard.wait_for("scan", whole, PATIENCE)
            assert caplog.messages.count(text) == 1


def test_what_was_said_while_the_driver_was_held_up_is_left_out(
    robo_session: zenoh.Session, port: Path, heard: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = PseudoTerminal(port)
    far, near = (b"".join(map(encode, spoken(4.0, distance=distance))) for distance in (5.0, 0.4))
    is_held, released = threading.Event(), threading.Event()

    def hold(chunk: bytes, read_at: float) -> None:
        is_held.set()
        assert released.wait(PATIENCE)
        taken(chunk, read_at)

    def say(what: bytes) -> bool:
        terminal.write(what)  # four turns: less than a port takes
        return bool(heard.messages("scan"))

    try:
        with driver(robo_session, port) as node:
            eventually(lambda: say(far), "it sees")
            taken = node._take
            monkeypatch.setattr(node, "_take", hold)
            eventually(lambda: say(far) and is_held.is_set(), "it is held up")
            while terminal.write(far):
                pass
            begin = node.clock.wall.monotonic()
            eventually(lambda: node.clock.wall.monotonic() - begin > STALE_AFTER, "time passes")
            released.set()
            eventually(lambda: node._held_up > 0, "it notices")
            heard.clear()  # what was read before that says itself how old it is
            eventually(lambda: say(near), "it sees again")
            assert {distance for scan in heard.messages("scan") for distance in scan.ranges} == {0.4}
    finally:
        terminal.unplug()


def test_a_scan_that_is_published_late_says_so(deaf: LdLidar, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[LaserScan, float]] = []
    monkeypatch.setattr(deaf.scans, "publish", lambda scan, age=0.0: told.append((scan, age)))
    deaf._take(b"".join(map(encode, spoken(2.2))), deaf.clock.wall.monotonic() - 2.0)
    ((scan, age),) = told
    assert 2.01 < age < PATIENCE, "the turn had ended before the last packet"
    assert deaf.now().to_seconds() - scan.header.stamp.to_seconds() >= age


def test_what_is_no_lidar_is_said_with_its_bytes(
    robo_session: zenoh.Session, port: Path, caplog: pytest.LogCaptureFixture
) -> None:
    other = PseudoTerminal(port)
    try:
        with driver(robo_session, port):

            def is_said() -> bool:
                other.write(b"$GPGGA,123519,4807.038,N*47\r\n" * 40)  # what comes before it is open is lost
                return any("were no packet" in message and "(47 bytes)" in message for message in caplog.messages)

            eventually(is_said, "it is said")
    finally:
        other.unplug()


def test_a_port_that_another_one_has_open_is_left_alone(
    robo_session: zenoh.Session, port: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with emulated(robo_session, port), driver(robo_session, port):
        second = LdLidar(session=robo_session, name="second", parameters={"port": str(port)})
        with second:
            eventually(lambda: any("another program has it open" in message for message in caplog.messages), "it waits")


def test_it_ends_at_once_while_nothing_comes(robo_session: zenoh.Session, port: Path) -> None:
    silent = PseudoTerminal(port)
    try:
        with driver(robo_session, port):
            pass
    finally:
        silent.unplug()


def test_pyserial_that_is_not_installed_is_said_at_the_start(
    robo_session: zenoh.Session, port: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(RunError, match=r"robo-zenoh\[serial\]"):
        driver(robo_session, port).start()


def test_a_link_that_a_process_has_left_is_replaced_and_a_file_is_not(tmp_path: Path) -> None:
    link = tmp_path / "port"
    link.symlink_to("/dev/pts/no_such")
    terminal = PseudoTerminal(link)
    assert os.readlink(link) == terminal.path
    terminal.unplug()
    assert not link.is_symlink()
    link.write_text("a file")
    with pytest.raises(FileExistsError):
        PseudoTerminal(link)
    assert link.read_text() == "a file"
