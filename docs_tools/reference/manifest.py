"""The page of the manifest language, from `launch.manifest`, `launch.plan` and `launch.schema`."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec

from docs_tools.reference.markdown import code, described, link, prose, table
from robo.launch.expression import as_text
from robo.launch.forms import FILLED, MOST, Schema
from robo.launch.language import Key, keys_of, short_of
from robo.launch.manifest import Manifest
from robo.launch.plan import ProcessPlan
from robo.launch.schema import SPECIAL, parts

_INTRO = """\
How the parts work together is told in [launch manifests](../launch.md); `robo schema manifest` prints the same for
editors. Wherever a value is expected, text with `${name}` in it may stand."""

_FILE = "The file"
_TITLES: Final[Mapping[str, str]] = {"params_item": "params", "variable": "env", "includes": "include"}
"""Headings of parts that are not called as the keys that hold them."""


def lines() -> list[str]:
    """The page's lines: the file, and each part of it that is a map of known keys."""
    found = [
        *_INTRO.splitlines(),
        "",
        f"## {_FILE}",
        "",
        *_part(Manifest),
    ]
    for name, part in parts().items():
        if name == "override":
            found += [
                "## override",
                "",
                f"What is different about a node of an included manifest: {_link('node')}.",
                "",
            ]
        else:
            found += [f"## {_TITLES.get(name, name)}", "", *_part(part)]
    return found


def _part(part: type[msgspec.Struct]) -> list[str]:
    about = prose(described(part.__doc__ or "", part.__name__))
    keys = keys_of(part)
    short = [code(key.name) for key in short_of(part)]
    alone = f" A single value in place of the map is its {' or its '.join(short)}." if short else ""
    return [
        f"{about}{alone}",
        "",
        *table(("key", "value", "default", "what"), [_key(part, key) for key in keys.values()]),
    ]


def _key(part: type[msgspec.Struct], key: Key) -> tuple[str, str, str, str]:
    return (
        code(key.name),
        form_text(key.form.schema),
        _default(ProcessPlan if key.plain else part, key),
        prose(described(key.about, f"{part.__name__}.{key.field}")),
    )


def _default(part: type[msgspec.Struct], key: Key) -> str:
    """What holds where nothing is said; empty where that is nothing, or told by another part."""
    field = next((one for one in msgspec.structs.fields(part) if one.name == key.field), None)
    value = field.default if field is not None else msgspec.NODEFAULT
    if isinstance(value, bool) or (value and isinstance(value, (str, int, float))):
        return code(as_text(value))
    return ""


def form_text(schema: Schema) -> str:
    """What a value looks like, in words."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return form_text(SPECIAL[name]) if name in SPECIAL else _link(name)
    if "anyOf" in schema:
        return ", or ".join(_either(schema["anyOf"]))
    if "enum" in schema:
        return ", ".join(code(word) for word in schema["enum"])
    kind = schema.get("type")
    return _SEVERAL[frozenset(kind)] if isinstance(kind, list) else _KINDS[str(kind)](schema)


def _either(forms: Sequence[Schema]) -> list[str]:
    """What each of several forms looks like; a list of what may also stand alone is said so."""
    single = [form for form in forms if form != FILLED and form.get("type") != "array"]
    found = list(dict.fromkeys(map(form_text, single)))
    for form in forms:
        if form.get("type") == "array":
            items = form.get("items", {})
            found.append("list of them" if items.get("anyOf", [items]) == single else form_text(form))
    return found


def _link(name: str) -> str:
    title = _TITLES.get(name, name)
    return link(title, title)


def _number(schema: Schema) -> str:
    low, high = schema.get("minimum"), schema.get("maximum", MOST)
    noun = "whole number" if schema["type"] == "integer" else "number"
    if low is None:
        return f"{noun} above {schema['exclusiveMinimum']}"
    return f"{noun}, at least {low}" if high == MOST else f"{noun}, {low} to {high}"


def _object(schema: Schema) -> str:
    values = schema.get("additionalProperties")
    if not isinstance(values, dict):
        return "map"
    return f"map from {'one name' if schema.get('maxProperties') == 1 else 'names'} to {form_text(values)}"


def _array(schema: Schema) -> str:
    items = schema.get("items")
    if not items:
        return "list"
    text = form_text(items).replace(", or ", " or ")
    return f"list of {_PLURALS.get(text, text)}"


_PLURALS: Final[Mapping[str, str]] = {"text": "texts", "a value": "values"}
_SEVERAL: Final[Mapping[frozenset[str], str]] = {
    frozenset(("string", "number", "boolean", "null")): "a value",
    frozenset(("boolean", "string")): "`true`, `false` or an expression",
}
_KINDS: Final[Mapping[str, Callable[[Schema], str]]] = {
    "string": lambda _: "text",
    "boolean": lambda _: "`true`, `false`",
    "integer": _number,
    "number": _number,
    "array": _array,
    "object": _object,
    "null": lambda _: "nothing",
}
