"""A tool that comes while robots link anew, as the one at whose router they met has left."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import msgspec
import pytest
import zenoh

from robo.cli.connection import connect_to_supervisors, join_robot
from robo.cli.reach import Reach
from robo.machine.log_files import LogFiles, RunInfo
from robo.tools import gathering, runs
from robo.wire import meeting
from robo.wire.claims import Claim
from robo.wire.keys import SupervisorToken, control_key
from robo.wire.network import Network
from robo.wire.run_id import new_run_id
from robo.wire.session import close_session, open_session
from tests.reports import process

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(autouse=True)
def _places_of_this_test(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBO_MEETING", str(tmp_path / "m"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("ROBO_CONNECT", "ROBO_LISTEN", "ROBO_SECURITY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def holder() -> Iterator[zenoh.Session]:
    """The router that has just taken the meeting place over."""
    meeting.prepare()
    session = open_session(Network(mode="router", listen=(meeting.endpoint(),)))
    yield session
    close_session(session)


def logged(robot: str, endpoint: str) -> str:
    """The id of a run of this process, of which its log tells."""
    run = new_run_id()
    info = RunInfo(
        run=run, robot=robot, manifest="", begin=time.time_ns(), pid=os.getpid(), nodes=[f"/{robot}/base"],
        endpoints=[endpoint],
    )  # fmt: skip
    LogFiles(info).begin()
    return run


@pytest.fixture
def linking(holder: zenoh.Session) -> Iterator[None]:
    """The supervisor of robot r2 links to the router in a moment."""
    run = logged("r2", meeting.endpoint())
    key = control_key("r2", "ps")
    told = msgspec.msgpack.encode([msgspec.structs.replace(process("r2", "/r2/base"), run=run)])
    supervisors: list[object] = []

    def link() -> None:
        supervisors.append(holder.declare_queryable(key, lambda query: query.reply(key, told)))

    linked = threading.Timer(0.3, link)
    linked.start()
    yield
    linked.join()


def have_met_since(seconds: float) -> None:
    """Robots meet where they do for so long."""
    then = time.time() - seconds
    os.utime(Path(meeting.folder(), "router.sock"), (then, then))


@pytest.mark.usefixtures("linking")
def test_it_waits_for_who_has_not_linked_yet() -> None:
    with closing(join_robot(Reach())) as session:
        assert [one.robot for one in runs.processes(session)] == ["r2"]


def test_it_waits_for_nobody_who_meets_elsewhere(holder: zenoh.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meeting, "LINKED_WITHIN", 3600.0)
    logged("r2", "tcp/127.0.0.1:7448")
    gathering.wait_for_others(holder, 3600.0)


def test_it_waits_for_nobody_where_robots_have_met_for_long(
    holder: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged("r2", meeting.endpoint())
    monkeypatch.setattr(meeting, "LINKED_WITHIN", 3600.0)
    have_met_since(7200.0)
    gathering.wait_for_others(holder, 3600.0)


@pytest.mark.usefixtures("linking")
def test_a_tool_of_supervisors_waits_for_one_that_is_just_linking() -> None:
    have_met_since(7200.0)
    with connect_to_supervisors(Reach()) as session:
        assert [one.robot for one in runs.processes(session)] == ["r2"]


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:7448", ""])
def test_it_does_not_where_none_can_come_or_one_is_there(
    holder: zenoh.Session, monkeypatch: pytest.MonkeyPatch, endpoint: str
) -> None:
    logged("r2", endpoint or meeting.endpoint())
    monkeypatch.setattr(meeting, "LINKED_WITHIN", 3600.0)
    token = SupervisorToken("r3", os.getpid(), "host")
    with ExitStack() as undo:
        if not endpoint:
            undo.enter_context(holder.liveliness().declare_token(token.key()))
        client = open_session(Network(mode="client", connect=(meeting.endpoint(),)))
        undo.callback(close_session, client)
        gathering.wait_for_supervisors(client, 3600.0)


def test_it_does_not_wait_for_ever(holder: zenoh.Session) -> None:
    logged("r2", meeting.endpoint())
    gathering.wait_for_others(holder, 3600.0)
    assert meeting.held_for() > meeting.LINKED_WITHIN / 2


@pytest.mark.usefixtures("holder")
def test_who_begins_knows_how_long_others_may_still_link() -> None:
    here = Network.from_environment("router")
    assert 0.0 < Claim(here, "r2", [], new_run_id()).gathers_for() <= meeting.LINKED_WITHIN
    elsewhere = Network(mode="router", listen=("tcp/127.0.0.1:7448",))
    assert Claim(elsewhere, "r2", [], new_run_id()).gathers_for() == 0.0
    have_met_since(60.0)
    assert Claim(here, "r2", [], new_run_id()).gathers_for() == 0.0
