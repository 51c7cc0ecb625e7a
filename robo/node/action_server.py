"""A node's live end of an action: what `@action` becomes.

Goals, cancelling and results are asked for on one queryable, feedback and status are topics. One thread runs the
handler: each of its steps, from one `yield` to the next, takes the node's turn as a callback does, and between two of
them other callbacks run. Whoever asks for a result is answered when the goal ends.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

import zenoh

from robo.node.actions import GoalCanceled
from robo.node.clock import Clock
from robo.node.ending import NodeStopping
from robo.node.goals import Goal, Goals, Refused
from robo.node.handler import Handler, Handling
from robo.node.topics import Publish
from robo.node.turn import Turn, name_of, taking
from robo.wire import codec, queries
from robo.wire.actions import ActionTypes
from robo.wire.codec import Decoder, Malformed
from robo.wire.goals import GoalState
from robo.wire.keys import EndpointToken, action_key
from robo.wire.queries import Fault, QueryLoop
from robo_messages import Message
from robo_messages.action import CancelGoal, GoalStatusArray


class ActionServer:
    """Takes goals, runs the handler, tells how far they have come and what they came to."""

    def __init__(
        self,
        session: zenoh.Session,
        token: EndpointToken,
        types: ActionTypes,
        handling: Handling,
        turn: Turn,
        clock: Clock,
        publish_feedback: Publish[Any],
        publish_status: Publish[GoalStatusArray],
        on_error: Callable[[BaseException], None],
    ) -> None:
        """
        Args:
            session: the network.
            token: what announces it.
            types: of the action.
            handling: what is done with goals.
            turn: the node's.
            clock: by which the handler is run, and goals are stamped.
            publish_feedback, publish_status: where progress is told.
            on_error: is told what the handler raised; clients get it as well.
        """
        self.key = key = token.topic
        self.announced = token
        self._types = types
        self._handling = handling
        self._turn = turn
        self._clock = clock
        self._status = publish_status
        self._on_error = on_error
        cancelable = handling.yields or handling.begin is not None
        self._goals = Goals(handling.policy, cancelable=cancelable, now=clock.wall.monotonic)
        self._telling = threading.Lock()
        self._woken = threading.Event()
        self._handler = Handler(handling, types, self._goals, turn, clock, self._woken, publish_feedback)
        self._stopping = False
        self._answers: dict[str, Callable[[zenoh.Query, str], bool | None]] = {
            action_key(key, "send_goal"): self._on_send_goal,
            action_key(key, "cancel_goal"): self._on_cancel_goal,
            action_key(key, "get_result"): self._on_get_result,
        }
        self._worker = threading.Thread(target=turn.guarded(self._run), name=f"robo-{key}", daemon=True)
        self._loop = QueryLoop(session, action_key(key, "*"), self._answer, acts=list(self._answers))
        with ExitStack() as made:
            made.callback(self._loop.stop, 0.0)
            self._loop.start()
            self._token = session.liveliness().declare_token(token.key())
            made.pop_all()

    @property
    def taken(self) -> int:
        """Goals taken so far."""
        return self._goals.taken

    def start(self) -> None:
        """Begin to run goals."""
        self._clock.expect(self._worker)
        self._worker.start()

    def stop(self, timeout: float) -> bool:
        """Take no more goals, and abort those there are. Returns whether the handler came back within `timeout` s."""
        end = time.monotonic() + timeout
        self._token.undeclare()
        self.interrupt()
        self._stopping = True
        self._wake()
        returned = True
        if self._worker.ident and self._worker is not threading.current_thread():
            self._worker.join(timeout)
            returned = not self._worker.is_alive()
        self._handler.give_up()
        self._wake()
        given_up = self._goals.give_up("its node has stopped without waiting for it")
        if given_up is not None:
            self._changed([given_up])
        return self._loop.stop(max(0.0, end - time.monotonic())) and returned

    def interrupt(self) -> None:
        """Take no more goals, and have the handler stop."""
        self._changed(self._goals.close("its node is stopping"))
        self._wake()

    # -- what clients ask --------------------------------------------------------------------------------------------

    def _answer(self, query: zenoh.Query, key: str) -> bool | None:
        try:
            return self._answers[key](query, key)
        except Malformed as reason:
            queries.reply_error(query, Fault.of(reason))
            return False

    def _on_send_goal(self, query: zenoh.Query, key: str) -> None:
        request = _read(query, self._types.send_goal_request)
        response = self._types.send_goal_response
        goal_id, stamp = request.goal_id.uuid, self._clock.now()
        try:
            self._goals.check(goal_id)
            self._ask_node(request.goal)
            _, ended = self._goals.take(goal_id, request.goal, stamp)
        except Refused as reason:
            _reply(query, key, response(message=str(reason)))
            return
        except BaseException as error:
            queries.reply_error(query, Fault.of(error))
            self._on_error(error)
            return
        _reply(query, key, response(accepted=True, stamp=stamp))
        self._changed(ended)
        self._wake()

    def _ask_node(self, goal: Message) -> None:
        handling = self._handling
        if reason := handling.why_not():
            raise Refused(reason)
        if handling.accept is not None:
            with taking(self._turn, name_of(handling.accept), self._loop.spare):
                try:
                    handling.accept(goal)
                except ValueError as error:
                    raise Refused(str(error)) from None

    def _on_cancel_goal(self, query: zenoh.Query, key: str) -> None:
        request = _read(query, CancelGoal.Request)
        response, ended = self._goals.cancel(request.goal_info)
        _reply(query, key, response)
        if response.goals_canceling:
            self._changed(ended)
            self._wake()

    def _on_get_result(self, query: zenoh.Query, key: str) -> bool:
        request = _read(query, self._types.get_result_request)
        goal = self._goals.find(request.goal_id.uuid)
        try:
            if goal is not None and self._goals.wait_for(goal, partial(self._tell_result, query, key)):
                return True
        except Refused as reason:
            queries.reply_error(query, Fault("Refused", str(reason)))
            return False
        _reply(query, key, self._result_of(goal))
        return False

    def _result_of(self, goal: Goal | None) -> Message:
        made: Message
        if goal is None:
            made = self._types.get_result_response(GoalState.UNKNOWN, message="there is no such goal, or no longer")
        else:
            result = goal.result if goal.result is not None else self._types.result()
            made = self._types.get_result_response(goal.state, result, goal.message)
        return made

    def _tell_result(self, query: zenoh.Query, key: str, goal: Goal) -> None:
        _reply(query, key, self._result_of(goal))
        query.drop()

    def _changed(self, ended: Iterable[Goal] = ()) -> None:
        """Tell how far the goals have come, and those who wait that some have ended."""
        for goal, tell in self._goals.take_waiting(ended):
            tell(goal)
        with self._telling, suppress(zenoh.ZError):  # what is told later is newer; the network may have gone
            self._status(self._goals.status())

    def look(self) -> None:
        """See whether goals may still be handled, and interrupt the one under way if not."""
        self._goals.interrupt(self._handling.why_not())
        self._wake()

    def _wake(self) -> None:
        self._woken.set()
        self._clock.wake()
        self._handler.interrupt()

    # -- the thread that runs the handler ----------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            self._woken.clear()
            goal = self._goals.next()
            if goal is not None:
                self._changed()
                self._execute(goal)
            elif self._stopping:
                return
            else:
                self._clock.wait(self._woken, math.inf, self._clock.jumps)

    def _execute(self, goal: Goal) -> None:
        result: Message | None = None
        failure: str | None = None
        try:
            found = self._handler.handle(goal)
            if not isinstance(found, self._types.result):
                raise TypeError(f"the handler returned {type(found).__name__}, not {self._types.result.__name__}")
            result = found
        except GoalCanceled as given_up:
            if not goal.told:
                failure = str(given_up) or "its handler has given it up"
        except NodeStopping:
            failure = "its node is stopping"
        except BaseException as error:
            failure = f"{type(error).__name__}: {error}"
            self._on_error(error)
        if self._goals.finish(goal, result, failure):
            self._changed([goal])


def _read(query: zenoh.Query, type_: Any) -> Any:
    """What is asked, as a message.

    Raises:
        Malformed: it is none of this type.
    """
    payload = query.payload.to_bytes() if query.payload is not None else b"\x80"  # nothing is an empty map
    return Decoder(type_).decode(payload, str(query.encoding))


def _reply(query: zenoh.Query, key: str, message: Message) -> None:
    with suppress(zenoh.ZError):  # whoever asked may be gone, or this node may be leaving
        queries.reply(query, key, message, codec.encoding_of(type(message)))
