"""Which pages there are."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from docs_tools.reference import commands, environment, keys, manifest, messages, nodes, reports
from docs_tools.reference.markdown import table

FOLDER = Path(__file__).parents[2] / "docs" / "reference"
COMMAND = "python -m docs_tools.reference"
_MADE = f"<!-- Made from the code by `{COMMAND}`: change what the code says, not this page. -->"


class Page(NamedTuple):
    """A page of the reference."""

    title: str
    about: str
    """For the index, a sentence."""
    lines: Callable[[], list[str]]


def pages() -> dict[str, str]:
    """All pages by the names of their files.

    Raises:
        Gap: something has no description.
    """
    among: Mapping[str, Page] = {
        "nodes.md": Page("Nodes", "The nodes that ship: topics, services, parameters.", nodes.lines),
        **{
            messages.page_of(group): Page(f"Messages: {group}", about, messages.lines_of(group))
            for group, about in messages.groups().items()
        },
        "commands.md": Page("Commands", "Every command of `robo` with its options and examples.", commands.lines),
        "manifest.md": Page("Launch manifests", "Every key of a manifest.", manifest.lines),
        "environment.md": Page("Environment variables", "What robo reads from its environment.", environment.lines),
        "keys.md": Page("Key space", "Every key and token that robo puts on the network.", keys.lines),
        "reports.md": Page("Reports", "What nodes and supervisors tell on these keys, field by field.", reports.lines),
    }
    index = [
        "What there is, complete and short; how to use it is told by the other pages. These pages are made from the",
        "code, and a test says when one of them is out of date.",
        "",
        *table(("page", "what"), [(f"[{page.title}]({name})", page.about) for name, page in among.items()]),
    ]
    whole = {"index.md": _text("Reference", index)}
    return whole | {name: _text(page.title, page.lines()) for name, page in among.items()}


def _text(title: str, lines: list[str]) -> str:
    return "\n".join([_MADE, "", f"# {title}", "", *lines]).rstrip("\n") + "\n"
