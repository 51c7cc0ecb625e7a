"""The parameters of a running node: checked, set, told and explained."""

import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from typing import Any, Protocol

from robo.errors import ContractError, ParameterError
from robo.node.loops import period_of
from robo.node.turn import Turn, taking
from robo.parameters.model import Parameters, change, default_of, flat
from robo.wire.reports import Setting
from robo_messages import Parameter, ParameterEvent, Time

SET_WHILE_RUNNING = "set while running"
DECLARED_DEFAULT = "declared default"


class Tunable(Protocol):
    """What tuning needs of its node."""

    full_name: str
    parameters: Parameters

    def now(self) -> Time:
        """The time for stamps."""

    def on_parameters_changing(self, new: Any) -> None:
        """Look at the parameters as they would be; raise ValueError to refuse."""

    def on_parameters_changed(self, names: Set[str]) -> None:
        """Take note of what was changed."""


class Ticking(Protocol):
    """What tuning needs of a timer: its period may hang on a parameter."""

    def period(self) -> float:
        """Its period, s. Raises ContractError or ParameterError for what cannot be waited for."""

    def reschedule(self) -> None:
        """Ask for the period again."""


class Tuning:
    """Changes the parameters of one node: all that belong together, or none."""

    def __init__(
        self,
        node: Tunable,
        settings: Mapping[str, Sequence[Setting]],
        turn: Turn,
        timers: Callable[[], Iterable[Ticking]],
        handler: Callable[[Callable[..., object]], Callable[[BaseException], None]],
    ) -> None:
        """
        Args:
            node: whose parameters.
            settings: by parameter, what was said of it before the node started, weakest first.
            turn: the node's.
            timers: those that the node has just now.
            handler: what is done with an exception of a callback.
        """
        self._node = node
        self._settings = {name: list(said) for name, said in settings.items()}
        self._turn = turn
        self._timers = timers
        self._handler = handler
        self._events: deque[ParameterEvent] = deque()
        self._events_lock = threading.Lock()
        self.announce: Callable[[ParameterEvent], None] | None = None
        """Where changes are told while the node runs; None while it does not."""

    def set(self, changes: Mapping[str, object]) -> None:
        """Change parameters, all or none: see `Node.set_parameters`.

        Raises:
            ParameterError: a name is unknown, a value does not fit, is read-only, or was refused.
        """
        node = self._node
        change(node.parameters, changes, node.full_name)  # what is wrong with them costs callbacks no time
        with taking(self._turn, "set_parameters"):
            self._commit(changes)
        self._tell()

    def explain(self, name: str) -> list[Setting]:
        """All that was said of a parameter, weakest first; the last one holds."""
        default = default_of(type(self._node.parameters), name)
        said = self._settings.get(name, ())
        return [*([] if default is None else [Setting(default, DECLARED_DEFAULT)]), *said]

    def period(self, rate: float | str) -> Callable[[], float]:
        """What says the period of a timer, s, by its rate in Hz or the name of the parameter that says it.

        Raises:
            ContractError: the rate is not one that a timer can keep.
        """
        if isinstance(rate, str):
            name = rate
            return lambda: self._period_by(name)
        period = period_of(rate)
        return lambda: period

    def text(self, name: str | None) -> Callable[[], str] | None:
        """What says a parameter as text; None where no parameter is named."""
        return None if name is None else lambda: str(getattr(self._node.parameters, name))

    def _period_by(self, parameter: str) -> float:
        try:
            return period_of(getattr(self._node.parameters, parameter))
        except ContractError as error:
            raise ParameterError(f"{self._node.full_name}: {parameter}: {error}") from None

    def _commit(self, changes: Mapping[str, object]) -> None:
        """Change them under the node's turn; each step that may refuse comes before those that may not."""
        node, old = self._node, self._node.parameters
        new = change(old, changes, node.full_name)
        self._offer(new)
        node.parameters = new
        try:
            for timer in self._timers():
                timer.period()
        except Exception as error:
            node.parameters = old
            raise error if isinstance(error, ParameterError) else self._refusal(error) from None
        before = flat(old)
        changed = {name: value for name, value in flat(new).items() if value != before[name]}
        for name, value in changed.items():
            self._note(name, value)
        for timer in self._timers():
            timer.reschedule()
        told = [Parameter(name, value) for name, value in changed.items()]
        # Before the node takes note: what it changes thereupon is told after this.
        self._events.append(ParameterEvent(node.now(), node.full_name, changed_parameters=told))
        try:
            node.on_parameters_changed(changed.keys())
        except BaseException as error:
            self._handler(node.on_parameters_changed)(error)

    def _offer(self, new: Parameters) -> None:
        try:
            self._node.on_parameters_changing(new)
        except BaseException as error:
            if not isinstance(error, ValueError):
                self._handler(self._node.on_parameters_changing)(error)
            raise self._refusal(error) from None

    def _refusal(self, error: BaseException) -> ParameterError:
        return ParameterError(f"{self._node.full_name} refuses: {error}")

    def _note(self, name: str, value: object) -> None:
        """Keep what was set last, for whoever asks why it has this value."""
        settings = self._settings.setdefault(name, [])
        if settings and settings[-1].source == SET_WHILE_RUNNING:
            settings.pop()
        settings.append(Setting(value, SET_WHILE_RUNNING))

    def _tell(self) -> None:
        """Announce changes in the order in which they were made, whoever made them."""
        with self._events_lock:
            while self._events:
                event = self._events.popleft()
                if self.announce is not None and event.changed_parameters:
                    self.announce(event)
