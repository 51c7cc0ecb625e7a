"""The page of environment variables, from `robo/environment.py`."""

import ast
import re
from pathlib import Path

from docs_tools.reference.markdown import code, described, prose, table
from robo import environment
from robo.text.docstrings import assigned_docs

_SECTION = re.compile(r"^# -- (.*?) -+$", re.MULTILINE)


def lines() -> list[str]:
    """The page's lines: the sections of the file, with their variables."""
    source = Path(str(environment.__file__)).read_text(encoding="utf-8")
    titles = _SECTION.findall(source)
    found = ["Where an option of a command says the same, the option holds.", ""]
    for title, part in zip(titles, _SECTION.split(source)[2::2], strict=True):
        docs = assigned_docs(ast.parse(part).body)
        rows = [
            (code(getattr(environment, name)), prose(described(docs.get(name, ""), name)))
            for name in re.findall(r"^([A-Z_]+) = ", part, re.MULTILINE)
        ]
        found += [f"## {title[:1].upper()}{title[1:]}", "", *table(("variable", "what it says"), rows)]
    return found
