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
from collections.abc import Callable, Mapping
from pathlib import Path

from robo.launch.expression import ExpressionError, as_text, evaluate
from robo.launch.manifest import Condition
from robo.launch.packages import folders_of
from robo.text.brief import shown
from robo.text.suggestions import closest
from robo.text.tree import Entry, Items, Position, Problem, Scalar, Tree
from robo.text.yaml_tree import resolve_scalar
from robo.wire.names import is_word

MAX_TEXT = 1_000_000
"""A text that is longer once its `${name}` are replaced is refused, characters."""

MAX_FILLED = 20_000_000
"""The texts of one launch with `${name}` in them may have so many characters in all."""

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


class _Broken:
    """Stands for a value that could not be worked out; why has been said already."""


BROKEN = _Broken()


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


class Scope:
    """The names that can be used in one place of a manifest, and where mistakes go."""

    def __init__(self, file: Path, values: Mapping[str, object], problems: list[Problem], shared: Shared) -> None:
        """
        Args:
            file: the manifest.
            values: by name.
            problems: where mistakes are added.
            shared: of the launch.
        """
        self.file = file
        self.values = values
        self.problems = problems
        self._shared = shared

    @property
    def folder(self) -> Path:
        """What relative paths of this manifest are relative to."""
        return self.file.parent

    def inner(self, values: Mapping[str, object]) -> "Scope":
        """This scope with more names."""
        return Scope(self.file, {**self.values, **values}, self.problems, self._shared)

    def complain(self, position: Position, text: str) -> None:
        """Add a mistake."""
        self.problems.append(Problem(position, text))

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
        known = sorted({*self.values, *places})
        close = closest(name, known)
        instead = f"did you mean ${{{close}}}?" if close is not None else f"known are {', '.join(known)}"
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
        """The value of a scalar; a Word where it comes from outside, BROKEN where it has a mistake."""
        text = scalar.value
        if not isinstance(text, str) or "${" not in text:
            return text
        whole = _PATTERN.fullmatch(text)
        if whole is not None:
            return self._piece(whole, scalar)
        pieces = [self._piece(match, scalar) for match in _PATTERN.finditer(text)]
        if BROKEN in pieces:
            return BROKEN
        texts = [as_text(piece) for piece in pieces]
        if not self._fits(len(text) + sum(map(len, texts)), scalar.position):
            return BROKEN
        rest = iter(texts)
        return _PATTERN.sub(lambda _: next(rest), text)

    def _fits(self, length: int, position: Position) -> bool:
        """Whether a text may be written; small files can unfold to more than any machine holds."""
        before = self._shared.room
        self._shared.room -= length
        if length > MAX_TEXT:
            text = f"a text of {length:,} characters, once its ${{name}} are replaced; at most {MAX_TEXT:,}"
            self.complain(position, text)
        elif before >= 0 > self._shared.room:
            text = f"the texts of this launch have more than {MAX_FILLED:,} characters, once all ${{name}} are replaced"
            self.complain(position, text)
        return length <= MAX_TEXT and self._shared.room >= 0

    def value(self, scalar: Scalar) -> object:
        """The value of a scalar with its type, BROKEN where it has a mistake."""
        return settled(self.raw(scalar))

    def text(self, scalar: Scalar) -> str | None:
        """The value of a scalar as text, None where it has a mistake."""
        value = self.raw(scalar)
        return None if value is BROKEN else as_text(value)

    def path(self, scalar: Scalar) -> str | None:
        """The value of a scalar as a path, None where it has a mistake.

        What is put *into* a path stays below where it is put: only a value that is the whole path,
        or its beginning, may lead elsewhere.
        """
        text = scalar.value
        for match in _PATTERN.finditer(text) if isinstance(text, str) else ():
            if match.group() == text or match.group(1) is None:
                continue
            problems = len(self.problems)
            piece = as_text(self._piece(match, scalar))
            del self.problems[problems:]
            if ".." in re.split(r"[/\\]", piece) or (match.start() and piece.startswith("/")):
                where = scalar.place(match.start())
                self.complain(where, f"{match.group()} is {shown(piece)}, which leads out of the folder that is meant")
                return None
        found = self.text(scalar)
        if found is not None and "\0" in found:
            self.complain(scalar.position, "a path cannot hold a zero character")
            return None
        return found

    def plain(self, tree: Tree) -> object:
        """A tree as plain data with every `${name}` replaced; BROKEN where any of it has a mistake."""
        if isinstance(tree, Scalar):
            return self.value(tree)
        if isinstance(tree, Items):
            items = [self.plain(item) for item in tree.items]
            return BROKEN if BROKEN in items else items
        values = {entry.key: self.plain(entry.value) for entry in tree}
        return BROKEN if BROKEN in values.values() else values

    def texts(self, entries: tuple[Entry, ...]) -> dict[str, str]:
        """Single values by key, as text; those with mistakes are left out."""
        return {
            entry.key: text
            for entry in entries
            if isinstance(entry.value, Scalar) and (text := self.text(entry.value)) is not None
        }

    def check_names(self, tree: Tree) -> None:
        """Complain of every `${name}` that nothing defines, and of nothing else."""
        if isinstance(tree, Scalar):
            for match in _PATTERN.finditer(tree.value) if isinstance(tree.value, str) else ():
                if match[1] is not None and ":" not in match[1]:
                    self._piece(match, tree)
        elif isinstance(tree, Items):
            for item in tree.items:
                self.check_names(item)
        else:
            for entry in tree:
                self.check_names(entry.value)

    def _piece(self, match: re.Match[str], scalar: Scalar) -> object:
        if match.group() == "$${":
            return "${"
        name = match.group(1)
        try:
            if name is None:
                raise KeyError(f"{shown(scalar.value)}: '${{' is never closed; write $${{ for a literal one")
            return self.look_up(name)
        except KeyError as error:
            self.complain(scalar.place(match.start()), str(error.args[0]))
            return BROKEN

    # -- conditions ------------------------------------------------------------------------------

    def holds(self, condition: Condition) -> bool:
        """Whether a condition is met. One with a mistake is, so that what it guards is checked too."""
        when = self.truth(condition.when, default=True)
        return self.truth(condition.unless, default=False) is False and when

    def truth(self, scalar: Scalar | None, *, default: bool) -> bool:
        """The value of an expression; `default` where there is none or it has a mistake."""
        if scalar is None:
            return default
        if isinstance(scalar.value, bool):
            return scalar.value
        if not isinstance(scalar.value, str):
            self.complain(scalar.position, f"expected true, false or an expression, not {shown(scalar.value)}")
            return default
        try:
            return evaluate(scalar.value, self._operand)
        except _BrokenOperand:
            return default
        except ExpressionError as error:
            self.complain(scalar.place(error.offset), f"{shown(scalar.value)}: {error}")
            return default

    def _operand(self, name: str) -> object:
        value = settled(self.look_up(name))
        if value is BROKEN:
            raise _BrokenOperand
        return value


def _share_folder(package: str) -> Path:
    try:
        folders = [folder / "share" for folder in folders_of(package)]
    except LookupError as error:
        raise KeyError(f"${{share:{package}}}: {error}") from None
    for folder in folders:
        if folder.is_dir():
            return folder
    raise KeyError(f"${{share:{package}}}: package {shown(package)} has no folder {folders[0]}")
