"""Nodes that share a process, as a supervisor sees them; the process is a played one."""

import asyncio
import os
import signal
import socket
from collections import deque
from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import Any

import msgspec
import pytest

from robo.environment import LOG_LEVEL_VARIABLE, OWNER_VARIABLE, SPEC_VARIABLE
from robo.machine.child import Spawned
from robo.machine.forks import Fork
from robo.machine.orphans import Left
from robo.process.spec import Ended, Order
from robo.supervisor.sharing import Houses, Lodger

LIMIT = 60.0
PID = 4_000_000
"""Beyond the ids that a kernel gives."""


class Played:
    """A process that does what a test says."""

    def __init__(self, stage: "Stage", on_line: Callable[[str, str], None], hear: Callable[[bytes], None]) -> None:
        self.last_lines: deque[str] = deque(["the end"])
        self.left: Sequence[Left] = ()
        self.pid: int | None = None
        self.environment: Mapping[str, str] = {}
        self.orders: list[Order] = []
        self.outputs: dict[int, int] = {}
        """By number of a stay, where its node prints."""
        self.sent: list[signal.Signals] = []
        self.deaf = False
        self.line = on_line
        self._stage = stage
        self._hear = hear
        self._over: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    @property
    def running(self) -> bool:
        return self.pid is not None and not self._over.done()

    async def start(
        self, command: Sequence[str], environment: Mapping[str, str], *, cwd: str | None = None, fork: Fork | None
    ) -> None:
        assert cwd is None
        assert fork is None
        if self._stage.missing:
            raise FileNotFoundError(2, "No such file or directory", command[0])
        await asyncio.sleep(0)  # others may come meanwhile
        self.environment = environment
        self.pid = PID + len(self._stage.made)

    async def wait(self) -> int:
        return await asyncio.shield(self._over)

    def say(self, data: bytes, descriptors: Sequence[int] = ()) -> None:
        if self.deaf:
            raise BlockingIOError(11, "busy")
        order = msgspec.msgpack.decode(data, type=Order)
        self.orders.append(order)
        if order.spec:
            output, heart = map(os.dup, descriptors)
            self.outputs[order.number] = output
            self._stage.descriptors += [output, heart]
            with socket.socket(fileno=os.dup(heart)) as beats:
                beats.send(b"beat of %d" % order.number)

    def send(self, number: signal.Signals) -> None:
        self.sent.append(number)
        if number == signal.SIGKILL:
            self.end(-number)

    async def stop(self, ended: "asyncio.Task[int]", *, patience: float) -> None:
        assert patience > 0
        self.sent.append(signal.SIGINT)
        self.end(0)
        await ended

    def tell(self, number: int, code: int, *, closing: bool = False) -> None:
        """Say that a node has ended."""
        os.close(self.outputs[number])
        self._stage.descriptors.remove(self.outputs[number])
        self._hear(msgspec.msgpack.encode(Ended(number, code, closing)))

    def hear(self, data: bytes) -> None:
        self._hear(data)

    def end(self, code: int) -> None:
        if not self._over.done():
            self._over.set_result(code)


class Stage:
    """A run with played processes."""

    def __init__(self) -> None:
        self.made: list[Played] = []
        self.lines: list[tuple[str, str]] = []
        """Who printed, and what."""
        self.beats: list[bytes] = []
        self.left: list[Left] = []
        self.missing = False
        self.descriptors: list[int] = []
        self.lodgers: list[Lodger] = []
        """Those that have started."""
        spawned = Spawned(1, lambda _pid, _running: None)
        self.houses = Houses(
            spawned, lambda process, _, line: self.lines.append((process, line)), self.left.append, self._make
        )

    def _make(self, _: Spawned, on_line: Callable[[str, str], None], hear: Callable[[bytes], None]) -> Played:
        self.made.append(Played(self, on_line, hear))
        return self.made[-1]

    def lodger(self, name: str, process: str = "/r1/team") -> Lodger:
        def print_line(_: str, line: str) -> None:
            self.lines.append((name, line))

        return Lodger(self.houses, process, name, print_line, self.beats.append, 0.5)

    async def started(self, name: str, process: str = "/r1/team", **environment: str) -> Lodger:
        lodger = self.lodger(name, process)
        own = {SPEC_VARIABLE: f"spec of {name}", OWNER_VARIABLE: name, "HERE": "yes", **environment}
        await lodger.start(["python"], own, cwd=None, fork=None)
        self.lodgers.append(lodger)
        return lodger

    @property
    def process(self) -> Played:
        return self.made[-1]


def play(scene: Callable[[Stage], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        stage = Stage()
        try:
            async with asyncio.timeout(LIMIT):
                await scene(stage)
        finally:
            for process in stage.made:
                process.end(-9)
            for lodger in stage.lodgers:
                await lodger.wait()
            for descriptor in stage.descriptors:
                os.close(descriptor)

    asyncio.run(run())


def test_the_first_node_starts_the_process_and_each_is_told_to_begin() -> None:
    async def scene(stage: Stage) -> None:
        one, two = await asyncio.gather(stage.started("one"), stage.started("two", **{LOG_LEVEL_VARIABLE: "debug"}))
        assert len(stage.made) == 1
        assert one.pid == two.pid == stage.process.pid
        assert one.running
        own = stage.process.environment
        assert (own["HERE"], own[OWNER_VARIABLE]) == ("yes", "/r1/team")
        assert not own.keys() & {SPEC_VARIABLE, LOG_LEVEL_VARIABLE}
        orders = [(order.spec, order.level, order.period) for order in stage.process.orders]
        assert orders == [("spec of one", None, 0.5), ("spec of two", "debug", 0.5)]
        while len(stage.beats) < 2:
            await asyncio.sleep(0)
        assert sorted(stage.beats) == [b"beat of 1", b"beat of 2"]
        other = await stage.started("three", "/r1/other")
        assert len(stage.made) == 2
        assert other.pid != one.pid

    play(scene)


def test_lines_are_those_of_the_node_that_printed_them_or_of_the_process() -> None:
    async def scene(stage: Stage) -> None:
        one, two = await stage.started("one"), await stage.started("two")
        os.write(stage.process.outputs[2], b"INFO  hello\n")
        stage.process.line("stdout", "bare")
        stage.process.tell(2, 3)
        assert await two.wait() == 3
        assert stage.lines == [("/r1/team", "bare"), ("two", "INFO  hello")]
        assert [*two.last_lines] == ["INFO  hello"]
        assert [*one.last_lines] == []

    play(scene)


def test_a_node_that_is_asked_to_end_ends_alone_and_the_last_one_ends_the_process() -> None:
    async def scene(stage: Stage) -> None:
        one, two = await stage.started("one"), await stage.started("two")
        one.send(signal.SIGTERM)  # whatever its manifest says comes first
        one.send(signal.SIGCONT)
        assert stage.process.sent == [signal.SIGCONT]
        assert (stage.process.orders[-1].number, stage.process.orders[-1].spec) == (1, "")
        stage.process.tell(1, 0)
        assert await one.wait() == 0
        assert not one.running
        assert one.pid is None, "its id may soon be that of another stay"
        assert two.running
        again = await stage.started("one")
        assert len(stage.made) == 1
        for lodger, number in ((two, 2), (again, 3)):
            lodger.send(signal.SIGINT)
            stage.process.tell(number, 0)
            assert await lodger.wait() == 0
        await stage.houses.close()
        assert stage.process.sent[-1] == signal.SIGINT
        assert not stage.process.running
        await stage.started("one")
        assert len(stage.made) == 2, "that process is gone"

    play(scene)


def test_a_process_that_is_killed_takes_all_its_nodes_along() -> None:
    async def scene(stage: Stage) -> None:
        lodgers = [await stage.started(name) for name in ("one", "two")]
        stage.process.end(-9)
        assert [await lodger.wait() for lodger in lodgers] == [-9, -9]
        assert [lodger.pid for lodger in lodgers] == [stage.process.pid] * 2
        assert [[*lodger.last_lines] for lodger in lodgers] == [["the end"]] * 2

    play(scene)


def test_a_process_that_ends_without_a_word_of_its_nodes_has_failed() -> None:
    async def scene(stage: Stage) -> None:
        one = await stage.started("one")
        stage.process.end(0)
        assert await one.wait() == 1

    play(scene)


@pytest.mark.parametrize("hangs", [False, True])
def test_what_is_insisted_on_hits_the_process_and_the_others_are_told_why(hangs: bool) -> None:
    async def scene(stage: Stage) -> None:
        one, two, three = [await stage.started(name) for name in ("one", "two", "three")]
        if not hangs:
            one.send(signal.SIGINT)
        one.send(signal.SIGABRT if hangs else signal.SIGTERM)
        if hangs:
            assert stage.process.orders[-1].where
            while not stage.process.sent:
                await asyncio.sleep(0.01)
        number = signal.SIGABRT if hangs else signal.SIGTERM
        assert stage.process.sent == [number]
        why = f"WARN  the process /r1/team is ended, as one {'hangs' if hangs else 'does not end'}"
        assert [line for who, line in stage.lines if who == "two"] == [why]
        stage.process.tell(2, 0)
        assert await two.wait() == -number, "nobody had asked it: it is to be started again"
        stage.process.tell(3, 4)
        assert await three.wait() == 4
        one.send(signal.SIGKILL)
        assert await one.wait() == -9

    play(scene)


def test_a_node_that_comes_while_its_process_ends_gets_a_new_one() -> None:
    async def scene(stage: Stage) -> None:
        one = await stage.started("one")
        one.send(signal.SIGTERM)
        one.send(signal.SIGTERM)
        two = await stage.started("two")
        assert len(stage.made) == 2
        assert two.pid == stage.process.pid != one.pid

    play(scene)


def test_a_process_that_says_that_it_ends_takes_no_more_nodes() -> None:
    async def scene(stage: Stage) -> None:
        one, _ = await stage.started("one"), await stage.started("two")
        stage.process.tell(1, 1, closing=True)
        assert await one.wait() == 1
        again = await stage.started("one")
        assert len(stage.made) == 2
        assert again.pid == stage.process.pid

    play(scene)


def test_a_process_is_renewed_and_the_old_one_ends_with_its_last_node() -> None:
    async def scene(stage: Stage) -> None:
        one, two = await stage.started("one"), await stage.started("two")
        old = stage.process
        stage.houses.renew(["/r1/team", None])
        stage.houses.renew(["/r1/nobody"])
        old.tell(1, 0)
        again = await stage.started("one")
        assert again.pid == stage.process.pid != two.pid
        old.tell(2, 0)
        assert [await lodger.wait() for lodger in (one, two)] == [0, 0]
        while old.running:
            await asyncio.sleep(0)
        assert again.running

    play(scene)


def test_what_cannot_be_started_is_told() -> None:
    async def scene(stage: Stage) -> None:
        stage.missing = True
        with pytest.raises(FileNotFoundError):
            await stage.started("one")
        stage.missing = False
        one = await stage.started("one")
        stage.process.deaf = True
        with pytest.raises(BlockingIOError):
            await stage.started("two")
        one.send(signal.SIGINT)  # nobody hears; whoever asks insists
        assert one.running

    play(scene)


def test_what_a_process_leaves_behind_is_told_and_nonsense_is_left_out() -> None:
    async def scene(stage: Stage) -> None:
        one = await stage.started("one")
        stage.process.hear(b"\xff nonsense")
        stage.process.left = (left := Left(1, "", "sleep"),)
        stage.process.tell(1, 0)
        assert await one.wait() == 0
        await stage.houses.close()
        await asyncio.sleep(0)
        assert stage.left == [left]

    play(scene)
