"""What the documentation tells its readers to type works, in its order, as printed."""

import re
import shutil
import sys
from pathlib import Path

import psutil
import pytest

from tests.pages import PAGES, ROOT, Block, blocks
from tests.support import Desk, Running, eventually, is_endless

INSTALL = re.compile(r"^python3 -m venv \.venv && \.venv/bin/pip install -q \S+ && ")
"""It is installed here: that takes a minute, and CI does it before the tests."""

pytestmark = pytest.mark.timeout(300)


class Reader:
    """Types what stands in a page."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._at = desk.folder
        (desk.folder / ".venv").symlink_to(sys.prefix)

    def follow(self, block: Block) -> None:
        """Do what a block says."""
        if block.mark == "not run":
            return
        if block.mark == "file":
            file = self._at / block.about
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text)
        elif block.language == "python":
            (self._at / "snippet.py").write_text(block.text)
            self._type("python snippet.py", [])
        for command, output in block.commands():
            line = INSTALL.sub("", command)
            if folder := re.fullmatch(r"cd (\S+)", line):
                self._at = (self._at / folder[1]).resolve(strict=True)
            elif re.search(r"\brobo (up|router)\b", line) and is_endless(line):
                self._leave(self._desk.start(self._here(line)), ends=block.mark == "Ctrl-C after each")
            else:
                self._type(line, output)

    def _here(self, line: str) -> str:
        """A line as it is typed in the folder that the page has gone into."""
        return line if self._at == self._desk.folder else f"cd {self._at} && {line}"

    def _leave(self, terminal: Running, *, ends: bool) -> None:
        """Wait until it runs, and let it run in its terminal, or end it."""
        terminal.wait_for(" at tcp/")
        if ends:
            terminal.interrupt()
            assert terminal.wait() == 130, terminal.output
            assert "Traceback" not in terminal.output
            assert "FATAL" not in terminal.output

    def _type(self, line: str, output: list[str]) -> None:
        if " jq " in line and shutil.which("jq") is None:
            return
        fails = any(text.startswith("error: ") for text in output)
        code, said = self._desk.run(self._here(line), ends=fails or not is_endless(line))
        assert (code != 0) == fails, f"{line} ended with {code}\n{said}"
        assert "Traceback" not in said, f"{line}\n{said}"
        if fails or not is_endless(line):
            _compare(output, said, line)


def _compare(printed: list[str], said: str, line: str) -> None:
    """Find each line that a page prints below a command, in this order; others may stand between."""
    rest = _blurred(said)
    for wanted in printed:
        pattern = ".*".join(map(re.escape, _blurred(wanted).split("…")))
        found = re.search(pattern, rest)
        assert found, f"{line}: {wanted!r} is not what comes next in\n{said}"
        rest = rest[found.end() :]


def _blurred(text: str) -> str:
    """A text without its numbers."""
    return re.sub(r"\d+(\.\d+)?", "0", text)


def test_an_ellipsis_stands_for_what_varies() -> None:
    _compare(["one … three", "…", "0.5 s"], "zero\none two three\nfour\n1.25 s", "robo")
    with pytest.raises(AssertionError, match="four"):
        _compare(["four", "one"], "one\n", "robo")
    with pytest.raises(AssertionError, match="one"):
        _compare(["four", "one"], "one\nfour", "robo")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_works_from_top_to_bottom(page: Path, desk: Desk) -> None:
    reader = Reader(desk)
    for block in blocks(page):
        reader.follow(block)


def test_a_desk_leaves_no_robot_in_the_background(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    try:
        assert desk.run("robo up --robot-name r1 -d --wait")[0] == 0
        pids = [int(pid) for pid in re.findall(r'"pid": ?(\d+)', desk.run("robo ps --json")[1])]
        assert len(pids) == 6
    finally:
        desk.close()
    eventually(lambda: not any(map(psutil.pid_exists, pids)), "all of it has ended")
