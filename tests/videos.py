"""Video files that tests make for themselves."""

from pathlib import Path

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
