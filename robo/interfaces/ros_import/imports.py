"""What a module of message types imports, under names that nothing else in it has. Pure."""

import re
import sys
from collections.abc import Iterable

import robo_messages
from robo_messages import Message

WIDTH = 88
"""The longest line, letters: what ruff and black take where nothing else is said, and any longer one takes as well."""


class Imports:
    """The names that a module has from elsewhere."""

    def __init__(self, taken: Iterable[str]) -> None:
        """
        Args:
            taken: names that the module gives itself.
        """
        self._taken = frozenset(taken)
        self._names: dict[tuple[str, str], str] = {}

    def name(self, module: str, name: str) -> str:
        """What something of a module is called here."""
        key = module, name
        if key not in self._names:
            local = name
            while local in self._taken or local in self._names.values():
                prefix = "ROBO_" if name.isupper() else "Robo"
                local = f"{prefix}{name}" if local == name else f"{local}_"
            self._names[key] = local
        return self._names[key]

    def message(self, type_: type[Message]) -> str:
        """What a message type that ships is called here."""
        ships_above = getattr(robo_messages, type_.__qualname__, None) is type_
        return self.name(robo_messages.__name__ if ships_above else type_.__module__, type_.__qualname__)

    def lines(self) -> list[str]:
        """The statements, in the order of isort: the standard library, packages, then modules beside this one."""
        parts: list[list[str]] = [[], [], []]
        modules: dict[str, list[tuple[str, str]]] = {}
        for (module, name), local in self._names.items():
            modules.setdefault(module, []).append((name, local))
        for module in sorted(modules, key=_order):
            part = 2 if module.startswith(".") else 0 if module in sys.stdlib_module_names else 1
            parts[part] += _statements(module, modules[module])
        return "\n\n".join("\n".join(part) for part in parts if part).splitlines()


def _statements(module: str, names: list[tuple[str, str]]) -> list[str]:
    """The statements for the names of one module, each of which is called here as it is there, or otherwise."""
    plain = sorted((name for name, local in names if name == local), key=_member_order)
    found = [(plain[0], _statement(module, plain))] if plain else []
    found += [(name, _statement(module, [f"{name} as {local}"])) for name, local in names if name != local]
    return [statement for _, statement in sorted(found, key=lambda pair: _member_order(pair[0]))]


def _statement(module: str, names: list[str]) -> str:
    line = f"from {module} import {', '.join(names)}"
    return (
        line if len(line) <= WIDTH else "\n".join([f"from {module} import (", *(f"    {name}," for name in names), ")"])
    )


def _order(name: str) -> tuple[object, ...]:
    """Alphabetical, with the numbers in names as numbers: `Int8` before `Int16`."""
    return tuple(
        (0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.findall(r"\d+|\D+", name.lower())
    )


def _member_order(name: str) -> tuple[object, ...]:
    """CONSTANTS, then Classes, then functions."""
    kind = 0 if name.isupper() and len(name) > 1 else 1 if name[:1].isupper() else 2
    return (kind, _order(name), name)
