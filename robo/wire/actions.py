"""The types in which an action travels: made from its goal, result and feedback, and named as ROS names them.

`send_goal` and `get_result` are services, `feedback` is a topic; `cancel_goal` and `status` have the same types for
all actions (`robo_messages.action`).
"""

from typing import Any

import msgspec

import robo_messages
from robo.errors import ContractError
from robo_messages import Message
from robo_messages._types import Int8
from robo_messages.action import UUID, action_type_name
from robo_messages.std import Time


class ActionTypes(msgspec.Struct, frozen=True):
    """All types of one action."""

    name: str
    """For example `example/Fibonacci`."""
    goal: type[Message]
    result: type[Message]
    feedback: type[Message]
    send_goal_request: Any
    """`goal_id`, `goal`."""
    send_goal_response: Any
    """`accepted`, `stamp`, and `message`: why not."""
    get_result_request: Any
    """`goal_id`."""
    get_result_response: Any
    """`status`, `result`, and `message`: why it was aborted."""
    feedback_message: Any
    """`goal_id`, `feedback`."""


_made: dict[tuple[type[Message], type[Message], type[Message]], ActionTypes] = {}


def action_types(goal: type[Message], result: type[Message], feedback: type[Message]) -> ActionTypes:
    """The types of an action, from its three parts.

    Raises:
        ContractError: they are not named as one action's, or the result cannot be made of nothing.
        robo_messages.UnknownType: one of them was never registered.
    """
    parts = goal, result, feedback
    if parts not in _made:
        _made[parts] = _make(*parts)
    return _made[parts]


def _make(goal: type[Message], result: type[Message], feedback: type[Message]) -> ActionTypes:
    try:
        name = action_type_name(goal, result, feedback)
    except ValueError as error:
        raise ContractError(str(error)) from None
    try:
        result()
    except TypeError as error:
        text = f"{name}_Result: {error}; give each field a default, for a goal that is aborted has nothing to tell"
        raise ContractError(text) from None

    def made(part: str, *fields: tuple[Any, ...]) -> Any:
        stem = name.rpartition("/")[2]
        type_: Any = msgspec.defstruct(f"{stem}_{part}", fields, bases=(Message,), module=__name__)
        return robo_messages.message(f"{name}_{part}")(type_)

    goal_id, message = ("goal_id", UUID), ("message", str, "")
    stamp = "stamp", Time, msgspec.field(default_factory=Time)
    final = "result", result, msgspec.field(default_factory=result)
    return ActionTypes(
        name,
        goal,
        result,
        feedback,
        made("SendGoal_Request", goal_id, ("goal", goal)),
        made("SendGoal_Response", ("accepted", bool, False), stamp, message),
        made("GetResult_Request", goal_id),
        made("GetResult_Response", ("status", Int8, 0), final, message),
        made("FeedbackMessage", goal_id, ("feedback", feedback)),
    )
