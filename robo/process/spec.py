"""All that a node's process is told, resolved."""

from typing import TYPE_CHECKING

import msgspec

from robo.wire.network import Mode
from robo.wire.reports import Setting

if TYPE_CHECKING:
    pass


class NodeSpec(msgspec.Struct, frozen=True, kw_only=True):
    """All that a node's process needs to know, resolved."""

    service: str = ""
    """`package.module:Class` or `package.module`; empty for a command that may run any node."""
    name: str | None = None
    namespace: str | None = None
    parameters: dict[str, object] = {}
    sources: dict[str, list[Setting]] = {}
    """By parameter, all that was said of it, from the weakest to what holds."""
    remappings: dict[str, str] = {}
    memory: str = ""
    """The file that its launch has made for what it keeps over restarts."""
    needs: tuple[str, ...] = ()
    """Full names of nodes that this one must see before it starts."""
    mode: Mode | None = None
    """None for one that nobody has launched: ROBO_MODE says it, or it is a router of its own."""
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
