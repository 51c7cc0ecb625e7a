"""`python -m benchmarks.camera`: films of 640x480 at 30 Hz, played by the node camera; writes CAMERA.md.

Camera and viewer are processes of their own; the viewer subscribes with depth 10 and counts. `lost` are pictures of
which the camera published the sequence number and the viewer had none. Processor time is that of each process while
it plays, in percent of one core. `late` is how much later than a thirtieth of a second after the one before a
picture came.
"""

import argparse
import itertools
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import msgspec
import psutil

from benchmarks.__main__ import machine
from robo.testing.run import Run
from robo_services.camera_source import import_av

RESULTS = Path(__file__).parent / "CAMERA.md"
RATE = 30

VIEWER = """
import time
from pathlib import Path

import msgspec
from robo import MessageInfo, Node, subscribe
from robo_messages import CompressedImage, Image


class Viewer(Node):
    def on_start(self) -> None:
        self.numbers, self.times = [], []

    def see(self, info: MessageInfo) -> None:
        self.numbers.append(info.sequence_number)
        self.times.append(time.monotonic())

    def on_stop(self) -> None:
        Path("seen.json").write_bytes(msgspec.json.encode([self.numbers, self.times]))


class Plain(Viewer):
    @subscribe("image_raw", depth=10)
    def on_image(self, image: Image, info: MessageInfo) -> None:
        self.see(info)


class Jpeg(Viewer):
    @subscribe("image_raw/compressed", depth=10)
    def on_image(self, image: CompressedImage, info: MessageInfo) -> None:
        self.see(info)
"""

MANIFEST = """
groups:
  eyes:
    namespace: ${{robot_name}}
    nodes:
      viewer: {{service: "viewer:{viewer}"}}
      camera:
        service: robo_services.camera
        params: {{source: ./{film}}}
        needs: {{viewer: ready}}
"""

VARIANTS = {
    "JPEGs, decoded for `image_raw`": ("film.avi", "Plain"),
    "JPEGs, passed on": ("film.avi", "Jpeg"),
    "H.264, decoded for `image_raw`": ("film.mp4", "Plain"),
    "H.264, made into JPEGs": ("film.mp4", "Jpeg"),
}


def make_film(path: Path, seconds: float, codec: str, pixels: str) -> None:
    """A film of FFmpeg's second test picture."""
    av = import_av()
    source = av.open(f"testsrc2=size=640x480:rate={RATE}:duration={seconds}", format="lavfi")
    with source, av.open(str(path), "w") as film:
        stream = film.add_stream(codec, rate=RATE)
        stream.width, stream.height, stream.pix_fmt = 640, 480, pixels
        for frame in source.decode(video=0):
            film.mux(stream.encode(frame.reformat(format=pixels)))
        film.mux(stream.encode())


def cpu_times(timeout: float) -> dict[str, float]:
    """Processor time of camera and viewer, s, until the camera has ended."""
    used: dict[str, float] = {}
    missed = 0
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        alive = set()
        for process in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                name = ["", *process.cmdline()][-1].rpartition("/")[2]
                times = process.cpu_times()
                used[name] = times.user + times.system
                alive.add(name)
        missed = missed + 1 if "camera" in used and "camera" not in alive else 0
        if missed == 10:  # a process may have another name for a moment while it is made
            return used
        time.sleep(0.2)
    raise TimeoutError(f"the camera has not come and gone within {timeout:g} s")


def measure(folder: Path, film: str, viewer: str, seconds: float) -> str:
    """A row of the table."""
    (folder / "film.yaml").write_text(MANIFEST.format(film=film, viewer=viewer))
    logs = Path(tempfile.mkdtemp(dir=folder))
    run = Run("film.yaml", "bench", [], logs, folder)
    try:
        run.wait_until_reached(60.0)
        used = cpu_times(seconds + 60.0)
    finally:
        run.end()
    numbers, times = msgspec.json.decode((folder / "seen.json").read_bytes(), type=tuple[list[int], list[float]])
    sent = numbers[-1] - numbers[0] + 1
    late = sorted(1e3 * (b - a - 1 / RATE) for a, b in itertools.pairwise(times))
    shares = [f"{100 * used[name] / seconds:.0f} %" for name in ("camera", "viewer")]
    return " | ".join([f"{len(numbers):,}", str(sent - len(numbers)), f"{late[len(late) * 99 // 100]:.1f}", *shares])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.camera", description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="how long a film is (default 60)")
    parser.add_argument("--quick", action="store_true", help="3 s; writes no results")
    options = parser.parse_args()
    seconds = 3.0 if options.quick else options.seconds
    lines = [
        "# Pictures",
        "",
        f"Written by `python -m benchmarks.camera`: {seconds:.0f} s of each.",
        "",
        *machine(),
        *__doc__.split("\n\n", 1)[1].splitlines(),
        "",
        "| film | seen | lost | late, 99th percentile, ms | camera | viewer |",
        "|---|---|---|---|---|---|",
    ]
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as name:
        folder = Path(name)
        (folder / "viewer.py").write_text(VIEWER)
        make_film(folder / "film.avi", seconds, "mjpeg", "yuvj420p")
        make_film(folder / "film.mp4", seconds, "libx264", "yuv420p")
        for title, (film, viewer) in VARIANTS.items():
            lines.append(f"| {title} | {measure(folder, film, viewer, seconds)} |")
    text = "\n".join([*lines, ""])
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
