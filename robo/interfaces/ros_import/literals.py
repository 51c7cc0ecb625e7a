"""Values as ROS writes them: constants and defaults. Pure."""

import math
import re
import struct
from collections.abc import Iterator

from robo.interfaces.catalogue import Constant
from robo.interfaces.ros_import.definition import Literal, TypeName
from robo.interfaces.ros_shape import FLOATS, INTEGERS, TEXTS
from robo.text.brief import shown

PRIMITIVE = ("bool", *INTEGERS, *FLOATS, *TEXTS)
_TRUTHS = {"true": True, "1": True, "false": False, "0": False}
_NUMBER = re.compile(r"[+-]?(?:0[xX][0-9a-fA-F]+|0[bB][01]+|0[oO][0-7]+|[0-9]{1,30})")


def read_literal(type_: TypeName, text: str) -> Literal:
    """The value that a text says, of one of ROS's own types.

    Raises:
        ValueError: it is none of the type.
    """
    if not type_.is_array:
        return _single(type_, text)
    if not (text.startswith("[") and text.endswith("]")):
        raise ValueError(f"expected a list such as [1, 2], not {shown(text)}")
    values = [_single(type_, item) for item in _items(text[1:-1])]
    if type_.length is not None and len(values) != type_.length:
        raise ValueError(f"expected {type_.length} elements, not {len(values)}")
    if type_.most is not None and len(values) > type_.most:
        raise ValueError(f"expected at most {type_.most} elements, not {len(values)}")
    return values


def _items(text: str) -> Iterator[str]:
    """What stands between commas; one behind the last element is left alone."""
    begin, quote, is_begun = 0, "", False
    for at, letter in enumerate(text):
        if quote:
            if letter == quote and text[at - 1] != "\\":
                quote = ""
        elif letter in "\"'" and not is_begun:
            quote, is_begun = letter, True
        elif letter == ",":
            yield text[begin:at].strip()
            begin, is_begun = at + 1, False
        elif not letter.isspace():
            is_begun = True
    if quote:
        raise ValueError(f"the quote of {shown(text[begin:].strip())} is not closed")
    if text[begin:].strip():
        yield text[begin:].strip()


def _single(type_: TypeName, text: str) -> Constant:
    if type_.base in TEXTS:
        return _text(type_, text)
    if type_.base == "bool":
        if text.lower() not in _TRUTHS:
            raise ValueError(f"expected true or false, not {shown(text)}")
        return _TRUTHS[text.lower()]
    if type_.base in FLOATS:
        return _float(type_.base, text)
    least, most = INTEGERS[type_.base]
    if _NUMBER.fullmatch(text) is None:
        raise ValueError(f"expected a whole number, not {shown(text)}")
    value = int(text, 0) if re.match(r"[+-]?0[xXbBoO]", text) else int(text)
    if not least <= value <= most:
        raise ValueError(f"a {type_.base} is from {least} to {most}, not {shown(text)}")
    return value


def _float(base: str, text: str) -> float:
    try:
        value = float(text)
        struct.pack("<f" if base == "float32" else "<d", value)
    except ValueError:
        raise ValueError(f"expected a number, not {shown(text)}") from None
    except OverflowError:
        raise ValueError(f"{shown(text)} is beyond {base}") from None
    if math.isinf(value) and "inf" not in text.lower():
        raise ValueError(f"{shown(text)} is beyond {base}")
    return value


def _text(type_: TypeName, text: str) -> str:
    """With or without quotes; the only escape is that of the quote."""
    quote = text[:1]
    if quote in ("'", '"') and len(text) > 1 and text.endswith(quote):
        inner = text[1:-1]
        if re.search(rf"(?<!\\){quote}", inner):
            raise ValueError(f"a quote within a text is written \\{quote}")
        text = inner.replace(f"\\{quote}", quote)
    if type_.letters is not None and len(text) > type_.letters:
        raise ValueError(f"expected at most {type_.letters} letters, not {len(text)}")
    return text
