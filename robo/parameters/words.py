"""Words of a command line: `name:=value`."""

from collections.abc import Iterable

from robo.errors import ParameterError
from robo.parameters.hints import plain_type
from robo.parameters.model import Parameters
from robo.parameters.shape import declared, declared_as


def sides_of(word: str) -> tuple[str, str] | None:
    """Name and value of `name:=value`, the name perhaps empty; None for another word."""
    name, assign, value = word.partition(":=")
    return (name, value) if assign else None


def sorted_out(words: Iterable[str]) -> tuple[list[str], dict[str, str]]:
    """The words that are no `name:=value`, and the values of those that are, by name; of one name the last."""
    others: list[str] = []
    values: dict[str, str] = {}
    for word in words:
        sides = sides_of(word)
        if sides is None:
            others.append(word)
        else:
            values[sides[0]] = sides[1]
    return others, values


def parse_assignment(text: str, cls: type[Parameters] | None = None) -> tuple[str, object]:
    """`name:=value` from a command line. Where `cls` declares the name as text, it stays text.

    Raises:
        ParameterError: there is no `:=`, or the value is cut short.
    """
    name, value = sides_of(text) or ("", "")
    if not name:
        raise ParameterError(f"parameter {text!r}: write name:=value, for example log_rate:=2.0")
    if cls is not None and (known := declared_as(name, declared(cls))) and plain_type(declared(cls)[known].hint) is str:
        return name, value
    return name, parse_value(value)


def parse_value(text: str) -> object:
    """A value as a command line writes it: true, 3, 2.5, [1, 2], {a: 1}, "quoted" or plain text.

    Raises:
        ParameterError: a list, map or quote is not closed.
    """
    stripped = text.strip()
    if stripped in ("true", "false"):
        return stripped == "true"
    for number in (int, float):
        try:
            return number(stripped)
        except ValueError:
            continue
    if stripped[:1] in ("[", "{", '"', "'"):
        import yaml

        try:
            value: object = yaml.safe_load(stripped)
        except yaml.YAMLError as error:
            raise ParameterError(f"value {text!r}: {error}") from None
        return value
    return text
