"""The states of managed nodes, and the services that ask for them (ROS: lifecycle_msgs).

Imported when one of its types is asked for.
"""

from typing import ClassVar

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import UInt8, UInt64


@message("lifecycle/State")
class State(Message):
    """How far a managed node has come."""

    PRIMARY_STATE_UNKNOWN: ClassVar[int] = 0
    PRIMARY_STATE_UNCONFIGURED: ClassVar[int] = 1
    PRIMARY_STATE_INACTIVE: ClassVar[int] = 2
    PRIMARY_STATE_ACTIVE: ClassVar[int] = 3
    PRIMARY_STATE_FINALIZED: ClassVar[int] = 4
    TRANSITION_STATE_CONFIGURING: ClassVar[int] = 10
    TRANSITION_STATE_CLEANINGUP: ClassVar[int] = 11
    TRANSITION_STATE_SHUTTINGDOWN: ClassVar[int] = 12
    TRANSITION_STATE_ACTIVATING: ClassVar[int] = 13
    TRANSITION_STATE_DEACTIVATING: ClassVar[int] = 14
    TRANSITION_STATE_ERRORPROCESSING: ClassVar[int] = 15

    id: UInt8 = 0
    """One of the constants."""
    label: str = ""
    """The same in a word: `unconfigured`."""


@message("lifecycle/Transition")
class Transition(Message):
    """A way from one state to another."""

    TRANSITION_CREATE: ClassVar[int] = 0
    TRANSITION_CONFIGURE: ClassVar[int] = 1
    TRANSITION_CLEANUP: ClassVar[int] = 2
    TRANSITION_ACTIVATE: ClassVar[int] = 3
    TRANSITION_DEACTIVATE: ClassVar[int] = 4
    TRANSITION_UNCONFIGURED_SHUTDOWN: ClassVar[int] = 5
    TRANSITION_INACTIVE_SHUTDOWN: ClassVar[int] = 6
    TRANSITION_ACTIVE_SHUTDOWN: ClassVar[int] = 7
    TRANSITION_DESTROY: ClassVar[int] = 8
    TRANSITION_ON_CONFIGURE_SUCCESS: ClassVar[int] = 10
    TRANSITION_ON_CONFIGURE_FAILURE: ClassVar[int] = 11
    TRANSITION_ON_CONFIGURE_ERROR: ClassVar[int] = 12
    TRANSITION_ON_CLEANUP_SUCCESS: ClassVar[int] = 20
    TRANSITION_ON_CLEANUP_FAILURE: ClassVar[int] = 21
    TRANSITION_ON_CLEANUP_ERROR: ClassVar[int] = 22
    TRANSITION_ON_ACTIVATE_SUCCESS: ClassVar[int] = 30
    TRANSITION_ON_ACTIVATE_FAILURE: ClassVar[int] = 31
    TRANSITION_ON_ACTIVATE_ERROR: ClassVar[int] = 32
    TRANSITION_ON_DEACTIVATE_SUCCESS: ClassVar[int] = 40
    TRANSITION_ON_DEACTIVATE_FAILURE: ClassVar[int] = 41
    TRANSITION_ON_DEACTIVATE_ERROR: ClassVar[int] = 42
    TRANSITION_ON_SHUTDOWN_SUCCESS: ClassVar[int] = 50
    TRANSITION_ON_SHUTDOWN_FAILURE: ClassVar[int] = 51
    TRANSITION_ON_SHUTDOWN_ERROR: ClassVar[int] = 52
    TRANSITION_ON_ERROR_SUCCESS: ClassVar[int] = 60
    TRANSITION_ON_ERROR_FAILURE: ClassVar[int] = 61
    TRANSITION_ON_ERROR_ERROR: ClassVar[int] = 62
    TRANSITION_CALLBACK_SUCCESS: ClassVar[int] = 97
    TRANSITION_CALLBACK_FAILURE: ClassVar[int] = 98
    TRANSITION_CALLBACK_ERROR: ClassVar[int] = 99

    id: UInt8 = 0
    """One of the constants up to 62."""
    label: str = ""
    """The same in a word: `configure`. In a request it counts rather than the id."""


@message("lifecycle/TransitionDescription")
class TransitionDescription(Message):
    """A transition with both its ends."""

    transition: Transition = field(default_factory=Transition)
    """Which one."""
    start_state: State = field(default_factory=State)
    """Where it begins."""
    goal_state: State = field(default_factory=State)
    """Where it leads."""


@message("lifecycle/TransitionEvent")
class TransitionEvent(Message):
    """A node has come from one state to another."""

    timestamp: UInt64 = 0
    """When, ns since the epoch."""
    transition: Transition = field(default_factory=Transition)
    """By which transition."""
    start_state: State = field(default_factory=State)
    """Where it was."""
    goal_state: State = field(default_factory=State)
    """Where it is."""


class ChangeState:
    """Take a managed node through a transition."""

    @message("lifecycle/ChangeState_Request")
    class Request(Message):
        """Which transition."""

        transition: Transition = field(default_factory=Transition)
        """By its label, or where that is empty by its id."""

    @message("lifecycle/ChangeState_Response")
    class Response(Message):
        """How it went."""

        success: bool = False
        """Whether the transition was possible and the node's hook succeeded."""


class GetState:
    """Ask a managed node for its state."""

    @message("lifecycle/GetState_Request")
    class Request(Message):
        """Nothing to say."""

    @message("lifecycle/GetState_Response")
    class Response(Message):
        """The state."""

        current_state: State = field(default_factory=State)
        """That of now."""


class GetAvailableStates:
    """Ask which states there are."""

    @message("lifecycle/GetAvailableStates_Request")
    class Request(Message):
        """Nothing to say."""

    @message("lifecycle/GetAvailableStates_Response")
    class Response(Message):
        """The states."""

        available_states: list[State] = []
        """All of them, in every state."""


class GetAvailableTransitions:
    """Ask which transitions there are."""

    @message("lifecycle/GetAvailableTransitions_Request")
    class Request(Message):
        """Nothing to say."""

    @message("lifecycle/GetAvailableTransitions_Response")
    class Response(Message):
        """The transitions."""

        available_transitions: list[TransitionDescription] = []
        """Those of the present state; of `~/get_transition_graph` all."""
