"""All that a node's process is told, resolved."""

from collections.abc import Mapping, Sequence

import msgspec

from robo.wire.codec import jsonable
from robo.wire.network import Mode
from robo.wire.reports import Setting


class NodeSpec(msgspec.Struct, frozen=True, kw_only=True):
    """All that a node's process needs to know, resolved."""

    service: str = ""
    """`package.module:Class` or `package.module`; empty for a command that may run any node."""
    name: str | None = None
    namespace: str | None = None
    settings: Mapping[str, Sequence[Setting]] = {}
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

    @property
    def parameters(self) -> dict[str, object]:
        """The values that hold, by name."""
        return {name: settings[-1].value for name, settings in self.settings.items()}

    def as_json(self) -> str:
        """For an environment. What holds stands there once more as `parameters`, for commands in other languages."""
        data = msgspec.to_builtins(self) | {"parameters": self.parameters}
        return msgspec.json.encode(jsonable(data)).decode()
