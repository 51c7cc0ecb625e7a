"""The turns of a node: its own, which callbacks take, and those that some callbacks have for themselves."""

from collections.abc import Callable, Mapping
from functools import partial

from robo.errors import ContractError
from robo.node.clock import Clock
from robo.node.turn import Turn
from robo.wire import names


def check_turn(name: str) -> str:
    """The name of a turn, if it can be one; empty means the node's own.

    Raises:
        ContractError: it is no word.
    """
    if name and not names.is_word(name):
        raise ContractError(f"turn={name!r} names no turn: use {names.RULE}")
    return name


class Turns:
    """All turns of one node; callbacks of different ones may run at the same time."""

    def __init__(self, on_death: Callable[[BaseException], None] | None = None, clock: Clock | None = None) -> None:
        """`on_death` as for a `Turn`; the `clock` says where threads wait, by default on their own."""
        self._new = partial(Turn, on_death, (clock or Clock()).barrier)
        self.own = self._new()
        """What callbacks take that say nothing else."""
        self._others: dict[str, Turn] = {}
        self._callbacks: dict[str, list[str]] = {}

    @property
    def others(self) -> Mapping[str, Turn]:
        """Those beside the node's own, by name."""
        return dict(self._others)

    @property
    def callbacks(self) -> Mapping[str, list[str]]:
        """Who shares each of those, in the order in which they came."""
        return {name: list(callbacks) for name, callbacks in self._callbacks.items()}

    def of(self, name: str, callback: str) -> Turn:
        """The turn of this name; the node's own for an empty one.

        Args:
            name: of the turn.
            callback: who is going to take it.

        Raises:
            ContractError: the name is none.
        """
        if not check_turn(name):
            return self.own
        turn = self._others.setdefault(name, self._new())
        known = self._callbacks.setdefault(name, [])
        if callback not in known:
            known.append(callback)
        return turn
