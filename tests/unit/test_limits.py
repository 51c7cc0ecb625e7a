"""Limits of processes: what manifests say, control groups of both versions as files, and what is said of an end."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robo.launch import resolve
from robo.launch.plan import LimitsPlan
from robo.launch.resolve import Resolution
from robo.machine import cgroup, limit_groups
from robo.machine.cgroup import ControlGroup
from robo.machine.limit_groups import LimitGroup, LimitGroups
from robo.machine.limits import Hold, used_memory
from robo.text.sizes import in_short
from tests.support import eventually

M = 1 << 20


# -- what a manifest says ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "size"),
    [("256M", 256 * M), ("256MiB", 256 * M), ("1.5G", 1536 * M), ("2 g", 2048 * M), (f"{M}", M), ("1024k", M)],
)
def test_sizes_are_read(tmp_path: Path, text: str, size: int) -> None:
    assert limits_of(tmp_path, f"{{memory: {text}}}").memory == size


@pytest.mark.parametrize("text", ["lots", "-1M", "1000", "1.5", "256X", "5000G"])
def test_what_is_no_size_is_told(tmp_path: Path, text: str) -> None:
    found = resolved(tmp_path, manifest(f"{{memory: {text}}}"))
    assert [p.text for p in found.problems] == [f"memory: '{text}' is no size of at least 1M; write 256M or 1.5G"]


def test_what_a_group_says_holds_for_all_in_it_and_a_node_says_more(tmp_path: Path) -> None:
    text = """
groups:
  g:
    limits: {memory: 64M, files: 100}
    nodes:
      a: {run: [sleep, 1]}
      b: {run: [sleep, 1], limits: {memory: 128M, cpu: 0.5}}
"""
    a, b = resolved(tmp_path, text).plan.processes
    assert a.limits == LimitsPlan(memory=64 * M, files=100)
    assert b.limits == LimitsPlan(memory=128 * M, files=100, cpu=0.5)


SHARED = """
groups:
  g:
    nodes:
      a: {{service: robo_services.velocity_smoother, process: p{0}}}
      b: {{service: robo_services.velocity_smoother, process: p{1}}}
"""


def test_nodes_that_share_a_process_share_its_limits(tmp_path: Path) -> None:
    one = ", limits: {memory: 64M}"
    for said in (("", one), (one, ""), (one, one)):
        found = resolved(tmp_path, SHARED.format(*said))
        assert not found.problems
        assert [p.limits for p in found.plan.processes] == [LimitsPlan(memory=64 * M)] * 2
    (problem,) = resolved(tmp_path, SHARED.format(one, ", limits: {files: 100}")).problems
    assert "limits: /a has other ones for the process /p, which both share" in problem.text


def resolved(folder: Path, text: str) -> Resolution:
    (folder / "m.yaml").write_text(text)
    return resolve.resolve(folder / "m.yaml", {}, robot="r1")


def manifest(limits: str) -> str:
    return f"groups: {{g: {{nodes: {{a: {{run: [sleep, '1'], limits: {limits}}}}}}}}}"


def limits_of(folder: Path, limits: str) -> LimitsPlan:
    found = resolved(folder, manifest(limits))
    assert not found.problems
    return found.plan.processes[0].limits


@pytest.mark.parametrize(("size", "text"), [(256 * M, "256M"), (1536 * M, "1.5G"), (107_123_456, "102M"), (9, "9")])
def test_sizes_are_told_in_short(size: int, text: str) -> None:
    assert in_short(size) == text


# -- control groups, as files ------------------------------------------------------------------------------------------

MOUNTS = """\
25 30 0:22 / /proc rw - proc proc rw
31 30 0:26 / /sys/fs/cgroup ro - tmpfs tmpfs ro
32 31 0:27 /docker/abc /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory
33 31 0:28 / /sys/fs/cgroup/cpu,cpuacct rw - cgroup cgroup rw,cpu,cpuacct
34 31 0:29 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw
"""
GROUPS = """\
4:memory:/docker/abc/inner
2:cpu,cpuacct:/user
0::/user.slice
"""


def test_where_a_process_is_is_known_for_both_versions(tmp_path: Path) -> None:
    (tmp_path / "mounts").write_text(MOUNTS)
    (tmp_path / "groups").write_text(GROUPS)
    found = cgroup.own_folders(tmp_path / "mounts", tmp_path / "groups")
    assert found == {
        "memory": Path("/sys/fs/cgroup/memory/inner"),
        "cpu": Path("/sys/fs/cgroup/cpu,cpuacct/user"),
        "cpuacct": Path("/sys/fs/cgroup/cpu,cpuacct/user"),
        "": Path("/sys/fs/cgroup/unified/user.slice"),
    }
    assert cgroup.own_folders(tmp_path / "none", tmp_path / "groups") == {}


def test_the_files_of_version_2_are_written(tmp_path: Path) -> None:
    for name in ("memory.max", "memory.swap.max", "memory.oom.group", "cpu.max", "cgroup.procs"):
        (tmp_path / name).touch()
    (tmp_path / "memory.events").write_text("low 0\noom 3\noom_kill 2\noom_group_kill 1\n")
    group = LimitGroup({"memory": tmp_path, "cpu": tmp_path})
    assert group.limit(LimitsPlan(memory=64 * M, cpu=1.5)) == []
    written = {name: (tmp_path / name).read_text() for name in ("memory.max", "memory.oom.group", "cpu.max")}
    assert written == {"memory.max": f"{64 * M}", "memory.oom.group": "1", "cpu.max": "150000 100000"}
    assert group.memory_kills() == 2
    assert group.take(4711)
    assert (tmp_path / "cgroup.procs").read_text() == "4711"


def test_the_files_of_version_1_are_written(tmp_path: Path) -> None:
    memory, cpu = tmp_path / "memory", tmp_path / "cpu"
    memory.mkdir()
    cpu.mkdir()
    for file in (memory / "memory.limit_in_bytes", cpu / "cpu.cfs_period_us", cpu / "cpu.cfs_quota_us"):
        file.touch()
    (memory / "memory.oom_control").write_text("oom_kill_disable 0\nunder_oom 0\noom_kill 1\n")
    group = LimitGroup({"memory": memory, "cpu": cpu})
    assert group.limit(LimitsPlan(memory=64 * M, cpu=0.5)) == []
    assert (memory / "memory.limit_in_bytes").read_text() == f"{64 * M}"
    assert ((cpu / "cpu.cfs_quota_us").read_text(), (cpu / "cpu.cfs_period_us").read_text()) == ("50000", "100000")
    assert group.memory_kills() == 1


def test_a_controller_that_is_not_granted_is_missing(tmp_path: Path) -> None:
    (tmp_path / "memory.max").touch()
    group = LimitGroup({"memory": tmp_path})
    assert group.limit(LimitsPlan(memory=64 * M, cpu=0.5)) == ["cpu"]


@pytest.fixture
def outer() -> Iterator[Path]:
    """A group of the kernel's own, version 2, whose only controller is one that nobody needs."""
    own = cgroup.own_folders().get("")
    folder = own / "robo-test-limits" if own is not None else Path("/nowhere")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("no control group of version 2 can be made here")
    yield folder
    eventually(lambda: cgroup.remove(folder), "the group is empty")


def test_the_kernel_lets_a_run_be_divided(outer: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    controllers = (outer / "cgroup.controllers").read_text().split()
    if not controllers:
        pytest.skip("no controller of version 2 is there")
    monkeypatch.setattr(limit_groups, "CONTROLLERS", frozenset(controllers[:1]))
    inner = outer / "robo-run"
    inner.mkdir()
    sleep = [sys.executable, "-c", "input()"]
    with (
        subprocess.Popen(sleep, stdin=subprocess.PIPE) as member,
        subprocess.Popen(sleep, stdin=subprocess.PIPE) as watchdog,
        subprocess.Popen(sleep, stdin=subprocess.PIPE) as limited,
    ):
        group = ControlGroup(inner)
        assert group.take(member.pid)
        assert cgroup.move(watchdog.pid, outer)
        found = LimitGroups("run", group, watchdog.pid, {}).of("/r1/eater")
        assert found is not None
        assert found.take(limited.pid)
        assert (inner / "r1.eater" / "cgroup.procs").read_text().split() == [str(limited.pid)]
        assert (inner / "rest" / "cgroup.procs").read_text().split() == [str(member.pid)]
        assert (outer / "robo-watchdogs" / "cgroup.procs").read_text().split() == [str(watchdog.pid)]
        assert group.before == outer / "robo-watchdogs"
        group.kill()  # whatever is in it, and in the groups below
        assert {member.wait(), limited.wait()} == {-signal.SIGKILL}
        eventually(group.remove, "the group is empty")
        watchdog.communicate(b"\n")


def test_where_somebody_else_is_in_the_group_nothing_is_limited_by_it(outer: Path) -> None:
    inner = outer / "robo-run"
    inner.mkdir()
    found = LimitGroups("run", ControlGroup(inner), 1, {})
    if not (outer / "cgroup.controllers").read_text().split():
        assert found.of("/r1/eater") is None
    assert LimitGroups("run", None, 1, {}).of("/r1/eater") is None


# -- one process -------------------------------------------------------------------------------------------------------


@pytest.fixture
def process() -> Iterator["subprocess.Popen[bytes]"]:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as running:
        yield running
        running.communicate(b"\n")


def test_without_a_control_group_what_is_used_is_looked_at(process: "subprocess.Popen[bytes]") -> None:
    used = [50 * M]
    hold = Hold(process.pid, LimitsPlan(memory=64 * M), None, lambda _: used[0])
    assert hold.lacking == ""
    assert not hold.look()
    assert hold.blame(-signal.SIGKILL, []) == ""
    used[0] = 65 * M
    assert hold.look()
    assert hold.blame(-signal.SIGKILL, []) == ": it used 65M of memory, and its limit is 64M"


def test_processor_time_is_limited_by_control_groups_alone(process: "subprocess.Popen[bytes]") -> None:
    hold = Hold(process.pid, LimitsPlan(cpu=0.5), None)
    assert hold.lacking == "cpu 0.5: no control group can be made here"
    assert not hold.look()


@pytest.mark.skipif(sys.platform != "linux", reason="limits of other processes are Linux's")
def test_open_files_and_reserved_memory_are_limited_by_the_system(process: "subprocess.Popen[bytes]") -> None:
    import resource

    Hold(process.pid, LimitsPlan(memory=64 * M, files=100), None)
    assert resource.prlimit(process.pid, resource.RLIMIT_NOFILE) == (100, 100)
    assert resource.prlimit(process.pid, resource.RLIMIT_DATA) == (384 * M, 384 * M)


def test_the_kernel_s_kill_is_told_as_what_it_is(process: "subprocess.Popen[bytes]", tmp_path: Path) -> None:
    for name in ("memory.max", "cgroup.procs"):
        (tmp_path / name).touch()
    (tmp_path / "memory.events").write_text("oom_kill 1\n")
    hold = Hold(process.pid, LimitsPlan(memory=64 * M), LimitGroup({"memory": tmp_path}))
    assert hold.blame(-signal.SIGKILL, []) == ""  # by somebody: the count is that of a former process
    (tmp_path / "memory.events").write_text("oom_kill 2\n")
    words = ": it needed more memory than its limit of 64M"
    assert hold.blame(-signal.SIGKILL, []) == hold.blame(137, ["Killed"]) == words
    assert hold.blame(0, []) == ""
    assert not hold.look()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("MemoryError", ": it got no more memory, and its limit is 64M"),
        ("OSError: [Errno 24] Too many open files: 'x'", ": it had as many files open as its limit of 100 allows"),
        ("KeyError: 'x'", ""),
    ],
)
def test_a_process_that_ends_because_it_gets_no_more_is_known_by_its_last_words(
    process: "subprocess.Popen[bytes]", line: str, words: str
) -> None:
    hold = Hold(process.pid, LimitsPlan(memory=64 * M, files=100), None)
    assert hold.blame(1, ["Traceback (most recent call last):", line]) == words
    assert Hold(process.pid, LimitsPlan(cpu=1.0), None).blame(1, [line]) == ""


def test_the_memory_of_what_a_process_has_started_is_its_own() -> None:
    inner = "data = b'x' * 50_000_000; print(flush=True); input()"
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {inner!r}])"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as running:
        assert running.stdout is not None
        running.stdout.readline()
        assert 50_000_000 < used_memory(running.pid) < 150_000_000
        running.communicate(b"\n")
    assert used_memory(running.pid) == 0
