"""What packages, nodes, messages, topics and services of a package may be called, and what code calls them. Pure."""

import importlib.util
import keyword
import re
import sys
import unicodedata
from collections.abc import Iterable

from robo.errors import InvalidName
from robo.node.node import Node
from robo.text.brief import shown
from robo.wire import names
from robo_messages import type_names

LONGEST = 40
"""Letters of a package, a node or a message."""

LONGEST_TOPIC = 60
"""Letters of the whole name of a topic or a service."""

_SNAKE = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*\Z")
_PASCAL = re.compile(r"[A-Z][A-Za-z0-9]*\Z")

_FOLDERS = {"config", "launch", "share", "tests"}
_MODULES = {"manifest", "messages", "share"}
"""What a package has beside its nodes, or tests beside theirs."""
USED = {"Annotated", "Clock", "Meta", "Node", "Parameters", "Publisher", "RunNode", "Unit"}
"""Classes that the files of a node import beside messages."""
_TAKEN_IN_CLASSES = {
    *dir(Node), "clock", "contract", "exit_code", "full_name", "logger", "memory", "name", "namespace", "parameters",
    "qualities", "count", "robo", "send", "service", "subscribe", "timer",
}  # fmt: skip
"""What a node has, and what the sample's has beside it and names in its class."""

_AMBIGUOUS = frozenset(("I", "O", "l"))
"""Names that are read as digits, which linters refuse."""


def package_fault(name: str) -> str | None:
    """What is wrong with the name of a new package, and what to do; None for nothing."""
    fault = _snake_fault(name, "package")
    if fault is not None:
        return fault
    if name in _FOLDERS:
        return f"package name {name!r}: that is a folder of every package; try my_{name} or {name}_robot"
    if name in sys.stdlib_module_names:
        return f"package name {name!r}: Python has a module of this name; try my_{name} or {name}_robot"
    if _is_importable(name):
        return f"package name {name!r}: a package of this name is installed or stands here; try my_{name}"
    if name in {known.partition("/")[0] for known in type_names()}:
        return f"package name {name!r}: {name}/… are message types that ship; try my_{name} or {name}_robot"
    return None


def _is_importable(name: str) -> bool:
    """Whether `import name` finds something here; a folder without Python files in it is nothing."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return False
    return spec is not None and spec.origin is not None


def node_fault(name: str) -> str | None:
    """The same for a new node. Its name is that of its module."""
    fault = _snake_fault(name, "node")
    if fault is not None:
        return fault
    if name in _MODULES or class_of(name) in USED:
        return f"node name {name!r}: that is something else in every package; try {name}_node"
    if class_of(name) in _AMBIGUOUS:
        return f"node name {name!r}: its class {class_of(name)} reads like a digit; try {name}_node"
    if name.endswith("_logic"):
        return f"node name {name!r}: modules that end in _logic hold what nodes decide; try {name}_node"
    if name.startswith("test_"):
        return f"node name {name!r}: modules that begin with test_ hold tests; try {name.removeprefix('test_')}"
    return None


def message_fault(name: str) -> str | None:
    """The same for a new message type of the package."""
    if "/" in name:
        return f"message name {shown(name)}: write only the type's own name, {name.rpartition('/')[2] or 'Grip'}"
    if name in _AMBIGUOUS:
        return f"message name {name!r} reads like a digit; say what it is about, for example GripState"
    if keyword.iskeyword(name) or name == "Message":
        return f"message name {name!r} is taken; say what it is about, for example GripState"
    if not _PASCAL.match(name):
        meant = _meant(class_of(_ascii(name)))
        return f"message name {shown(name)}: use words that begin with a capital, as in GripState{meant}"
    return f"message name {shown(name)} has more than {LONGEST} letters" if len(name) > LONGEST else None


def end_fault(what: str, name: str) -> str | None:
    """What is wrong with the name of a topic or a service."""
    try:
        names.resolve(name, namespace="", node="node")
    except InvalidName as error:
        return f"{what} {error}"
    if name == "~" or len(name) > LONGEST_TOPIC:
        return f"{what} {shown(name)}: " + ("name it, ~/state" if name == "~" else f"more than {LONGEST_TOPIC} letters")
    return None


def key(end: str, node: str) -> str:
    """Two names of topics or services with the same key mean the same, whoever says them."""
    return names.resolve(end, namespace="robot", node=node)


def class_of(name: str) -> str:
    """What the class of a node is called: `grip_driver` to `GripDriver`."""
    return "".join(word[:1].upper() + word[1:] for word in re.split(r"[^A-Za-z0-9]+", name))


def labels(ends: Iterable[str]) -> dict[str, str]:
    """What code calls topics or services of one node: the last part of each, or all parts where two end alike."""
    whole = list(ends)
    short = {end: _snake(end.rpartition("/")[2]) for end in whole}
    twice = {label for label in short.values() if list(short.values()).count(label) > 1}
    return {end: _snake(end.replace("/", "_")) if label in twice else label for end, label in short.items()}


def attribute(label: str) -> str:
    """What a node calls its publisher: a name that nothing else in its class has."""
    if label[0].isdigit():
        return f"publisher_{label}"
    taken = label in _TAKEN_IN_CLASSES | _AMBIGUOUS or keyword.iskeyword(label)
    return f"{label}_publisher" if taken else label


def handler(label: str) -> str:
    """What a node calls the callback of a subscription."""
    return f"on_{label}_message" if f"on_{label}" in _TAKEN_IN_CLASSES else f"on_{label}"


def answerer(label: str) -> str:
    """What a node calls the callback of a service."""
    return f"handle_{label}"


def _snake(text: str) -> str:
    """As PEP 8 writes functions: `jointStates` to `joint_states`."""
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", text).lower()
    return re.sub(r"_+", "_", apart).strip("_~") or "it"


def _snake_fault(name: str, what: str) -> str | None:
    if keyword.iskeyword(name):
        return f"{what} name {name!r} is a word of Python's; try {name}_{'robot' if what == 'package' else 'node'}"
    if not _SNAKE.match(name):
        plain = re.sub(r"[^a-z0-9]+", "_", _snake(_ascii(name))).strip("_")
        return f"{what} name {shown(name)}: use lower case letters, digits and single _, a letter first{_meant(plain)}"
    return f"{what} name {name!r} has more than {LONGEST} letters" if len(name) > LONGEST else None


def _ascii(text: str) -> str:
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()


def _meant(name: str) -> str:
    valid = (_SNAKE.match(name) or _PASCAL.match(name)) and not keyword.iskeyword(name)
    return f"; did you mean {name}?" if valid else ""
