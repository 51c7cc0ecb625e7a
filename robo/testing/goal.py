"""A goal that a test has sent to a node under test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import msgspec

import robo_messages
from robo.errors import ActionError
from robo.testing.bench import Bench, Seat
from robo.testing.call import Call, StillWaiting, decoded, who_waits
from robo.wire import codec
from robo.wire.actions import ActionTypes
from robo.wire.goals import GoalState, id_text, new_goal_id, state_of
from robo.wire.keys import action_key
from robo.wire.queries import read_fault
from robo_messages import Message
from robo_messages.action import UUID, CancelGoal, GoalInfo


class Goal:
    """What `send_goal` gives a test.

    Each of its methods returns when all is done that is to be done now; `clock.advance` lets the handler go on.
    """

    def __init__(self, types: ActionTypes, action: str, bench: Bench, seat: Seat, number: int) -> None:
        self._types = types
        self._action = action
        self._bench = bench
        self._seat = seat
        self._number = number
        self._id = new_goal_id()
        self._result: Call | None = None

    @property
    def goal_id(self) -> str:
        """Its id, as people write UUIDs."""
        return id_text(self._id)

    @property
    def feedback(self) -> list[Any]:
        """What the node has told so far, or since the node's `clear`, in order."""
        self._bench.settle()
        told = (message for message in self._sent("feedback") if message.goal_id.uuid == self._id)
        return [message.feedback for message in told]

    @property
    def status(self) -> GoalState:
        """How far the goal has come."""
        self._bench.settle_quietly()
        response = self._response()
        if response is not None:
            return state_of(response.status)
        told = GoalState.ACCEPTED
        for message in self._sent("status"):
            for one in message.status_list:
                told = state_of(one.status) if one.goal_info.goal_id.uuid == self._id else told
        return told

    def cancel(self) -> bool:
        """Ask the node to cancel it. Returns whether it does so; False where the goal had ended already.

        Raises:
            ActionError: it refuses.
        """
        response = CancelGoal.Response
        answer = self._call("cancel_goal", CancelGoal.Request(GoalInfo(UUID(self._id)))).result()
        if answer.return_code == response.ERROR_REJECTED:
            raise ActionError(f"{self._name}: the node does not cancel it", GoalState.EXECUTING)
        return bool(answer.return_code == response.ERROR_NONE)

    def result(self) -> Any:
        """The result.

        Raises:
            StillWaiting: the goal has not ended, and does so only when time goes on.
            ActionError: it was canceled or aborted; says why.
        """
        self._bench.settle_quietly()
        response = self._response()
        if response is None:
            text = f"{self._name} has not ended; let time pass with clock.advance() before result()"
            raise StillWaiting(f"{text}. {who_waits(self._bench)}")
        status = state_of(response.status)
        if status != GoalState.SUCCEEDED:
            told = ": ".join(part for part in (status.name.lower(), response.message) if part)
            raise ActionError(f"{self._name}: {told}", status, response.result)
        self._bench.complain()
        return response.result

    def send(self, goal: Message) -> None:
        """Have the node take it.

        Raises:
            ActionError: it refuses.
            TypeError: it is no goal of this action.
        """
        if not isinstance(goal, self._types.goal):
            wanted = robo_messages.type_name(self._types.goal)
            raise TypeError(f"action {self._action} takes {wanted}, not {type(goal).__name__}")
        answer = self._call("send_goal", self._types.send_goal_request(UUID(self._id), goal)).result()
        if not answer.accepted:
            raise ActionError(f"action {self._action} refuses the goal: {answer.message}")
        self._result = self._call("get_result", self._types.get_result_request(UUID(self._id)))
        self._bench.settle()

    @property
    def _name(self) -> str:
        return f"action {self._action}: goal {self.goal_id}"

    def _response(self) -> Any:
        """The answer to the question for the result; None before it is there."""
        reply = self._result.answer if self._result is not None else None
        if reply is None:
            return None
        if reply.ok is None:
            fault = read_fault(reply)
            raise ActionError(f"{self._name}: {fault.message if fault is not None else 'no answer'}")
        return decoded(reply.ok)

    def _call(self, part: Literal["send_goal", "cancel_goal", "get_result"], request: Message) -> Call:
        key, payload = action_key(self._action, part), msgspec.msgpack.encode(request)
        return Call.begin(self._bench, self._seat, self._number, key, payload, codec.encoding_of(type(request)))

    def _sent(self, part: Literal["feedback", "status"]) -> Iterator[Any]:
        key = action_key(self._action, part)
        for sent in list(self._seat.session.sent):
            if sent.key == key:
                yield robo_messages.decode(sent.payload, robo_messages.find_type(sent.type))
