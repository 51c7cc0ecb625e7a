"""Drivers of sensors as processes: an emulated lidar, a GPS and a camera of files."""

import math
from pathlib import Path

import pytest

from robo.testing import Launch
from robo_messages import LaserScan, Trigger
from robo_services.nmea import checksum

pytestmark = pytest.mark.timeout(300)

MANIFEST = """
groups:
  sensors:
    namespace: ${robot_name}
    nodes:
      emulated_lidar: {service: robo_services.emulated_lidar, params: {port: ./lidar, range_noise: 0.0, garbled: 0.01}}
      ld_lidar: {service: robo_services.ld_lidar, params: {port: ./lidar}}
      nmea_gps: {service: robo_services.nmea_gps, params: {port: ./drive.nmea, loop: true}}
"""


def test_a_lidar_is_unplugged_and_comes_back_beside_a_gps(launch: Launch, tmp_path: Path) -> None:
    pytest.importorskip("serial", reason="the extra serial is not installed")
    pytest.importorskip("pynmea2", reason="the extra gps is not installed")
    body = b"GPGGA,120001.00,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"
    (tmp_path / "drive.nmea").write_bytes(b"$%s*%02X\r\n" % (body, checksum(body)))
    (tmp_path / "sensors.yaml").write_text(MANIFEST)
    robot = launch("sensors.yaml", folder=tmp_path)

    def is_room(scan: LaserScan) -> bool:
        measured = [distance for distance in scan.ranges if not math.isnan(distance)]
        return len(measured) > 300 and 4.99 < min(measured) <= max(measured) < 5.01 * math.sqrt(2)

    assert robot.wait_for("scan", is_room).scan_time == pytest.approx(0.1, rel=0.05)
    assert robot.wait_for("fix", lambda fix: fix.status.status == 0).latitude == pytest.approx(48 + 7.038 / 60)
    assert robot.call("emulated_lidar/unplug", Trigger.Request()).success
    robot.wait_until("ld_lidar", lambda process: process.health == "error")
    robot.clear()
    assert robot.call("emulated_lidar/replug", Trigger.Request()).success
    robot.wait_for("scan", is_room)
    robot.wait_until("ld_lidar", lambda process: process.health == "ok")
    assert robot.process("ld_lidar").restarts == 0


VIEWER = '''
import math
import time

from robo import MessageInfo, Node, Publisher, subscribe, timer
from robo_messages import Image, String


class Viewer(Node):
    """Say how many pictures have come, how many were sent, and how long none came at most."""

    told = Publisher(String, "seen")

    def on_start(self) -> None:
        self.first = self.last = self.came = 0
        self.seen, self.longest = math.inf, 0.0

    @subscribe("image_raw", depth=10)
    def on_image(self, image: Image, info: MessageInfo) -> None:
        self.last = info.sequence_number
        self.first = self.first or self.last
        self.came += 1
        now = time.monotonic()
        self.seen, self.longest = now, max(self.longest, now - self.seen)

    @timer(rate=10.0)
    def tell(self) -> None:
        self.told.publish(String(f"{self.came} {self.last - self.first + 1} {self.longest}"))
'''

FILM = """
groups:
  eyes:
    namespace: ${robot_name}
    nodes:
      viewer: {service: "viewer:Viewer"}
      camera:
        service: robo_services.camera
        params: {source: ./film.avi, loop: true}
        needs: {viewer: ready}
"""


def test_a_film_of_640x480_at_30_hz_is_seen_whole_by_another_process(launch: Launch, tmp_path: Path) -> None:
    pytest.importorskip("av", reason="the extra camera is not installed: 100 MB")
    from tests.videos import make_video

    make_video(tmp_path / "film.avi", 90, size=(640, 480))
    (tmp_path / "viewer.py").write_text(VIEWER)
    (tmp_path / "film.yaml").write_text(FILM)
    robot = launch("film.yaml", folder=tmp_path)
    said = robot.wait_for("seen", lambda text: int(text.data.split()[0]) >= 150)
    came, sent, longest = map(float, said.data.split())
    assert came == sent or longest > 0.3, "only a reader that was held up loses one"
