"""Processes that several nodes of a run share.

Each node keeps a life of its own; what its life takes for a child is a `Lodger`, which lives in a real process together
with others. The first one that comes starts the process, and when the last one has gone, it ends. What cannot be done
to one node alone, such as to kill it, is done to the process.
"""

import asyncio
import itertools
import signal
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from typing import Protocol

import msgspec

from robo.environment import LOG_LEVEL_VARIABLE, OWNER_VARIABLE, SPEC_VARIABLE
from robo.machine.child import Child, Spawned
from robo.machine.forks import Fork
from robo.machine.hearing import Hearing
from robo.machine.orphans import Left
from robo.process.spec import Ended, Order
from robo.supervisor import instance
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE

_INSIST = 1.0
"""How long a process without nodes has to end before it is told so again, s."""
_ANSWER = 0.2
"""How long a node that hangs has to say where, s."""
_LISTENS = 5.0
"""Within what time a process reads what it is told, s."""
_AGAIN = 0.05
"""How often it is told again meanwhile, s."""


class Process(instance.Child, Protocol):
    """What is needed of a real process."""

    def say(self, data: bytes, descriptors: Sequence[int] = ()) -> None:
        """Say something to it; raises OSError where it does not hear."""

    async def stop(self, ended: "asyncio.Task[int]", *, patience: float) -> None:
        """Ask it to end, then insist."""


MakeProcess = Callable[[Spawned, Callable[[str, str], None], Callable[[bytes], None]], Process]
"""Takes the processes of the run; what takes lines, by stream; what takes what the process says."""


class House:
    """A process with the nodes that share it."""

    def __init__(self, make: MakeProcess, spawned: Spawned, output: Callable[[str, str], None]) -> None:
        """
        Args:
            make: makes the process.
            spawned: the processes of the run.
            output: takes the lines that are no node's, by stream.
        """
        self.process = make(spawned, output, self._hear)
        self.open = True
        """Whether more nodes may come."""
        self.ended: asyncio.Task[int] | None = None
        """Waits for its end, once it has started."""
        self._numbers = itertools.count(1)
        self._lodgers: dict[int, Lodger] = {}
        self._insisted: signal.Signals | None = None
        self._leaving: asyncio.Task[None] | None = None

    async def start(self, command: Sequence[str], environment: Mapping[str, str], fork: Fork | None) -> None:
        """Start the process; raises OSError where that is not possible."""
        await self.process.start(command, environment, cwd=None, fork=fork)
        self.ended = asyncio.create_task(self._watch())

    def take(self, lodger: "Lodger", order: Order, descriptors: Sequence[int]) -> int:
        """Let a node begin here.

        Returns:
            The number of its stay.

        Raises:
            OSError: the process does not hear.
        """
        number = next(self._numbers)
        self.process.say(msgspec.msgpack.encode(msgspec.structs.replace(order, number=number)), descriptors)
        self._lodgers[number] = lodger
        return number

    def ask(self, number: int) -> None:
        """Tell one node to end."""
        with suppress(OSError):  # whoever asks will insist
            self.process.say(msgspec.msgpack.encode(Order(number=number)))

    def ask_where(self, number: int) -> None:
        """Let a node that hangs say where."""
        with suppress(OSError):  # then the signal that follows says it
            self.process.say(msgspec.msgpack.encode(Order(number=number, where=True)))

    def insist(self, number: signal.Signals, by: "Lodger", why: str) -> None:
        """Send a signal to the process, for one of its nodes.

        Args:
            number: the signal.
            by: the node.
            why: what is told in the output of the others.
        """
        if self._insisted is None:
            for lodger in self._lodgers.values():
                if lodger is not by:
                    lodger.hear_of(why)
        self._insisted = number
        self.open = False
        self.process.send(number)

    async def _watch(self) -> int:
        code = await self.process.wait()
        self.open = False
        for lodger in [*self._lodgers.values()]:
            # One that ends well tells so of each node before: whose end it has not told has not done its work.
            lodger.end(code or 1, self.process.last_lines)
        self._lodgers.clear()
        return code

    def _hear(self, data: bytes) -> None:
        try:
            ended = msgspec.msgpack.decode(data, type=readable(Ended))
        except UNREADABLE:  # what runs there may write what it likes
            return
        self.open &= not ended.closing
        lodger = self._lodgers.pop(ended.number, None)
        if lodger is not None:
            # It ends well, but nobody had asked it to: a signal did that was meant for another node.
            unasked = -self._insisted if self._insisted is not None and not lodger.asked else 0
            lodger.end(ended.code or unasked, ())
        self.leave_if_empty()

    def retire(self) -> None:
        """Let no more nodes come; it ends with the last one."""
        self.open = False
        self.leave_if_empty()

    def leave_if_empty(self) -> None:
        """Have the process end where no node is in it."""
        if not self._lodgers and self._leaving is None and self.ended is not None:
            self.open = False
            self._leaving = asyncio.create_task(self.process.stop(self.ended, patience=_INSIST))


class Houses:
    """All processes of a run that nodes share."""

    def __init__(
        self,
        spawned: Spawned,
        output: Callable[[str, str, str], None],
        left: Callable[[Left], None],
        make: MakeProcess = Child,
    ) -> None:
        """
        Args:
            spawned: the processes of the run.
            output: takes the lines that are no node's: the full name of the process, the stream, the line.
            left: is told of what such a process has started and not ended.
            make: makes a process.
        """
        self._spawned = spawned
        self._output = output
        self._left = left
        self._make = make
        self._houses: dict[str, House] = {}
        """By full name of the process, the one into which nodes come."""
        self._all: set[House] = set()
        self._locks: dict[str, asyncio.Lock] = {}

    async def enter(
        self, name: str, command: Sequence[str], environment: Mapping[str, str], fork: Fork | None
    ) -> House:
        """The process of a name, started if it does not run.

        Raises:
            OSError: it cannot be started.
        """
        async with self._locks.setdefault(name, asyncio.Lock()):
            house = self._houses.get(name)
            if house is None or not house.open:
                house = House(self._make, self._spawned, lambda stream, text: self._output(name, stream, text))
                await house.start(command, environment, fork)
                self._houses[name] = house
                self._all.add(house)
                assert house.ended is not None
                house.ended.add_done_callback(lambda _: self._forget(house))
            return house

    def renew(self, names: Iterable[str | None]) -> None:
        """Let nodes that come from now on begin in new processes; the present ones end with their last nodes."""
        for house in [self._houses.pop(name) for name in names if name in self._houses]:
            house.retire()

    async def close(self) -> None:
        """Wait until all have ended, now that no node is left."""
        await asyncio.gather(*(house.ended for house in self._all if house.ended is not None))

    def _forget(self, house: House) -> None:
        self._all.discard(house)
        for left in house.process.left:
            self._left(left)


class Lodger:
    """A node in a process that it shares: like a `Child` to whoever looks after it."""

    def __init__(
        self,
        houses: Houses,
        process: str,
        label: str,
        on_line: Callable[[str, str], None],
        on_beat: Callable[[bytes], None] | None,
        beat_period: float,
    ) -> None:
        """
        Args:
            houses: all processes that are shared.
            process: the full name of its own.
            label: what the node is called in the output.
            on_line: takes its lines.
            on_beat: takes its heartbeats.
            beat_period: the time between two, s.
        """
        self.left: Sequence[Left] = ()
        """Nobody: what it leaves behind is in the group of the process."""
        self.asked = False
        """Whether it was told to end."""
        self._houses = houses
        self._process = process
        self._label = label
        self._on_line = on_line
        self._beat_period = beat_period
        self._hearing = Hearing(on_line, on_beat or (lambda _: None), streams=("stderr",))
        self._house: House | None = None
        self._number = 0
        self._hangs = False
        self._silent: list[str] = []
        """What it had said last when it was asked where it hangs."""
        self._ended: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    @property
    def last_lines(self) -> deque[str]:
        """The end of what it has printed, and of what the process has where it has ended with it."""
        return self._hearing.last_lines

    @property
    def pid(self) -> int | None:
        """Of the process; None where that goes on without it: its id says nothing of this node any more."""
        if self._house is None or (self._ended.done() and self._house.process.running):
            return None
        return self._house.process.pid

    @property
    def running(self) -> bool:
        """Whether it has started and not yet ended."""
        return self._house is not None and not self._ended.done()

    async def start(
        self, command: Sequence[str], environment: Mapping[str, str], *, cwd: str | None, fork: Fork | None
    ) -> None:
        """Start it, and its process if that does not run; raises OSError where that is not possible."""
        assert cwd is None
        shared = {**environment, OWNER_VARIABLE: self._process}
        del shared[SPEC_VARIABLE]
        level = shared.pop(LOG_LEVEL_VARIABLE, None)  # each node's own; the first one does not say it for the others
        order = Order(number=0, spec=environment[SPEC_VARIABLE], level=level, period=self._beat_period)
        house = await self._houses.enter(self._process, command, shared, fork)
        try:
            self._number = await self._enter(house, order)
        except OSError:
            self._hearing.close()
            house.leave_if_empty()
            raise
        self._house = house
        await self._hearing.begin()

    async def _enter(self, house: House, order: Order) -> int:
        with ExitStack() as theirs:
            descriptors = self._hearing.open(theirs)
            loop = asyncio.get_running_loop()
            until = loop.time() + _LISTENS
            while True:
                try:
                    return house.take(self, order, descriptors)
                except BlockingIOError:  # it has just started, and has not read yet what many others have sent
                    if loop.time() >= until or not house.open:
                        raise
                await asyncio.sleep(_AGAIN)

    async def wait(self) -> int:
        """Wait until it has ended, or its process has."""
        code = await asyncio.shield(self._ended)
        await self._hearing.finish()
        return code

    def send(self, number: signal.Signals) -> None:
        """Ask the node to end; what is sent after that, or is to leave no choice, is sent to the process."""
        if self._house is None or not self.running:
            return
        if number == signal.SIGCONT:
            self._house.process.send(number)
        elif self.asked or number in (signal.SIGKILL, signal.SIGABRT):
            self._hangs = hangs = number == signal.SIGABRT
            what = "hangs" if hangs else "does not end" if self.asked else "is killed"
            self.asked = self.asked or not hangs
            why = f"WARN  the process {self._process} is ended, as {self._label} {what}"
            if hangs:  # of all threads of the process those of the node are told first, in its own output
                self._silent = list(self._hearing.last_lines)
                self._house.ask_where(self._number)
                asyncio.get_running_loop().call_later(_ANSWER, self._insist, self._house, number, why)
            else:
                self._house.insist(number, self, why)
        else:
            self.asked = True
            self._house.ask(self._number)

    def _insist(self, house: House, number: signal.Signals, why: str) -> None:
        if self.running:
            house.insist(number, self, why)

    def hear_of(self, text: str) -> None:
        """Something is told of its process."""
        self._hearing.last_lines.append(text)
        self._on_line("stderr", text)

    def end(self, code: int, last_lines: Sequence[str] | deque[str]) -> None:
        """It has ended, with what its process has said last where that has ended too."""
        if not self._hangs or self._silent == list(self._hearing.last_lines):  # else it has said itself where it is
            self._hearing.last_lines.extend(last_lines)
        if not self._ended.done():
            self._ended.set_result(code)
