"""What the doctor finds on a machine that is made up."""

from collections.abc import Iterator

import pytest

from robo.machine import orphans
from robo.tools import doctor


def looks(monkeypatch: pytest.MonkeyPatch, *found: list[int]) -> None:
    """Let the doctor find other leftovers at each look, the last ones again and again."""

    def later() -> Iterator[list[int]]:
        yield from found
        while True:
            yield found[-1]

    looks = later()
    monkeypatch.setattr(orphans, "leftovers", lambda: next(looks))


def test_what_a_watchdog_is_just_ending_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    looks(monkeypatch, [7, 8], [8], [])
    assert doctor.leftovers().verdict == "ok"


def test_what_stays_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_ENDED_WITHIN", 0.0)
    looks(monkeypatch, [7, 8])
    found = doctor.leftovers()
    assert found.verdict == "fault"
    assert "7, 8" in found.message
    assert found.fix == "the next robo up ends them"
