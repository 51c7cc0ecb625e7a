"""Pictures of files and of the test picture, and when they are due."""

import errno
import math
import os
import random
import sys
import wave
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import pytest

from robo.errors import RunError
from robo_messages import Header
from robo_services.camera_source import TEST, Picture, Source, SourceGone, Wanted, import_av
from robo_services.pictures import Gaps, JpegEncoder, Pace, Rate, image_of
from tests.videos import PluggedIn, brightness, make_video

needs_av = pytest.mark.skipif("not __import__('importlib.util').util.find_spec('av')", reason="no extra camera")


BROKEN = int(os.environ.get("BROKEN_VIDEOS", "1000"))
"""How many files are broken; 10,000 take a minute."""


def played(source: Source, *, frames: bool = True) -> list[Picture]:
    try:
        return list(source.pictures(lambda: frames, lambda _: False))
    finally:
        source.close()


# -- sources ---------------------------------------------------------------------------------------


@needs_av
@pytest.mark.parametrize(("name", "codec"), [("a.avi", "mjpeg"), ("a.mp4", "mpeg4"), ("a:b.avi", "mjpeg")])
def test_each_picture_of_a_file_comes_once_and_as_it_is(tmp_path: Path, name: str, codec: str) -> None:
    source = Source(str(make_video(tmp_path / name, 20, codec=codec)), Wanted())
    assert (source.rate, source.is_live) == (30.0, False)
    found = played(source)
    assert [picture.time for picture in found] == pytest.approx([n / 30 for n in range(20)], abs=1e-3)
    for number, picture in enumerate(found):
        image = image_of(picture.frame, "rgb8", Header(frame_id="camera"))
        assert (image.width, image.height, image.encoding, len(image.data)) == (64, 48, "rgb8", 48 * image.step)
        middle = image.data[24 * image.step + 96]
        assert abs(middle - brightness(number)) <= 12


@needs_av
def test_jpegs_of_a_source_are_passed_on_without_decoding(tmp_path: Path) -> None:
    found = played(Source(str(make_video(tmp_path / "a.avi", 3)), Wanted()), frames=False)
    assert [picture.frame for picture in found] == [None] * 3
    assert all(
        picture.jpeg.startswith(b"\xff\xd8") and picture.jpeg.rstrip(b"\0").endswith(b"\xff\xd9") for picture in found
    )
    assert (found[0].width, found[0].height) == (64, 48)


@needs_av
def test_the_test_picture_moves() -> None:
    source = Source(TEST, Wanted(320, 240, 15.0))
    found = list(islice(source.pictures(lambda: True, lambda _: True), 16))
    source.close()
    assert [picture.time for picture in found] == pytest.approx([n / 15 for n in range(16)])
    first, last = (bytes(image_of(found[n].frame, "rgb8", Header()).data) for n in (0, 15))
    assert len(first) == 320 * 240 * 3
    assert first != last


@needs_av
@pytest.mark.parametrize(
    ("encoding", "bytes_of_pixel", "red"), [("rgb8", 3, (255, 0, 0)), ("bgr8", 3, (0, 0, 255)), ("mono8", 1, (76,))]
)
def test_encodings(encoding: str, bytes_of_pixel: int, red: tuple[int, ...]) -> None:
    frame = import_av().VideoFrame(62, 4, "rgb24")
    plane = frame.planes[0]
    plane.update((b"\xff\0\0" * 62).ljust(plane.line_size, b"\0") * 4)
    image = image_of(frame, encoding, Header())  # type: ignore[arg-type]
    assert image.array.shape[:2] == (4, 62)
    assert tuple(image.data[:bytes_of_pixel]) == pytest.approx(red, abs=1)
    assert tuple(image.data[image.step : image.step + bytes_of_pixel]) == pytest.approx(red, abs=1), (
        "rows may be longer"
    )


@needs_av
def test_jpegs_are_as_large_as_their_quality() -> None:
    source = Source(TEST, Wanted())
    (picture,) = islice(source.pictures(lambda: True, lambda _: True), 1)
    encoder = JpegEncoder(import_av())
    sizes = [len(encoder.encode(picture.frame, quality)) for quality in (1, 50, 80, 100, 80)]
    source.close()
    assert sizes[0] < sizes[1] < sizes[2] < sizes[3]
    assert sizes[2] == sizes[4]


@needs_av
@pytest.mark.parametrize(("name", "codec"), [("a.avi", "mjpeg"), ("a.mp4", "mpeg4")])
def test_each_picture_of_a_film_becomes_a_jpeg(tmp_path: Path, name: str, codec: str) -> None:
    found = played(Source(str(make_video(tmp_path / name, 20, codec=codec)), Wanted()))
    encoder = JpegEncoder(import_av())
    jpegs = [encoder.encode(picture.frame, 80) for picture in found]
    (tmp_path / "again.mjpeg").write_bytes(b"".join(jpegs))
    again = played(Source(str(tmp_path / "again.mjpeg"), Wanted()))
    grey = [image_of(picture.frame, "mono8", Header()).data[2000] for picture in again]
    assert grey == pytest.approx([brightness(number) for number in range(20)], abs=16)


@needs_av
@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("/dev/no_video", "No such file or directory"),
        ("/dev/null", "Inappropriate ioctl"),
        ("none.mp4", "No such file or directory"),
        (".", "is no file"),
        ("a\0b", "null"),
        ("http://127.0.0.1/a.mp4", "No such file or directory"),
        (__file__, "Invalid data"),
    ],
)
def test_what_cannot_be_opened_says_why(place: str, text: str) -> None:
    with pytest.raises(SourceGone, match=text):
        Source(place, Wanted())


def spoilt(whole: bytes, begin: int, chance: random.Random) -> bytes:
    """A file with wrong bytes, most of them behind its beginning; or without an end, or nothing but noise."""
    data = bytearray(whole)
    for _ in range(chance.randrange(1, 8)):
        data[chance.randrange(0 if chance.random() < 0.03 else begin, len(data))] = chance.randrange(256)
    if chance.random() < 0.1:
        del data[chance.randrange(len(data)) :]
    return bytes(data) if chance.random() < 0.98 else chance.randbytes(500)


@needs_av
@pytest.mark.parametrize(
    ("name", "codec", "pictures"), [("a.avi", "mjpeg", b"movi"), ("a.mp4", "libx264", b"mdat")], ids=["mjpeg", "h264"]
)
def test_broken_files_break_nothing(tmp_path: Path, name: str, codec: str, pictures: bytes) -> None:
    if codec not in import_av().codecs_available:
        pytest.skip(f"no {codec} is here to make a film with")
    chance, source = random.Random(19), tmp_path / f"broken{name[1:]}"
    whole = make_video(tmp_path / name, 2, codec=codec, size=(16, 16)).read_bytes()
    begin = whole.index(pictures)
    came = refused = 0
    for _ in range(BROKEN):
        source.write_bytes(spoilt(whole, begin, chance))
        try:
            for picture in played(Source(str(source), Wanted())):
                image = image_of(picture.frame, "rgb8", Header())
                assert len(image.data) == image.step * image.height <= 256 * 1024 * 1024
                came += 1
        except SourceGone:
            refused += 1
    assert came > BROKEN / 2
    assert refused > BROKEN / 100


@needs_av
def test_a_camera_is_asked_without_waiting_and_tells_that_it_was_unplugged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = PluggedIn(make_video(tmp_path / "a.avi", 5), 100.0)
    monkeypatch.setattr("robo_services.camera_source.import_av", lambda: camera)
    source = Source("/dev/video7", Wanted(64, 48, 30.0, "mjpeg"))
    asked = camera.asked[0]
    assert (asked["place"], asked["format"]) == ("/dev/video7", "v4l2")
    assert asked["options"].items() >= {"video_size": "64x48", "framerate": "30", "input_format": "mjpeg"}.items()
    waited: list[float] = []
    found: list[Picture] = []

    def wait(seconds: float) -> bool:
        waited.append(seconds)
        return True

    with pytest.raises(SourceGone, match="/dev/video7: No such device"):
        found.extend(source.pictures(lambda: False, wait))
    assert len(waited) == 1
    assert [picture.time for picture in found] == pytest.approx([100.0 + n / 30 for n in range(1, 5)], abs=1e-3)
    source.close()


class Refuses:
    """PyAV with a camera that does not open."""

    def __init__(self, number: int) -> None:
        self._av, self._number = import_av(), number

    def __getattr__(self, name: str) -> Any:
        return getattr(self._av, name)

    def open(self, place: str, **_: Any) -> Any:
        self._av.error.err_check(-self._number, place)


@needs_av
@pytest.mark.parametrize(
    ("wanted", "number", "text"),
    [
        (
            Wanted(641, 481, 7.5, "none"),
            errno.EINVAL,
            "/dev/video7 cannot give 641x481, 7.5 pictures a second, none: Inv",
        ),
        (Wanted(pixel_format="none"), errno.EINVAL, "/dev/video7 cannot give none: Invalid argument"),
        (Wanted(), errno.EINVAL, "/dev/video7: Invalid argument"),
        (Wanted(641, 481), errno.ENODEV, "/dev/video7: No such device"),
        (Wanted(641, 481), errno.EBUSY, "/dev/video7: Device or resource busy"),
    ],
)
def test_a_camera_that_cannot_give_what_is_asked_for_says_so(
    monkeypatch: pytest.MonkeyPatch, wanted: Wanted, number: int, text: str
) -> None:
    plugged_in = Refuses(number)
    monkeypatch.setattr("robo_services.camera_source.import_av", lambda: plugged_in)
    with pytest.raises(SourceGone) as error:
        Source("/dev/video7", wanted)
    assert str(error.value).startswith(text)


@needs_av
def test_a_file_without_pictures_is_closed(tmp_path: Path) -> None:
    place = tmp_path / "a.wav"
    with wave.open(str(place), "wb") as sound:
        sound.setparams((1, 1, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(8000))
    with pytest.raises(SourceGone, match="has no pictures"):
        Source(str(place), Wanted())
    assert str(place) not in {os.path.realpath(f"/proc/self/fd/{fd}") for fd in os.listdir("/proc/self/fd")}


@needs_av
@pytest.mark.parametrize("frames", [True, False])
def test_a_picture_that_is_too_large_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, frames: bool) -> None:
    source = Source(str(make_video(tmp_path / "a.avi", 5)), Wanted())
    monkeypatch.setattr("robo_services.camera_source.MOST_PIXELS", 1000)
    assert played(source, frames=frames) == []
    assert source.broken == 5


@needs_av
@pytest.mark.parametrize("rate", [0.0004, 0.5, 29.97, 30.0, 1000.0])
def test_any_rate_is_asked_for(rate: float) -> None:
    source = Source(TEST, Wanted(64, 48, rate))
    source.close()
    assert source.rate == pytest.approx(rate, rel=1e-6)


def test_pyav_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(RunError, match=r"need PyAV, which is not installed: pip install 'robo-zenoh\[camera\]'"):
        Source(TEST, Wanted())


# -- when they are due -----------------------------------------------------------------------------


def test_pictures_are_due_as_they_were_taken() -> None:
    pace = Pace(2.0, 30.0)
    assert pace.wait(5.0, 100.0) == 0.0, "the first one at once"
    assert pace.wait(6.0, 100.2) == pytest.approx(0.3)
    assert pace.wait(7.0, 101.1) == 0.0, "a little late: the next ones make up for it"
    assert pace.wait(8.0, 101.1) == pytest.approx(0.4)


def test_a_pause_is_not_made_up_for_and_a_leap_of_time_not_waited_for() -> None:
    pace = Pace(1.0, 30.0)
    pace.wait(0.0, 100.0)
    assert [pace.wait(1.0, 110.0), pace.wait(2.0, 110.0)] == pytest.approx([0.0, 1.0])
    assert [pace.wait(5000.0, 112.0), pace.wait(5001.0, 112.0)] == pytest.approx([0.0, 1.0])
    assert pace.slips == 1, "a leap is no pause"
    slow = Pace(1.0, 0.01)
    slow.wait(0.0, 0.0)
    assert slow.wait(100.0, 0.0) == pytest.approx(100.0)


def test_time_that_steps_back_is_not_waited_for() -> None:
    pace = Pace(1.0, 30.0)
    pace.wait(0.0, 1000.0)
    assert pace.wait(1 / 30, 5.0) == pytest.approx(0.0, abs=1 / 60)
    assert pace.wait(2 / 30, 5.0 + 1 / 60) == pytest.approx(1 / 60, abs=1 / 60)


def test_what_is_late_is_caught_up_with_at_twice_the_rate() -> None:
    pace = Pace(1.0, 30.0)
    pace.wait(0.0, 100.0)
    now, times = 100.9, []  # it was held up
    for number in range(1, 61):
        now += pace.wait(number / 30, now)
        times.append(now)
    gaps = [later - sooner for sooner, later in pairwise(times)]
    assert min(gaps) == pytest.approx(1 / 60)
    assert times[-1] == pytest.approx(102.0)
    assert pace.slips == 0


def test_a_gap_that_is_longer_than_usual_is_a_loss() -> None:
    gaps = Gaps()
    times = [n / 30 for n in (0, 1, 2, 3, 4, 7, 8, 9.2, 9.9, 11, 21)]
    assert [gaps.lost(time) for time in times] == [0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 9]
    assert [gaps.lost(time) for time in (math.nan, 2.0, 1.0, 1.0)] == [0] * 4


def test_a_camera_that_is_slower_for_a_while_loses_nothing() -> None:
    gaps, time, lost = Gaps(), 0.0, []
    for gap in [1 / 30] * 100 + [1 / 15] * 100 + [1 / 30] * 100:
        time += gap
        lost.append(gaps.lost(time))
    assert sum(lost) == sum(lost[100:106]), "nothing, once it is usual"
    assert sum(lost) <= 6


def test_a_rate_is_that_of_the_last_seconds() -> None:
    rate = Rate()
    assert rate.at(0.0) == 0.0
    for n in range(300):
        rate.take(n / 30)
    assert rate.at(10.0) == pytest.approx(30.0, rel=0.05)
    assert rate.at(11.0) == pytest.approx(15.0, rel=0.05)
    assert rate.at(100.0) == 0.0
