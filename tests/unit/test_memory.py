from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from robo.environment import MEMORY_VARIABLE
from robo.errors import NotKept
from robo.node.memory import Memory


def test_what_is_kept_is_there_after_a_restart(tmp_path: Path) -> None:
    file = tmp_path / "m.json"
    file.write_text("{}")
    first = Memory(file, expected=True)
    assert first.recall("stop") is None
    assert not first.lost
    first.keep("stop", True)
    second = Memory(file, expected=True)
    assert second.recall("stop") is True
    assert not second.lost


@pytest.mark.parametrize("content", [None, b"", b"{", b"[1]", b"\xff", b"{" * 100_000])
def test_a_file_that_is_gone_or_torn_is_a_loss(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "m.json"
    if content is not None:
        file.write_bytes(content)
    assert Memory(file, expected=True).lost


def test_what_cannot_be_kept_is_told_and_lost_for_the_next(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    file = folder / "m.json"
    file.write_text("{}")
    memory = Memory(file, expected=True)
    file.unlink()
    folder.rmdir()
    with pytest.raises(NotKept, match="a restart of this node cannot know"):
        memory.keep("stop", True)
    assert memory.recall("stop") is True, "this process knows it all the same"
    assert Memory(file, expected=True).lost


def test_a_container_keeps_it_in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MEMORY_VARIABLE, str(tmp_path))
    first = Memory.of("/r1/arm/monitor")
    assert not first.lost
    first.keep("stop", True)
    assert Memory.of("/r1/arm/monitor").recall("stop") is True
    assert Memory.of("/r2/arm/monitor").recall("stop") is None


def test_a_container_whose_folder_was_full_knows_that_something_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(MEMORY_VARIABLE, str(tmp_path))
    memory = Memory.of("/r1/monitor")
    (tmp_path / "r1%monitor.json.new").mkdir()  # so that nothing can be written
    with pytest.raises(NotKept):
        memory.keep("stop", True)
    (tmp_path / "r1%monitor.json.new").rmdir()
    assert Memory.of("/r1/monitor").lost


@pytest.mark.parametrize("expected", [True, False])
def test_what_cannot_be_written_at_the_start_may_have_been_lost_before(tmp_path: Path, expected: bool) -> None:
    file = tmp_path / "m.json"
    file.write_text('{"stop": false}')
    (tmp_path / "m.json.new").mkdir()
    memory = Memory(file, expected=expected)
    assert memory.lost
    assert str(file) in memory.problem


def test_a_node_that_is_run_alone_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(MEMORY_VARIABLE, raising=False)
    memory = Memory.of("/r1/monitor")
    memory.keep("stop", True)
    assert not memory.lost
    assert Memory.of("/r1/monitor").recall("stop") is None


def test_what_two_turns_keep_at_once_is_all_kept(tmp_path: Path) -> None:
    file = tmp_path / "kept.json"
    memory = Memory(file)
    with ThreadPoolExecutor(4) as turns:
        for number in range(50):
            list(turns.map(lambda name, number=number: memory.keep(name, number), "abcd"))
            assert [Memory(file).recall(name) for name in "abcd"] == [number] * 4
