"""Which keys steer a recording that is played, and the line that shows where it is. Pure."""

from typing import Final, Literal

from robo.recording.play.player import State

Key = Literal["pause", "step", "next", "ahead", "back", "far ahead", "far back", "faster", "slower", "quit"]

HELP: Final = "space pause   . step   n next   ← → 5 s   PgUp PgDn 60 s   + - rate   q quit"

SEEK: Final = 5.0
"""By an arrow, s of the recording."""
FAR: Final = 60.0
"""By a page, s of the recording."""

_ESCAPE = "\x1b"
_KEYS: dict[str, Key] = {
    " ": "pause",
    ".": "step",
    "n": "next",
    "+": "faster",
    "=": "faster",
    "-": "slower",
    "q": "quit",
    "Q": "quit",
    "[C": "ahead",
    "[D": "back",
    "[A": "faster",
    "[B": "slower",
    "[5~": "far ahead",
    "[6~": "far back",
}
_RATES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


_FAR_AWAY = 10.0
"""From how far away the next message is told, s of the wall clock."""
_DAY = 86_400 * 10**9
"""ns."""
_CLOCK_WAS_SET = 2 * _DAY
"""No recorder waits so long, ns."""


def far_away(state: State) -> str | None:
    """What is told of a message that comes after a long time of nothing; None where it comes soon."""
    left = 0 if state.coming is None or state.paused else state.coming - state.position
    if not state.rate or left * 1e-9 / state.rate < _FAR_AWAY:
        return None
    if left > _CLOCK_WAS_SET:
        return f"nothing for {left / _DAY:,.0f} days of the recording: its clock was set there"
    return f"nothing for {left * 1e-9:.0f} s of the recording"


class Decoder:
    """Keys from what a terminal sends, which may come in parts."""

    def __init__(self) -> None:
        self._begun = ""

    def keys(self, data: bytes) -> list[Key]:
        """The keys that have a meaning."""
        found: list[Key] = []
        for character in data.decode("latin-1"):
            word = self._begun + character
            if character == _ESCAPE:
                self._begun = character
            elif word == _ESCAPE + "O":
                self._begun = _ESCAPE + "["  # arrows of a terminal in its other mode
            elif word == _ESCAPE + "[" or (word.startswith(_ESCAPE + "[") and not "@" <= character <= "~"):
                self._begun = word if len(word) < 16 else ""
            else:
                self._begun = ""
                key = _KEYS.get(word.removeprefix(_ESCAPE))
                if key is not None:
                    found.append(key)
        return found


def next_rate(rate: float, *, faster: bool) -> float:
    """The rate that comes next; as fast as it goes, 0, is beyond all, and left again by slower."""
    if not rate:
        return 0.0 if faster else _RATES[-1]
    if faster:
        return next((one for one in _RATES if one > rate * 1.0001), rate)
    return next((one for one in reversed(_RATES) if one < rate * 0.9999), rate)


def status_line(state: State, first: int, end: int, width: int) -> str:
    """Where it is, in a line that fits.

    Args:
        state: of the player.
        first: where the recording begins, ns since the epoch.
        end: where it ends.
        width: of the terminal, columns.
    """
    at, whole = (state.position - first) * 1e-9, (end - first) * 1e-9
    rate = f"x{state.rate:g}" if state.rate else "as fast as it goes"
    what = "paused " if state.paused else "playing"
    text = f"{what} {at:8.2f} of {whole:.2f} s  {rate}  {state.played:,} messages"
    longer = f"{text}   {HELP}"
    return (longer if len(longer) < width else text)[: max(width - 1, 0)]
