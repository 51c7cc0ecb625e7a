"""The forms that the value of a key may have: a text, a number, a command, a rate …

A form holds all that is to be known of its values: what an editor is told of them, how they are written, how `${name}`
is put into them, which holds where several layers say one, and what becomes of it in the plan. A value with a mistake
is None from then on, so that one mistake is one message.
"""

import re
import shlex
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Final, Protocol

import msgspec

from robo.errors import InvalidName
from robo.launch.expression import as_text
from robo.launch.substitution import PLACEHOLDER, Broken, Complain, Scope, known, settled
from robo.text.brief import shown
from robo.text.suggestions import hint
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree, kind
from robo.wire import names

Schema = dict[str, Any]

Read = Callable[[Tree, str, "Reading"], Any]
"""From a tree and the name of its key to the value as written; None where it has another form, which is a mistake."""

Fill = Callable[[Tree, str, Scope], Tree]
"""From a tree and the name of its key to the same tree, every `${name}` replaced; Broken where that is impossible."""

Merge = Callable[[Tree, Tree], Tree]
"""What holds, of what was said first and what is said over it."""

Value = Callable[[Tree, str, Complain], Any]
"""From a filled tree and the name of its key to a value; None where it has a mistake."""

MOST: Final = 1_000_000_000
"""No number of a manifest is larger."""

LEAST_MEMORY: Final = 1 << 20
MOST_MEMORY: Final = 1 << 40
"""Of a process, bytes."""

TEXT: Final[Schema] = {"type": "string"}
SCALAR: Final[Schema] = {"type": ["string", "number", "boolean", "null"]}
FILLED: Final[Schema] = {"type": "string", "pattern": r"\$\{"}
"""Wherever a value is expected, text with `${…}` in it may stand."""

_MARK = "\ue002"
_CPUS = re.compile(r"\s*(\d{1,4})\s*(?:-\s*(\d{1,4}))?\s*")
_SIZE = re.compile(r"\s*(\d{1,15}|\d{1,15}\.\d{1,6}(?=\s*[KMGT]))\s*(?:([KMGT])i?)?B?\s*", re.IGNORECASE)
_RATE = re.compile(r"\s*(>=|<=|>|<|==?)?\s*([0-9.eE+-]+)\s*(?:Hz)?\s*")


class Reading(Protocol):
    """What a form needs of whoever reads a manifest."""

    def complain(self, position: Position, text: str) -> None:
        """Add a mistake."""

    def part(self, name: str, entry: Entry) -> Any:
        """A part of the language by its name: what an entry of a map is read as; None where it is left out."""

    def special(self, name: str, tree: Tree) -> Any:
        """The value of a key that is like no other."""


class Form(msgspec.Struct, frozen=True, kw_only=True):
    """How the value of a key is written, and what becomes of it."""

    schema: Schema
    """For editors, as JSON Schema."""
    read: Read
    fill: Fill = lambda tree, _key, _scope: tree
    merge: Merge = lambda _before, tree: tree
    value: Value = lambda _tree, _key, _complain: None
    words: tuple[str, ...] = ()
    """Of one that takes some words and no others: these."""
    fields: Mapping[str, int] | None = None
    """Of one whose value fills several fields of the plan: by field, which item of the value."""
    part: type[msgspec.Struct] | None = None
    """Of one that is a map of known keys: what it becomes."""


def one_of(*forms: Schema) -> Schema:
    """What has one of several forms."""
    return {"anyOf": list(forms)}


def list_of(form: Schema) -> Schema:
    """A list that holds something."""
    return {"type": "array", "items": form, "minItems": 1}


def map_of(form: Schema) -> Schema:
    """A map from names."""
    return {"type": "object", "additionalProperties": form}


# -- what is written, and what is filled in ----------------------------------------------------------------------------


def single(tree: Tree, key: str, complain: Complain) -> Scalar | None:
    """A tree that is a single value; None, with a mistake, where it is not."""
    if isinstance(tree, Scalar):
        return tree
    complain(tree.position, f"{key}: expected a single value, not {kind(tree)}")
    return None


def scalars(tree: Tree) -> list[Scalar]:
    """One value or several."""
    return [item for item in (tree.items if isinstance(tree, Items) else (tree,)) if isinstance(item, Scalar)]


def is_one_of(scalar: Scalar, key: str, words: Collection[str], complain: Complain) -> bool:
    """Whether a scalar as written is one of some words, or a substitution that may give one."""
    if scalar.value in words or (isinstance(scalar.value, str) and "${" in scalar.value):
        return True
    *others, last = words
    either = f"; use {', '.join(others)} or {last}" if others else f"; use {last}"
    complain(scalar.position, f"{key}: {shown(scalar.value)} is not known{hint(str(scalar.value), words, either)}")
    return False


def is_name(name: str, position: Position, complain: Complain) -> bool:
    """Whether a name of a topic is valid, wherever it is resolved."""
    try:
        names.resolve(name, namespace="", node="node")
    except InvalidName as error:
        complain(position, str(error))
        return False
    return True


def text_of(scalar: Scalar, complain: Complain) -> str | None:
    """A filled scalar as text; None where it is Broken, which is complained of."""
    known(scalar.value, complain)
    return None if isinstance(scalar.value, Broken) else as_text(scalar.value)


# -- single values -----------------------------------------------------------------------------------------------------

Convert = Callable[[Scalar, str, Complain], Any]
"""The value of a filled scalar that is not Broken."""


def _single(
    schema: Schema,
    convert: Convert,
    *,
    filled: Callable[[Scope, Scalar], object] = Scope.raw,
    read: Read | None = None,
    words: Sequence[str] = (),
    fields: Mapping[str, int] | None = None,
) -> Form:
    def fill(tree: Tree, _key: str, scope: Scope) -> Tree:
        return Scalar(filled(scope, tree), tree.position) if isinstance(tree, Scalar) else tree

    def value(tree: Tree, key: str, complain: Complain) -> Any:
        assert isinstance(tree, Scalar)
        known(tree.value, complain)
        return None if isinstance(tree.value, Broken) else convert(tree, key, complain)

    return Form(
        schema=schema,
        read=read or (lambda tree, key, reading: single(tree, key, reading.complain)),
        fill=fill,
        value=value,
        words=tuple(words),
        fields=fields,
    )


def _text(scalar: Scalar, _key: str, _complain: Complain) -> str:
    return as_text(scalar.value)


def _settled(scalar: Scalar, _key: str, _complain: Complain) -> object:
    return settled(scalar.value)


def _node_name(scalar: Scalar, _key: str, complain: Complain) -> str | None:
    try:
        return names.check_node_name(as_text(scalar.value))
    except InvalidName as error:
        complain(scalar.position, str(error))
        return None


def _process(scalar: Scalar, key: str, complain: Complain) -> str | None:
    text = as_text(scalar.value)
    if text and not names.is_word(text):
        complain(scalar.position, f"{key}: {shown(text)} is no name; use letters, digits and _, no digit first")
        return None
    return text


def _service(scalar: Scalar, key: str, complain: Complain) -> str | None:
    text = as_text(scalar.value)
    if not text:
        complain(scalar.position, f"{key}: name a node class, for example my_package.my_node")
    return text or None


def _pattern(scalar: Scalar, key: str, complain: Complain) -> str | None:
    pattern = as_text(scalar.value)
    try:
        re.compile(pattern)
    except (re.error, RecursionError, OverflowError) as error:
        complain(scalar.position, f"ready: {key}: {shown(pattern)} is no pattern: {error}")
        return None
    return pattern


def _port(scalar: Scalar, key: str, complain: Complain) -> str | None:
    text = as_text(scalar.value)
    host, _, port = text.rpartition(":")
    if port.isdecimal() and port.isascii() and 0 < int(port) < 65_536:
        return f"{host or '127.0.0.1'}:{int(port)}"
    complain(scalar.position, f"ready: {key}: {shown(text)} is no port; write 8080 or host:8080")
    return None


def _rate(scalar: Scalar, key: str, complain: Complain) -> tuple[float | None, float | None] | None:
    text = as_text(scalar.value)
    match = _RATE.fullmatch(text)
    try:
        number = float(match[2]) if match is not None else -1.0
    except ValueError:
        number = -1.0
    if match is None or not 0 < number < MOST:
        complain(scalar.position, f"{key}: {shown(text)} is no rate; write '>= 5', '<= 50' or a number")
        return None
    sign = match[1] or ">="
    return (number if sign[0] in ">=" else None, number if sign[0] in "<=" else None)


def _size(scalar: Scalar, key: str, complain: Complain) -> int | None:
    text = as_text(scalar.value)
    match = _SIZE.fullmatch(text)
    size = float(match[1]) * 1024 ** " KMGT".index((match[2] or " ").upper()) if match is not None else 0.0
    if not LEAST_MEMORY <= size <= MOST_MEMORY:
        least = f"{LEAST_MEMORY >> 20}M"
        complain(scalar.position, f"{key}: {shown(text)} is no size of at least {least}; write 256M or 1.5G")
        return None
    return int(size)


def beside_manifest(scope: Scope, scalar: Scalar) -> object:
    """A path whose relative form counts from the manifest's folder; empty where it is."""
    path = scope.path(scalar)
    return path if isinstance(path, Broken) or not path else str(scope.folder.absolute() / path)


ANY_VALUE = _single(SCALAR, _settled)
A_TEXT = _single(TEXT, _text)
A_FLAG = _single({"type": ["boolean", "string"]}, _settled, filled=Scope.truth)
"""True, false or an expression."""
A_BOOLEAN = _single({"type": "boolean"}, _settled)
"""True or false, as it stands there."""
A_NODE_NAME = _single(TEXT, _node_name)
A_PROCESS = _single(TEXT, _process)
"""A name, or empty."""
A_SERVICE = _single(TEXT, _service)
A_PATH = _single(TEXT, lambda scalar, _key, _complain: as_text(scalar.value) or None, filled=beside_manifest)
A_PATTERN = _single(TEXT, _pattern)
A_PORT = _single(one_of({"type": "integer", "minimum": 1, "maximum": 65_535}, TEXT), _port)
"""`8080` or `host:8080`."""
A_RATE = _single(
    one_of({"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": MOST}, TEXT),
    _rate,
    fields={"min_rate": 0, "max_rate": 1},
)
"""`>= 5`, `<= 50`, `10` (at least): the least and the most messages per second, either of them None."""


A_SIZE = _single(one_of({"type": "integer", "minimum": LEAST_MEMORY, "maximum": MOST_MEMORY}, TEXT), _size)
"""`256M`, `1.5G`: bytes, of which 1024 are a K; without a letter bytes."""


def a_number(low: float, high: float = MOST, *, whole: bool = False) -> Form:
    """A number between limits, both included."""
    kinds = int if whole else (int, float)
    noun = "a whole number" if whole else "a number"
    wanted = f"{noun} of at least {low}" if high == MOST else f"{noun} from {low} to {high}"

    def convert(scalar: Scalar, key: str, complain: Complain) -> float | None:
        value = settled(scalar.value)
        if isinstance(value, kinds) and not isinstance(value, bool) and low <= value <= high:
            return value if whole else float(value)
        complain(scalar.position, f"{key}: expected {wanted}, not {shown(value)}")
        return None

    plain: Schema = {"type": "integer" if whole else "number", "minimum": low, "maximum": high}
    return _single(one_of(plain, FILLED), convert)


def a_word(words: Sequence[str], *, substituted: bool = True) -> Form:
    """One of some words; with `substituted` also `${…}` that gives one of them."""

    def read(tree: Tree, key: str, reading: Reading) -> Scalar | None:
        scalar = single(tree, key, reading.complain)
        return scalar if scalar is not None and is_one_of(scalar, key, words, reading.complain) else None

    enum: Schema = {"enum": list(words)}
    return _single(one_of(enum, FILLED) if substituted else enum, _in(words, as_text), read=read, words=words)


def a_signal(*signals: str) -> Form:
    """A signal's name, with SIG before it or without, in capitals or not."""
    words = [*signals, *(f"SIG{name}" for name in signals)]
    in_capitals = _in(words, lambda value: as_text(value).upper())

    def convert(scalar: Scalar, key: str, complain: Complain) -> str | None:
        name: str | None = in_capitals(scalar, key, complain)
        return None if name is None else name.removeprefix("SIG")

    return _single(one_of({"enum": words}, FILLED), convert, words=words)


def _in(words: Sequence[str], spelt: Callable[[object], str]) -> Convert:
    def convert(scalar: Scalar, key: str, complain: Complain) -> str | None:
        if spelt(scalar.value) in words:
            return spelt(scalar.value)
        complain(scalar.position, f"{key}: {shown(as_text(scalar.value))} is not known; use {', '.join(words)}")
        return None

    return convert


# -- several values ----------------------------------------------------------------------------------------------------


def _read_several(tree: Tree, key: str, reading: Reading) -> Tree | None:
    if isinstance(tree, Map) or (isinstance(tree, Items) and not tree.items):
        reading.complain(tree.position, f"{key}: expected a text or a list of words, not {kind(tree)}")
        return None
    for item in tree.items if isinstance(tree, Items) else ():
        if single(item, key, reading.complain) is None:
            return None
    return tree


def _fill_several(tree: Tree, _key: str, scope: Scope) -> Items:
    return Items(tuple(Scalar(scope.raw(one), one.position) for one in scalars(tree)), tree.position)


def _texts(tree: Tree, _key: str, complain: Complain) -> tuple[str, ...]:
    return tuple(text for one in scalars(tree) if (text := text_of(one, complain)) is not None)


def _topics(tree: Tree, _key: str, complain: Complain) -> tuple[str, ...]:
    texts = ((one, text_of(one, complain)) for one in scalars(tree))
    return tuple(text for one, text in texts if text is not None and is_name(text, one.position, complain))


def _cpus(tree: Tree, key: str, complain: Complain) -> tuple[int, ...]:
    found: set[int] = set()
    for one in scalars(tree):
        text = text_of(one, complain)
        for part in text.split(",") if text is not None else ():
            match = _CPUS.fullmatch(part)
            some = range(int(match[1]), int(match[2] or match[1]) + 1) if match is not None else ()
            if not some:
                complain(one.position, f"{key}: {shown(text)} is no processor; write [0, 1] or 0-3")
                break
            found |= set(some)
    return tuple(sorted(found))


def _split(tree: Tree, key: str, scope: Scope) -> Tree:
    """A line split as a shell would, before anything is put in."""
    if not isinstance(tree, Scalar):
        return _fill_several(tree, key, scope)
    line = str(tree.value)
    kept = iter(PLACEHOLDER.findall(line))
    try:
        words = shlex.split(PLACEHOLDER.sub(_MARK, line))
    except ValueError as error:
        text = f"{key}: {shown(line)} cannot be split into words: {str(error).lower()}"
        return Scalar(Broken((Problem(tree.position, text),)), tree.position)
    split = [Scalar(re.sub(_MARK, lambda _: next(kept), word), tree.position, None) for word in words]
    return _fill_several(Items(tuple(split), tree.position), key, scope)


def _words(tree: Tree, key: str, complain: Complain) -> tuple[str, ...]:
    words = _texts(tree, key, complain)
    if any("\0" in word for word in words):
        complain(tree.position, f"{key} holds a zero character")
    if key == "run" and isinstance(tree, Items) and not tree.items:
        complain(tree.position, "run: the command is empty")
    return words


def _several(schema: Schema, value: Value, fill: Fill = _fill_several) -> Form:
    return Form(schema=schema, read=_read_several, fill=fill, value=value)


_CPU: Schema = {"type": "integer", "minimum": 0, "maximum": 9_999}

SOME_TEXTS = _several(one_of(TEXT, list_of(TEXT)), _texts)
SOME_VALUES = _several(list_of(SCALAR), _texts)
SOME_TOPICS = _several(one_of(TEXT, list_of(TEXT)), _topics)
SOME_CPUS = _several(one_of(_CPU, TEXT, list_of(one_of(_CPU, TEXT))), _cpus)
"""Processors: `[0, 1]` or `0-3`."""
A_COMMAND = _several(one_of(TEXT, list_of(SCALAR)), _words, _split)
"""A command's words: a list as it is, or a line."""
