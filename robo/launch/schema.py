"""The JSON Schema of manifests, for editors that complete and check YAML by it."""

from typing import Final

import msgspec

from robo.launch.forms import TEXT, Schema, list_of, map_of, one_of
from robo.launch.language import definition, keys_of, name_of, ref
from robo.launch.manifest import PARTS, Manifest
from robo.launch.plan import NEEDS

SPECIAL: Final[dict[str, Schema]] = {
    "includes": one_of(ref("include"), {"type": "array", "items": ref("include")}),
    # A map of plain values is as good as one with a condition.
    "params": one_of(
        TEXT, {"type": "object"}, {"type": "array", "items": one_of(ref("params_item"), {"type": "object"})}
    ),
    "needs": one_of(TEXT, list_of(TEXT), map_of({"enum": list(NEEDS)})),
    "for_each": {
        "type": "object",
        "minProperties": 1,
        "maxProperties": 1,
        "additionalProperties": {"type": "array"},
    },
}
"""The values that the reader knows by name: they are no maps of known keys."""


def manifest_schema() -> Schema:
    """The JSON Schema (2020-12) of a launch manifest."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "robo launch manifest",
        **definition(Manifest),
        "$defs": SPECIAL | {name: definition(part) for name, part in parts().items()},
    }


def parts() -> dict[str, type[msgspec.Struct]]:
    """All parts of the language that are maps of known keys, by their names in the schema."""
    within = (key.form.part for part in PARTS.values() for key in keys_of(part).values())
    return {**PARTS, **{name_of(part): part for part in within if part is not None}}
