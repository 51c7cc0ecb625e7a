"""Pictures of PyAV's as messages: plain ones, and JPEGs; and when those of a file are due."""

import math
from collections import deque
from fractions import Fraction
from statistics import median
from typing import Any, Literal

from robo_messages import CompressedImage, Header, Image

Encoding = Literal["rgb8", "bgr8", "mono8"]

FORMATS = {"rgb8": "rgb24", "bgr8": "bgr24", "mono8": "gray"}
"""What FFmpeg calls the encodings of an Image."""


def image_of(frame: Any, encoding: Encoding, header: Header) -> Image:
    """A frame as a plain picture, whose bytes are the frame's own."""
    plain = frame.reformat(format=FORMATS[encoding])
    (plane,) = plain.planes
    rows, step = plain.height, plane.line_size
    data = memoryview(plane)[: rows * step]
    return Image(header, rows, plain.width, encoding, 0, step, data)


def jpeg_image(data: bytes, header: Header) -> CompressedImage:
    """A JPEG as a message."""
    return CompressedImage(header, "jpeg", memoryview(data))


TICK = Fraction(1, 1000)


class JpegEncoder:
    """Makes JPEGs of frames."""

    def __init__(self, av: Any) -> None:
        """`av`: PyAV."""
        self._av = av
        self._codec: Any = None
        self._number = 0
        self._made_for: tuple[int, int, int] | None = None

    def encode(self, frame: Any, quality: int) -> bytes:
        """A frame as a JPEG.

        Args:
            frame: of PyAV's.
            quality: 1 to 100.

        Raises:
            ValueError: FFmpeg cannot make one of it.
        """
        wanted = (frame.width, frame.height, quality)
        if self._made_for != wanted:
            self._codec = self._made(*wanted)
            self._made_for = wanted
        full = frame.reformat(format="yuvj420p")
        self._number += 1
        full.pts, full.time_base = self._number, TICK  # an encoder takes only what is later than what it had
        try:
            return b"".join(bytes(packet) for packet in self._codec.encode(full))
        except self._av.FFmpegError as error:
            self._made_for = None
            raise ValueError(str(error)) from None

    def _made(self, width: int, height: int, quality: int) -> Any:
        codec = self._av.CodecContext.create("mjpeg", "w")
        codec.width, codec.height, codec.pix_fmt = width, height, "yuvj420p"
        codec.time_base = TICK
        scale = round(31 - (quality - 1) * 29 / 99)  # FFmpeg's 2 is the best, 31 the worst
        codec.qmin = codec.qmax = scale
        codec.thread_count = 1  # else it holds pictures back
        return codec


class Pace:
    """When the pictures of a file are due."""

    SLIPPED = 1.0
    """A file that is played later than this goes on from there, s: no burst of pictures makes up for a pause."""
    LONGEST_GAP = 10.0
    """A longer gap between two pictures is not waited for, s, unless they are further apart anyway."""

    def __init__(self, speed: float, rate: float) -> None:
        """
        Args:
            speed: 1 as fast as it was recorded.
            rate: pictures per second, as the file says; 0 where it does not.
        """
        self._speed = speed
        self._period = 1.0 / rate / speed if rate > 0.0 else 0.0
        self._longest = max(self.LONGEST_GAP, 2.0 * self._period)
        self._begin = math.nan
        self._last = -math.inf
        """When the last picture was shown."""
        self.slips = 0
        """How often it was held up."""

    def wait(self, taken: float, now: float) -> float:
        """How long to wait for a picture, s.

        Args:
            taken: when it was taken, s from the file's beginning.
            now: s by the node's clock; simulated time may step back.
        """
        self._last = min(self._last, now)
        due = self._begin + taken / self._speed
        if not -self.SLIPPED <= due - now <= self._longest:  # so is the first one, as NaN
            self.slips += due < now - self.SLIPPED
            self._begin, due = now - taken / self._speed, now
        # What is late is caught up with at twice the rate: all at once it would be more than a reader keeps.
        self._last = max(due, now, self._last + self._period / 2.0)
        return self._last - now


class Gaps:
    """How many pictures a camera has lost, by the gaps between those that came.

    A gap is compared with what was usual of late, not with the rate that a camera says: in dim light it has another.
    """

    OVER = 10
    """Gaps that tell what is usual."""
    LEAST = 3

    def __init__(self) -> None:
        self._before = math.nan
        self._gaps: deque[float] = deque(maxlen=self.OVER)

    def lost(self, taken: float) -> int:
        """How many were lost before a picture that was taken then, s; NaN where that is not known."""
        gap, self._before = taken - self._before, taken
        if not 0.0 < gap < math.inf:
            return 0
        usual = median(self._gaps) if len(self._gaps) >= self.LEAST else gap
        self._gaps.append(gap)
        return max(0, round(gap / usual) - 1)


class Rate:
    """How many pictures came a second, of late."""

    OVER = 2.0
    """s."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=4096)

    def take(self, now: float) -> None:
        """A picture came; s by a monotonic clock."""
        self._times.append(now)

    def at(self, now: float) -> float:
        """Pictures per second over the last `OVER` s, or since the first one if that is less long ago."""
        recent = [time for time in tuple(self._times) if 0.0 <= now - time <= self.OVER]
        if len(recent) < 2:
            return 0.0
        return len(recent) / max(now - recent[0], 1e-3)

    def forget(self) -> None:
        """Begin anew."""
        self._times.clear()
