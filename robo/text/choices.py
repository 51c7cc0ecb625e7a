"""Words of which only some are meant."""

from collections.abc import Iterable
from typing import TypeVar

W = TypeVar("W", bound=str)


def choice_of(word: str, choices: Iterable[W]) -> W | None:
    """The choice that a word is; None where it is none of them.

    `word in choices` would say the same of the word, but not make its type the choices' Literal.
    """
    return next((choice for choice in choices if choice == word), None)
