"""How far a verb on recordings is, what mends a file, and times for people."""

import io
import sys

import pytest

from robo.cli.views import bag_progress
from robo.cli.views.bag_progress import progress
from robo.cli.views.bag_times import duration
from robo.errors import BagError, DamagedBag
from robo.text.dates import date
from robo.text.terminal import Door


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def looked_at(stream: io.StringIO, monkeypatch: pytest.MonkeyPatch, first: float = 0.0) -> None:
    """Have stderr be a stream, and everything be told at once."""
    monkeypatch.setattr(bag_progress, "_FIRST", first)
    monkeypatch.setattr(bag_progress, "_PERIOD", 0.0)
    monkeypatch.setattr(sys, "stderr", Door(stream))


def test_how_far_it_is_stands_on_one_line_that_goes_away(monkeypatch: pytest.MonkeyPatch) -> None:
    stderr = Terminal()
    looked_at(stderr, monkeypatch)
    with progress("reading a.mcap") as tell:
        tell(50, 200)
        tell(300, 200)
        tell(1, 0)
    begin = "\r\x1b[K"
    assert stderr.getvalue() == (
        f"{begin}reading a.mcap: 25%; Ctrl-C ends{begin}reading a.mcap: 100%; Ctrl-C ends"
        f"{begin}reading a.mcap: 1 message; Ctrl-C ends{begin}"
    )


def test_what_is_done_soon_tells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    stderr = Terminal()
    looked_at(stderr, monkeypatch, first=1e6)
    with progress("reading a.mcap") as tell:
        tell(50, 200)
    assert stderr.getvalue() == ""


def test_where_nobody_looks_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    file = io.StringIO()
    looked_at(file, monkeypatch)
    with progress("reading a.mcap") as tell:
        tell(50, 200)
    assert file.getvalue() == ""


def test_what_mends_a_file_is_named() -> None:
    with pytest.raises(DamagedBag) as error, progress("reading"):
        raise DamagedBag("it makes no sense", "a.mcap", 12, cut=True)
    advice = "`robo bag recover a.mcap -o WHOLE` makes a whole file of what can be read"
    assert str(error.value) == f"a.mcap, byte 12: it makes no sense; {advice}"
    assert error.value.cut
    for other in (DamagedBag("it is no MCAP file", "a.mcap", 0), BagError("no such file", "a.mcap"), error.value):
        with pytest.raises(BagError) as same, progress("reading"):
            raise other
        assert same.value is other


def test_times_are_those_of_the_clock_here() -> None:
    assert date(1_700_000_000_123_456_789).startswith("2023-11-1")
    assert ".123 +" in date(1_700_000_000_123_456_789) or ".123 -" in date(1_700_000_000_123_456_789)
    assert date(2**64 - 1).startswith("2554-07-2")
    assert [duration(round(seconds * 1e9)) for seconds in (0, 59.9994, 61.3, 3723)] == [
        "0.000 s", "59.999 s", "1:01 (61.3 s)", "1:02:03 (3,723.0 s)",
    ]  # fmt: skip
