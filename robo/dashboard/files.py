"""The files of the page, and what a browser is told with each: that nothing comes from elsewhere."""

import http
import mimetypes
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOM = Path(__file__).parent / "page"

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What a page may load: files of its own, and its own socket."""
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
_TYPES = {".js": "text/javascript", ".css": "text/css", ".html": "text/html", ".svg": "image/svg+xml"}


class Answer(NamedTuple):
    """What a browser gets."""

    status: http.HTTPStatus
    headers: dict[str, str]
    body: bytes


@cache
def _names() -> dict[str, Path]:
    """The files by path: nothing else is served, whatever a path says."""
    found = {"/" + path.relative_to(ROOM).as_posix(): path for path in ROOM.rglob("*") if path.suffix in _TYPES}
    return {**found, "/": ROOM / "index.html"}


def answer(path: str) -> Answer:
    """The file of a path, or that there is none."""
    file = _names().get(path)
    if file is None:
        return text(http.HTTPStatus.NOT_FOUND, "there is no such page")
    kind = _TYPES.get(file.suffix) or mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    return Answer(http.HTTPStatus.OK, {**HEADERS, "Content-Type": f"{kind}; charset=utf-8"}, file.read_bytes())


def text(status: http.HTTPStatus, words: str, **headers: str) -> Answer:
    """A few words, for somebody who is not let in."""
    more = {name.replace("_", "-"): value for name, value in headers.items()}
    return Answer(status, {**HEADERS, "Content-Type": "text/plain; charset=utf-8", **more}, f"{words}\n".encode())
