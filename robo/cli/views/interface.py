"""`robo interface`: printing types of messages, services and actions."""

import msgspec

from robo.cli.json_text import document
from robo.cli.printing import note, paint, print_json, print_line, print_table, print_text
from robo.errors import ContractError, MessageError, UsageError
from robo.interfaces import apart, catalogue
from robo.interfaces.apart import Described, InRos, Sheet
from robo.interfaces.catalogue import FieldInfo
from robo.text import colours
from robo_messages import UnknownType


def print_list(*, json: bool) -> None:
    """Print all known types."""
    found = apart.types()
    listed = catalogue.together(found.listed.values())
    if json:
        for one in listed:
            print_json(one)
    else:
        rows = [(one.name, one.kind, one.description or f"in {one.source}") for one in listed]
        print_table([("TYPE", "KIND", "DESCRIPTION"), *rows])
    for problem in found.broken:
        note(f"left out: {problem}")


def print_type(name: str, form: str | None) -> None:
    """Print one type: its fields with types, defaults and units; or as JSON, JSON Schema, or ROS writes it.

    Args:
        name: of the type.
        form: `json`, `json_schema`, `ros` or `type_hash`; None for people.

    Raises:
        MessageError: there is no such type.
        ContractError: the file that says it cannot be imported, or ROS is asked for and cannot have it.
        UsageError: ROS makes it of another one, so that it has nothing but a hash.
    """
    try:
        found = apart.described(name)
    except UnknownType as error:
        raise MessageError(error.args[0]) from None
    sheets = found.sheets
    if found.made_of and form != "type_hash":
        raise UsageError(f"ROS makes {name} of {found.made_of}: only its --type-hash is there; show {found.made_of}")
    if form == "ros":
        print_text(_in_ros(found).text)
    elif form == "type_hash":
        print_text(_in_ros(found).type_hash)
    elif form == "json_schema":
        schemas = [sheet.schema for sheet in sheets]
        names = [sheet.interface.name.rpartition("_")[2].lower() for sheet in sheets]
        whole = schemas[0] if len(schemas) == 1 else dict(zip(names, schemas, strict=True))
        print_text(document(whole))
    elif form == "json":
        hashes = found.ros.parts if found.ros is not None else [(None, None)] * len(sheets)
        for sheet, (ros_type, type_hash) in zip(sheets, hashes, strict=True):
            print_json(msgspec.to_builtins(sheet.interface) | {"ros_type": ros_type, "type_hash": type_hash})
    else:
        for number, sheet in enumerate(sheets):
            if number:
                print_line("---")
            _print(sheet)


def _in_ros(found: Described) -> InRos:
    if found.ros is None:
        raise ContractError(found.not_in_ros)
    return found.ros


def _print(sheet: Sheet) -> None:
    interface = sheet.interface
    print_line(paint(interface.name, colours.BOLD))
    for line in interface.description.splitlines():
        print_line(f"  {line}".rstrip())
    for name, value in interface.constants.items():
        print_line(f"  {name} = {value}")
    rows = list(_rows(sheet, 0))
    widths = [max((len(row[i]) for row in rows), default=0) for i in range(2)]
    for left, kind, about in rows:
        print_line(f"  {left:{widths[0]}}  {kind:{widths[1]}}  {about}".rstrip())
    if not rows:
        print_line("  no fields")


def _rows(sheet: Sheet, depth: int) -> list[tuple[str, str, str]]:
    """Name, type, and default with description of each field, those of inner messages below theirs."""
    rows = []
    for field in sheet.interface.fields:
        about = _about(field, shows_default=field.name not in sheet.inner)
        rows.append((f"{'  ' * depth}{field.name}", field.type, about))
        if field.name in sheet.inner:
            rows += _rows(sheet.inner[field.name], depth + 1)
    return rows


def _about(field: FieldInfo, *, shows_default: bool) -> str:
    default = catalogue.default_text(field.default) if shows_default and field.default is not None else ""
    short = default if len(default) <= 24 else "…"
    return "  ".join(part for part in (f"= {short}" if short and short != '""' else "", field.description) if part)
