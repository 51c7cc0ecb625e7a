"""Where pictures come from: a camera of Video4Linux, a video file, or a test picture; by PyAV, which brings FFmpeg.

PyAV rather than OpenCV: it has half the size (104 MB installed beside 226 MB with numpy, which OpenCV needs), hands out
JPEGs of a camera as they are, without decoding, and tells when each picture was taken.
"""

import errno
import importlib
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from typing import Any, NamedTuple

from robo.errors import RunError

TEST = "test"
"""The name of the test picture."""

MOST_PIXELS = 8192 * 8192
"""A picture with more is refused: a broken file may ask for all memory."""

POLL = 0.002
"""How often a camera is asked for its next picture, s: it is asked without waiting, so that a node can end."""

MOST_BROKEN = 100
"""Pictures in a row that cannot be decoded before a source is given up."""

OPENED_WITHIN = 5.0
"""A camera that shows nothing for this long after it was opened is given up, s."""

_NON_BLOCK = "+4"
"""FFmpeg's AVFMT_FLAG_NONBLOCK, which has no name as an option; a device is opened by it."""

_TABLES, _SCAN = b"\xff\xc4", b"\xff\xda"
"""What a JPEG has before its scan, unless a camera leaves it out."""


class SourceGone(OSError):
    """A source cannot be opened, was unplugged, or is broken; the message says why."""


class Picture(NamedTuple):
    """One picture."""

    time: float
    """When it was taken: of a file, s from its beginning; of a camera, s by the kernel's monotonic clock, or NaN."""
    frame: Any
    """A VideoFrame of PyAV's; None where only `jpeg` was asked for."""
    jpeg: bytes
    """The same as a JPEG, where the source has it so; else nothing."""
    width: int
    """Pixels."""
    height: int


class Wanted(NamedTuple):
    """What a camera or the test picture is asked for; a file is as it is."""

    width: int = 0
    """Pixels; 0 as the camera likes it."""
    height: int = 0
    rate: float = 0.0
    """Pictures per second; 0 as the camera likes it."""
    pixel_format: str = ""
    """As FFmpeg calls it, such as mjpeg or yuyv422; empty as the camera likes it."""

    def __str__(self) -> str:
        """What is asked for, in words; empty for nothing."""
        size = f"{self.width}x{self.height}" if self.width and self.height else ""
        rate = f"{self.rate:g} pictures a second" if self.rate else ""
        return ", ".join(filter(None, (size, rate, self.pixel_format)))


class Source:
    """A source that is open."""

    def __init__(self, place: str, wanted: Wanted) -> None:
        """Open it.

        Args:
            place: `test`, a device such as /dev/video0, or a file.
            wanted: see `Wanted`.

        Raises:
            SourceGone: it is not there, may not be read, or is no video.
            RunError: PyAV is not installed.
        """
        self._av = import_av()
        self.place, self.is_live = place, is_device(place)
        name, form, options = place, None, {"max_pixels": str(MOST_PIXELS)}
        if place == TEST:
            size = f"{wanted.width or 640}x{wanted.height or 480}"
            name, form = f"testsrc=size={size}:rate={_ratio(wanted.rate) or 30}", "lavfi"
        elif self.is_live:
            form = "v4l2"
            options |= _device_options(wanted)
        else:
            _check_file(place)
            name = f"file:{place}"  # else FFmpeg takes a name with a colon for a protocol
        try:
            timeout = OPENED_WITHIN if self.is_live else None
            self._container: Any = self._av.open(name, format=form, options=options, timeout=timeout)
        except (OSError, ValueError, self._av.FFmpegError) as error:
            asked = str(wanted) if self.is_live and getattr(error, "errno", None) == errno.EINVAL else ""
            what = f"{place} cannot give {asked}" if asked else place
            raise SourceGone(f"{what}: {_reason(error)}") from None
        streams = self._container.streams.video
        if not streams or streams[0].codec_context is None:
            self.close()
            raise SourceGone(f"{place} has {'pictures that nothing here can decode' if streams else 'no pictures'}")
        self._stream: Any = streams[0]
        self.rate = float(self._stream.average_rate or 0)
        """Pictures per second, as it says; 0 where it does not."""
        self.broken = 0
        """Pictures that could not be decoded."""
        self._broken_in_a_row = 0

    def pictures(self, wants_frame: Callable[[], bool], wait: Callable[[float], bool]) -> Iterator[Picture]:
        """Its pictures, in their order, to its end.

        Args:
            wants_frame: whether the next picture is needed as a frame; asked only where the source has it as a JPEG.
            wait: waits some s; False where it is time to stop.

        Raises:
            SourceGone: it was unplugged, or is broken.
        """
        has_jpegs = self._stream.codec_context.name == "mjpeg"
        for packet in self._packets(wait):
            jpeg = bytes(packet) if has_jpegs else b""
            jpeg = jpeg if _TABLES in jpeg.partition(_SCAN)[0] else b""
            if jpeg and not wants_frame():
                codec = self._stream.codec_context
                if self._is_sized(codec):
                    yield Picture(self._time(packet.pts), None, jpeg, codec.width, codec.height)
                continue
            for frame in filter(self._is_sized, self._decoded(packet)):
                yield Picture(self._time(frame.pts), frame, jpeg, frame.width, frame.height)

    def close(self) -> None:
        """Give it back."""
        with suppress(OSError, self._av.FFmpegError):
            self._container.close()

    def _packets(self, wait: Callable[[float], bool]) -> Iterator[Any]:
        while True:
            try:
                yield from self._container.demux(self._stream)
                return
            except BlockingIOError:  # nothing yet
                if not wait(POLL):
                    return
            except (OSError, ValueError, self._av.FFmpegError) as error:
                raise SourceGone(f"{self.place}: {_reason(error)}") from None

    def _decoded(self, packet: Any) -> list[Any]:
        try:
            frames = packet.decode()
        except (OSError, ValueError, self._av.FFmpegError) as error:
            self.broken += 1
            self._broken_in_a_row += 1
            if self._broken_in_a_row >= MOST_BROKEN:
                raise SourceGone(f"{self.place}: {_reason(error)}") from None
            return []
        if frames:
            self._broken_in_a_row = 0
        return list(frames)

    def _is_sized(self, picture: Any) -> bool:
        """Whether a picture has a size that it may have; counts it as broken where it has none."""
        fits: bool = 0 < picture.width * picture.height <= MOST_PIXELS
        self.broken += not fits
        return fits

    def _time(self, pts: int | None) -> float:
        return float(pts * self._stream.time_base) if pts is not None else float("nan")


def is_device(place: str) -> bool:
    """Whether a place is a camera's, or would be if it were plugged in."""
    try:
        return stat.S_ISCHR(os.stat(place).st_mode)
    except (OSError, ValueError):
        return place.startswith("/dev/")


def _check_file(place: str) -> None:
    try:
        mode = os.stat(place).st_mode
    except (OSError, ValueError) as error:
        raise SourceGone(f"{place}: {_reason(error)}") from None
    if not stat.S_ISREG(mode):
        raise SourceGone(f"{place} is no file")


def _ratio(rate: float) -> Fraction:
    """A rate as FFmpeg takes it; 0 is none."""
    if 0.0 < rate < 1.0:
        return 1 / Fraction(1.0 / rate).limit_denominator(1001)
    return Fraction(rate).limit_denominator(1001)


def _device_options(wanted: Wanted) -> dict[str, str]:
    options = {"fflags": _NON_BLOCK}
    if wanted.width and wanted.height:
        options["video_size"] = f"{wanted.width}x{wanted.height}"
    if _ratio(wanted.rate):
        options["framerate"] = str(_ratio(wanted.rate))
    if wanted.pixel_format:
        options["input_format"] = wanted.pixel_format
    return options


def import_av() -> Any:
    """The module of PyAV, which says nothing by itself.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        av = importlib.import_module("av")
    except ImportError:
        raise RunError("pictures need PyAV, which is not installed: pip install 'robo-zenoh[camera]'") from None
    importlib.import_module("av.logging").set_level(None)
    return av


def _reason(error: Exception) -> str:
    """Why, and what to do where there is something."""
    reason = getattr(error, "strerror", None) or str(error)
    if isinstance(error, PermissionError):
        return f"{reason}; sudo usermod -aG video $USER, and log in again"
    return reason
