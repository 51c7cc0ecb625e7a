"""`--watch` without a process: what of a run is touched when files change."""

import asyncio
import os
from collections.abc import Collection, Coroutine
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.launch.plan import Plan, ProcessPlan
from robo.supervisor.reload import Reload, files_of, same
from robo.text.tree import Position
from tests.processes import FakeJournal, FakeProcess, process_plan
from tests.virtual_time import run


def plan_of(*processes: ProcessPlan, files: tuple[str, ...] = ()) -> Plan:
    return Plan(
        manifest="m.yaml", description="", robot="r1", arguments={}, processes=processes, topics=(), files=files
    )


class Tasks:
    def __init__(self) -> None:
        self.running: set[asyncio.Task[object]] = set()

    def do(self, work: Coroutine[Any, Any, object]) -> object:
        task = asyncio.ensure_future(work)
        self.running.add(task)
        task.add_done_callback(self.running.discard)
        return task


class Desk:
    """A run whose manifest can be changed. It takes a second to add or to remove a process."""

    def __init__(self, *processes: ProcessPlan, files: tuple[str, ...] = ()) -> None:
        self.processes = {one.full_name: FakeProcess(one) for one in processes}
        self.journal, self.tasks = FakeJournal(), Tasks()
        self.taken: set[str] = set()
        """Names that others have."""
        self.tried: list[str] = []
        self.renewed: list[str] = []
        """Who was about to be started anew."""
        self.manifest: Plan | str = plan_of(*processes, files=files)
        assert isinstance(self.manifest, Plan)
        self.reload = Reload(self.manifest, lambda: self.manifest, self.processes, self.journal, self.tasks, self)

    async def add(self, plan: ProcessPlan) -> bool:
        self.tried.append(f"add {plan.full_name}")
        await asyncio.sleep(1.0)
        if plan.full_name in self.taken:
            return False
        assert plan.full_name not in self.processes, "it was there already"
        self.processes[plan.full_name] = FakeProcess(plan)
        return True

    async def remove(self, name: str) -> None:
        self.tried.append(f"remove {name}")
        await asyncio.sleep(1.0)
        del self.processes[name]

    def renew(self, names: Collection[str]) -> None:
        self.renewed += sorted(names)

    def follow(self, *plans: tuple[float, Plan]) -> None:
        """Take over plans, each after so many seconds more, and wait until all is done."""

        async def follow() -> None:
            for seconds, plan in plans:
                await asyncio.sleep(seconds)
                self.reload.take_over(plan)
            while self.tasks.running:
                await asyncio.gather(*self.tasks.running)

        run(follow())


A, B, C = (process_plan(f"/r1/{name}") for name in "abc")
RESTARTED = "restart: changed: its part of the manifest or of its parameter files"


# -- another plan --------------------------------------------------------------------------------


def test_only_what_is_different_is_touched() -> None:
    desk = Desk(A, B, C)
    other = msgspec.structs.replace(B, args=("--fast",))
    moved = msgspec.structs.replace(A, source=Position("m.yaml", 99, 1))
    desk.follow((0.0, plan_of(moved, other, process_plan("/r1/d"))))
    assert desk.processes.keys() == {"/r1/a", "/r1/b", "/r1/d"}
    assert desk.processes["/r1/a"].asked == []
    assert desk.processes["/r1/a"].plan == moved, "where it stands now"
    assert desk.processes["/r1/b"].asked == [RESTARTED]
    assert desk.processes["/r1/b"].plan == other
    assert sorted(desk.tried) == ["add /r1/d", "remove /r1/c"]


def test_a_name_that_others_have_is_not_started_and_is_tried_again_with_the_next_change() -> None:
    desk = Desk(A)
    desk.taken = {"/r1/b"}
    desk.follow((0.0, plan_of(A, B)))
    assert desk.processes.keys() == {"/r1/a"}
    desk.taken = set()
    desk.follow((0.0, plan_of(A, B)))
    assert desk.processes.keys() == {"/r1/a", "/r1/b"}


def test_what_is_taken_out_while_it_comes_does_not_stay() -> None:
    desk = Desk(A)
    desk.follow((0.0, plan_of(A, B)), (0.5, plan_of(A)))
    assert desk.processes.keys() == {"/r1/a"}


def test_what_is_put_back_while_it_goes_comes_again() -> None:
    desk = Desk(A, B)
    changed = msgspec.structs.replace(B, args=("--fast",))
    desk.follow((0.0, plan_of(A)), (0.5, plan_of(A, changed)))
    assert desk.processes["/r1/b"].plan == changed


def test_what_changes_while_it_comes_comes_as_it_is_wanted_last() -> None:
    desk = Desk(A)
    changed = msgspec.structs.replace(B, args=("--fast",))
    desk.follow((0.0, plan_of(A, B)), (0.5, plan_of(A, changed)))
    assert desk.processes["/r1/b"].plan == changed
    assert desk.processes["/r1/b"].asked == [RESTARTED]


@given(st.lists(st.tuples(st.sampled_from([0.0, 0.3, 1.0, 2.5]), st.sets(st.sampled_from("abcd"))), max_size=6))
def test_whatever_plans_follow_each_other_the_last_one_holds(steps: list[tuple[float, set[str]]]) -> None:
    desk = Desk(A, B)
    plans = [(seconds, plan_of(*(process_plan(f"/r1/{name}") for name in sorted(names)))) for seconds, names in steps]
    desk.follow(*plans)
    last = plans[-1][1] if plans else plan_of(A, B)
    assert desk.processes.keys() == {one.full_name for one in last.processes}


# -- changed files -------------------------------------------------------------------------------


class Files:
    """A manifest, a module and a parameter file, each of which can be changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._time = 1
        for name in ("m.yaml", "module.py", "log.gz"):
            self.change(name)

    def __getitem__(self, name: str) -> str:
        return str(self.folder / name)

    def change(self, name: str) -> None:
        self._time += 1
        (self.folder / name).write_text("x")
        os.utime(self.folder / name, ns=(self._time, self._time))


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def looked(desk: Desk) -> None:
    async def look() -> None:
        desk.reload.look()
        while desk.tasks.running:
            await asyncio.gather(*desk.tasks.running)

    run(look())


def test_a_changed_module_restarts_the_nodes_that_have_it(files: Files) -> None:
    desk = Desk(A, B, files=(files["m.yaml"],))
    desk.processes["/r1/a"].files = (files["module.py"],)
    looked(desk)
    files.change("module.py")
    looked(desk)
    looked(desk)
    assert desk.processes["/r1/a"].asked == [f"restart: changed: {files['module.py']}"]
    assert desk.processes["/r1/b"].asked == []


def test_changed_code_restarts_all_that_share_the_process(files: Files) -> None:
    shared = [process_plan(f"/r1/{name}", process="/r1/team") for name in "ab"]
    desk = Desk(*shared, C)
    desk.processes["/r1/a"].files = (files["module.py"], files["world.yaml"])
    looked(desk)
    files.change("world.yaml")
    looked(desk)
    assert {one.label for one in desk.processes.values() if one.asked} == {"a"}, "what it has read is its own"
    files.change("module.py")
    looked(desk)
    assert {one.label: len(one.asked) for one in desk.processes.values()} == {"a": 2, "b": 1, "c": 0}
    assert desk.renewed == ["/r1/a", "/r1/a", "/r1/b"]


def test_what_was_stopped_stays_so(files: Files) -> None:
    desk = Desk(A)
    process = desk.processes["/r1/a"].come_to("stopped", wanted=False)
    process.files = (files["module.py"],)
    looked(desk)
    files.change("module.py")
    looked(desk)
    assert process.asked == []


def test_a_changed_manifest_is_read_again_and_its_mistakes_are_told(files: Files) -> None:
    desk = Desk(A, files=(files["m.yaml"],))
    looked(desk)
    desk.manifest = "m.yaml:1:1: unknown key\nm.yaml:2:1: another"
    files.change("m.yaml")
    looked(desk)
    assert desk.journal.warned == ["m.yaml:1:1: unknown key", "m.yaml:2:1: another"]
    assert desk.processes.keys() == {"/r1/a"}
    desk.manifest = plan_of(A, B, files=(files["m.yaml"],))
    files.change("m.yaml")
    looked(desk)
    assert desk.processes.keys() == {"/r1/a", "/r1/b"}


def test_the_files_of_a_command_are_the_words_that_name_one(files: Files) -> None:
    words = ("python", "module.py", "log.gz", "none.py", "")
    command = process_plan("/r1/tool", service=None, run=words, cwd=str(files.folder))
    assert files_of(command) == [files["log.gz"], files["module.py"]]
    assert files_of(plan_of(command, files=("b.yaml", "a.yaml"))) == ["a.yaml", "b.yaml"]


def test_two_plans_that_do_the_same_are_the_same_wherever_they_stand() -> None:
    assert same(A, msgspec.structs.replace(A, source=Position("other.yaml", 7, 1)))
    assert not same(A, msgspec.structs.replace(A, needs={"/r1/b": "ready"}))
