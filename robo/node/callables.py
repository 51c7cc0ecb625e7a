"""What a callback is, seen from its code: async, one that yields, one that takes more than a message."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import FunctionType, MethodType
from typing import Any, Protocol

from robo.errors import ContractError


class AsyncRun(Protocol):
    """One run of an async callback."""

    def cancel(self) -> None:
        """Cancel it, from any thread."""

    def wait(self) -> Any:
        """Wait for its end in a thread of the node, whose turn others have meanwhile; returns or raises as it does."""


class AsyncCallback(Protocol):
    """An async callback as a function."""

    def __call__(self, *arguments: Any) -> Any:
        """Run it to its end."""

    def begin(self, *arguments: Any) -> AsyncRun:
        """Begin to run it."""


def takes_info(callback: Callable[..., object]) -> bool:
    """Whether a callback of a subscription takes a `MessageInfo` beside the message."""
    function: Any = callback
    filled = 0
    while isinstance(function, partial):
        filled += len(function.args) + len(function.keywords)
        function = function.func
    called = function
    code = getattr(function, "__code__", None)
    while code is not None and code.co_flags & _TAKES_ALL and hasattr(function, "__wrapped__"):
        function = function.__wrapped__  # what a decorator hands all on to
        code = getattr(function, "__code__", None)
    if code is None:
        return False
    given = len(getattr(function, "__defaults__", None) or ()) + (getattr(called, "__self__", None) is not None)
    return bool(code.co_argcount - given - filled >= 2)


_TAKES_ALL = 0x04
_COROUTINE, _ASYNC_GENERATOR = 0x80, 0x200  # as in `inspect`, whose import would cost each node 0.5 MB
_GENERATOR = 0x20 | _ASYNC_GENERATOR


def is_async(callback: Callable[..., object], name: str = "") -> bool:
    """Whether a callback is an `async def`, which the loop has to run.

    Args:
        callback: a function, a method, a partial or an object to call.
        name: what to call it; by default its own name.

    Raises:
        ContractError: it yields, so that calling it does nothing.
    """
    function, flags = _function_called(callback)
    if flags & _GENERATOR:
        raise ContractError(
            f"{place_of(function)}: {name or function.__name__} yields, so that calling it does nothing; a callback is"
            " a function (def or async def) that returns"
        )
    return bool(flags & _COROUTINE)


def check_steps(callback: Callable[..., object], name: str = "") -> bool:
    """Refuse a handler of an action that is async and yields; a plain one may. Returns whether it is async.

    Args:
        callback, name: as for `is_async`.

    Raises:
        ContractError: it is such a one.
    """
    function, flags = _function_called(callback)
    if flags & _ASYNC_GENERATOR:
        raise ContractError(
            f"{place_of(function)}: {name or function.__name__} is async and yields; let it take a function beside the"
            " goal, feedback: Callable[[…Feedback], None], and call that"
        )
    return bool(flags & _COROUTINE)


def check_plain(callback: Callable[..., object], name: str = "") -> None:
    """Refuse a hook that is async, or that yields.

    Args:
        callback, name: as for `is_async`.

    Raises:
        ContractError: it is such a one.
    """
    function, flags = _function_called(callback)
    if flags & (_COROUTINE | _ASYNC_GENERATOR):
        raise ContractError(
            f"{place_of(function)}: {name or function.__name__} is async; that may be callbacks of topics, timers,"
            " services and actions, and main: let it be a plain function (def)"
        )
    is_async(callback, name)


def _function_called(callback: Callable[..., object]) -> tuple[Any, int]:
    """The Python function that a call of it runs in the end, and its flags."""
    function: Any = callback
    while (inner := _inner(function)) is not None:
        function = inner
    code = getattr(function, "__code__", None)
    return function, 0 if code is None else code.co_flags


def _inner(function: Any) -> Any:
    """What a partial, a method or an object calls; None for a function. A decorator may make an async one plain."""
    if isinstance(function, partial):
        return function.func
    if isinstance(function, MethodType):
        return function.__func__
    if isinstance(function, (FunctionType, type)) or not callable(function):
        return None
    call = type(function).__call__
    return call if isinstance(call, FunctionType) else None


def place_of(function: Any) -> str:
    """`file:line` of a Python function."""
    return f"{function.__code__.co_filename}:{function.__code__.co_firstlineno}"
