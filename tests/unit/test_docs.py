"""The form of the documentation; tests/e2e/test_docs.py tries what it says."""

import re
from pathlib import Path

import pytest

from robo.cli import ros2_words
from tests.pages import PAGES, ROOT, blocks

LANGUAGES = {"sh", "console", "text", "python", "yaml", "json", "toml", "dockerfile", "xml"}
MARKS = {"", "not run", "file", "beside", "Ctrl-C after each"}

every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


@every_page
def test_every_block_says_what_it_is(page: Path) -> None:
    for block in blocks(page):
        assert block.language in LANGUAGES, f"{page}:{block.line}: say the language, `text` for what is no command"
        assert block.mark in MARKS, f"{page}:{block.line}"
        assert block.mark != "not run" or block.about, f"{page}:{block.line}: say why it is not run"
        if block.language == "console":
            assert block.text.startswith("$ "), f"{page}:{block.line}"


@every_page
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith(("http:", "https:")):
            continue
        name, _, anchor = target.partition("#")
        file = page if not name else page.parent / name
        assert file.exists(), f"{page}: {target}"
        if anchor:
            assert anchor in anchors(file), f"{page}: {target}"


def anchors(page: Path) -> set[str]:
    """What the headings of a page are called in links."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_blocks_are_read_with_what_is_said_of_them(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        """
<!-- beside: robo up -->
<!-- Ctrl-C after each -->
```sh
# a title
robo up one.yaml          # one
robo topic echo '#1'
```
<!-- file: a.py -->

```python
pass
```
Text takes a mark away.
```console
$ robo ps
nobody
$ robo down
```
"""
    )
    beside, shell, file, console = blocks(page)
    assert (beside.mark, list(beside.commands())) == ("beside", [("robo up", [])])
    assert (shell.mark, shell.line) == ("Ctrl-C after each", 5)
    assert list(shell.commands()) == [("robo up one.yaml", []), ("robo topic echo '#1'", [])]
    assert (file.mark, file.about, file.text) == ("file", "a.py", "pass\n")
    assert list(console.commands()) == [("robo ps", ["nobody"]), ("robo down", [])]
    assert console.mark == ""


def test_the_page_for_those_who_come_from_ros_2_says_what_the_commands_answer() -> None:
    page = (ROOT / "docs" / "from_ros2.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?`) \| (.*) \|$", page.partition("## What is not there")[2], re.MULTILINE)
    told = {word: line.replace("`", "") for words, line in rows for word in re.findall(r"`(?:ros2 )?(\w+)`", words)}
    assert told == {word: line.replace("`", "") for word, line in ros2_words.VERBS.items()}


def test_the_index_names_every_page() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").glob("*.md")} - {"index.md"}
    assert pages <= set(re.findall(r"\]\(([^)#]+)", index)), "each page has a line in docs/index.md"
