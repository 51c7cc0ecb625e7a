"""What people are told of a run, and whoever waits for one in the background."""

import pytest

from robo.supervisor.news import ENDS, HEED, News
from robo.wire.reports import State
from tests.processes import FakeJournal, FakeProcess, process_plan


class Desk:
    def __init__(self, *names: str) -> None:
        self.now = 10.0
        self.journal, self.notified = FakeJournal(), list[str]()
        self.processes = {f"/r1/{name}": FakeProcess(process_plan(f"/r1/{name}")) for name in names}
        self.news = News(self.processes, self.journal, self.notified.append, lambda: self.now)

    def __getitem__(self, name: str) -> FakeProcess:
        return self.processes[f"/r1/{name}"]

    def look(self, *, with_timing: bool = False) -> None:
        self.news.look("r1", "at tcp/127.0.0.1:7447", with_timing=with_timing)


def test_that_all_is_ready_is_told_once() -> None:
    desk = Desk("a", "b")
    desk["a"].wait()
    desk.now += 1.25
    desk.look()
    assert desk.journal.said == []
    desk["a"].complete()  # as good as ready
    desk.look()
    desk.look()
    assert desk.journal.said == ["r1 is ready: 2 nodes in 1.25 s, at tcp/127.0.0.1:7447; Ctrl-C stops"]
    assert desk.journal.happened == [("ready", "")]
    assert desk.notified == ["ready"]
    assert desk.news.all_ready


def test_one_node_is_one() -> None:
    desk = Desk("a")
    desk.look()
    assert desk.journal.said[0].startswith("r1 is ready: 1 node in 0.00 s")


def test_what_people_should_know_of_the_run_is_told_to_who_waits_as_well() -> None:
    desk = Desk("a")
    desk.news.heed("others cannot look at r1")
    assert desk.journal.warned == ["others cannot look at r1"]
    assert desk.notified == [f"{HEED}others cannot look at r1"]


def test_where_the_time_went_is_told_where_it_is_wanted() -> None:
    desk = Desk("a", "b")
    desk.news.phase_over("manifest read")
    desk.look(with_timing=True)
    told = "\n".join(desk.journal.said)
    assert "manifest read" in told
    assert "a started" in told
    assert "a ready" in told


@pytest.mark.parametrize(
    ("state", "said", "warned"),
    [
        ("failed", [], ["a broke; it is not started again: robo start a does that"]),
        ("restarting", [], ["a broke"]),
        ("degraded", [], ["a is degraded: broke"]),
        ("completed", ["a broke"], []),
        ("stopped", ["a is stopped"], []),
        ("ready", [], []),
        ("starting", [], []),
        ("stopping", [], []),
    ],
)
def test_people_are_told_what_becomes_of_a_process(state: State, said: list[str], warned: list[str]) -> None:
    desk = Desk("a")
    desk.news.changed(desk["a"].come_to(state, "broke"), closing=False)
    assert (desk.journal.said, desk.journal.warned) == (said, warned)
    assert desk.journal.happened == [(state, "a")]


def test_at_the_end_of_a_run_nobody_is_told_of_each_stop() -> None:
    desk = Desk("a", "b")
    desk.news.up()
    desk.news.changed(desk["a"].come_to("stopped", "as asked"), closing=True)
    desk.news.changed(desk["b"].fail("was killed by SIGKILL"), closing=True)
    assert desk.journal.said == []
    assert desk.journal.warned == ["b was killed by SIGKILL"]
    assert desk.journal.happened[1:] == [("stopped", "a"), ("failed", "b")], "but it has happened"
    assert desk.notified == ["up"]


def test_that_one_is_ready_is_told_where_nobody_knows_it() -> None:
    desk = Desk("a", "b")
    again = desk["a"].come_to("ready")
    again.restarts.count = 1
    desk.news.changed(again, closing=False)
    assert desk.journal.said == ["a is ready again"]
    desk.look()
    desk.news.changed(desk["b"].come_to("ready"), closing=False)
    assert desk.journal.said[2:] == ["b is ready"]
    desk.news.changed(desk["b"].come_to("ready", shows_readiness=False), closing=False)
    assert len(desk.journal.said) == 3, "it has only been started"


def test_what_waits_in_vain_is_named() -> None:
    desk = Desk("a")
    desk.processes["/r1/b"] = FakeProcess(process_plan("/r1/b", {"/r1/a": "ready"})).wait()
    desk.news.changed(desk["a"].fail(), closing=False)
    assert desk.journal.warned == [
        "a ended with exit code 1; it is not started again: robo start a does that",
        "b is not started: it needs a ready",
    ]


def test_whoever_waits_in_the_background_hears_why_it_will_not_be_ready() -> None:
    desk = Desk("a", "b")
    desk["a"].fail("ended with exit code 3")
    desk.news.tell_starter(ends=False)
    assert desk.notified == [], "too early: there is nobody to ask"
    desk.news.up()
    desk.news.tell_starter(ends=False)
    assert desk.notified == ["up", "a ended with exit code 3"]
    desk["a"].ready = True
    desk.look()
    desk["b"].fail()
    desk.news.tell_starter(ends=False)
    assert desk.notified[2:] == ["ready"], "it has been ready: nobody waits any more"
    desk.news.down()
    assert desk.notified[-1] == "down"


def test_whoever_waits_in_the_background_hears_that_the_run_ends_with_it() -> None:
    desk = Desk("a")
    desk.news.up()
    desk["a"].fail("was killed by SIGSEGV")
    desk.news.tell_starter(ends=True)
    assert desk.notified == ["up", f"{ENDS}a was killed by SIGSEGV"]


def test_a_run_in_the_foreground_has_nobody_waiting() -> None:
    journal = FakeJournal()
    news = News({}, journal)
    news.up()
    news.down()
    assert journal.happened == [("up", "")]
