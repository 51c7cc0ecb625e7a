"""What a node class promises of actions: collected from its declarations as `contract` does it for the rest."""

from __future__ import annotations

import collections.abc
import typing
from collections.abc import Callable
from typing import Any

import msgspec

import robo_messages
from robo.errors import ContractError
from robo.node.actions import ActionClient, ActionMark, Policy
from robo.node.callables import is_async
from robo.node.declare import Declares
from robo.node.handler import Handling
from robo.wire.actions import ActionTypes, action_types
from robo_messages import Message, UnknownType
from robo_messages.action import parts_of


class ActionDeclaration(msgspec.Struct, frozen=True):
    """One `@action`."""

    action: str
    types: ActionTypes
    rate: float | str
    """Hz, or the name of the parameter that says it."""
    policy: Policy
    accept: str | None
    """The name of the method that is asked before a goal is taken."""
    method: str
    yields: bool
    """Whether the method yields feedback."""
    tells: bool
    """Whether it takes a function that tells feedback; an async one may."""
    turn: str = ""

    def handling(self, node: object, period: Callable[[], float]) -> Handling:
        """How a node handles its goals.

        Args:
            node: one of the class.
            period: says how long to wait from one step to the next, s.
        """
        accept = getattr(node, self.accept) if self.accept is not None else None
        return Handling(getattr(node, self.method), self.yields, self.tells, period, self.policy, accept)


class ActionClientDeclaration(msgspec.Struct, frozen=True):
    """One `ActionClient`."""

    action: str
    types: ActionTypes
    timeout: float
    """s."""
    attribute: str


def action_declaration(
    cls: type[Declares], name: str, mark: ActionMark, goal: type[Message], told: object, returns: object
) -> ActionDeclaration:
    """What `@action` promises.

    Args:
        cls: the node class.
        name: of the method.
        mark: what `@action` has left on it.
        goal: the type that the method takes.
        told: the annotation of the function that an async method takes beside; None where it takes none.
        returns: the annotation of what it returns.

    Raises:
        ContractError: the types are not those of one action, or `accept` is no method of the class.
    """
    where = f"{cls.__name__}.{name}"
    found = _types_of(where, goal)
    yields = typing.get_origin(returns) is collections.abc.Generator
    result, feedback = found.result.__qualname__, found.feedback.__qualname__
    if told is not None and not (is_async(getattr(cls, name)) and told == Callable[[found.feedback], None]):
        raise ContractError(
            f"{where}: an action's method takes self and the goal; an async one may take, to tell how far it is,"
            f" feedback: Callable[[{feedback}], None]"
        )
    if yields:
        yielded, _, returned = typing.get_args(returns)
        fitting = returned is found.result and yielded in (found.feedback, found.feedback | None)
    else:
        fitting = returns is found.result
    if not fitting:
        raise ContractError(
            f"{where}: annotate what it returns: Generator[{feedback}, None, {result}], or {result} for a method that"
            " yields nothing"
        )
    if mark.accept is not None and not callable(getattr(cls, mark.accept, None)):
        raise ContractError(f"{where}: accept={mark.accept} is no method of {cls.__name__}")
    return ActionDeclaration(
        mark.action, found, mark.rate, mark.policy, mark.accept, name, yields, told is not None, mark.turn
    )


def action_client_declaration(
    cls: type[Declares], name: str, declared: ActionClient[Any, Any, Any]
) -> ActionClientDeclaration:
    """What an `ActionClient` promises.

    Raises:
        ContractError: the types are not those of one action.
    """
    try:
        found = action_types(declared.goal_type, declared.result_type, declared.feedback_type)
    except (ContractError, UnknownType) as error:
        raise ContractError(f"{cls.__name__}.{name}: {error.args[0]}") from None
    return ActionClientDeclaration(declared.action, found, declared.timeout, name)


def _types_of(where: str, goal: type[Message]) -> ActionTypes:
    """The types of an action whose goal is of a type."""
    name = robo_messages.type_name(goal)
    action = name.removesuffix("_Goal")
    if action == name:
        raise ContractError(f"{where}: {name} is no goal of an action; the name of such a type ends with _Goal")
    try:
        return action_types(*map(robo_messages.find_type, parts_of(action)))
    except (ContractError, UnknownType) as error:
        raise ContractError(f"{where}: {error.args[0]}") from None
