"""The node camera: files, the test picture, a camera that is not there; plain pictures and JPEGs."""

import math
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robo import Node, ParameterError, subscribe
from robo.errors import RunError
from robo_messages import CameraInfo, CompressedImage, Image, Time
from robo_services.camera import Camera, _before
from robo_services.camera_info import CalibrationError
from tests.support import PATIENCE, eventually
from tests.unit.test_camera_info import CALIBRATION
from tests.videos import PluggedIn, brightness, make_video

pytest.importorskip("av", reason="the extra camera is not installed: 100 MB")


class Viewer(Node):
    """Keeps up with what it sees."""

    def on_start(self) -> None:
        self.images: list[Image] = []
        self.jpegs: list[CompressedImage] = []
        self.infos: list[CameraInfo] = []

    @subscribe("camera_info", latched=True)
    def on_info(self, info: CameraInfo) -> None:
        self.infos.append(info)


class PlainViewer(Viewer):
    @subscribe("image_raw", depth=10)
    def on_image(self, image: Image) -> None:
        self.images.append(image)


class JpegViewer(Viewer):
    @subscribe("image_raw/compressed", depth=10)
    def on_jpeg(self, image: CompressedImage) -> None:
        self.jpegs.append(image)


def camera(session: zenoh.Session, source: str | Path, **parameters: Any) -> Camera:
    return Camera(session=session, parameters={"source": str(source), **parameters})


def test_a_file_is_seen_whole_and_the_node_ends_with_it(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "robo.node")
    film = make_video(tmp_path / "a.avi", 60, size=(320, 240))
    with PlainViewer(session=robo_session) as viewer, camera(robo_session, film, frame_id="eye") as node:
        begin = node.clock.wall.monotonic()
        assert node.wait(PATIENCE)
        took = node.clock.wall.monotonic() - begin
        eventually(lambda: len(viewer.images) == 60, "each picture")
        assert viewer.status.dropped == {} or not any(viewer.status.dropped.values())
        eventually(lambda: len(viewer.infos) == 1, "its size is told once")
    assert took > 1.8, "as fast as it was recorded"
    for number, image in enumerate(viewer.images):
        assert (image.width, image.height, image.encoding, image.header.frame_id) == (320, 240, "rgb8", "eye")
        assert abs(image.data[120 * image.step + 480] - brightness(number)) <= 4
    info = viewer.infos[0]
    assert (info.width, info.height, info.k[0], info.header.frame_id) == (320, 240, 0.0, "eye")
    assert f"told 60 pictures of {film}" in caplog.messages


def test_jpegs_alone_are_passed_on_and_nothing_is_decoded(robo_session: zenoh.Session, tmp_path: Path) -> None:
    film = make_video(tmp_path / "a.avi", 10)
    with JpegViewer(session=robo_session) as viewer, camera(robo_session, film) as node:
        assert node.wait(PATIENCE)
        eventually(lambda: len(viewer.jpegs) == 10, "each picture")
        assert node.status.published.get("image_raw", 0) == 0
        assert node.images.published == 0
    assert {image.format for image in viewer.jpegs} == {"jpeg"}
    assert bytes(viewer.jpegs[0].data) in film.read_bytes()


def test_jpegs_are_made_where_the_source_has_none(robo_session: zenoh.Session) -> None:
    parameters = {"image_width": 320, "image_height": 240}
    with JpegViewer(session=robo_session) as viewer, camera(robo_session, "test", **parameters):
        eventually(lambda: len(viewer.jpegs) >= 3, "pictures")
        assert bytes(viewer.jpegs[0].data[:2]) == b"\xff\xd8"
        eventually(lambda: [(info.width, info.height) for info in viewer.infos] == [(320, 240)], "their size")


def test_nothing_is_made_while_nobody_listens(robo_session: zenoh.Session) -> None:
    with camera(robo_session, "test", framerate=100.0) as node:
        eventually(lambda: node._count > 10, "it plays")
        assert node.images.published == node.jpegs.published == 0


def test_a_file_is_played_again_and_again(robo_session: zenoh.Session, tmp_path: Path) -> None:
    film = make_video(tmp_path / "a.avi", 5, rate=100)
    with PlainViewer(session=robo_session) as viewer, camera(robo_session, film, loop=True):
        eventually(lambda: len(viewer.images) > 12, "more pictures than the file has")


def test_a_camera_that_is_not_there_is_said_once_and_waited_for(
    robo_session: zenoh.Session, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo_services.camera.RETRY", 0.02)
    with camera(robo_session, "/dev/video_none") as node:
        text = "no camera: /dev/video_none: No such file or directory; it is waited for"
        eventually(lambda: text in caplog.messages, "it is said")
        health = node.pictures_come()
        assert (health.level, health.message) == (2, text.partition(";")[0])
    assert caplog.messages.count(text) == 1


def test_what_a_camera_loses_is_told_and_one_that_is_unplugged_comes_back(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo_services.camera.RETRY", 0.02)
    film = make_video(tmp_path / "a.avi", 10)
    now = time.monotonic()
    plugged_in = PluggedIn(film, since=now - 0.4, skips=(5, 6))
    monkeypatch.setattr("robo_services.camera_source.import_av", lambda: plugged_in)
    with PlainViewer(session=robo_session) as viewer, camera(robo_session, "/dev/video7") as node:
        eventually(lambda: len(plugged_in.asked) > 2, "it comes back")
        eventually(lambda: len(viewer.images) > 7, "pictures of both")
        eventually(lambda: node._lost >= 2, "it is counted")
    assert "the source is gone: /dev/video7: No such device" in caplog.messages
    assert "2 pictures were lost between camera and node so far" in caplog.messages


def test_a_camera_is_seen_where_simulated_time_stands_still(
    robo_session: zenoh.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo_services.camera.RETRY", 0.02)
    plugged_in = PluggedIn(make_video(tmp_path / "a.avi", 10), since=time.monotonic())
    monkeypatch.setattr("robo_services.camera_source.import_av", lambda: plugged_in)
    with camera(robo_session, "/dev/video7", use_sim_time=True) as node:
        eventually(lambda: len(plugged_in.asked) > 1, "all were seen, and it was looked for again")
        assert node._count >= 9


def test_half_a_size_is_refused(robo_session: zenoh.Session) -> None:
    for half in ("image_width", "image_height"):
        with pytest.raises(ParameterError, match="image_width and image_height are asked for together"):
            camera(robo_session, "test", **{half: 640})


def test_a_picture_is_stamped_with_when_it_was_taken() -> None:
    now = Time(100, 0)
    assert _before(now, 0.25) == Time(99, 750_000_000)
    for unknown in (math.nan, -1.0, 50.0, math.inf):
        assert _before(now, unknown) == now


def test_a_file_that_is_not_there_or_no_video_is_said_at_the_start(robo_session: zenoh.Session, tmp_path: Path) -> None:
    (tmp_path / "no_video").write_text("hello")
    for name, text in (("none.mp4", "No such file"), ("no_video", "Invalid data")):
        with pytest.raises(ParameterError, match=text):
            camera(robo_session, tmp_path / name).start()


def test_a_calibration_is_told_and_one_of_another_size_warned_of(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "calibration.yaml"
    file.write_text(CALIBRATION)
    for size, level in (((640, 480), 0), ((320, 240), 1)):
        parameters = {"image_width": size[0], "image_height": size[1], "camera_info_url": file.as_uri()}
        with Viewer(session=robo_session) as viewer, camera(robo_session, "test", **parameters) as node:
            eventually(lambda viewer=viewer: bool(viewer.infos), "it is told")  # type: ignore[misc]
            assert (viewer.infos[0].k[0], viewer.infos[0].width) == (500.5, 640)
            assert node.pictures_come().level == level
    assert "pictures are 320x240 and the calibration is for 640x480" in caplog.messages
    with pytest.raises(CalibrationError):
        camera(robo_session, "test", camera_info_url=str(tmp_path / "none.yaml")).start()


def test_a_file_of_which_a_part_is_broken_is_played_as_far_as_it_goes(
    robo_session: zenoh.Session, tmp_path: Path
) -> None:
    film = make_video(tmp_path / "a.avi", 30, rate=100)
    data = bytearray(film.read_bytes())
    data[len(data) // 3 : len(data) // 2] = b"\0" * (len(data) // 2 - len(data) // 3)
    film.write_bytes(data)
    with PlainViewer(session=robo_session) as viewer, camera(robo_session, film) as node:
        assert node.wait(PATIENCE)
        assert node.exit_code == 0
    assert 0 < len(viewer.images) < 30


def test_pyav_that_is_not_installed_is_said_at_the_start(
    robo_session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(RunError, match=r"robo-zenoh\[camera\]"):
        camera(robo_session, "test").start()
