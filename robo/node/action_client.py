"""A node's live client of an action: what `ActionClient` becomes, and a goal that it has sent."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any, Generic, TypeVar

import msgspec
import zenoh

import robo_messages
from robo.errors import ActionError, ActionTimeout
from robo.node.clock import Clock
from robo.node.services import Presence
from robo.node.turn import paused
from robo.wire import codec, queries
from robo.wire.actions import ActionTypes
from robo.wire.codec import Decoder, Malformed
from robo.wire.goals import GoalState, id_text, new_goal_id, state_of
from robo.wire.keys import ActionPart, EndpointToken, action_key
from robo.wire.long_query import Gone, LongQuery
from robo.wire.queries import Fault
from robo.wire.targets import OF_ONE
from robo_messages import Message
from robo_messages.action import UUID, CancelGoal, GoalInfo

G = TypeVar("G", bound=Message)
R = TypeVar("R", bound=Message)
F = TypeVar("F", bound=Message)

MOST_LISTENERS = 64
"""Goals that have ended whose feedback may still come: it waits behind the node's other callbacks."""


class ActionCaller(Generic[G, R, F]):
    """Sends goals to one action."""

    def __init__(
        self, session: zenoh.Session, token: EndpointToken, types: ActionTypes, timeout: float, clock: Clock
    ) -> None:
        """
        Args:
            session: the network.
            token: what announces it.
            types: of the action.
            timeout: how long the server may take to answer, s.
            clock: by which results are waited for.
        """
        self.key = token.topic
        self.announced = token
        self._session = session
        self._types = types
        self._timeout = timeout
        self._clock = clock
        self._numbers = itertools.count(1)
        self._under_way: dict[bytes, SentGoal[R, F]] = {}
        self._listeners: dict[bytes, Callable[[F], object]] = {}
        """Callbacks for feedback, by goal: of those under way and the last that have ended."""
        self._ended: deque[bytes] = deque()
        self._presence = Presence(session, action_key(self.key, "send_goal"), self._lose)
        with ExitStack() as made:
            made.callback(self._presence.close)
            self._token = session.liveliness().declare_token(token.key())
            made.pop_all()

    def __call__(self, goal: G, feedback: Callable[[F], object] | None = None, timeout: float | None = None) -> R:
        """Send a goal and wait for its result; other callbacks of the node run meanwhile.

        However the wait ends without a result, be it that it took too long or that this node is stopping, the goal
        is canceled.

        Args:
            goal: what to do.
            feedback: a callback for what the server tells meanwhile.
            timeout: how long it may take, s; by default as long as it takes.

        Raises:
            ActionTimeout: there is no server, it does not answer, or there is no result in time.
            ActionError: the goal is refused, was canceled or aborted, or the server has gone.
            TypeError: it is no goal of this action.
        """
        sent = self.send_goal(goal, feedback)
        try:
            return sent.result(timeout)
        except BaseException:
            if not sent.done():
                sent.renounce()
            raise

    def send_goal(self, goal: G, feedback: Callable[[F], object] | None = None) -> SentGoal[R, F]:
        """Send a goal, and return as soon as the server has taken it.

        Raises:
            ActionTimeout: there is no server, or it does not answer.
            ActionError: the server refuses the goal; says why.
            TypeError: it is no goal of this action.
        """
        if not isinstance(goal, self._types.goal):
            wanted = robo_messages.type_name(self._types.goal)
            raise TypeError(f"action {self.key} takes {wanted}, not {type(goal).__name__}")
        sent: SentGoal[R, F] = SentGoal(self, new_goal_id(), self._types, self._clock.wall)
        self._under_way[sent.id] = sent
        if feedback is not None:
            self._listeners[sent.id] = feedback  # some may come before the answer
        try:
            with paused():
                request = self._types.send_goal_request(UUID(sent.id), goal)
                answer = self.ask("send_goal", request, self._types.send_goal_response)
        except ActionTimeout:
            sent.renounce()  # it may have been taken all the same
            self.forget(sent)
            raise
        except BaseException:
            self.forget(sent)
            raise
        if not answer.accepted:
            self.forget(sent)
            raise ActionError(f"action {self.key} refuses the goal: {answer.message or 'it does not say why'}")
        sent.begin(self._session)
        if not self._presence.is_there:  # it has left meanwhile
            sent.lose()
        return sent

    def wait_for_server(self, timeout: float) -> bool:
        """Wait until there is a server. Returns whether there is one, within `timeout` seconds."""
        with paused():
            return self._presence.wait(timeout)

    def abandon(self) -> None:
        """Let those that wait for a server or a result fail at once: the node is told to stop."""
        self._presence.abandon()
        for sent in list(self._under_way.values()):
            sent.wake()

    @property
    def is_abandoned(self) -> bool:
        """Whether nobody is to wait any more."""
        return self._presence.abandoned

    def close(self) -> None:
        """Leave the network."""
        self._token.undeclare()
        self._presence.close()

    def take_feedback(self, message: Any) -> None:
        """Hand feedback to whoever has sent its goal; a callback of the node."""
        listener = self._listeners.get(message.goal_id.uuid)
        if listener is not None:
            listener(message.feedback)

    def forget(self, sent: SentGoal[R, F]) -> None:
        """Expect no more of a goal, but for feedback that has come and waits for the node's turn."""
        if self._under_way.pop(sent.id, None) is not None and sent.id in self._listeners:
            self._ended.append(sent.id)
            if len(self._ended) > MOST_LISTENERS:
                del self._listeners[self._ended.popleft()]

    def _lose(self) -> None:
        for sent in list(self._under_way.values()):
            sent.lose()

    def tell(self, part: ActionPart, request: Message) -> None:
        """Ask the server for something and wait for no answer."""
        with suppress(zenoh.ZError):
            self._get(part, request, self._timeout, zenoh.handlers.Callback(_nothing, indirect=False))

    def ask(self, part: ActionPart, request: Message, response: Any) -> Any:
        """Ask the server for something.

        Raises:
            ActionTimeout: there is no server, or it does not answer.
            ActionError: it cannot do that.
        """
        begin = time.monotonic()
        if not self._presence.wait(self._timeout):
            raise ActionTimeout(f"action {self.key}: there is no server (waited {self._timeout:g} s)")
        if self.is_abandoned and part == "send_goal":
            raise ActionTimeout(f"action {self.key}: nothing is sent, this node is stopping")
        left = max(self._timeout - (time.monotonic() - begin), 0.001)
        asked = time.monotonic()
        answer = queries.first_answer(self._get(part, request, left))
        if isinstance(answer, Fault):
            raise ActionError(f"action {self.key}: {answer.error}: {answer.message}")
        if answer is not None:
            return decoded(self.key, answer, response)
        if time.monotonic() - asked < left * 0.9:
            raise ActionTimeout(f"action {self.key}: its server, or the link to it, went away without an answer")
        raise ActionTimeout(f"action {self.key}: its server did not answer within {self._timeout:g} s")

    def _get(self, part: ActionPart, request: Message, timeout: float, handler: Any = None) -> Any:
        return self._session.get(
            action_key(self.key, part),
            handler,
            payload=msgspec.msgpack.encode(request),
            attachment=codec.pack_attachment(next(self._numbers), time.time_ns()),
            encoding=codec.encoding_of(type(request)),
            timeout=timeout,
            **OF_ONE,
        )


class SentGoal(Generic[R, F]):
    """A goal that a server has taken."""

    def __init__(
        self,
        caller: ActionCaller[Any, R, F],
        goal_id: bytes,
        types: ActionTypes,
        clock: Clock,
    ) -> None:
        self.id = goal_id
        """Its id, 16 bytes."""
        self._caller = caller
        self._types = types
        self._clock = clock
        self._woken = threading.Event()
        self._lock = threading.Lock()
        self._query: LongQuery | None = None
        self._status: GoalState | None = None
        self._result: R | None = None
        self._problem = ""

    @property
    def goal_id(self) -> str:
        """Its id, as people write UUIDs."""
        return id_text(self.id)

    @property
    def status(self) -> GoalState | None:
        """How it has ended: SUCCEEDED, CANCELED or ABORTED, UNKNOWN where its server has gone; None before."""
        self._look()
        return self._status

    def done(self) -> bool:
        """Whether it has ended."""
        return self.status is not None

    def result(self, timeout: float | None = None) -> R:
        """Wait for the result; other callbacks of the node run meanwhile.

        Args:
            timeout: how long, s; by default as long as it takes. The goal goes on where that is too short.

        Raises:
            ActionTimeout: there is none in time.
            ActionError: the goal was canceled or aborted, its server has gone, or this node is stopping.
        """
        until = math.inf if timeout is None else self._clock.monotonic() + timeout
        with paused():
            while True:
                jumps = self._clock.jumps
                self._woken.clear()
                self._look()
                if self._status is not None or self._caller.is_abandoned:
                    break
                if self._clock.monotonic() >= until:
                    raise ActionTimeout(f"{self._name}: no result within {timeout:g} s")
                self._clock.wait(self._woken, min(until, self._look_again_at()), jumps)
        if self._status == GoalState.SUCCEEDED and self._result is not None:
            return self._result
        raise self._error()

    def cancel(self) -> bool:
        """Ask the server to cancel it. Returns whether it does so; False for a goal that has ended already.

        Raises:
            ActionTimeout: the server has gone, or does not answer.
            ActionError: it refuses: the action's handler cannot be interrupted.
        """
        response = CancelGoal.Response
        with paused():
            answer = self._caller.ask("cancel_goal", self._cancel_request(), response)
        if answer.return_code == response.ERROR_REJECTED:
            raise ActionError(f"{self._name}: its server does not cancel it", GoalState.EXECUTING)
        return bool(answer.return_code == response.ERROR_NONE)

    def renounce(self) -> None:
        """Have it canceled, without waiting for that."""
        self._caller.tell("cancel_goal", self._cancel_request())

    def begin(self, session: zenoh.Session) -> None:
        """Ask for the result, now that the server knows the goal."""
        request = self._types.get_result_request(UUID(self.id))
        ask = partial(LongQuery, session, action_key(self._caller.key, "get_result"))
        payload, encoding = msgspec.msgpack.encode(request), codec.encoding_of(type(request))
        with self._lock:
            self._query = ask(payload, encoding, self.wake, self._clock.monotonic)

    def lose(self) -> None:
        """Take note that there is no server just now."""
        query = self._query
        if query is not None:
            query.lose()

    def wake(self) -> None:
        """Let whoever waits look."""
        self._woken.set()
        self._clock.wake()

    @property
    def _name(self) -> str:
        return f"action {self._caller.key}: goal {self.goal_id}"

    def _cancel_request(self) -> CancelGoal.Request:
        return CancelGoal.Request(GoalInfo(UUID(self.id)))

    def _look_again_at(self) -> float:
        return self._query.look_again_at if self._query is not None else math.inf

    def _look(self) -> None:
        """Take note of the result, if it is there."""
        with self._lock:
            if self._status is not None or self._query is None:
                return
            try:
                answer = self._query.look()
            except Gone:
                self._settle(GoalState.UNKNOWN, "its server has gone, and what became of the goal is not known")
                return
            if isinstance(answer, Fault):
                self._settle(GoalState.UNKNOWN, f"{answer.error}: {answer.message}")
            elif answer is not None:
                self._take(answer)

    def _take(self, answer: zenoh.Sample) -> None:
        try:
            response = decoded(self._caller.key, answer, self._types.get_result_response)
        except ActionError as error:
            self._settle(GoalState.UNKNOWN, str(error))
            return
        self._result = response.result
        status = state_of(response.status)
        if status == GoalState.UNKNOWN:
            self._settle(status, "its server has started again and does not know it, or it ended too long ago")
        else:
            self._settle(status, response.message)

    def _settle(self, status: GoalState, problem: str) -> None:
        self._status, self._problem = status, problem
        self._caller.forget(self)
        self.wake()  # others may wait for it, too

    def _error(self) -> ActionError:
        """Why there is no result."""
        if self._status is None:
            return ActionError(f"{self._name}: not waited for, this node is stopping")
        what = {GoalState.CANCELED: "canceled", GoalState.ABORTED: "aborted"}.get(self._status, "")
        told = ": ".join(part for part in (what, self._problem) if part)
        return ActionError(f"{self._name}: {told}", self._status, self._result)


def decoded(action: str, sample: zenoh.Sample, type_: Any) -> Any:
    """An answer of an action's server.

    Raises:
        ActionError: it cannot be read.
    """
    try:
        return Decoder(type_).decode(sample.payload.to_bytes(), str(sample.encoding))
    except Malformed as reason:
        raise ActionError(f"action {action}: the answer is {reason}") from None


def _nothing(_: object) -> None:
    """What becomes of an answer that nobody waits for."""
