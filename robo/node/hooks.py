"""What a node class may do at each step of a node's life, beside what it declares."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence, Set
from typing import Any

from robo.node.declare import Declares


class Hooks(Declares):
    """The methods of a node that are there to be overridden."""

    @classmethod
    def lacking(cls, parameters: Any) -> Sequence[str]:  # noqa: ARG003 - for whoever overrides it
        """What a node with these parameters needs and this machine does not have, and how to get it, a sentence each.

        By default the modules of `REQUIRES` that are not installed. `robo up` asks before anything starts, and `robo
        run` before the node does. Override it for what parameters decide, such as a screen:
        `return [*super().lacking(parameters), "window: there is no screen"]`. It is asked of the class, without a node.
        """
        if not cls.REQUIRES:
            return ()
        from robo.packages.absent import absent

        return absent(cls.REQUIRES)

    def on_start(self) -> None:
        """Called when the publishers exist and before any other callback runs."""

    def ready(self) -> bool:
        """Whether the node can do its work. Override it where starting is not all: a sensor has to warm up.

        It is asked as a callback until it says yes; then the node's liveliness token shows, and what
        needs this node starts.
        """
        return True

    def on_stop(self) -> None:
        """Called after the last callback, while the publishers still exist."""

    def on_parameters_changing(self, new: Any) -> None:
        """Called with the parameters as they would be, before they are changed; raise ValueError to refuse."""

    def on_parameters_changed(self, names: Set[str]) -> None:
        """Called after parameters were changed while the node runs, with their names."""

    def main(self) -> Coroutine[Any, Any, None] | None:
        """Work that is no reaction: a player, a script, a test drive. It may be async.

        Runs in a thread of its own once the node is ready, beside the callbacks. When it returns the
        node ends; when it raises, with exit code 1. It should return soon once `stopping` is true. An async one
        runs in turn with the callbacks from one `await` to the next, and is cancelled at the stop.
        """
        return None


def overrides(node: object, hook: Callable[..., object]) -> bool:
    """Whether a node has a method of its own in the place of a hook."""
    return getattr(type(node), hook.__name__) is not hook
