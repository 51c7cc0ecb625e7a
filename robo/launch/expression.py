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
from collections.abc import Callable, Iterable
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


LookUp = Callable[[str], object]
"""The value of a name or of what stands within `${}`; raises KeyError with a message."""

_Value = Callable[[LookUp], object]
"""A part of an expression that has been read: its value, once names have values."""


def evaluate(text: str, look_up: LookUp) -> bool:
    """Whether a condition holds.

    Raises:
        ExpressionError: it is not a valid expression, a name is unknown, or it is neither true nor false.
    """
    return Condition(text).holds(look_up)


class Condition:
    """A condition that is read once and asked often."""

    def __init__(self, text: str) -> None:
        """
        Raises:
            ExpressionError: it is not a valid expression.
        """
        self._value = _Parser(_tokens(text)).whole()

    def holds(self, look_up: LookUp) -> bool:
        """Whether it holds, as `evaluate` says it.

        Raises:
            ExpressionError: a name is unknown, or it is neither true nor false.
        """
        return self._value(look_up)


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
    """Makes functions of tokens, by the grammar above; each reads what it stands for and goes past it."""

    def __init__(self, tokens: list[_Token]) -> None:
        self._tokens = tokens
        self._at = 0
        self._depth = 0

    @property
    def token(self) -> _Token:
        return self._tokens[self._at]

    def whole(self) -> Callable[[LookUp], bool]:
        start = self.token
        value = self.either()
        if self.token.kind != "end":
            raise self.error(f"unexpected {shown(self.token.text)}")
        return _truth(value, start)

    def error(self, text: str, at: _Token | None = None) -> ExpressionError:
        return ExpressionError(text, (at or self.token).offset)

    def either(self) -> _Value:
        return self._joined("or", self.both, any)

    def both(self) -> _Value:
        return self._joined("and", self.negation, all)

    def _joined(self, word: str, operand: Callable[[], _Value], join: Callable[[Iterable[bool]], bool]) -> _Value:
        start = self.token
        first = operand()
        if self.token.text != word:
            return first
        parts = [_truth(first, start)]
        while self._accept(word):
            start = self.token
            parts.append(_truth(operand(), start))
        # All are asked: an unknown name is a mistake wherever it stands.
        return lambda look_up: join([part(look_up) for part in parts])

    def negation(self) -> _Value:
        if not self._accept("not"):
            return self.comparison()
        self._deeper()
        start = self.token
        value = _truth(self.negation(), start)
        self._depth -= 1
        return lambda look_up: not value(look_up)

    def comparison(self) -> _Value:
        left = self.value()
        sign = self.token
        if self._accept("in"):
            return _compared(left, self.value(), sign, _contains)
        if sign.text == "not" and self._tokens[self._at + 1].text == "in":
            self._at += 2
            return _compared(left, self.value(), sign, lambda item, container, at: not _contains(item, container, at))
        if sign.kind != "sign" or sign.text not in ("==", "!=", *_ORDER):
            return left
        self._at += 1
        right = self.value()
        if self.token.text in ("==", "!=", *_ORDER):
            raise self.error("one comparison at a time; join two with `and`")
        return _compared(left, right, sign, _equal if sign.text in ("==", "!=") else _ordered)

    def value(self) -> _Value:
        token = self.token
        if token.kind == "end":
            raise self.error("something is missing at the end")
        self._at += 1
        if token.kind == "number":
            return _constant(self._number(token))
        if token.kind == "text":
            return lambda look_up: _filled(token, look_up)
        if token.kind == "reference":
            return lambda look_up: _known(token.text[2:-1], token, look_up)
        if token.kind == "name" and token.text not in ("and", "or", "in", "not"):
            if token.text in _WORDS:
                return _constant(_WORDS[token.text])
            return lambda look_up: _known(token.text, token, look_up)
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

    def _list(self) -> _Value:
        self._deeper()
        items: list[_Value] = []
        while not self._accept("]"):
            if items:
                self._expect(",")
            items.append(self.value())
        self._depth -= 1
        return lambda look_up: [item(look_up) for item in items]

    def _accept(self, text: str) -> bool:
        if self.token.text != text:  # a text keeps its quotes, so 'or' in quotes is none of these
            return False
        self._at += 1
        return True

    def _expect(self, text: str) -> None:
        if not self._accept(text):
            raise self.error(f"expected {text!r}, not {shown(self.token.text)}")

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise self.error(f"nested more than {_MAX_DEPTH} levels deep")


def _constant(value: object) -> _Value:
    return lambda _look_up: value


def _truth(value: _Value, at: _Token) -> Callable[[LookUp], bool]:
    def found(look_up: LookUp) -> bool:
        known = value(look_up)
        if isinstance(known, bool):
            return known
        raise ExpressionError(f"{shown(known)} is neither true nor false; compare it with something", at.offset)

    return found


def _compared(left: _Value, right: _Value, sign: _Token, compare: Callable[[Any, Any, _Token], bool]) -> _Value:
    return lambda look_up: compare(left(look_up), right(look_up), sign)


def _equal(left: object, right: object, sign: _Token) -> bool:
    return (left == right and isinstance(left, bool) == isinstance(right, bool)) == (sign.text == "==")


def _ordered(left: object, right: object, sign: _Token) -> bool:
    numbers = isinstance(left, (int, float)) and isinstance(right, (int, float))
    if numbers or (isinstance(left, str) and isinstance(right, str)):
        return _ORDER[sign.text](left, right)
    raise ExpressionError(f"{shown(left)} and {shown(right)} have no order", sign.offset)


def _contains(item: object, container: object, at: _Token) -> bool:
    if isinstance(container, (list, tuple)):
        return item in container
    if isinstance(container, str) and isinstance(item, str):
        return item in container
    raise ExpressionError(f"{shown(item)} cannot be in {shown(container)}; use a list or a text", at.offset)


def _known(name: str, token: _Token, look_up: LookUp) -> object:
    try:
        return look_up(name)
    except KeyError as error:
        quotes = f"; a text stands in quotes: '{name}'" if token.kind == "name" else ""
        raise ExpressionError(f"{error.args[0]}{quotes}", token.offset) from None


def _filled(token: _Token, look_up: LookUp) -> str:
    """A text with the `${name}` in it replaced: in a shell one writes '${mode}' == 'fast'."""
    left = MAX_TEXT

    def filled(match: re.Match[str]) -> str:
        nonlocal left
        text = as_text(_known(match[1], token, look_up))
        left -= len(text)
        if left < 0:
            long = f"a text of more than {MAX_TEXT:,} characters, once its ${{name}} are replaced"
            raise ExpressionError(long, token.offset)
        return text

    return _REFERENCE.sub(filled, token.text[1:-1])


def as_text(value: object) -> str:
    """A value within longer text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else str(value)
