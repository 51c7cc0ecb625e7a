"""A part of nodes: endpoints, and what belongs to them, that several node classes have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, Self, overload

from robo.node.declare import Declares

if TYPE_CHECKING:
    from robo.node.clock import Clock
    from robo.node.log import NodeLogger
    from robo_messages import Time


class Host(Protocol):
    """What a part has of its node."""

    name: str
    namespace: str
    full_name: str
    clock: Clock
    logger: NodeLogger

    @property
    def stopping(self) -> bool:
        """Whether it is told to stop."""

    def now(self) -> Time:
        """The time for stamps."""

    def resolve(self, name: str) -> str:
        """The key expression that a name of a topic stands for."""

    def shutdown(self, exit_code: int = 0) -> None:
        """Tell it to end."""


class Part(Declares):
    """Base of what a node class takes in as an attribute; it declares with the words that a node does.

        class Odometer(Part):
            total = 0.0

            @subscribe("odom")
            def on_odometry(self, odometry: Odometry) -> None: ...

        class Follower(Node):
            odometer = Odometer()

    On a node, `self.odometer` is one of its own, made with the same arguments. Its callbacks take the node's turn, its
    names are the node's. It has no parameters,
    no actions and no hooks: those are the node's.
    """

    node: Host
    """Whose part it is."""

    _made_with: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **options: Any) -> Self:
        """Remember how it is made: each node gets one like it."""
        self = super().__new__(cls)
        self._made_with = args, options
        return self

    def __set_name__(self, owner: type[object], name: str) -> None:
        self._attribute = name

    @overload
    def __get__(self, instance: None, owner: type[object]) -> Self: ...
    @overload
    def __get__(self, instance: Host, owner: type[object]) -> Self: ...
    def __get__(self, instance: Host | None, owner: type[object]) -> Self:
        if instance is None:
            return self
        args, options = self._made_with
        part = type(self)(*args, **options)
        part.node = instance
        # Where it hides this descriptor from now on.
        vars(instance)[self._attribute] = part
        return part


def found_in(node: object, path: str) -> Any:
    """What a node has under a name, or one of its parts under `part.name`."""
    part, _, name = path.rpartition(".")
    return getattr(getattr(node, part) if part else node, name)


def put_into(node: object, path: str, value: object) -> None:
    """Give it to a node, or to one of its parts, under a name; there it hides what the class has declared."""
    part, _, name = path.rpartition(".")
    vars(getattr(node, part) if part else node)[name] = value
