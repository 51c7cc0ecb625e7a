"""ROS 2's state machine of managed nodes: a table, and what goes through it. It knows of no node and no network.

States, transitions, their ids and labels are those of `lifecycle_msgs` and of rcl_lifecycle's default machine: a
transition that somebody asks for leads to a transition state, in which the node's hook is called; what comes of that
leads on. An error is processed at once, by `on_error`.

| asked for | from | by the hook | SUCCESS | FAILURE | ERROR |
|---|---|---|---|---|---|
| `configure` | unconfigured | `on_configure` | inactive | unconfigured | errorprocessing |
| `activate` | inactive | `on_activate` | active | inactive | errorprocessing |
| `deactivate` | active | `on_deactivate` | inactive | active | errorprocessing |
| `cleanup` | inactive | `on_cleanup` | unconfigured | inactive | errorprocessing |
| `shutdown` | all three | `on_shutdown` | finalized | finalized | errorprocessing |
| | errorprocessing | `on_error` | unconfigured | finalized | finalized |
"""

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple

from robo.errors import LifecycleError


class LifecycleState(IntEnum):
    """How far a managed node has come."""

    UNKNOWN = 0
    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4
    CONFIGURING = 10
    CLEANINGUP = 11
    SHUTTINGDOWN = 12
    ACTIVATING = 13
    DEACTIVATING = 14
    ERRORPROCESSING = 15

    @property
    def label(self) -> str:
        """In a word, as ROS says it: `unconfigured`."""
        return self.name.lower()

    def __str__(self) -> str:
        return self.label

    @property
    def is_primary(self) -> bool:
        """Whether the node stays there until somebody asks for a transition."""
        return self < LifecycleState.CONFIGURING


class TransitionCallbackReturn(IntEnum):
    """How a hook went. One that returns nothing has succeeded; what it raises is an ERROR."""

    SUCCESS = 97
    FAILURE = 98
    """It could not be done; all is as before."""
    ERROR = 99
    """It went wrong in the middle: `on_error` is called."""

    def __str__(self) -> str:
        return self.name


class Transition(NamedTuple):
    """A way from one state to another."""

    id: int
    label: str
    start: LifecycleState
    goal: LifecycleState


_OUTCOMES = {
    TransitionCallbackReturn.SUCCESS: "transition_success",
    TransitionCallbackReturn.FAILURE: "transition_failure",
    TransitionCallbackReturn.ERROR: "transition_error",
}

TRANSITIONS = (
    Transition(1, "configure", LifecycleState.UNCONFIGURED, LifecycleState.CONFIGURING),
    Transition(10, "transition_success", LifecycleState.CONFIGURING, LifecycleState.INACTIVE),
    Transition(11, "transition_failure", LifecycleState.CONFIGURING, LifecycleState.UNCONFIGURED),
    Transition(12, "transition_error", LifecycleState.CONFIGURING, LifecycleState.ERRORPROCESSING),
    Transition(2, "cleanup", LifecycleState.INACTIVE, LifecycleState.CLEANINGUP),
    Transition(20, "transition_success", LifecycleState.CLEANINGUP, LifecycleState.UNCONFIGURED),
    Transition(21, "transition_failure", LifecycleState.CLEANINGUP, LifecycleState.INACTIVE),
    Transition(22, "transition_error", LifecycleState.CLEANINGUP, LifecycleState.ERRORPROCESSING),
    Transition(3, "activate", LifecycleState.INACTIVE, LifecycleState.ACTIVATING),
    Transition(30, "transition_success", LifecycleState.ACTIVATING, LifecycleState.ACTIVE),
    Transition(31, "transition_failure", LifecycleState.ACTIVATING, LifecycleState.INACTIVE),
    Transition(32, "transition_error", LifecycleState.ACTIVATING, LifecycleState.ERRORPROCESSING),
    Transition(4, "deactivate", LifecycleState.ACTIVE, LifecycleState.DEACTIVATING),
    Transition(40, "transition_success", LifecycleState.DEACTIVATING, LifecycleState.INACTIVE),
    Transition(41, "transition_failure", LifecycleState.DEACTIVATING, LifecycleState.ACTIVE),
    Transition(42, "transition_error", LifecycleState.DEACTIVATING, LifecycleState.ERRORPROCESSING),
    Transition(5, "shutdown", LifecycleState.UNCONFIGURED, LifecycleState.SHUTTINGDOWN),
    Transition(6, "shutdown", LifecycleState.INACTIVE, LifecycleState.SHUTTINGDOWN),
    Transition(7, "shutdown", LifecycleState.ACTIVE, LifecycleState.SHUTTINGDOWN),
    Transition(50, "transition_success", LifecycleState.SHUTTINGDOWN, LifecycleState.FINALIZED),
    Transition(51, "transition_failure", LifecycleState.SHUTTINGDOWN, LifecycleState.FINALIZED),
    Transition(52, "transition_error", LifecycleState.SHUTTINGDOWN, LifecycleState.ERRORPROCESSING),
    Transition(60, "transition_success", LifecycleState.ERRORPROCESSING, LifecycleState.UNCONFIGURED),
    Transition(61, "transition_failure", LifecycleState.ERRORPROCESSING, LifecycleState.FINALIZED),
    Transition(62, "transition_error", LifecycleState.ERRORPROCESSING, LifecycleState.FINALIZED),
)
"""All there are, in the order in which ROS lists them."""

HOOKS = {
    LifecycleState.CONFIGURING: "on_configure",
    LifecycleState.CLEANINGUP: "on_cleanup",
    LifecycleState.SHUTTINGDOWN: "on_shutdown",
    LifecycleState.ACTIVATING: "on_activate",
    LifecycleState.DEACTIVATING: "on_deactivate",
    LifecycleState.ERRORPROCESSING: "on_error",
}
"""What is called in each transition state."""

WAY_UP = ("configure", "activate")
"""What brings a node from its start to its work."""
WAY_DOWN = ("deactivate", "cleanup", "shutdown")
"""What brings it to its end, each as far as it is possible."""


class Lifecycle:
    """The state of one managed node."""

    def __init__(
        self, call: Callable[[str], TransitionCallbackReturn], moved: Callable[[Transition], None] = lambda _: None
    ) -> None:
        """
        Args:
            call: calls a hook by its name and says how it went; what it raises is nobody's.
            moved: is told of each transition, when the new state holds.
        """
        self.state = LifecycleState.UNCONFIGURED
        self.before = LifecycleState.UNKNOWN
        """The primary state in which the present transition, or the last one, began."""
        self._call = call
        self._moved = moved

    @property
    def available(self) -> Sequence[Transition]:
        """The transitions that begin in the present state."""
        return [one for one in TRANSITIONS if one.start is self.state]

    def find(self, label: str = "", id: int = 0) -> Transition:  # noqa: A002
        """The transition that somebody asks for now: by its label, or where that is empty by its id.

        Raises:
            LifecycleError: there is none in the present state; says which there are.
        """
        asked = [one for one in self.available if self.state.is_primary]
        for one in asked:
            if one.label == label if label else one.id == id:
                return one
        wanted = label or f"go through transition {id}"
        possible = " or ".join(one.label for one in asked) if asked else "do nothing else now"
        raise LifecycleError(f"it is {self.state.label} and cannot {wanted}; it can {possible}")

    def change(self, wanted: Transition) -> TransitionCallbackReturn:
        """Go through a transition that begins in the present state, to the primary state where it ends.

        Returns:
            How its hook went; after an error `on_error` has been called as well.
        """
        self.before = self.state
        self._move(wanted)
        outcome = self._hook()
        if outcome is TransitionCallbackReturn.ERROR:
            self._hook()
        return outcome

    def _hook(self) -> TransitionCallbackReturn:
        outcome = self._call(HOOKS[self.state])
        self._move(next(one for one in self.available if one.label == _OUTCOMES[outcome]))
        return outcome

    def _move(self, transition: Transition) -> None:
        self.state = transition.goal
        self._moved(transition)
