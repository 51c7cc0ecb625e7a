"""What crosses, in the words of a command line: `odom=/odom`, `cmd_ros=/cmd_vel,from_ros,depth=1`. Pure."""

from collections.abc import Iterable
from typing import get_args

import msgspec

from robo.errors import UsageError
from robo.launch.plan import CrossingPlan
from robo.text.readable import readable
from robo.text.suggestions import suggest


def _words() -> dict[str, str]:
    """Each word that a value may be, with the field that it is a value of."""
    found: dict[str, str] = {}
    for field in msgspec.structs.fields(CrossingPlan):
        for part in (field.type, *get_args(field.type)):
            for one in (part, *get_args(part)):
                found |= {word: field.name for word in get_args(one) if isinstance(word, str)}
    return found


def crossings(words: Iterable[str] | None) -> dict[str, CrossingPlan] | None:
    """Rules by name in robo; None where there are no words.

    Raises:
        UsageError: a word makes no sense; tells all that do not.
    """
    found: dict[str, CrossingPlan] = {}
    wrong = []
    for word in words or ():
        try:
            name, plan = _crossing(word)
            found[name] = plan
        except ValueError as error:
            wrong.append(f"{word}: {error}")
    if wrong:
        raise UsageError("\n".join(wrong))
    return found or None


def _crossing(word: str) -> tuple[str, CrossingPlan]:
    names, *facts = word.split(",")
    name, _, ros = names.partition("=")
    values: dict[str, object] = {"ros": ros or None}
    known = _words()
    for fact in facts:
        key, equals, value = fact.partition("=")
        if equals:
            values[key] = int(value) if key == "depth" and value.isdecimal() else value
        elif fact in known:
            values[known[fact]] = fact
        else:
            raise ValueError(f"{fact} is not known; {suggest(fact, [*known, 'type=', 'depth='])}")
    unknown = [key for key in values if key not in CrossingPlan.__struct_fields__]
    if unknown:
        raise ValueError(f"{unknown[0]} is not known; {suggest(unknown[0], CrossingPlan.__struct_fields__)}")
    try:
        return name, msgspec.convert(values, readable(CrossingPlan))
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None
