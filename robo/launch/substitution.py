"""`${name}`: values put into a manifest.

    ${speed}                   an argument, or a name that a loop gives
    ${env:NAME}                an environment variable; ${env:NAME:-default} where it may be unset
    ${dir} ${file}             the folder of this manifest, and the manifest itself
    ${workspace}               the folder that the command was given in
    ${share:package}           the folder `share` of an installed package
    ${anon:prefix}             prefix and a random end, the same in all of one launch
    $${                        a literal ${

A value that is nothing but one `${name}` takes the value with its type, so `${use_sim}` stays a bool;
within longer text the value becomes text.
"""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Protocol, TypeVar

import msgspec

from robo.launch.expression import ExpressionError, as_text, evaluate
from robo.packages.find import find
from robo.text.brief import shown
from robo.text.suggestions import closest
from robo.text.tree import Items, Position, Problem, Scalar, Tree
from robo.text.yaml_tree import resolve_scalar
from robo.wire.names import is_word

T = TypeVar("T")

Complain = Callable[[Position, str], None]
"""Takes a mistake: where it is, and what."""

MAX_TEXT = 1_000_000
"""A text that is longer once its `${name}` are replaced is refused, characters."""

MAX_FILLED = 20_000_000
"""The texts of one launch with `${name}` in them may have so many characters in all."""

PLACEHOLDER = re.compile(r"\$?\$\{[^}]*\}")
"""`${name}`, and the literal `$${…}`."""

_PATTERN = re.compile(r"\$\$\{|\$\{([^}]*)\}|\$\{")


Environment = Callable[[str, str | None], str | None]
"""What `${env:NAME}` is: given a variable and the default, if there is one; None where there is none."""


def of_process(variable: str, default: str | None) -> str | None:
    """This process's own environment."""
    return os.environ.get(variable, default)


class Word(str):
    """Text from outside of YAML, from a command line or the environment: its use decides its type."""

    __slots__ = ()


def settled(value: object) -> object:
    """A value of which nothing says the type: a Word means what it would mean in YAML."""
    return resolve_scalar(str(value)) if isinstance(value, Word) else value


class Broken(msgspec.Struct, frozen=True):
    """Stands for a value that could not be worked out."""

    problems: tuple[Problem, ...] = ()
    """Why; empty where that has been said already."""


BROKEN = Broken()


def known(value: T | Broken, complain: Complain) -> T | None:
    """A value; None where it is Broken, which is complained of."""
    if not isinstance(value, Broken):
        return value
    for problem in value.problems:
        complain(*problem)
    return None


def told(value: object, complain: Complain) -> object:
    """A value; one that is Broken is complained of, and from now on Broken without a word."""
    known(value, complain)
    return BROKEN if isinstance(value, Broken) else value


class _BrokenOperand(Exception):
    """A condition uses a value that could not be worked out."""


class Shared:
    """What all scopes of one launch have in common."""

    def __init__(self, environment: Environment = of_process) -> None:
        self.environment = environment
        self.anonymous: dict[str, str] = {}
        """By prefix, the name that `${anon:prefix}` gave."""
        self.room = MAX_FILLED
        """How many characters may still be written."""
        self.overflow: Problem | None = None
        """The first text for which there was no room, whether somebody needs it or not: others may be left out too."""

    def takes(self, length: int, position: Position) -> bool:
        """Whether a text may be written; small files can unfold to more than any machine holds."""
        before = self.room
        self.room -= length
        if before >= 0 > self.room:
            text = f"the texts of this launch have more than {MAX_FILLED:,} characters, once all ${{name}} are replaced"
            self.overflow = Problem(position, text)
        return self.room >= 0


class Guarded(Protocol):
    """What has `if:` and `unless:`."""

    @property
    def when(self) -> Scalar | None:
        """The expression of `if:`."""

    @property
    def unless(self) -> Scalar | None:
        """That of `unless:`."""


class Scope:
    """The names that can be used in one place of a manifest. A value that cannot be worked out is Broken."""

    def __init__(self, file: Path, values: Mapping[str, object], shared: Shared) -> None:
        """
        Args:
            file: the manifest.
            values: by name.
            shared: of the launch.
        """
        self.file = file
        self.values = values
        self._shared = shared

    @property
    def folder(self) -> Path:
        """What relative paths of this manifest are relative to."""
        return self.file.parent

    def inner(self, values: Mapping[str, object]) -> "Scope":
        """This scope with more names."""
        return Scope(self.file, {**self.values, **values}, self._shared)

    def look_up(self, name: str) -> object:
        """The value of a name, or of what stands within `${}`.

        Raises:
            KeyError: there is none; its text says so.
        """
        kind, colon, rest = name.partition(":")
        if colon:
            return self._function(kind, rest)
        if name in self.values:
            return self.values[name]
        places = {"dir": self.folder.absolute, "file": self.file.absolute, "workspace": Path.cwd}
        if name in places:
            return str(places[name]())
        among = sorted({*self.values, *places})
        close = closest(name, among)
        instead = f"did you mean ${{{close}}}?" if close is not None else f"known are {', '.join(among)}"
        raise KeyError(f"${{{name}}} is not defined; {instead}")

    def _function(self, kind: str, rest: str) -> object:
        if kind == "env":
            variable, default_given, default = rest.partition(":-")
            value = self._shared.environment(variable, default if default_given else None)
            if value is not None:
                return Word(value)
            raise KeyError(f"environment variable {variable} is not set; set it, or write ${{env:{variable}:-default}}")
        if kind == "share":
            return str(_share_folder(rest))
        if kind == "anon":
            if not is_word(rest):
                raise KeyError(f"${{anon:{rest}}}: the prefix is a name: letters, digits and _")
            return self._shared.anonymous.setdefault(rest, f"{rest}_{os.urandom(4).hex()}")
        raise KeyError(f"${{{kind}:…}} is not known; there are ${{env:NAME}}, ${{share:package}} and ${{anon:prefix}}")

    # -- values ----------------------------------------------------------------------------------

    def raw(self, scalar: Scalar) -> object:
        """The value of a scalar; a Word where it comes from outside."""
        text = scalar.value
        if not isinstance(text, str) or "${" not in text:
            return text
        whole = _PATTERN.fullmatch(text)
        if whole is not None:
            return self._piece(whole, scalar)
        pieces = [self._piece(match, scalar) for match in _PATTERN.finditer(text)]
        if any(isinstance(piece, Broken) for piece in pieces):
            return joined(pieces)
        texts = [as_text(piece) for piece in pieces]
        length = len(text) + sum(map(len, texts))
        fits = self._shared.takes(length, scalar.position)
        if length > MAX_TEXT:
            text = f"a text of {length:,} characters, once its ${{name}} are replaced; at most {MAX_TEXT:,}"
            return Broken((Problem(scalar.position, text),))
        if not fits:
            return BROKEN
        rest = iter(texts)
        return _PATTERN.sub(lambda _: next(rest), text)

    def value(self, scalar: Scalar) -> object:
        """The value of a scalar with its type."""
        return settled(self.raw(scalar))

    def text(self, scalar: Scalar) -> str | Broken:
        """The value of a scalar as text."""
        value = self.raw(scalar)
        return value if isinstance(value, Broken) else as_text(value)

    def path(self, scalar: Scalar) -> str | Broken:
        """The value of a scalar as a path.

        What is put *into* a path stays below where it is put: only a value that is the whole path,
        or its beginning, may lead elsewhere.
        """
        text = scalar.value
        for match in _PATTERN.finditer(text) if isinstance(text, str) else ():
            if match.group() == text or match.group(1) is None:
                continue
            value = self._piece(match, scalar)
            piece = "" if isinstance(value, Broken) else as_text(value)
            if ".." in re.split(r"[/\\]", piece) or (match.start() and piece.startswith("/")):
                what = f"{match.group()} is {shown(piece)}, which leads out of the folder that is meant"
                return Broken((Problem(scalar.place(match.start()), what),))
        found = self.text(scalar)
        if isinstance(found, str) and "\0" in found:
            return Broken((Problem(scalar.position, "a path cannot hold a zero character"),))
        return found

    def plain(self, tree: Tree) -> object:
        """A tree as plain data with every `${name}` replaced; Broken where any of it is."""
        if isinstance(tree, Scalar):
            return self.value(tree)
        if isinstance(tree, Items):
            items = [self.plain(item) for item in tree.items]
            return joined(items) if any(isinstance(item, Broken) for item in items) else items
        values = {entry.key: self.plain(entry.value) for entry in tree}
        broken = any(isinstance(value, Broken) for value in values.values())
        return joined(list(values.values())) if broken else values

    def undefined(self, tree: Tree) -> Iterator[Problem]:
        """Every `${name}` of a tree that nothing defines."""
        if isinstance(tree, Scalar):
            for match in _PATTERN.finditer(tree.value) if isinstance(tree.value, str) else ():
                if match[1] is not None and ":" not in match[1]:
                    piece = self._piece(match, tree)
                    yield from piece.problems if isinstance(piece, Broken) else ()
        elif isinstance(tree, Items):
            for item in tree.items:
                yield from self.undefined(item)
        else:
            for entry in tree:
                yield from self.undefined(entry.value)

    def _piece(self, match: re.Match[str], scalar: Scalar) -> object:
        if match.group() == "$${":
            return "${"
        name = match.group(1)
        try:
            if name is None:
                raise KeyError(f"{shown(scalar.value)}: '${{' is never closed; write $${{ for a literal one")
            return self.look_up(name)
        except KeyError as error:
            return Broken((Problem(scalar.place(match.start()), str(error.args[0])),))

    # -- conditions ------------------------------------------------------------------------------

    def holds(self, part: Guarded, complain: Complain) -> bool:
        """Whether `if:` and `unless:` are met. A part with a mistake in them counts, so that it is checked too."""
        when = True if part.when is None else known(self.truth(part.when), complain)
        unless = False if part.unless is None else known(self.truth(part.unless), complain)
        return when is not False and unless is not True

    def truth(self, scalar: Scalar) -> bool | Broken:
        """The value of an expression."""
        if isinstance(scalar.value, bool):
            return scalar.value
        if not isinstance(scalar.value, str):
            text = f"expected true, false or an expression, not {shown(scalar.value)}"
            return Broken((Problem(scalar.position, text),))
        try:
            return evaluate(scalar.value, self._operand)
        except _BrokenOperand:
            return BROKEN
        except ExpressionError as error:
            return Broken((Problem(scalar.place(error.offset), f"{shown(scalar.value)}: {error}"),))

    def _operand(self, name: str) -> object:
        value = settled(self.look_up(name))
        if isinstance(value, Broken):
            raise _BrokenOperand
        return value


def joined(values: list[object]) -> Broken:
    """What stands for several values of which one or more are Broken."""
    return Broken(tuple(problem for value in values if isinstance(value, Broken) for problem in value.problems))


def _share_folder(package: str) -> Path:
    try:
        found = find(package)
    except LookupError as error:
        raise KeyError(f"${{share:{package}}}: {error}") from None
    if found.share is None:
        raise KeyError(f"${{share:{package}}}: package {shown(package)} has no folder {found.folders[0] / 'share'}")
    return found.share
