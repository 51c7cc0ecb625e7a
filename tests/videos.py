"""Video files that tests make for themselves, and a camera that plays one."""

import errno
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from robo_services.camera_source import import_av


def make_video(
    path: Path, count: int, *, codec: str = "mjpeg", size: tuple[int, int] = (64, 48), rate: int = 30
) -> Path:
    """A video file: picture n is grey, as bright as 8·n modulo 256.

    Args:
        path: where to; its ending says the container.
        count: how many pictures.
        codec: as FFmpeg calls it.
        size: width and height, pixels.
        rate: pictures per second.
    """
    av = import_av()
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height = size
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        for number in range(count):
            frame = av.VideoFrame(*size, "rgb24")
            plane = frame.planes[0]
            plane.update(bytes([8 * number % 256]) * plane.buffer_size)
            container.mux(stream.encode(frame.reformat(format=stream.pix_fmt)))
        container.mux(stream.encode())
    return path


def brightness(number: int) -> int:
    """How bright picture `number` is, 0 to 255."""
    return 8 * number % 256


class PluggedIn:
    """PyAV with a camera that a film plays: what FFmpeg does with a device is stood in for, the rest is PyAV's.

    Args:
        film: what the camera shows, JPEGs.
        since: when its first picture was taken, s by the kernel's clock.
        skips: numbers of pictures that get lost.
    """

    def __init__(self, film: Path, since: float, skips: tuple[int, ...] = ()) -> None:
        self._av = import_av()
        self._film, self._since, self._skips = film, since, skips
        self.asked: list[dict[str, Any]] = []
        """How the camera was opened, each time."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._av, name)

    def open(self, place: str, **options: Any) -> "PlayedCamera":
        self.asked.append({"place": place, **options})
        return PlayedCamera(self._av.open(str(self._film)), self._since, self._skips)


class PlayedCamera:
    """A camera that is open: at first nothing has come, at the end it is unplugged."""

    def __init__(self, container: Any, since: float, skips: tuple[int, ...]) -> None:
        self.streams = container.streams
        self._packets = enumerate(container.demux(video=0))
        self._since, self._skips = since, skips
        self._comes = False
        self.close = container.close

    def demux(self, stream: Any) -> Iterator[Any]:
        for number, packet in self._packets:
            if not packet.size:
                break
            if number in self._skips:
                continue
            if not self._comes:
                self._comes = True
                raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
            packet.pts += round(self._since / stream.time_base)
            yield packet
        raise OSError(errno.ENODEV, "No such device")
