"""What a node is called, and what it means by the names that it uses."""

import os
from collections.abc import Mapping

import msgspec

from robo.environment import NAMESPACE_VARIABLE, RUN_VARIABLE
from robo.wire import discovery, names
from robo.wire.keys import NodeToken


class Identity(msgspec.Struct, frozen=True):
    """A node's name and namespace, and the other names that it was told to use."""

    namespace: str
    """Without outer slashes; empty for the root."""
    name: str
    remappings: Mapping[str, str] = {}
    """From the declared name of a topic or service to another one."""

    @classmethod
    def of(cls, name: str, namespace: str | None = None, remappings: Mapping[str, str] | None = None) -> "Identity":
        """The identity of a node; its namespace is by default that of the environment.

        Raises:
            InvalidName: the name or the namespace breaks the rules.
        """
        name = names.check_node_name(name)
        if namespace is None:
            namespace = os.environ.get(NAMESPACE_VARIABLE, "")
        return cls(names.normalize_namespace(namespace), name, dict(remappings or {}))

    @property
    def full_name(self) -> str:
        """For example `/r1/position_tracker`."""
        return "/" + names.join(self.namespace, self.name)

    def resolve(self, name: str) -> str:
        """The key expression of a topic or service name, after namespace and remapping.

        Raises:
            InvalidName: the name breaks the rules.
        """
        return names.resolve(name, namespace=self.namespace, node=self.name, remappings=self.remappings)

    def absolute(self, name: str) -> str:
        """A name that is meant within the namespace as a full one: `monitor` to `/r1/monitor`."""
        return names.absolute(name, self.namespace)

    def token(self, node_class: type[object]) -> NodeToken:
        """What says that the node, which this process runs, is ready."""
        class_name = f"{node_class.__module__}:{node_class.__qualname__}"
        run = os.environ.get(RUN_VARIABLE, "")
        return NodeToken(self.namespace, self.name, class_name, os.getpid(), discovery.hostname(), run)
