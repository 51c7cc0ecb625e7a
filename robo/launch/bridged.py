"""The nodes that the key `bridges` of a manifest or a group stands for: one for each other system."""

from collections.abc import Iterator

import msgspec

from robo.launch.language import fill, keys_of, values_of
from robo.launch.manifest import NodeEntry, ParameterSource
from robo.launch.plan import BridgesPlan
from robo.launch.substitution import Complain, Scope
from robo.text.tree import Entry, Map, Scalar

_SERVICES = {"ros2": "robo_services.ros2_bridge"}
"""By system, what connects it."""


def nodes_of(bridges: Map, namespace: str, scope: Scope, complain: Complain) -> Iterator[NodeEntry]:
    """The nodes of a key `bridges`, ready to be unfolded as if they stood there.

    Args:
        bridges: its value as read.
        namespace: of the robot.
        scope: what its names mean.
        complain: takes the mistakes.
    """
    keys = keys_of(BridgesPlan)
    written = {entry.key: entry.value for entry in bridges}
    found = values_of(keys, fill(keys, written, scope), complain)
    for entry in bridges:
        plan = found.get(keys[entry.key].field)
        if plan is None:
            continue
        where = entry.position
        settings = msgspec.json.encode(plan).decode().replace("${", "$\\u007b")  # it is filled already
        values = Map((Entry("settings", where, Scalar(settings, where)),), where)
        yield NodeEntry(
            key=f"{entry.key}_bridge",
            plain={"service": Scalar(_SERVICES[entry.key], where)},
            params=(ParameterSource(values=values),),
            namespace=Scalar(f"/{namespace}", where) if namespace else None,
            tree=Map((), where),
            position=where,
        )
