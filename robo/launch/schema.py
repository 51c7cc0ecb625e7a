"""The JSON Schema of manifests, for editors that complete and check YAML by it."""

from collections.abc import Mapping

from robo.launch import language
from robo.launch.language import Key, Schema


def manifest_schema() -> Schema:
    """The JSON Schema (2020-12) of a launch manifest."""
    definitions: dict[str, Schema] = dict(language.OTHER_FORMS)
    for name, (keys, short_forms) in language.SHORT_FORMS.items():
        whole = _object(keys)
        definitions[name] = {"anyOf": [*short_forms, whole]} if short_forms else whole
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "robo launch manifest",
        **_object(language.MANIFEST),
        "$defs": definitions,
    }


def _object(keys: Mapping[str, Key]) -> Schema:
    return {
        "type": "object",
        "properties": {name: {"description": key.about, **key.schema} for name, key in keys.items()},
        "additionalProperties": False,
    }
