"""Sending goals to an action and following them, as any Zenoh client does."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Literal

import msgspec
import zenoh

from robo.errors import ActionError, ActionTimeout
from robo.tools.offers import Offer, list_actions
from robo.wire import codec, queries
from robo.wire.goals import GoalState, id_of, id_text, new_goal_id, state_of
from robo.wire.keys import action_key
from robo.wire.long_query import Gone, LongQuery
from robo.wire.queries import Fault

_LOOK = 0.5
"""How often one looks whether an action is still executed while nothing is heard, s."""


class Outcome(msgspec.Struct, frozen=True):
    """How a goal has ended."""

    goal_id: str
    status: str
    """SUCCEEDED, CANCELED or ABORTED."""
    message: str
    """Why it was aborted."""
    result: Any


def ask(
    session: zenoh.Session, action: str, part: Literal["send_goal", "cancel_goal"], request: object, timeout: float
) -> Any:
    """Ask an action's server; request and answer are plain data.

    Raises:
        ActionError: it cannot do that.
        ActionTimeout: it does not answer.
    """
    replies = session.get(
        action_key(action, part),
        payload=msgspec.msgpack.encode(request),
        encoding=codec.MSGPACK,
        timeout=timeout,
        **queries.OF_ONE,
    )
    answer = queries.first_answer(replies)
    if isinstance(answer, Fault):
        raise ActionError(f"action {action}: {answer.error}: {answer.message}")
    if answer is None:
        raise ActionTimeout(f"action {action}: its server did not answer within {timeout:g} s")
    return msgspec.msgpack.decode(answer.payload.to_bytes())


def cancel(session: zenoh.Session, action: str, goal_id: str | None, timeout: float) -> list[str]:
    """Cancel a goal, or all. Returns the ids of those that are being canceled.

    Raises:
        ActionError: it is no id, the goal is not known, has ended, or cannot be canceled.
        ActionTimeout: the server does not answer.
    """
    wanted = bytes(16) if goal_id is None else id_of(goal_id)
    if wanted is None:
        raise ActionError(f"{goal_id} is no id of a goal; it looks like {id_text(bytes(range(16)))}")
    answer = ask(session, action, "cancel_goal", {"goal_info": {"goal_id": {"uuid": wanted}}}, timeout)
    why = {1: "cannot be canceled", 2: "is not known", 3: "has ended already"}.get(answer["return_code"])
    if why is not None:
        raise ActionError(f"action {action}: goal {goal_id or 'under way'} {why}")
    return [id_text(info["goal_id"]["uuid"]) for info in answer["goals_canceling"]]


class Sending:
    """One goal: sent, followed and waited for."""

    def __init__(self, session: zenoh.Session, action: Offer, timeout: float) -> None:
        """
        Args:
            session: the network.
            action: whose goal it is.
            timeout: how long the server may take to answer, s.
        """
        self.id = new_goal_id()
        self._session = session
        self._action = action
        self._timeout = timeout

    def follow(self, told: Callable[[object], None]) -> zenoh.Subscriber[None]:
        """Hand over the feedback on this goal, as plain data, on one of Zenoh's threads."""

        def take(sample: zenoh.Sample) -> None:
            message = codec.decode_any(sample.payload.to_bytes())
            if isinstance(message, dict) and message.get("goal_id") == {"uuid": self.id}:
                told(message.get("feedback"))

        return self._session.declare_subscriber(action_key(self._action.key, "feedback"), take)

    def send(self, goal: object) -> None:
        """Have the server take it.

        Raises:
            ActionError: it does not; says why.
            ActionTimeout: it does not answer.
        """
        request = {"goal_id": {"uuid": self.id}, "goal": goal}
        answer = ask(self._session, self._action.key, "send_goal", request, self._timeout)
        if not answer["accepted"]:
            raise ActionError(f"action {self._action.key} refuses the goal: {answer.get('message', '')}")

    def wait(self, timeout: float | None) -> Outcome:
        """Wait until it has ended.

        Raises:
            ActionTimeout: it has not in time.
            ActionError: its server has gone.
        """
        end = None if timeout is None else time.monotonic() + timeout
        woken = threading.Event()
        name = f"action {self._action.key}: goal {id_text(self.id)}"
        request = msgspec.msgpack.encode({"goal_id": {"uuid": self.id}})
        key = action_key(self._action.key, "get_result")
        query = LongQuery(self._session, key, request, codec.MSGPACK, woken.set, time.monotonic)
        while True:
            woken.clear()
            try:
                answer = query.look()
            except Gone:
                raise ActionError(f"{name}: its server has gone, and what became of the goal is not known") from None
            if isinstance(answer, Fault):
                raise ActionError(f"{name}: {answer.error}: {answer.message}")
            if answer is not None:
                return self._outcome(msgspec.msgpack.decode(answer.payload.to_bytes()), name)
            if end is not None and time.monotonic() >= end:
                raise ActionTimeout(f"{name}: no result within {timeout:g} s")
            if not woken.wait(_LOOK) and not self._is_executed():
                query.lose()

    def _is_executed(self) -> bool:
        return any(one.key == self._action.key for one in list_actions(self._session, self._timeout))

    def _outcome(self, response: Any, name: str) -> Outcome:
        status = state_of(response["status"])
        if status == GoalState.UNKNOWN:
            raise ActionError(f"{name}: its server has started again and does not know it")
        return Outcome(id_text(self.id), status.name, response.get("message", ""), response["result"])
