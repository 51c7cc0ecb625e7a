"""The page of what nodes and supervisors tell, from `wire/reports.py` and the verbs of a run."""

import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, get_args, get_type_hints

import msgspec
from msgspec import inspect as shapes

from docs_tools.reference import messages
from docs_tools.reference.markdown import code, described, link, paragraphs, prose, table
from robo.supervisor.commands import Commands
from robo.text.docstrings import attribute_docs
from robo.wire import reports
from robo_messages import Message, type_name

_INTRO = """\
What answers queries on [the key space](keys.md), and what is published there: MessagePack maps with these fields.
`robo ps`, `why` and `events` print the same with `--json`."""

_WITHIN = ("Beat",)
"""What a node tells its own supervisor alone, past the network."""


def lines() -> list[str]:
    """The page's lines: the verbs of a run, then every map."""
    commands = Commands.__new__(Commands)  # it says its verbs before it knows a run
    header = ("verb", "request", "answer", "what")
    return [
        *_INTRO.splitlines(),
        "",
        "## What a supervisor is asked",
        "",
        *table(header, [_verb(name, verb) for name, verb in {**commands.tells, **commands.acts}.items()]),
        *[line for struct in structs() for line in _struct(struct)],
    ]


def structs() -> Iterator[type[msgspec.Struct]]:
    """What goes over the network, in the order of the module."""
    for name, value in vars(reports).items():
        among = isinstance(value, type) and issubclass(value, msgspec.Struct) and value.__module__ == reports.__name__
        if among and name not in _WITHIN:
            yield value


def _verb(name: str, verb: Callable[..., object]) -> tuple[str, str, str, str]:
    hints = get_type_hints(verb)
    answer = hints.pop("return")
    several = get_args(answer)
    (request,) = hints.values()
    told = f"list of {_link(several[0])}" if several else _link(answer)
    return code(name), _link(request), told, prose(described(inspect.getdoc(verb) or "", name))


def _link(struct: type[Any]) -> str:
    if issubclass(struct, Message):
        return messages.link_to(type_name(struct))
    return link(struct.__name__, struct.__name__)


def _struct(struct: type[msgspec.Struct]) -> list[str]:
    docs = {name: text for cls in reversed(struct.__mro__) for name, text in attribute_docs(cls).items()}
    info = shapes.type_info(struct)
    assert isinstance(info, shapes.StructType)
    rows = [
        (
            code(field.encode_name),
            form_text(field.type),
            prose(described(docs.get(field.name, ""), f"{struct.__name__}.{field.name}")),
        )
        for field in info.fields
    ]
    about = paragraphs(described(struct.__doc__ or "", struct.__name__))
    return [f"## {struct.__name__}", "", *about, *table(("field", "value", "what"), rows)]


def form_text(info: shapes.Type) -> str:
    """What a value looks like, in words."""
    if isinstance(info, shapes.Metadata):
        return form_text(info.type)
    if isinstance(info, shapes.StructType):
        return _link(info.cls)
    if isinstance(info, shapes.ListType):
        return f"list of {form_text(info.item_type)}"
    if isinstance(info, shapes.DictType):
        return f"map from {form_text(info.key_type)} to {form_text(info.value_type)}"
    if isinstance(info, shapes.UnionType):
        return " or ".join(map(form_text, info.types))
    if isinstance(info, shapes.LiteralType):
        return ", ".join(map(code, info.values))
    return _NAMES[type(info)]


_NAMES: Final[Mapping[type[shapes.Type], str]] = {
    shapes.AnyType: "any value",
    shapes.CustomType: "any value",  # `object`
    shapes.BoolType: "true or false",
    shapes.FloatType: "number",
    shapes.IntType: "whole number",
    shapes.NoneType: "null",
    shapes.StrType: "text",
}
