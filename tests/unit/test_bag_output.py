"""New files made of others: whole and on the disk, or not there; nobody's file is lost."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robo.bag.edit.output import new_folder, new_output
from robo.errors import BagError


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("force", [False, True])
def test_nothing_has_the_name_before_it_is_whole(force: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with new_output(path, force=force) as output:
        output.write(b"half")
        assert not path.exists()
        output.write(b" and whole")
    assert path.read_bytes() == b"half and whole"
    assert names(tmp_path) == ["a.mcap"]


@pytest.mark.parametrize("force", [False, True])
def test_what_fails_leaves_nothing_and_takes_nothing_away(force: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"old")

    def interrupted() -> None:
        with new_output(path, force=force) as output:
            output.write(b"new")
            raise KeyboardInterrupt

    with pytest.raises((KeyboardInterrupt, BagError)):
        interrupted()
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["a.mcap"]


def test_who_was_sooner_keeps_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for links in (True, False):
        path = tmp_path / f"{links}.mcap"
        if not links:

            def refuse(*_: object) -> None:
                raise PermissionError("a disk without second names")

            monkeypatch.setattr(os, "link", refuse)
        with pytest.raises(BagError, match="it is there already"), new_output(path):
            path.write_bytes(b"theirs")
        assert path.read_bytes() == b"theirs"
        path.unlink()
        with new_output(path) as output:
            output.write(b"mine")
        assert path.read_bytes() == b"mine"
    assert names(tmp_path) == ["False.mcap", "True.mcap"]


def test_who_is_ended_leaves_no_half_file_under_the_name(tmp_path: Path) -> None:
    script = (
        "from robo.bag.edit.output import new_output\n"
        "with new_output('a.mcap') as output:\n"
        "    output.write(b'half')\n"
        "    print('written', flush=True)\n"
        "    input()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"written\n"
        process.send_signal(signal.SIGTERM)
        process.wait(30)
    assert not (tmp_path / "a.mcap").exists()
    with new_output(tmp_path / "a.mcap") as output:
        output.write(b"whole")
    assert (tmp_path / "a.mcap").read_bytes() == b"whole"


def test_a_folder_has_its_name_when_it_is_whole(tmp_path: Path) -> None:
    with new_folder(tmp_path / "a") as draft:
        (draft / "x").write_text("x")
        assert not (tmp_path / "a").exists()
    assert names(tmp_path / "a") == ["x"]
    with pytest.raises(BagError, match="it is there already"), new_folder(tmp_path / "a"):
        pass
    with pytest.raises(BagError, match="it cannot be written: No such file"), new_folder(tmp_path / "no" / "a"):
        pass
    with pytest.raises(BagError, match="it cannot be written: broken"), new_folder(tmp_path / "b"):
        raise OSError(28, "broken")
    assert names(tmp_path) == ["a"]
