"""What a node declares of actions: `ActionClient`, `@action`. They only declare."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar, cast, get_args, overload

import msgspec

from robo.errors import ContractError
from robo.node.declare import MARK, Declares, too_early
from robo.node.loops import period_of
from robo.node.turns import check_turn
from robo.wire.qos import DEFAULT_TIMEOUT
from robo_messages import Message

if TYPE_CHECKING:
    from robo.node.action_client import ActionCaller

G = TypeVar("G", bound=Message)
R = TypeVar("R", bound=Message)
F = TypeVar("F", bound=Message)
N = TypeVar("N", bound=Declares)

DEFAULT_RATE = 10.0
"""How often a handler goes on after a `yield`, Hz."""

Policy = Literal["refuse", "queue", "preempt"]
POLICIES: tuple[Policy, ...] = get_args(Policy)


class GoalCanceled(BaseException):
    """Raised in the handler of an action, where it yields, when its goal is canceled, preempted, or its node stops.

    A handler that lets it pass is done with that. One that catches it may yield further, and return a result.
    """


class ActionClient(Generic[G, R, F]):
    """Declares an action to which a node sends goals:

        follow = ActionClient(Follow.Goal, Follow.Result, Follow.Feedback, "follow")

    On a node, `self.follow(Follow.Goal())` sends a goal and waits for its result.
    """

    def __init__(
        self,
        goal_type: type[G],
        result_type: type[R],
        feedback_type: type[F],
        action: str,
        *,
        timeout: float = DEFAULT_TIMEOUT,
    ) -> None:
        """
        Args:
            goal_type, result_type, feedback_type: the action's three types.
            action: its name: relative, absolute or private.
            timeout: how long to wait until the server takes a goal or cancels it, s. How long a result may take
                is said where it is waited for.
        """
        self.goal_type = goal_type
        self.result_type = result_type
        self.feedback_type = feedback_type
        self.action = action
        self.timeout = timeout

    def __set_name__(self, owner: type[object], name: str) -> None:
        self._attribute = name

    @overload
    def __get__(self, instance: None, owner: type[object]) -> ActionClient[G, R, F]: ...
    @overload
    def __get__(self, instance: Declares, owner: type[object]) -> ActionCaller[G, R, F]: ...
    def __get__(self, instance: Declares | None, owner: type[object]) -> ActionClient[G, R, F] | ActionCaller[G, R, F]:
        if instance is None:
            return self
        raise too_early(owner, self._attribute)


class ActionMark(msgspec.Struct):
    """What `@action` leaves on a method."""

    action: str
    rate: float | str
    policy: Policy
    accept: str | None
    """The name of the method that is asked before a goal is taken."""
    turn: str = ""


class _Acting(Protocol):
    """A method that takes a goal and yields feedback before it returns the result, or returns it at once; or async."""

    @overload
    def __call__(
        self, method: Callable[[N, G, Callable[[F], None]], Coroutine[Any, Any, R]]
    ) -> Callable[[N, G, Callable[[F], None]], Coroutine[Any, Any, R]]: ...
    @overload
    def __call__(
        self, method: Callable[[N, G], Coroutine[Any, Any, R]]
    ) -> Callable[[N, G], Coroutine[Any, Any, R]]: ...
    @overload
    def __call__(
        self, method: Callable[[N, G], Generator[F | None, None, R]]
    ) -> Callable[[N, G], Generator[F | None, None, R]]: ...
    @overload
    def __call__(self, method: Callable[[N, G], R]) -> Callable[[N, G], R]: ...


def action(
    name: str,
    *,
    rate: float | str = DEFAULT_RATE,
    policy: Policy = "refuse",
    accept: Callable[[Any, Any], None] | None = None,
    turn: str = "",
) -> _Acting:
    """Handle the goals of an action with this method: it takes the goal, yields feedback, and returns the result.

        @action("follow", rate=20.0)
        def follow(self, goal: Follow.Goal) -> Generator[Follow.Feedback, None, Follow.Result]: ...

    Each step from one `yield` to the next is a callback; the node's others run in between. Where the goal is
    canceled, `yield` raises `GoalCanceled`. `yield None` tells no feedback. A plain method, which returns the
    result at once, handles a goal in one step, and cannot be canceled meanwhile.

    An async method tells feedback by a function that it is given, and is cancelled where it awaits:

        @action("follow")
        async def follow(self, goal: Follow.Goal, feedback: Callable[[Follow.Feedback], None]) -> Follow.Result: ...

    Args:
        name: of the action: relative, absolute or private.
        rate: how often it goes on after a `yield`, Hz, or the name of the parameter that says it.
        policy: what becomes of a goal that comes while another one is under way: `refuse` it, `queue` it, or
            `preempt` the other one, which is then aborted.
        accept: a method of the class that is asked before a goal is taken; it raises ValueError to refuse it.
        turn: a turn of its own, as for `subscribe`.
    """
    check_turn(turn)
    if not isinstance(rate, str):
        period_of(rate)
    if policy not in POLICIES:
        raise ContractError(f"action {name!r}: the policy {policy!r}: use one of {', '.join(POLICIES)}")

    def mark(method: Any) -> Any:
        setattr(method, MARK, ActionMark(name, rate, policy, accept.__name__ if accept is not None else None, turn))
        return method

    return cast(_Acting, mark)
