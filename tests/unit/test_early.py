"""What every process of a run finds in its environment."""

import pytest

from robo.supervisor.early import base_environment


def test_processes_keep_little_of_the_large_messages_that_they_have_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MALLOC_ARENA_MAX", raising=False)
    assert base_environment()["MALLOC_ARENA_MAX"] == "2"


def test_what_the_user_says_of_memory_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MALLOC_ARENA_MAX", "8")
    assert base_environment()["MALLOC_ARENA_MAX"] == "8"


def test_keys_of_a_secured_network_are_not_for_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBO_SECURITY", "/keys")
    assert "ROBO_SECURITY" not in base_environment()
