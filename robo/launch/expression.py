"""Conditions: `use_sim and mode == 'gazebo'`, `robot in ['r1', 'r2']`, `not headless`.

    or          a or b
    and         a and b
    not         not a
    comparison  a == b   !=   <   <=   >   >=   a in b   a not in b
    value       name   ${name}   3   0.5   'text'   true   false   null   [a, b]   (a or b)

Values are looked up, never executed. Only true and false are conditions: a text or number must be
compared with something.
"""

import math
import operator
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from robo.text.brief import shown

_TOKEN = re.compile(
    r"""\s*(?:
      (?P<reference>\$\{[^{}]*\})
    | (?P<number>-?(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?(?![\w.]))
    | (?P<text>'[^']*'|"[^"]*")
    | (?P<name>[A-Za-z_][\w.]*(?:\[-?\d+\][\w.]*)*)
    | (?P<sign>==|!=|<=|>=|<|>|\(|\)|\[|\]|,)
    )""",
    re.VERBOSE,
)
_REFERENCE = re.compile(r"\$\{([^{}]*)\}")
_ORDER: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
}  # fmt: skip
_WORDS = {"true": True, "false": False, "null": None}
_MAX_DEPTH = 50

MAX_LENGTH = 10_000
"""An expression of more characters is refused."""

MAX_TEXT = 100_000
"""A text that is longer once its `${name}` are replaced is refused."""

MAX_DIGITS = 300
"""A number of more digits is refused; up to there whole numbers are compared exactly."""


class ExpressionError(Exception):
    """An expression that cannot be understood; `offset` is where in its text, from 0."""

    def __init__(self, text: str, offset: int) -> None:
        super().__init__(text)
        self.offset = offset


class _Token(NamedTuple):
    kind: str
    text: str
    offset: int


def evaluate(text: str, look_up: Callable[[str], object]) -> bool:
    """Whether a condition holds.

    Args:
        text: the expression.
        look_up: the value of a name or of what stands within `${}`; raises KeyError with a message.

    Raises:
        ExpressionError: it is no expression, a name is unknown, or it is neither true nor false.
    """
    return Condition(text).holds(look_up)


class Condition:
    """A condition that is read once and asked often."""

    def __init__(self, text: str) -> None:
        """
        Raises:
            ExpressionError: it holds what is no part of an expression.
        """
        self._tokens = _tokens(text)
        self._parsed(lambda _name: None, dry=True)

    def holds(self, look_up: Callable[[str], object]) -> bool:
        """Whether it holds, as `evaluate` says it.

        Raises:
            ExpressionError: as `evaluate`.
        """
        return self._parsed(look_up, dry=False)

    def _parsed(self, look_up: Callable[[str], object], *, dry: bool) -> bool:
        parser = _Parser(self._tokens, look_up, dry=dry)
        start = parser.token
        value = parser.either()
        if parser.token.kind != "end":
            raise parser.error(f"unexpected {shown(parser.token.text)}")
        return parser.truth(value, start)


def _tokens(text: str) -> list[_Token]:
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"an expression of {len(text):,} characters; at most {MAX_LENGTH:,}", 0)
    tokens = []
    offset = 0
    end = len(text.rstrip())
    while offset < end:
        match = _TOKEN.match(text, offset)
        if match is None or match.lastgroup is None:
            offset += len(text[offset:]) - len(text[offset:].lstrip())
            raise ExpressionError(f"cannot read {text[offset : offset + 10]!r}", offset)
        tokens.append(_Token(match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
        offset = match.end()
    return [*tokens, _Token("end", "the end", end)]


class _Parser:
    def __init__(self, tokens: list[_Token], look_up: Callable[[str], object], *, dry: bool) -> None:
        """`dry` only looks whether the tokens form an expression, whatever the names stand for."""
        self._tokens = tokens
        self._at = 0
        self._depth = 0
        self._look_up = look_up
        self._dry = dry

    @property
    def token(self) -> _Token:
        return self._tokens[self._at]

    def error(self, text: str, at: _Token | None = None) -> ExpressionError:
        return ExpressionError(text, (at or self.token).offset)

    def truth(self, value: object, at: _Token) -> bool:
        if isinstance(value, bool) or self._dry:
            return bool(value)
        raise self.error(f"{shown(value)} is neither true nor false; compare it with something", at)

    def either(self) -> object:
        start = self.token
        value = self.both()
        while self._accept("or"):
            left, start = self.truth(value, start), self.token
            right = self.truth(self.both(), start)
            value = left or right
        return value

    def both(self) -> object:
        start = self.token
        value = self.negation()
        while self._accept("and"):
            left, start = self.truth(value, start), self.token
            right = self.truth(self.negation(), start)
            value = left and right
        return value

    def negation(self) -> object:
        if not self._accept("not"):
            return self.comparison()
        self._deeper()
        start = self.token
        value = not self.truth(self.negation(), start)
        self._depth -= 1
        return value

    def comparison(self) -> object:
        left = self.value()
        sign = self.token
        if self._accept("in"):
            return self._contains(self.value(), left, sign)
        if sign.text == "not" and self._tokens[self._at + 1].text == "in":
            self._at += 2
            return not self._contains(self.value(), left, sign)
        if sign.kind != "sign" or sign.text not in ("==", "!=", *_ORDER):
            return left
        self._at += 1
        right = self.value()
        if self.token.text in ("==", "!=", *_ORDER):
            raise self.error("one comparison at a time; join two with `and`")
        if self._dry:
            return True
        if sign.text in ("==", "!="):
            return (left == right and isinstance(left, bool) == isinstance(right, bool)) == (sign.text == "==")
        numbers = isinstance(left, (int, float)) and isinstance(right, (int, float))
        if not (numbers or (isinstance(left, str) and isinstance(right, str))):
            raise self.error(f"{shown(left)} and {shown(right)} have no order", sign)
        return _ORDER[sign.text](left, right)

    def value(self) -> object:
        token = self.token
        if token.kind == "end":
            raise self.error("something is missing at the end")
        self._at += 1
        if token.kind == "number":
            return self._number(token)
        if token.kind == "text":
            return self._filled(token)
        if token.kind == "reference":
            return self._known(token.text[2:-1], token)
        if token.kind == "name" and token.text not in ("and", "or", "in", "not"):
            return _WORDS[token.text] if token.text in _WORDS else self._known(token.text, token)
        if token.text == "(":
            self._deeper()
            value = self.either()
            self._expect(")")
            self._depth -= 1
            return value
        if token.text == "[":
            return self._list()
        raise self.error(f"unexpected {shown(token.text)}", token)

    def _number(self, token: _Token) -> float:
        digits = sum(map(str.isdigit, token.text))
        if digits > MAX_DIGITS:
            raise self.error(f"a number of {digits} digits; at most {MAX_DIGITS}", token)
        if not re.search(r"[.eE]", token.text):
            return int(token.text)
        number = float(token.text)
        if not math.isfinite(number):
            raise self.error(f"{token.text} is larger than any number here", token)
        return number

    def _list(self) -> list[object]:
        self._deeper()
        items: list[object] = []
        while not self._accept("]"):
            if items:
                self._expect(",")
            items.append(self.value())
        self._depth -= 1
        return items

    def _contains(self, container: object, item: object, at: _Token) -> bool:
        if self._dry:
            return True
        if isinstance(container, (list, tuple)):
            return item in container
        if isinstance(container, str) and isinstance(item, str):
            return item in container
        raise self.error(f"{shown(item)} cannot be in {shown(container)}; use a list or a text", at)

    def _known(self, name: str, token: _Token) -> object:
        try:
            return self._look_up(name)
        except KeyError as error:
            quotes = f"; a text stands in quotes: '{name}'" if token.kind == "name" else ""
            raise self.error(f"{error.args[0]}{quotes}", token) from None

    def _filled(self, token: _Token) -> str:
        """A text, with the `${name}` in it replaced: who comes from a shell writes '${mode}' == 'fast'."""
        left = MAX_TEXT

        def filled(match: re.Match[str]) -> str:
            nonlocal left
            text = as_text(self._known(match[1], token))
            left -= len(text)
            if left < 0:
                raise self.error(f"a text of more than {MAX_TEXT:,} characters, once its ${{name}} are replaced", token)
            return text

        return _REFERENCE.sub(filled, token.text[1:-1])

    def _accept(self, text: str) -> bool:
        if self.token.text == text and self.token.kind != "text":
            self._at += 1
            return True
        return False

    def _expect(self, text: str) -> None:
        if not self._accept(text):
            raise self.error(f"expected {text!r}, not {shown(self.token.text)}")

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise self.error(f"nested more than {_MAX_DEPTH} levels deep")


def as_text(value: object) -> str:
    """A value within longer text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else str(value)
