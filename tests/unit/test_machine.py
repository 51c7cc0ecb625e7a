"""Small things that the operating system does for a run: priorities, probes, use; and calls at a time."""

import asyncio
import os
import subprocess
import sys
import threading
import time

import psutil
import pytest

from robo.machine import ancestry, orphans
from robo.machine.ancestry import is_exiting
from robo.machine.child import Child, Spawned
from robo.machine.priority import give_priority
from robo.machine.probe import listens, succeeds
from robo.machine.usage import Usage
from robo.supervisor.alarm import Alarm
from robo.supervisor.changes import Changes
from tests import virtual_time
from tests.support import PATIENCE


def test_a_child_may_be_started_again_and_again_as_a_router_is() -> None:
    async def lives(count: int) -> list[tuple[str, str]]:
        lines: list[tuple[str, str]] = []
        child = Child(Spawned(0, lambda _, __: None), lambda stream, line: lines.append((stream, line)))
        for number in range(count):
            await child.start([sys.executable, "-c", f"print({number})"], dict(os.environ))
            async with asyncio.timeout(PATIENCE):
                assert await child.wait() == 0
        return lines

    assert asyncio.run(lives(3)) == [("stdout", "0"), ("stdout", "1"), ("stdout", "2")]


def test_a_process_that_is_about_to_go_is_known() -> None:
    assert not is_exiting(os.getpid())
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        os.waitid(os.P_PID, ended.pid, os.WEXITED | os.WNOWAIT)
        assert is_exiting(ended.pid)
    assert not is_exiting(4_000_000), "beyond the ids that a kernel gives: the system does not tell"


@pytest.mark.parametrize(
    ("state", "flags", "pending", "exiting"), [("S", 0x400040, 0, False), ("R", 0x4, 0, True), ("D", 0, 1 << 8, True)]
)
def test_one_that_is_ending_or_was_killed_is_exiting(
    monkeypatch: pytest.MonkeyPatch, state: str, flags: int, pending: int, exiting: bool
) -> None:
    fields = [state, *"11110", str(flags), *"0" * 21, str(pending), *"000"]
    monkeypatch.setattr(ancestry, "_fields", lambda _: fields)
    monkeypatch.setattr(sys, "platform", "linux")
    assert is_exiting(1) == exiting


def test_what_needs_no_priority_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "setpriority", lambda *_: pytest.fail("nobody asked"))
    assert give_priority(1, None, ()) is None


def test_a_process_gets_its_priority_and_its_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[tuple[object, ...]] = []
    monkeypatch.setattr(os, "setpriority", lambda *words: done.append(words))
    monkeypatch.setattr(os, "sched_setaffinity", lambda *words: done.append(words), raising=False)
    assert give_priority(7, -5, (0, 1)) is None
    assert done == [(os.PRIO_PROCESS, 7, -5), (7, (0, 1))]


def test_what_a_process_has_to_do_without_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    def gone(*_: object) -> None:
        raise ProcessLookupError

    monkeypatch.setattr(os, "setpriority", refuse)
    assert give_priority(7, -5, ()) == "priority -5: [Errno 13] Permission denied"
    assert give_priority(7, -5, (2,)) == "priority -5 cpus [2]: [Errno 13] Permission denied"
    monkeypatch.setattr(os, "setpriority", gone)
    assert give_priority(7, -5, ()) is None, "it has ended already"


def test_a_probe_is_a_process_of_the_run_while_it_lasts() -> None:
    told: list[bool] = []
    spawned = Spawned(1, lambda _, running: told.append(running))

    async def probe(code: str) -> bool:
        return await succeeds([sys.executable, "-Sc", code], {"X": "y"}, None, spawned)

    assert asyncio.run(probe("import os; assert dict(os.environ)['X'] == 'y'"))
    assert not asyncio.run(probe("raise SystemExit(3)"))
    assert told == [True, False, True, False]
    assert not asyncio.run(succeeds(["/no/such/program"], {}, None, spawned))
    assert len(told) == 4


def test_a_probe_that_nobody_waits_for_any_more_is_killed() -> None:
    pids: list[int] = []
    spawned = Spawned(1, lambda pid, running: pids.append(pid) if running else None)

    async def give_up() -> None:
        probe = asyncio.create_task(
            succeeds([sys.executable, "-Sc", "import time; time.sleep(600)"], {}, None, spawned)
        )
        while not pids:
            await asyncio.sleep(0.001)
        probe.cancel()
        await asyncio.gather(probe, return_exceptions=True)
        # This loop has to collect it, before 3.12 by a thread.
        while psutil.pid_exists(pids[0]) or any("waitpid" in thread.name for thread in threading.enumerate()):
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.01)

    asyncio.run(give_up())


def test_an_address_where_something_listens() -> None:
    async def look() -> tuple[bool, bool]:
        server = await asyncio.start_server(lambda _, writer: writer.close(), "127.0.0.1", 0)
        address = f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
        open_ = await listens(address)
        server.close()
        await server.wait_closed()
        return open_, await listens(address)

    assert asyncio.run(look()) == (True, False)


def test_the_use_of_a_process_is_not_measured_over_too_short_a_time() -> None:
    now = 0.0
    usage = Usage(os.getpid(), lambda: now)
    usage.begin()
    cpu, memory = usage.measure()
    assert cpu == 0.0
    assert memory is not None
    assert memory > 1_000_000
    end = time.process_time() + 0.02
    while time.process_time() < end:
        pass
    now = 0.4
    assert usage.measure() == (cpu, memory), "too early"
    now = 0.6
    later, _ = usage.measure()
    assert later is not None
    assert later > 0.0


def test_a_process_that_is_gone_uses_nothing() -> None:
    assert Usage(4_000_000).measure() == (None, None)


def test_an_alarm_rings_at_the_last_time_that_it_was_set_to() -> None:
    async def wait() -> list[float]:
        rung: list[float] = []
        alarm = Alarm(lambda: rung.append(virtual_time.now()), virtual_time.now)
        alarm.set(10.0)
        alarm.set(30.0)
        await asyncio.sleep(40.0)
        alarm.set(35.0)  # which is over
        await asyncio.sleep(1.0)
        alarm.set(60.0)
        alarm.set(None)
        await asyncio.sleep(100.0)
        return rung

    assert virtual_time.run(wait()) == [30.0, 40.0]


def test_whoever_waits_looks_again_at_each_change() -> None:
    async def wait() -> list[str]:
        changes = Changes()
        seen: list[str] = []
        count = 0

        async def until(least: int) -> None:
            await changes.until(lambda: count >= least)
            seen.append(f"{least} at {count}")

        tasks = [asyncio.create_task(until(least)) for least in (2, 0, 1)]
        while count < 3:
            await asyncio.sleep(0)
            changes.notify()
            await asyncio.sleep(0)
            count += 1
        tasks.append(asyncio.create_task(until(9)))
        await asyncio.sleep(0)
        tasks[-1].cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        changes.notify()  # one who has given up is no obstacle
        return seen

    assert asyncio.run(wait()) == ["0 at 0", "1 at 1", "2 at 2"]


STUBBORN = """\
import signal
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, signal.SIG_IGN)
print("up", flush=True)
while True:
    signal.pause()
"""


def test_one_whose_number_is_a_thread_s_by_now_keeps_no_other_from_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    send = psutil.Process.send_signal

    def sends(process: psutil.Process, number: int) -> None:
        if process.pid == stubborn.pid:  # the other one is this very process
            send(process, number)

    monkeypatch.setattr(psutil.Process, "send_signal", sends)
    with subprocess.Popen([sys.executable, "-c", STUBBORN], stdout=subprocess.PIPE) as stubborn:
        assert stubborn.stdout is not None
        try:
            assert stubborn.stdout.readline() == b"up\n"
            assert thread.native_id is not None
            numbers = [thread.native_id, stubborn.pid]
            assert [one.pid for one in orphans._end(lambda: numbers)] == numbers
            stubborn.wait(PATIENCE)
        finally:
            over.set()
            stubborn.kill()
