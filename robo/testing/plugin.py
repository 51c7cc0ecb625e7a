"""The fixtures that pytest finds where robo is installed. Nothing of robo is imported before one of them is used."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    import zenoh

    from robo.testing.bench import Bench
    from robo.testing.clock import Clock
    from robo.testing.launch import Launch
    from robo.testing.node import RunNode


_PATIENCE = "10"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare what a project may set for all its tests."""
    told = f"how long a test waits for robots, and for callbacks of nodes, unless it says otherwise, s ({_PATIENCE})"
    parser.addini("robo_patience", told, default=_PATIENCE)


_EXIT_CODE = pytest.StashKey[int]()


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Note with what this run ends."""
    session.config.stash[_EXIT_CODE] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """End the run, whatever tests have left behind."""
    leaks = sys.modules.get("robo.testing.leaks")
    if leaks is not None:
        leaks.end_run(config.stash.get(_EXIT_CODE, 1))


_LAUNCH = pytest.StashKey["Launch"]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show with a test that has failed what its robots were about."""
    report = yield
    if report.failed:
        starters = [node.stash[_LAUNCH] for node in item.listchain() if _LAUNCH in node.stash]
        robots = [robot for starter in starters for robot in starter.robots]
        report.sections += [(f"robot {robot.name}", robot.report()) for robot in robots]
    return report


@pytest.fixture
def nothing_left() -> Iterator[None]:
    """The test leaves no thread, session or process behind, or fails and says which. Robo's other fixtures use it."""
    from robo.testing.leaks import Before

    before = Before()
    yield
    before.check()


@pytest.fixture
def robo_session(nothing_left: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[zenoh.Session]:
    """A Zenoh network of this test alone: a session without links. What is said to robo in variables does not count."""
    del nothing_left  # it looks once this session is closed
    from robo.wire.network import Network
    from robo.wire.session import close_session, open_session

    for name in [name for name in os.environ if name.startswith("ROBO_")]:
        monkeypatch.delenv(name)
    session = open_session(Network(mode="peer"))
    yield session
    close_session(session)


@pytest.fixture
def _robo_bench(robo_session: zenoh.Session, request: pytest.FixtureRequest) -> Iterator[Bench]:
    from robo.testing.bench import Bench

    bench = Bench(robo_session, _patience(request.config))
    yield bench
    bench.close()


@pytest.fixture
def clock(_robo_bench: Bench) -> Clock:
    """The time of the nodes that `run_node` runs: it stands still until the test lets it go on."""
    return _robo_bench.clock


@pytest.fixture
def run_node(_robo_bench: Bench) -> RunNode:
    """Runs nodes in the test's process; they end with the test."""
    from robo.testing.node import RunNode

    return RunNode(_robo_bench)


@pytest.fixture
def launch(
    nothing_left: None, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Launch]:
    """Starts robots: real processes, at ports and in folders of this test alone; they end with the test."""
    del nothing_left  # it looks once they have ended
    yield from _launch(request, tmp_path_factory)


@pytest.fixture(scope="module")
def module_launch(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Launch]:
    """As `launch`, for fixtures of a module's own: a robot that several tests look at ends after the last of them."""
    from robo.testing.leaks import Before

    before = Before()
    yield from _launch(request, tmp_path_factory)
    before.check()


def _launch(request: pytest.FixtureRequest, folders: pytest.TempPathFactory) -> Iterator[Launch]:
    from robo.testing.launch import Launch

    starter = Launch(lambda: folders.mktemp("robot"), request.config.rootpath, _patience(request.config))
    request.node.stash[_LAUNCH] = starter
    yield starter
    starter.close()


def _patience(config: pytest.Config) -> float:
    said = config.getini("robo_patience")
    try:
        seconds = float(said)
    except (TypeError, ValueError):
        seconds = 0.0
    if not seconds > 0:
        raise pytest.UsageError(f"robo_patience = {said}: say how many seconds, such as {_PATIENCE}")
    return seconds
