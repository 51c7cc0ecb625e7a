"""Plain data as YAML for people: every value written out where it stands, but for the maps that have an anchor."""

import math
from collections.abc import Mapping
from typing import Any

import yaml


class Merge:
    """The key `<<`: what the map with the anchor of its value holds is taken in."""


MERGE = Merge()


class Alias:
    """Refers to a map that has an anchor: `*name`."""

    def __init__(self, name: str) -> None:
        self.name = name


class Anchored:
    """A map that others refer to: `&name`."""

    def __init__(self, name: str, entries: Mapping[str, Any]) -> None:
        self.name = name
        self.entries = dict(entries)


def dumped(tree: Mapping[Any, Any]) -> str:
    """A map as YAML, in the order of its keys. An alias may refer to an anchor in another text."""
    text: str = yaml.dump(dict(tree), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=120)
    return text


def quoted(text: str) -> str:
    """A text in quotes, on one line."""
    return _inline(text, default_style='"')


def inline(value: object) -> str:
    """A list or a map on one line."""
    return _inline(value, default_flow_style=True, sort_keys=False)


def _inline(value: object, **settings: Any) -> str:
    text: str = yaml.safe_dump(value, allow_unicode=True, width=math.inf, **settings)
    return text.rstrip("\n")


class _AliasNode(yaml.ScalarNode):
    """Stands for an alias; its value is the anchor's name."""


class _AnchoredNode(yaml.MappingNode):
    anchor: str


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True

    def anchor_node(self, node: yaml.Node) -> None:
        super().anchor_node(node)
        if isinstance(node, _AnchoredNode):
            self.anchors[node] = node.anchor

    def serialize_node(self, node: yaml.Node, parent: yaml.Node | None, index: Any) -> None:
        if isinstance(node, _AliasNode):
            self.emit(yaml.AliasEvent(node.value))
        else:
            super().serialize_node(node, parent, index)


def _anchored(dumper: _Dumper, data: Anchored) -> yaml.Node:
    plain = dumper.represent_dict(data.entries)
    node = _AnchoredNode(plain.tag, plain.value, flow_style=plain.flow_style)
    node.anchor = data.name
    return node


_Dumper.add_representer(Anchored, _anchored)
_Dumper.add_representer(Alias, lambda _, alias: _AliasNode("", alias.name))
_Dumper.add_representer(Merge, lambda dumper, _: dumper.represent_scalar("tag:yaml.org,2002:merge", "<<"))
