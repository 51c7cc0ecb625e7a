"""The keys of a part of a manifest, from the one place where each is said: an annotated field of a Struct.

    class StopPlan(msgspec.Struct):
        SHORT: ClassVar = ("signal",)                                     # `stop: TERM` is enough
        timeout: Annotated[float, Meta(ge=0, description="How long until the next one, s.")] = 1.0

Type, range, sentence and default of the field are those of the key. What a reader accepts, how several layers are
merged, what becomes of the value, and the JSON Schema all follow from it. A form that the type does not tell stands
beside it: `Annotated[str | None, A_PATTERN, Meta(…)]`. A field without a sentence is no key.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from types import UnionType
from typing import Annotated, Any, Final, Literal, NamedTuple, Union, get_args, get_origin

import msgspec
from msgspec import Meta

from robo.errors import InvalidName
from robo.launch.forms import (
    A_FLAG,
    A_TEXT,
    MOST,
    Form,
    Reading,
    Schema,
    a_number,
    a_word,
    is_one_of,
    map_of,
    one_of,
    single,
)
from robo.launch.substitution import Complain, Scope
from robo.text.brief import shown
from robo.text.suggestions import suggest
from robo.text.tree import Entry, Items, Map, Scalar, Tree, kind
from robo.wire import names

Written = Mapping[str, Tree]
"""Plain keys of a part with their values, each in its form."""

NOTHING: Final[Written] = {}

OF_GROUPS: Final = "of groups"
"""Marks a key of a process that a group may have too: it is for all that is in it."""


class Named(NamedTuple):
    """Marks a key that is not called as its field is."""

    name: str


class Key(NamedTuple):
    """A key of a part."""

    name: str
    field: str
    about: str
    form: Form
    of_groups: bool = False
    plain: bool = False
    """Whether it stays a tree until all layers are known: a key of the plan, in a part of the manifest."""


Keys = Mapping[str, Key]


class KeysOf(NamedTuple):
    """Stands for the keys of another Struct: those of what the plan says of a process are a node's own."""

    part: type[msgspec.Struct]
    of_groups: bool = False
    """Those alone that a group may have."""

    def keys(self) -> dict[str, Key]:
        """The keys, by name."""
        wanted = (key for key in keys_of(self.part).values() if key.of_groups or not self.of_groups)
        return {key.name: key._replace(plain=True) for key in wanted}


@lru_cache
def keys_of(part: type[msgspec.Struct]) -> Mapping[str, Key]:
    """The keys of a part, by name."""
    found: dict[str, Key] = {}
    for field in msgspec.structs.fields(part):
        metadata, type_ = _unwrapped(field.type)
        for other in metadata:
            if isinstance(other, KeysOf):
                found |= other.keys()
        meta = next((one for one in metadata if isinstance(one, Meta)), None)
        if meta is None or meta.description is None:
            continue
        form = next((one for one in metadata if isinstance(one, Form)), None) or _form_of(type_, meta)
        name = next((one.name for one in metadata if isinstance(one, Named)), field.encode_name)
        found[name] = Key(name, field.name, meta.description, form, of_groups=OF_GROUPS in metadata)
    return found


def _unwrapped(annotation: Any) -> tuple[Sequence[object], Any]:
    """What is noted beside a type, and the type, without None."""
    metadata: list[object] = []
    while True:
        if get_origin(annotation) is Annotated:
            annotation, *more = get_args(annotation)
            metadata += more
        elif get_origin(annotation) in (Union, UnionType):
            kinds = [kind for kind in get_args(annotation) if kind is not type(None)]
            if len(kinds) > 1:
                return metadata, annotation
            annotation = kinds[0]
        else:
            return metadata, annotation


def _form_of(type_: Any, meta: Meta) -> Form:
    if type_ is bool:
        return A_FLAG
    if type_ in (int, float) and meta.ge is not None:  # none may be as small as it likes
        return a_number(meta.ge, meta.le if meta.le is not None else MOST, whole=type_ is int)
    if type_ is str:
        return A_TEXT
    if get_origin(type_) is Literal:
        return a_word(get_args(type_))
    if isinstance(type_, type) and issubclass(type_, msgspec.Struct):
        return part_of(type_)
    raise TypeError(f"say the form of {type_}: Annotated[…, A_FORM, Meta(description=…)]")


def short_of(part: type[msgspec.Struct]) -> Sequence[Key]:
    """The keys of which a value may stand alone, in place of the map: `stop: TERM`."""
    return [keys_of(part)[name] for name in getattr(part, "SHORT", ())]


def ref(name: str) -> Schema:
    """What stands in the schema for a part of this name."""
    return {"$ref": f"#/$defs/{name}"}


def name_of(part: type[msgspec.Struct]) -> str:
    """What a part of the plan is called in the schema: `restart` for a RestartPlan."""
    return part.__name__.removesuffix("Plan").lower()


def definition(part: type[msgspec.Struct]) -> Schema:
    """The schema of a part: a map of its keys, or one of its values alone."""
    whole: Schema = {
        "type": "object",
        "properties": {name: {"description": key.about, **key.form.schema} for name, key in keys_of(part).items()},
        "additionalProperties": False,
    }
    short = [key.form.schema for key in short_of(part)]
    return one_of(*short, whole) if short else whole


# -- from a map as written to values ---------------------------------------------------------------------------------


def fields(tree: Map, what: str, keys: Keys, reading: Reading) -> dict[str, Tree]:
    """The values of a map by key; unknown keys are mistakes, and a key without a value is not there."""
    for entry in tree:
        if entry.key not in keys:
            instead = suggest(entry.key, sorted(keys), "it may hold")
            reading.complain(entry.position, f"unknown key {shown(entry.key)} in {what}; {instead}")
    return {entry.key: entry.value for entry in tree if entry.key in keys and not _is_empty(entry.value)}


def _is_empty(tree: Tree) -> bool:
    return isinstance(tree, Scalar) and tree.value is None


def read(keys: Keys, parts: Mapping[str, Tree], reading: Reading) -> dict[str, Any]:
    """The values of keys, each in its form; those that are not are mistakes, and left out."""
    found = {name: keys[name].form.read(tree, name, reading) for name, tree in parts.items()}
    return {name: value for name, value in found.items() if value is not None}


def fill(keys: Keys, written: Written, scope: Scope) -> dict[str, Tree]:
    """The same values with every `${name}` replaced."""
    return {name: keys[name].form.fill(tree, name, scope) for name, tree in written.items()}


def merged(keys: Keys, layers: Iterable[Written]) -> dict[str, Tree]:
    """What holds where several layers say something, weakest first."""
    found: dict[str, Tree] = {}
    for layer in layers:
        for name, tree in layer.items():
            found[name] = keys[name].form.merge(found[name], tree) if name in found else tree
    return found


def values_of(keys: Keys, filled: Written, complain: Complain) -> dict[str, Any]:
    """The values of filled keys, by field; those with mistakes are left out, so that the defaults hold."""
    found: dict[str, Any] = {}
    for name, tree in filled.items():
        form = keys[name].form
        value = form.value(tree, name, complain)
        if value is not None and form.fields is not None:
            found |= {field: value[item] for field, item in form.fields.items()}
        elif value is not None:
            found[keys[name].field] = value
    return found


# -- keys that hold other parts ----------------------------------------------------------------------------------------


def part_of(part: type[msgspec.Struct], *, whole: bool = False) -> Form:
    """A map of known keys that becomes a Struct of the plan, or the most important of its values alone.

    Args:
        part: what it becomes.
        whole: what is said over it replaces all of it, and not only the keys that it says itself.
    """

    def read_part(tree: Tree, key: str, reading: Reading) -> Map | None:
        if isinstance(tree, Items) or not (isinstance(tree, Map) or short_of(part)):
            wanted = "a value or a map" if short_of(part) else "a map"
            reading.complain(tree.position, f"{key}: expected {wanted}, not {kind(tree)}")
            return None
        if isinstance(tree, Scalar):
            return _read_short(part, tree, key, reading)
        found = read(keys_of(part), fields(tree, key, keys_of(part), reading), reading)
        places = {entry.key: entry.position for entry in tree}
        return Map(tuple(Entry(name, places[name], value) for name, value in found.items()), tree.position)

    def fill_part(tree: Tree, _key: str, scope: Scope) -> Map:
        filled = fill(keys_of(part), _by_key(tree), scope)
        return Map(tuple(entry._replace(value=filled[entry.key]) for entry in _entries(tree)), tree.position)

    def merge_part(before: Tree, tree: Tree) -> Map:
        both = {entry.key: entry for entry in (*_entries(before), *_entries(tree))}
        return Map(tuple(both.values()), tree.position)

    def value(tree: Tree, _key: str, complain: Complain) -> msgspec.Struct:
        return part(**values_of(keys_of(part), _by_key(tree), complain))

    form = Form(schema=ref(name_of(part)), read=read_part, fill=fill_part, value=value, part=part)
    return form if whole else msgspec.structs.replace(form, merge=merge_part)


def parts_of(part: type[msgspec.Struct]) -> Form:
    """A map from names of topics, or patterns of them, to parts of one kind: a dict in the plan."""
    one = part_of(part)

    def read_parts(tree: Tree, key: str, reading: Reading) -> Map | None:
        if not isinstance(tree, Map):
            reading.complain(tree.position, f"{key}: expected a map, not {kind(tree)}")
            return None
        found = ((entry, one.read(_or_nothing(entry.value), f"{key} {entry.key}", reading)) for entry in tree)
        return Map(tuple(entry._replace(value=value) for entry, value in found if value is not None), tree.position)

    def fill_parts(tree: Tree, key: str, scope: Scope) -> Map:
        filled = (entry._replace(value=one.fill(entry.value, key, scope)) for entry in _entries(tree))
        return Map(tuple(filled), tree.position)

    def value(tree: Tree, key: str, complain: Complain) -> dict[str, msgspec.Struct]:
        for entry in _entries(tree):
            try:
                names.key_of(entry.key)
            except InvalidName as error:
                complain(entry.position, f"{key}: {error}")
        return {entry.key: one.value(entry.value, key, complain) for entry in _entries(tree)}

    return Form(
        schema=map_of(one_of(ref(name_of(part)), {"type": "null"})),
        read=read_parts,
        fill=fill_parts,
        value=value,
        part=part,
    )


def _or_nothing(tree: Tree) -> Tree:
    """A key that stands alone, `odom:`, says nothing more of what it names."""
    return Map((), tree.position) if _is_empty(tree) else tree


def _read_short(part: type[msgspec.Struct], scalar: Scalar, key: str, reading: Reading) -> Map | None:
    """The map for which a single value stands."""
    among = short_of(part)
    chosen = among[-1]
    if len(among) > 1:  # the word tells which of them is meant
        by_word = {word: short for short in among for word in short.form.words}
        if not is_one_of(scalar, key, list(by_word), reading.complain):
            return None
        chosen = by_word.get(str(scalar.value), chosen)
    value = chosen.form.read(scalar, chosen.name, reading)
    return Map((Entry(chosen.name, scalar.position, value),), scalar.position) if value is not None else None


def _entries(tree: Tree) -> tuple[Entry, ...]:
    return tree.entries if isinstance(tree, Map) else ()


def _by_key(tree: Tree) -> dict[str, Tree]:
    return {entry.key: entry.value for entry in _entries(tree)}


def entries(tree: Tree, key: str, reading: Reading) -> tuple[Entry, ...]:
    """The entries of a map; none, with a mistake, where it is something else."""
    if isinstance(tree, Map):
        return tree.entries
    reading.complain(tree.position, f"{key}: expected a map, not {kind(tree)}")
    return ()


def named(part: str) -> Form:
    """A map from names to parts."""

    def read_parts(tree: Tree, key: str, reading: Reading) -> tuple[Any, ...]:
        found = (reading.part(part, entry) for entry in entries(tree, key, reading))
        return tuple(one for one in found if one is not None)

    return Form(schema=map_of(ref(part)), read=read_parts)


def named_values(schema: Schema) -> Form:
    """A map from names to single values."""

    def read_values(tree: Tree, key: str, reading: Reading) -> tuple[Entry, ...]:
        among = entries(tree, key, reading)
        return tuple(e for e in among if single(e.value, f"{key} {e.key}", reading.complain) is not None)

    return Form(schema=map_of(schema), read=read_values)


def special(name: str) -> Form:
    """A value that is like no other; the reader knows it by its name, and so does the schema."""
    return Form(schema=ref(name), read=lambda tree, _key, reading: reading.special(name, tree))


A_MAP: Final = Form(
    schema={"type": "object"}, read=lambda tree, key, reading: Map(entries(tree, key, reading), tree.position)
)
"""A map of anything."""
