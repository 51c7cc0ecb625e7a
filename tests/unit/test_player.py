"""Who plays answers at once, whoever reads or receives slowly, and says nothing of before a jump after it."""

import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest

from robo.recording.play import player as player_module
from robo.recording.play.ahead import Wanted
from robo.recording.play.playback import Item
from robo.recording.play.player import Player
from robo.recording.play.tape import Ready
from tests.support import PATIENCE, eventually

pytestmark = pytest.mark.timeout(60)

MS = 1_000_000
START = 1_700_000_000_000_000_000


class Tape:
    """A message each 10 ms for a minute; from `slow` on, nobody finds one as long as they are wanted."""

    begin, end = START, START + 60_000 * MS

    def __init__(self, slow: int = 2**63) -> None:
        self.slow = slow
        self.reads = threading.Semaphore(0)

    def run(self, at: int, wanted: Wanted = lambda: True) -> Iterator[Item[Ready]]:
        for time in range(at, self.end + 1, 10 * MS):
            if time >= self.slow:
                self.reads.release()
                while wanted():
                    threading.Event().wait(0.001)
                return
            yield Item(time, False, Ready(0, 0, b"%d" % ((time - START) // MS)))


class Outputs:
    """What was said, ms; whoever receives it may be slow."""

    def __init__(self) -> None:
        self.said: list[int] = []
        self.begun = threading.Semaphore(0)
        self.go_on = threading.Event()
        self.go_on.set()

    def send(self, message: Ready) -> None:
        self.begun.release()
        assert self.go_on.wait(PATIENCE)
        self.said.append(int(message.payload))


class Told(list[int]):
    def send(self, time: int) -> None:
        self.append(time)


@contextmanager
def playing(tape: Tape, outputs: Outputs, **how: Any) -> Iterator[Player]:
    player = Player(tape, outputs, **how)  # type: ignore[arg-type]
    thread = threading.Thread(target=player.run)
    with closing(player):
        thread.start()
        yield player
        outputs.go_on.set()
        player.stop()
        thread.join(PATIENCE)
        assert not thread.is_alive()


def within(seconds: float, what: Callable[[], Any]) -> Any:
    """What a call returns that must not wait."""
    found: list[Any] = []
    thread = threading.Thread(target=lambda: found.append(what()), daemon=True)
    thread.start()
    thread.join(seconds)
    assert found, "it waits"
    return found[0]


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_nobody_waits_for_what_is_read(rate: float) -> None:
    tape = Tape(slow=START + 30_000 * MS)
    with playing(tape, Outputs(), rate=rate, paused=True) as player:
        there = tape.slow + 1000 * MS
        assert player.seek(there) == there
        assert tape.reads.acquire(timeout=PATIENCE)
        state = within(5.0, lambda: player.state)
        assert (state.position, state.paused, state.coming) == (there, True, None)
        assert within(5.0, player.step)
        within(5.0, player.pause)
        assert within(5.0, lambda: player.seek(START + 100 * MS)) == START + 100 * MS
        eventually(lambda: player.state.coming == START + 100 * MS, "it reads from there")
        player.seek(there)
        assert tape.reads.acquire(timeout=PATIENCE)
        within(5.0, player.stop)


@pytest.mark.parametrize("how", ["pause", "seek", "step"])
def test_what_was_on_its_way_is_out_before_anybody_hears_of_something_else(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(player_module, "_HANGS", PATIENCE)
    outputs = Outputs()
    outputs.go_on.clear()
    said: list[list[int]] = []
    with playing(Tape(), outputs) as player:
        do: dict[str, Callable[[], object]] = {
            "pause": player.pause,
            "seek": lambda: player.seek(Tape.end),
            "step": player.step,
        }

        def hear() -> None:
            do[how]()
            said.append(list(outputs.said))

        assert outputs.begun.acquire(timeout=PATIENCE)
        somebody = threading.Thread(target=hear)
        somebody.start()
        somebody.join(0.1)
        outputs.go_on.set()
        somebody.join(PATIENCE)
        assert said[0][0] == 0


def test_a_receiver_that_hangs_keeps_nobody_waiting() -> None:
    outputs = Outputs()
    outputs.go_on.clear()
    with playing(Tape(), outputs) as player:
        assert outputs.begun.acquire(timeout=PATIENCE)
        within(10.0, player.pause)
        assert within(5.0, lambda: player.state).paused


def test_the_time_is_told_once_in_a_period() -> None:
    clock = Told()
    with playing(Tape(), Outputs(), paused=True, clock=clock, clock_period=3600.0) as player:
        eventually(lambda: clock == [START], "it is told that it stands")
        for _ in range(10):
            player.pause()
        player.seek(START + 70 * MS)
        assert player.step()
        eventually(lambda: len(clock) > 1, "the time of the message")
    assert clock == [START, START + 70 * MS]
