"""What a service manager hears of a run: over a real socket, of processes that are none."""

import asyncio
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from robo.launch.plan import ProcessPlan, ReadyPlan
from robo.machine.service_manager import ServiceManager
from robo.supervisor.attendance import Attendance, start_is_over, status_of
from tests.processes import FakeProcess, process_plan
from tests.virtual_time import VirtualLoop


class Systemd:
    """The socket of a service manager."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address)
        self.socket.setblocking(False)

    def heard(self) -> list[list[str]]:
        found = []
        while True:
            try:
                found.append(self.socket.recv(4096).decode().split("\n"))
            except BlockingIOError:
                return found


class Ending:
    begun = False
    limit = 2.0


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[Systemd]:
    there = Systemd(str(tmp_path / "notify"))
    yield there
    there.socket.close()


def attendance(systemd: Systemd, *processes: FakeProcess, watchdog: float | None = None) -> tuple[Attendance, Ending]:
    ending = Ending()
    manager = ServiceManager(systemd.socket.getsockname(), watchdog)
    members = {one.plan.full_name: one for one in processes}
    return Attendance(manager, members, ending, lambda plan: list(plan.needs), 15.0, lambda: 10.0), ending


def process(name: str, plan: ProcessPlan | None = None) -> FakeProcess:
    return FakeProcess(plan or process_plan(f"/r1/{name}"))


def test_a_process_that_nobody_manages_tells_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert ServiceManager.from_environment() is None
    monkeypatch.setenv("NOTIFY_SOCKET", "vsock:2:1234")  # of virtual machines, for their first process
    assert ServiceManager.from_environment() is None


@pytest.mark.parametrize(("pid", "watchdog"), [("own", 10.0), ("1", None), ("", 10.0)])
def test_the_variables_are_for_this_process_alone(
    monkeypatch: pytest.MonkeyPatch, pid: str, watchdog: float | None
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", "/run/notify")
    monkeypatch.setenv("WATCHDOG_USEC", "10000000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()) if pid == "own" else pid)
    assert ServiceManager.from_environment() == ServiceManager("/run/notify", watchdog)
    assert not {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"} & os.environ.keys()


def test_an_abstract_socket_is_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    there = Systemd(f"\0robo-test-{os.getpid()}")
    monkeypatch.setenv("NOTIFY_SOCKET", f"@robo-test-{os.getpid()}")
    manager = ServiceManager.from_environment()
    assert manager is not None
    assert manager.tell("READY=1", "STATUS=well")
    assert there.heard() == [["READY=1", "STATUS=well"]]
    there.socket.close()
    assert not manager.tell("READY=1")


def test_that_all_is_ready_is_told_once_and_what_is_wrong_after_that(systemd: Systemd) -> None:
    base, camera = process("base"), process("camera").come_to("starting", "", ready=False)
    camera.started_at = 9.0
    told, _ = attendance(systemd, base, camera)
    told.look()
    assert systemd.heard() == [["EXTEND_TIMEOUT_USEC=30000000", "STATUS=1 of 2 nodes ready; camera starting"]]
    camera.come_to("ready", ready=True)
    told.look()
    told.look()
    assert systemd.heard() == [["READY=1", "STATUS=2 of 2 nodes ready"]]
    camera.come_to("degraded", "no\nframes")
    told.look()
    assert systemd.heard() == [["STATUS=1 of 2 nodes ready; camera degraded: no frames"]]


def test_what_nobody_hears_is_told_again(systemd: Systemd, tmp_path: Path) -> None:
    told, _ = attendance(systemd, process("base"))
    os.rename(tmp_path / "notify", tmp_path / "away")
    told.look()
    assert not told.ready
    os.rename(tmp_path / "away", tmp_path / "notify")
    told.look()
    assert systemd.heard() == [["READY=1", "STATUS=1 of 1 node ready"]]


def test_a_stop_is_told_with_the_time_that_it_may_take(systemd: Systemd) -> None:
    told, ending = attendance(systemd, process("base"))
    ending.begun = True
    told.look()
    told.look()
    assert systemd.heard() == [["STOPPING=1", "STATUS=stopping", "EXTEND_TIMEOUT_USEC=17000000"]]


def test_a_sign_of_life_comes_twice_within_the_watchdog_s_time(systemd: Systemd) -> None:
    told, _ = attendance(systemd, process("base"), watchdog=0.5)

    async def attend_for_a_while() -> None:
        attending = asyncio.create_task(told.attend())
        await asyncio.sleep(1.1)
        attending.cancel()

    loop = VirtualLoop()
    loop.run_until_complete(attend_for_a_while())
    loop.close()
    assert systemd.heard().count(["WATCHDOG=1"]) == 5


def over(*processes: FakeProcess, now: float = 10.0) -> bool:
    return start_is_over({one.plan.full_name: one for one in processes}, lambda plan: list(plan.needs), now)


def test_a_robot_without_one_of_its_sensors_is_up() -> None:
    assert over(process("base"), process("camera").fail())
    assert over(process("base"), process("driver").complete())


def test_what_waits_for_others_is_not_waited_for() -> None:
    waits = process("arm", process_plan("/r1/arm", {"/r1/other_host": "ready"})).wait()
    assert over(process("base"), waits)
    goes_on = process("arm").wait()  # what it needs is there by now: it is about to be started
    assert not over(process("base"), goes_on)


def test_what_may_take_for_ever_is_waited_for() -> None:
    slow = process("map", process_plan("/r1/map", ready=ReadyPlan(timeout=0.0))).come_to("starting", ready=False)
    assert not over(slow, now=1e6)
    assert not over(process("map").come_to("restarting", ready=False, running=False, next_start=11.0))


def test_a_managed_node_that_stays_inactive_holds_up_nobody_for_ever() -> None:
    node = process("planner", process_plan("/r1/planner", ready=ReadyPlan(timeout=0.0)))
    node.come_to("standby", "inactive", ready=False)
    assert not over(node, now=30.0)
    assert over(node, now=100.0)


def test_a_status_is_one_line_that_is_not_too_long() -> None:
    many = {f"/r1/n{i}": process(f"n{i}").fail("x" * 200) for i in range(5)}
    text = status_of(many)
    assert text.startswith("0 of 5 nodes ready; n0 failed: xxx")
    assert len(text) == 300
    few = {f"/r1/n{i}": process(f"n{i}").fail("no") for i in range(5)}
    assert status_of(few) == "0 of 5 nodes ready; n0 failed: no; n1 failed: no; n2 failed: no; 2 more"
