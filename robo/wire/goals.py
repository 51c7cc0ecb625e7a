"""Goals of actions: their states, as ROS 2 has them, what leads from one to another, and their ids. Pure."""

import os
from enum import Enum, IntEnum


class GoalState(IntEnum):
    """How far a goal has come; the numbers are those of `action/GoalStatus`."""

    UNKNOWN = 0
    """Nobody knows: no such goal, or its server has gone."""
    ACCEPTED = 1
    """Taken, and waits for its turn."""
    EXECUTING = 2
    """Under way."""
    CANCELING = 3
    """Somebody has asked to cancel it, and it is not over yet."""
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6
    """The server has given it up."""

    @property
    def is_terminal(self) -> bool:
        """Whether nothing comes after it."""
        return self >= GoalState.SUCCEEDED


class GoalEvent(Enum):
    """What can happen to a goal."""

    EXECUTE = "execute"
    CANCEL_GOAL = "cancel_goal"
    SUCCEED = "succeed"
    CANCELED = "canceled"
    ABORT = "abort"


TRANSITIONS: dict[tuple[GoalState, GoalEvent], GoalState] = {
    (GoalState.ACCEPTED, GoalEvent.EXECUTE): GoalState.EXECUTING,
    (GoalState.ACCEPTED, GoalEvent.CANCEL_GOAL): GoalState.CANCELING,
    (GoalState.EXECUTING, GoalEvent.CANCEL_GOAL): GoalState.CANCELING,
    (GoalState.EXECUTING, GoalEvent.SUCCEED): GoalState.SUCCEEDED,
    (GoalState.EXECUTING, GoalEvent.ABORT): GoalState.ABORTED,
    (GoalState.CANCELING, GoalEvent.SUCCEED): GoalState.SUCCEEDED,
    (GoalState.CANCELING, GoalEvent.CANCELED): GoalState.CANCELED,
    (GoalState.CANCELING, GoalEvent.ABORT): GoalState.ABORTED,
}
"""All that is legal."""


class IllegalTransition(Exception):
    """An event that cannot come in a state."""


def after(state: GoalState, event: GoalEvent) -> GoalState:
    """The state that follows.

    Raises:
        IllegalTransition: the event cannot come in this state.
    """
    try:
        return TRANSITIONS[state, event]
    except KeyError:
        raise IllegalTransition(f"a goal that is {state.name} cannot {event.value}") from None


def state_of(number: int) -> GoalState:
    """The state of a number; of one that means none, UNKNOWN."""
    return GoalState(number) if 0 <= number <= GoalState.ABORTED else GoalState.UNKNOWN


ID_LENGTH = 16
"""Of a goal's id, bytes."""


def new_goal_id() -> bytes:
    """A random UUID (of version 4)."""
    number = bytearray(os.urandom(ID_LENGTH))
    number[6] = number[6] & 0x0F | 0x40
    number[8] = number[8] & 0x3F | 0x80
    return bytes(number)


def id_text(goal_id: bytes) -> str:
    """A goal's id as people write UUIDs: `6f1c3e5a-…`."""
    text = goal_id.hex()
    return "-".join((text[:8], text[8:12], text[12:16], text[16:20], text[20:]))


def id_of(text: str) -> bytes | None:
    """The id that a text spells, with or without `-`; None for a text that spells none."""
    try:
        found = bytes.fromhex(text.replace("-", ""))
    except ValueError:
        return None
    return found if len(found) == ID_LENGTH else None
