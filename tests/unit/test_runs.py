"""Which robots are ended where none is named."""

import pytest

from robo.cli.views.runs import _robots_to_end
from robo.errors import RunError, UsageError
from robo.tools import runs
from robo.wire.discovery import hostname, user
from robo.wire.keys import SupervisorToken

MINE = SupervisorToken("r1", 1, hostname(), user=user())
ALSO_MINE = SupervisorToken("r2", 2, hostname(), user=user())
OF_BOB = SupervisorToken("r3", 3, hostname(), user="bob")
ELSEWHERE = SupervisorToken("r4", 4, "another_host", user="bob")


def ended(*found: SupervisorToken, every: bool = False, everyone: bool = False) -> list[str]:
    return _robots_to_end(found, every=every, everyone=everyone)


def test_without_a_word_it_is_the_only_one_of_ones_own() -> None:
    assert ended(MINE) == ["r1"]
    assert ended(MINE, OF_BOB) == ["r1"]
    with pytest.raises(UsageError, match="several robots run: r1, r2; say --robot-name, or --all"):
        ended(MINE, ALSO_MINE)
    with pytest.raises(UsageError, match="other users run r3 of bob; --everyone, or --robot-name"):
        ended(OF_BOB)
    with pytest.raises(RunError, match="no supervisor answers"):
        ended()


def test_all_are_all_but_those_of_other_users_of_the_machine(capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(MINE, ALSO_MINE, OF_BOB, ELSEWHERE, every=True) == ["r1", "r2", "r4"]
    assert "left alone: r3 of bob; --everyone ends what is of other users too" in capsys.readouterr().err
    assert ended(MINE, OF_BOB, ELSEWHERE, every=True, everyone=True) == ["r1", "r3", "r4"]


def test_a_supervisor_that_does_not_say_whose_it_is_is_ones_own() -> None:
    assert runs.is_mine(SupervisorToken("r1", 1, hostname()))
