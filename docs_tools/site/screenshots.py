"""The pictures of the dashboard in docs/images, made by a browser: `python -m docs_tools.site.screenshots`.

They are committed, as the other ones; made again where the page has changed, and then looked at. Needs the extra
dashboard, playwright, chromium, and half a minute.
"""

import base64
import importlib
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from docs_tools.site.images import FOLDER, ROOT

DRIVES = 20.0
"""For so long the robot drives before it is pictured: it has a trail, and curves, s."""


class Shot(NamedTuple):
    """A picture."""

    name: str
    width: int
    height: int
    scheme: str
    whole: bool
    """All of the page, or what is seen of it at once."""


SHOTS = (
    Shot("dashboard", 1280, 860, "light", True),
    Shot("dashboard_dark", 1280, 800, "dark", False),
    Shot("dashboard_phone", 844, 390, "light", False),
)


def main() -> None:
    """Make them all."""
    sync_api = importlib.import_module("playwright.sync_api")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "ROBO_LOG_DIR": folder}
        up = ["up", str(ROOT / "launch" / "simulation.yaml"), "robot_name:=r1", "--listen", endpoint]
        served = ["dashboard", "--connect", endpoint, "--listen", "127.0.0.1:0", "--json"]
        with (
            _running(up, "is ready", environment),
            _running(served, "}", environment) as said,
            sync_api.sync_playwright() as playwright,
        ):
            address = json.loads(said)["drive"]
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            pages = [(shot, _open(browser, address, shot)) for shot in SHOTS]
            time.sleep(DRIVES)
            for shot, page in pages:
                page.wait_for_selector("#pad:not(.locked)")  # the link is there, however busy the machine is
                file = FOLDER / f"{shot.name}.png"
                file.write_bytes(_small(browser, page.screenshot(full_page=shot.whole)))
                print(f"{file.relative_to(ROOT)}: {file.stat().st_size / 1e3:.0f} kB")
            browser.close()


def _open(browser: Any, address: str, shot: Shot) -> Any:
    """The page, with panels that show something."""
    size = {"width": shot.width, "height": shot.height}
    page = browser.new_context(viewport=size, color_scheme=shot.scheme).new_page()
    page.goto(address)
    page.wait_for_selector("#map canvas[data-drawn]")
    page.wait_for_selector("#parameters .field input")
    page.select_option("#parameters select", label="velocity_smoother")
    page.click("#topics button.link:text-is('current_position')")
    page.evaluate("scrollTo(0, 0)")
    return page


_COLOURS = """async (url) => {
    const picture = await createImageBitmap(await (await fetch(url)).blob());
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    const pen = canvas.getContext("2d");
    pen.drawImage(picture, 0, 0);
    const pixels = new Uint32Array(pen.getImageData(0, 0, picture.width, picture.height).data.buffer);
    const counts = new Map();
    for (const one of pixels) counts.set(one, (counts.get(one) ?? 0) + 1);
    const kinds = new Map(); // of colours that are much the same the commonest
    for (const [one, count] of counts) {
        const kind = one & 0xf0f0f0;
        const known = kinds.get(kind) ?? { most: 0, all: 0 };
        known.all += count;
        if (count > known.most) Object.assign(known, { one, most: count });
        kinds.set(kind, known);
    }
    const parts = (one) => [one & 255, (one >> 8) & 255, (one >> 16) & 255];
    const kept = [...kinds.values()].sort((a, b) => b.all - a.all).slice(0, MOST).map(({ one }) => parts(one));
    const near = new Map();
    const nearest = (one) => {
        const [r, g, b] = parts(one);
        let found = 0;
        let least = Infinity;
        kept.forEach((other, i) => {
            const far = (r - other[0]) ** 2 + (g - other[1]) ** 2 + (b - other[2]) ** 2;
            if (far < least) [found, least] = [i, far];
        });
        return found;
    };
    let places = "";
    for (const one of pixels) {
        if (!near.has(one)) near.set(one, nearest(one));
        places += String.fromCharCode(near.get(one));
    }
    return { width: picture.width, height: picture.height, colours: kept.flat(), places: btoa(places) };
}"""
"""The commonest colours of a picture, and for each pixel the nearest of them."""
_MOST_COLOURS = 200


def _small(browser: Any, png: bytes) -> bytes:
    """A picture with few colours, which takes less than half as much."""
    page = browser.new_page()
    url = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    found = page.evaluate(_COLOURS.replace("MOST", str(_MOST_COLOURS)), url)
    page.close()
    width, places = found["width"], base64.b64decode(found["places"])
    rows = b"".join(b"\0" + places[at : at + width] for at in range(0, len(places), width))

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, found["height"], 8, 3, 0, 0, 0)
    parts = (b"IHDR", head), (b"PLTE", bytes(found["colours"])), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(kind, data) for kind, data in parts)


@contextmanager
def _running(words: Sequence[str], until: str, environment: dict[str, str]) -> Iterator[str]:
    """A command of robo's that runs meanwhile; what it has printed until a line with some words."""
    command = [sys.executable, "-m", "robo", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        said = ""
        try:
            while until not in said:
                line = process.stdout.readline()
                if not line:
                    sys.exit(f"robo {words[0]} has ended")
                said += line
            yield said
        finally:
            process.terminate()


if __name__ == "__main__":
    main()
