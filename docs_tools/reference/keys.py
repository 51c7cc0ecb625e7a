"""The page of the key space, from `robo/wire/keys.py`."""

import inspect
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import msgspec

from docs_tools.reference import messages
from docs_tools.reference.markdown import code, described, paragraphs, prose, table
from robo.text.docstrings import attribute_docs
from robo.wire import keys

_INTRO = """\
A topic and a service of the full name `/r1/odom` have the key `r1/odom`; what a query does there is told in
[architecture](../architecture.md#names-and-keys). What is told on the other keys is in [reports](reports.md)."""


def lines() -> list[str]:
    """The page's lines: what is told and asked, and the tokens."""
    return [
        *_INTRO.splitlines(),
        "",
        *table(("key", "what"), _keys()),
        "## Tokens",
        "",
        *paragraphs((keys.__doc__ or "").partition("\n\n")[2]),
        *[line for token in tokens() for line in _token(token)],
    ]


def _keys() -> Iterator[tuple[str, str]]:
    for topic, type_ in keys.SYSTEM_TOPICS.items():
        yield code(f"<namespace>/{topic}"), f"Messages of the type {messages.link_to(type_)}."
    for name, function in vars(keys).items():
        if inspect.isfunction(function) and function.__module__ == keys.__name__ and name.endswith("_key"):
            words = {parameter: f"<{parameter}>" for parameter in inspect.signature(function).parameters}
            yield code(function(**words)), prose(described(function.__doc__ or "", name))


def tokens() -> Iterator[type[msgspec.Struct]]:
    """The classes of all tokens."""
    for name, value in vars(keys).items():
        if isinstance(value, type) and issubclass(value, msgspec.Struct) and name.endswith("Token"):
            yield value


def _token(token: Any) -> list[str]:
    docs = {name: text for cls in reversed(token.__mro__) for name, text in attribute_docs(cls).items()}
    fields = [field for field in token.__struct_fields__ if field != "kind"]
    kinds = keys.VERBS if "kind" in token.__struct_fields__ else None
    words: dict[str, Any] = {name: f"<{name}>" for name in fields}
    if "qos" in words:
        words["qos"] = SimpleNamespace(word="<qos>")
    spelt = (
        [token(**words).key()]
        if kinds is None
        else [
            f"{token(**words | {'kind': kind, 'id': words['id'] if kind == 'pub' else ''}).key()}   # {says}"
            for kind, says in kinds.items()
        ]
    )
    rows = [(code(f"<{name}>"), prose(described(docs.get(name, ""), f"{token.__name__}.{name}"))) for name in fields]
    about = paragraphs(described(token.__doc__ or "", token.__name__))
    return [f"### {token.__name__}", "", *about, "```text", *spelt, "```", "", *table(("part", "what"), rows)]
