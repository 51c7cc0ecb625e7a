"""Sending goals to an action and following them, as any Zenoh client does."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Literal, TypeVar

import msgspec
import zenoh

from robo.errors import ActionError, ActionTimeout
from robo.text.readable import readable
from robo.tools import replies
from robo.tools.long_calls import answer_of
from robo.tools.offers import Offer, list_actions
from robo.wire import codec, doors, queries
from robo.wire.goals import GoalState, id_of, id_text, new_goal_id, state_of
from robo.wire.keys import action_key
from robo.wire.long_query import Gone
from robo.wire.queries import Fault
from robo.wire.targets import OF_ONE
from robo_messages.action import UUID, CancelGoal

T = TypeVar("T")


class Outcome(msgspec.Struct, frozen=True):
    """How a goal has ended."""

    goal_id: str
    status: str
    """SUCCEEDED, CANCELED or ABORTED."""
    message: str
    """Why it was aborted."""
    result: Any


class Told(msgspec.Struct, frozen=True):
    """Feedback on a goal, whatever its type."""

    goal_id: UUID
    feedback: Any


class _Taken(msgspec.Struct, frozen=True):
    """Whether a server has taken a goal."""

    accepted: bool
    message: str = ""


class _Ended(msgspec.Struct, frozen=True):
    """What a goal came to."""

    status: int
    result: Any = None
    message: str = ""


def ask(
    session: zenoh.Session,
    action: str,
    part: Literal["send_goal", "cancel_goal"],
    request: object,
    kind: type[T],
    timeout: float,
) -> T:
    """Ask an action's server; the request is plain data, and the answer of some kind.

    Raises:
        ActionError: it cannot do that.
        ActionTimeout: it does not answer.
    """
    answers = session.get(
        action_key(action, part),
        payload=msgspec.msgpack.encode(request),
        encoding=codec.MSGPACK,
        timeout=timeout,
        **OF_ONE,
    )
    answer = queries.first_answer(answers)
    if isinstance(answer, Fault):
        raise ActionError(f"action {action}: {answer.error}: {answer.message}")
    if answer is None:
        doors.check(session, action.partition("/")[0], timeout)
        raise ActionTimeout(f"action {action}: its server did not answer within {timeout:g} s")
    return _read(answer, kind, action)


def _read(sample: zenoh.Sample, kind: type[T], action: str) -> T:
    """What an action's server answers.

    Raises:
        ActionError: it is no such answer.
    """
    try:
        return msgspec.convert(codec.decode_any(sample.payload.to_bytes()), readable(kind))
    except (codec.Malformed, msgspec.ValidationError) as error:
        raise ActionError(f"action {action}: its server answers what cannot be read: {error}") from None


def cancel(session: zenoh.Session, action: str, goal_id: str | None, timeout: float) -> list[str]:
    """Cancel a goal, or all. Returns the ids of those that are being canceled.

    Raises:
        ActionError: it is no id, the goal is not known, has ended, or cannot be canceled.
        ActionTimeout: the server does not answer.
    """
    wanted = bytes(16) if goal_id is None else id_of(goal_id)
    if wanted is None:
        raise ActionError(f"{goal_id} is no id of a goal; it looks like {id_text(bytes(range(16)))}")
    answer = ask(
        session, action, "cancel_goal", {"goal_info": {"goal_id": {"uuid": wanted}}}, CancelGoal.Response, timeout
    )
    why = {1: "cannot be canceled", 2: "is not known", 3: "has ended already"}.get(answer.return_code)
    if why is not None:
        raise ActionError(f"action {action}: goal {goal_id or 'under way'} {why}")
    return [id_text(info.goal_id.uuid) for info in answer.goals_canceling]


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

    def follow(self, told: Callable[[object], None]) -> Callable[[], None]:
        """Hand over the feedback on this goal, as plain data, on one of Zenoh's threads.

        Returns:
            What ends it: all that has come by then has been handed over before it returns. A server publishes feedback
            before it answers with the result, and the thread that hands over may be late.
        """
        over = threading.Event()

        def take(sample: zenoh.Sample) -> None:
            message = replies.read(sample, Told)
            if message is not None and message.goal_id.uuid == self.id:
                told(message.feedback)

        key = action_key(self._action.key, "feedback")
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.Callback(take, over.set))

        def end() -> None:
            subscriber.undeclare()
            over.wait()

        return end

    def send(self, goal: object) -> None:
        """Have the server take it.

        Raises:
            ActionError: it does not; says why.
            ActionTimeout: it does not answer.
        """
        request = {"goal_id": {"uuid": self.id}, "goal": goal}
        answer = ask(self._session, self._action.key, "send_goal", request, _Taken, self._timeout)
        if not answer.accepted:
            raise ActionError(f"action {self._action.key} refuses the goal: {answer.message}")

    def wait(self, timeout: float | None) -> Outcome:
        """Wait until it has ended.

        Raises:
            ActionTimeout: it has not in time.
            ActionError: its server has gone.
        """
        name = f"action {self._action.key}: goal {id_text(self.id)}"
        request = msgspec.msgpack.encode({"goal_id": {"uuid": self.id}})
        key = action_key(self._action.key, "get_result")
        try:
            answer = answer_of(self._session, key, request, codec.MSGPACK, self._is_executed, timeout)
        except Gone:
            raise ActionError(f"{name}: its server has gone, and what became of the goal is not known") from None
        if isinstance(answer, Fault):
            raise ActionError(f"{name}: {answer.error}: {answer.message}")
        if answer is None:
            raise ActionTimeout(f"{name}: no result within {timeout:g} s")
        return self._outcome(_read(answer, _Ended, self._action.key), name)

    def _is_executed(self) -> bool:
        return any(one.key == self._action.key for one in list_actions(self._session, self._timeout))

    def _outcome(self, ended: _Ended, name: str) -> Outcome:
        status = state_of(ended.status)
        if status == GoalState.UNKNOWN:
            raise ActionError(f"{name}: its server has started again and does not know it")
        return Outcome(id_text(self.id), status.name, ended.message, ended.result)
