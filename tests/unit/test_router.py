"""The robot's router as the supervisor keeps it, without a process."""

import asyncio
import resource
from collections.abc import Mapping, Sequence
from contextlib import suppress
from types import SimpleNamespace

import msgspec
import pytest

from robo.environment import NETWORK_VARIABLE
from robo.errors import NetworkError
from robo.machine.forks import Fork
from robo.process import router as process_router
from robo.supervisor import router as supervised
from robo.supervisor.router import Router
from robo.wire.network import Network
from tests.virtual_time import now, run

NETWORK = Network(name="r1", listen=("unixsock-stream//tmp/x.sock", "tcp/127.0.0.1:7447"))


class Ends:
    """A process that ends after so long, with such a code, each time it is started; or where it is told to."""

    def __init__(self, *lives: tuple[float, int]) -> None:
        self._lives = list(lives)
        self.starts: list[float] = []
        self.environment: Mapping[str, str] = {}
        self.command: Sequence[str] = []
        self.patience: float | None = None
        self.running = False
        self._told = asyncio.Event()

    async def start(self, command: Sequence[str], environment: Mapping[str, str], *, fork: Fork | None) -> None:
        assert fork is None
        self.command, self.environment = command, environment
        self.starts.append(now())
        self.running = True

    async def wait(self) -> int:
        seconds, code = self._lives.pop(0)
        with suppress(TimeoutError):
            await asyncio.wait_for(self._told.wait(), seconds)
        self._told.clear()
        self.running = False
        return code

    async def stop(self, ended: "asyncio.Task[int]", *, patience: float) -> None:
        self.patience = patience
        self._told.set()
        await ended


class Journal:
    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warn(self, text: str) -> None:
        self.warnings.append(text)


class Answers:
    """What a router says when it is asked, time after time; the last for ever. Each silence takes a while.

    None where it does not listen.
    """

    def __init__(self, *answers: bool | None) -> None:
        self._answers = list(answers)
        self.asked: list[float] = []

    async def __call__(self, endpoint: str) -> bool | None:
        assert endpoint == "unixsock-stream//tmp/x.sock"
        self.asked.append(now())
        answers = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        await asyncio.sleep(supervised.ANSWERS_WITHIN if answers is False else 0.0)
        return answers


def router(process: Ends, journal: Journal, *answers: bool | None) -> Router:
    return Router(process, NETWORK, {"PATH": "/bin"}, None, journal, Answers(*(answers or (True,))))


def keep(process: Ends, journal: Journal, *answers: bool | None, seconds: float = 60.0) -> None:
    """Start a router, and keep it for so long."""

    async def kept() -> None:
        one = router(process, journal, *answers)
        await one.start()
        async with asyncio.timeout(seconds):
            await one.keep()

    with pytest.raises(TimeoutError):
        run(kept())


def test_it_finds_its_network_in_its_environment() -> None:
    process = Ends()
    run(router(process, Journal()).start())
    assert process.command[1:] == ["-m", "robo.process.router"]
    assert process.environment["PATH"] == "/bin"
    assert msgspec.json.decode(process.environment[NETWORK_VARIABLE], type=Network) == NETWORK


def test_one_that_dies_is_started_again_and_that_is_told() -> None:
    process, journal = Ends((5.0, 1), (0.0, -11), (1e9, 0)), Journal()
    keep(process, journal)
    assert process.starts == pytest.approx([0.0, 5.1, 5.2]), "one that dies at once does not keep a core busy"
    assert journal.warnings == [
        "the router ended with exit code 1; starting it again",
        "the router ended with killed by SIGSEGV; starting it again",
    ]


def test_one_at_which_nobody_can_arrive_is_the_end_of_a_start_and_not_of_a_run() -> None:
    process = Ends((2.0, process_router.UNUSABLE))
    with pytest.raises(NetworkError, match="nobody could reach the robot's router"):
        run(router(process, Journal()).keep())
    process, journal = Ends((5.0, 1), (2.0, process_router.UNUSABLE), (1e9, 0)), Journal()
    keep(process, journal)
    assert len(process.starts) == 3
    assert journal.warnings[1] == f"the router ended with exit code {process_router.UNUSABLE}; starting it again"


def test_one_that_answers_nobody_is_started_again_and_that_is_told() -> None:
    process, journal = Ends((1e9, 0), (1e9, 0)), Journal()
    keep(process, journal, True, False, False, True)
    looks = 3 * supervised.LOOK_EVERY + 2 * supervised.ANSWERS_WITHIN
    assert process.starts == pytest.approx([0.0, looks + 0.1]), "not before it was silent twice in a row"
    assert journal.warnings == ["the router runs, but answers nobody; starting it again"]


def test_one_silence_may_be_the_machine() -> None:
    process, journal = Ends((1e9, 0)), Journal()
    keep(process, journal, False, True, False, True)
    assert process.starts == [0.0]
    assert journal.warnings == []


def test_one_that_never_listens_is_started_again_and_that_is_told() -> None:
    process, journal = Ends((1e9, 0), (1e9, 0)), Journal()
    keep(process, journal, *[None] * 8, True)
    assert process.starts == pytest.approx([0.0, 8 * supervised.LOOK_EVERY + 0.1])
    assert journal.warnings == ["the router runs, but answers nobody; starting it again"]


@pytest.mark.parametrize("answers", [(None, None, True), (True, None)])
def test_one_that_is_late_or_whose_socket_was_taken_away_is_left_alone(answers: tuple[bool | None, ...]) -> None:
    process, journal = Ends((1e9, 0)), Journal()
    keep(process, journal, *answers)
    assert process.starts == [0.0]
    assert journal.warnings == []


def test_it_is_given_the_time_to_pass_on_what_is_on_the_way() -> None:
    process = Ends((0.6, 0))

    async def stop() -> None:
        kept = router(process, Journal())
        await kept.stop()
        assert process.patience is None, "one that does not run is not stopped"
        await kept.start()
        await kept.stop()

    run(stop())
    assert process.patience == process_router.LONGEST_LINGER + 1.0
    assert not process.running


MUCH = process_router.FULL + 1000


@pytest.mark.parametrize(
    ("waits", "ends_at"),
    [
        pytest.param([], 0.5, id="nobody waits for anything"),
        pytest.param([(0.3, 9)], 0.5, id="what waited is taken in time"),
        pytest.param([(0.6, 9), (0.8, 4)], 0.9, id="a slow reader is waited for"),
        pytest.param([(0.6, MUCH + 4), (0.65, 0), (0.7, MUCH)], 0.8, id="a pause is no end"),
        pytest.param([(100.0, 9)], 1.0, id="a reader that takes nothing is left"),
        pytest.param([(i / 2, MUCH - i) for i in range(1, 100)], 10.0, id="nobody is waited for without end"),
        pytest.param([(i / 50, i % 2 * 1075) for i in range(600)], 0.5, id="others that go on are not waited for"),
    ],
)
def test_a_router_serves_its_last_readers(
    waits: list[tuple[float, int]], ends_at: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds = 0.0

    def sleep(time: float) -> None:
        nonlocal seconds
        seconds += time

    def waiting() -> int:
        return next((left for until, left in waits if seconds < until), 0)

    monkeypatch.setattr(process_router, "time", SimpleNamespace(monotonic=lambda: seconds, sleep=sleep))
    process_router.serve_the_last(0.5, waiting)
    assert seconds == pytest.approx(ends_at, abs=0.05)


@pytest.mark.parametrize(
    ("limits", "wanted"),
    [
        ((1024, 1_048_576), (8192, 1_048_576)),
        ((1024, resource.RLIM_INFINITY), (8192, resource.RLIM_INFINITY)),
        ((1024, 4096), (4096, 4096)),
        ((20_000, 20_000), None),
        ((resource.RLIM_INFINITY, resource.RLIM_INFINITY), None),
    ],
)
def test_a_router_may_have_as_many_connections_as_it_is_granted(
    limits: tuple[int, int], wanted: tuple[int, int] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits)
    monkeypatch.setattr(resource, "setrlimit", lambda _, given: said.append(given))
    process_router.allow_connections()
    assert said == ([] if wanted is None else [wanted])
