"""What a feed leaves out of what a serial port has kept."""

from pathlib import Path

import pytest

from robo_services.pseudo_terminal import PseudoTerminal
from robo_services.serial_feed import SerialFeed

pytest.importorskip("serial", reason="the extra serial is not installed")


def test_what_has_waited_for_too_long_is_left_out_and_silence_is_no_being_held_up(tmp_path: Path) -> None:
    board, now, gaps = PseudoTerminal(tmp_path / "port"), [100.0], list[float]()
    feed = SerialFeed(
        str(tmp_path / "port"),
        9600,
        lambda _: None,
        lambda _: None,
        stale_after=0.1,
        held_up=gaps.append,
        now=lambda: now[0],
    )
    chunks = feed.chunks(lambda: False)
    assert next(chunks) == b""
    now[0] += 0.05
    board.write(b"one")
    assert (next(chunks), feed.read_at) == (b"one", 100.05)
    now[0] += 0.09
    assert next(chunks) == b"", "nobody spoke, and it looked"
    now[0] += 0.09
    board.write(b"two")
    assert next(chunks) == b"two"
    while board.write(b"old " * 1000):
        pass
    now[0] += 3.0  # held up
    assert next(chunks) == b""
    assert gaps == pytest.approx([3.0])
    board.write(b"new")
    assert next(chunks) == b"new"
    chunks.close()
    feed.close()
    board.unplug()
