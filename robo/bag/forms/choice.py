"""Which form a file has, or is to have."""

from pathlib import Path
from typing import Literal, get_args

from robo.bag.forms.lines import STANDARD
from robo.bag.mcap.format import MAGIC
from robo.bag.mcap.source import other_form
from robo.errors import BagError, UnreadableFile
from robo.text.files import open_regular

Form = Literal["mcap", "carmen", "csv", "jsonl"]
FORMS: tuple[Form, ...] = get_args(Form)
WRITTEN: tuple[Form, ...] = ("mcap", "csv", "jsonl")
"""Nobody writes logs of CARMEN."""

_ENDINGS: dict[str, Form] = {
    ".mcap": "mcap", ".csv": "csv", ".jsonl": "jsonl", ".ndjson": "jsonl", ".log": "carmen", ".clf": "carmen",
    ".carmen": "carmen",
}  # fmt: skip


def form_of_input(path: str, said: str | None = None) -> Form:
    """The form of what is read: as somebody has said, else as its name ends, else by its first bytes.

    Raises:
        BagError: it cannot be told, or there is no such form.
    """
    if said is not None:
        return _checked(said, FORMS)
    if path == STANDARD:
        return "jsonl"
    where = Path(path)
    try:
        if where.is_dir():
            has_csv = any(one.suffix.lower() == ".csv" for one in where.iterdir())
            return "csv" if has_csv and not any(one.suffix == ".mcap" for one in where.iterdir()) else "mcap"
        with open_regular(path) as file:
            begin = file.read(len(MAGIC))
        if begin == MAGIC:
            return "mcap"
        if (other := other_form(begin)) is not None:
            raise BagError(f"it is {other}", path)
    except UnreadableFile as error:
        raise BagError(str(error), path) from None
    except (OSError, ValueError) as error:
        raise BagError(getattr(error, "strerror", None) or str(error), path) from None
    found = _by_name(path)
    if found is None:
        raise BagError(f"its name does not say what it is: add --from {', '.join(FORMS[:-1])} or {FORMS[-1]}", path)
    return found


def form_of_output(path: str, said: str | None = None) -> Form:
    """The form of what is written: as somebody has said, else as its name ends.

    Raises:
        BagError: it cannot be told, or there is no such form, or nobody writes it.
    """
    if said is not None:
        return _checked(said, WRITTEN)
    found = "jsonl" if path == STANDARD else _by_name(path)
    if found is None or found not in WRITTEN:
        raise BagError("what is it to be? End its name in .mcap, .jsonl or .csv, or add --to mcap, jsonl or csv", path)
    return found


def _by_name(path: str) -> Form | None:
    name = Path(path).name.lower()
    return _ENDINGS.get(Path(name.removesuffix(".gz")).suffix)


def _checked(word: str, forms: tuple[Form, ...]) -> Form:
    for form in forms:
        if word == form:
            return form
    raise BagError(f"there is no form {word!r}; use {', '.join(forms[:-1])} or {forms[-1]}")
