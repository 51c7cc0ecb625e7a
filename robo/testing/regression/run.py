"""`python -m robo.testing.regression.run`: one run. Reads a `RunOrder` from stdin, and tells lines of JSON on stdout.

What nodes print goes to stderr.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from robo import bag as bags
from robo.bag.publishers import publishers_of
from robo.bag.read.reader import Bag
from robo.bag.read.topics import BagMessage, Topic
from robo.bag.regression.report import Input, NodeTopics
from robo.errors import BagError, DamagedBag, RoboError, UsageError
from robo.node.contract import contract_of
from robo.node.loading import load_node_class
from robo.node.node import Node
from robo.testing.regression import other_clocks
from robo.testing.regression.bench import ReplayBench, SimulatedTime
from robo.testing.regression.feed import Feed, wanted_senders
from robo.testing.regression.order import Line, NodeOrder, RunOrder, RunResult
from robo.testing.regression.outlet import Outlet
from robo.testing.regression.outputs import others_of, outputs_of, said_then
from robo.testing.regression.wiring import (
    inputs_of,
    parameters_of,
    tell_changed_parameters,
    tell_what_is_not_replayed,
)
from robo.testing.stepper import Hung
from robo.text.readable import readable
from robo.wire import names
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Clock as ClockMessage

_TELL = 0.2
"""How often it is told how far it is, s."""

_SLICE = 1_000_000_000
"""For so long nothing that is said is written down, ns."""

_CLOCK = "clock"


def main() -> None:
    """Read the order, run it, tell the result."""
    lines = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    order = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=readable(RunOrder))

    def tell(line: Line) -> None:
        lines.write(msgspec.json.encode(line) + b"\n")

    try:
        tell(Line(done=1.0, result=run(order, tell)))
    except RoboError as error:
        tell(Line(mistake=str(error)))
    sys.stdout.flush()
    os._exit(0)  # a thread of a node that hangs holds nobody


def run(order: RunOrder, tell: Callable[[Line], None]) -> RunResult:
    """Feed a recording to nodes, and write down what they say.

    Raises:
        RoboError: the recording or a node cannot be used.
    """
    if order.other_clocks:  # before a recording's types bring in their packages
        other_clocks.install({one.service.partition(":")[0].partition(".")[0] for one in order.nodes})
    with ExitStack() as made:
        recording = made.enter_context(_open(order.bag))
        session = open_session(Network(mode="peer"))
        made.callback(close_session, session)
        return _Run(order, recording, session, tell).run()


def _open(path: str) -> Bag:
    recording = bags.open(path)
    for fault in recording.faults:
        recording.close()
        raise DamagedBag(f"{fault.reason}; `robo bag recover` makes a whole file of it", fault.path, fault.offset)
    if not recording.count:
        recording.close()
        raise BagError("it has no message", path)
    return recording


class _Run:
    def __init__(self, order: RunOrder, recording: Bag, session: zenoh.Session, tell: Callable[[Line], None]) -> None:
        self._order = order
        self._bag = recording
        self._session = session
        self._tell = tell
        self._told = time.monotonic()
        self._begin = min(order.begin if order.begin is not None else recording.begin, recording.begin)
        self._bench = ReplayBench(session, order.patience, self._begin)
        self._simulated: SimulatedTime | None = None
        self._outlet: Outlet | None = None
        self._others: dict[str, list[str]] = {}
        self._result = RunResult(begin=self._begin, first_input=recording.begin)
        self._note = self._result.notes.append
        self._ended: set[str] = set()

    def run(self) -> RunResult:
        begun = time.monotonic()
        classes = [load_node_class(one.service) for one in self._order.nodes]
        together = list(zip(self._order.nodes, classes, strict=True))
        if any(parameters_of(*one, lambda _: None).get("use_sim_time") for one in together):
            self._follow_clock()
        bench = self._bench
        self._outlet = outlet = Outlet(Path(self._order.output), lambda: bench.now, bench.note)
        try:
            for one, class_ in together:
                self._start(one, class_)
            if bench.seats and not bench.troubles:
                tell_what_is_not_replayed([seat.node for seat in bench.seats], self._note)
                self._play()
        except Hung as stuck:
            self._hung(stuck)
        finally:
            outlet.close()
        with suppress(Exception):  # the end of the nodes is not what is looked at
            bench.close()
        self._finish(outlet)
        self._result.seconds = time.monotonic() - begun
        return self._result

    # -- the nodes ---------------------------------------------------------------------------------------------------

    def _start(self, order: NodeOrder, node_class: type[Node]) -> None:
        outlet, bench = self._outlet, self._bench
        assert outlet is not None
        full_name = "/" + names.join(order.namespace, order.name or contract_of(node_class).name)
        options: dict[str, Any] = {
            "name": order.name,
            "namespace": order.namespace,
            "remappings": order.remappings,
            "parameters": parameters_of(order, node_class, self._note),
        }
        try:
            bench.start(node_class, options, note=outlet.of(full_name), qualities=order.qos)
        except RoboError:
            raise
        except Hung as stuck:
            bench.note(full_name, f"does not come back from its start: {stuck}")
            return
        except Exception as error:
            bench.note(full_name, f"raised {type(error).__name__} at its start: {error}")
            return

    # -- time --------------------------------------------------------------------------------------------------------

    def _follow_clock(self) -> None:
        first = next(self._clock_messages(), None)
        if first is None:
            self._note("nodes follow /clock, and the recording has none: they go by the times of arrival")
            return
        value: Any = first.value
        self._simulated = self._bench.follow_clock(value.clock.to_nanoseconds(), first.arrived)
        self._first_clock = value.clock.to_nanoseconds()

    def _clock_messages(self) -> Iterator[BagMessage]:
        topic = self._bag.topics.get(_CLOCK)
        if topic is not None and topic.known is not None and topic.type == "system/Clock":
            yield from self._bag.messages(_CLOCK)

    def _reach(self, arrived: int) -> None:
        """Let time go on until a message comes."""
        if self._simulated is not None:
            self._simulated.wall_ns = arrived
            return
        end, stepper = arrived - self._begin, self._bench.stepper
        while stepper.now + _SLICE < end:
            self._bench.settle(stepper.now + _SLICE)
            if self._outlet is not None:
                self._outlet.drain()  # what timers say while nothing comes
            self._progress(self._begin + stepper.now)
        self._bench.settle(end)

    def _tick(self, message: BagMessage) -> None:
        value: ClockMessage | Any = message.value
        at = value.clock.to_nanoseconds() - self._first_clock
        if at < self._bench.stepper.now:
            raise UsageError(
                f"{self._bag.path}: /clock steps back at {message.arrived} ns; nodes can be replayed up to there: "
                f"`robo bag cut` makes a recording of the part before"
            )
        self._bench.settle(at)

    # -- messages ----------------------------------------------------------------------------------------------------

    def _play(self) -> None:
        outlet, bench = self._outlet, self._bench
        assert outlet is not None
        result = self._result
        inputs = self._wire(outlet)
        outlet.drain()
        senders: dict[str, str] = {}
        for seat in bench.seats:
            senders |= wanted_senders(seat.node)
        for topic, name in senders.items():
            if topic in inputs:
                self._note(f"{topic}: no recording says who has sent a message; all come in the name of {name}")
        feed = Feed(self._session, inputs, senders)
        try:
            for message in self._messages(inputs):
                if message.topic.name == _CLOCK and self._simulated is not None:
                    self._tick(message)
                if message.topic.name in inputs:
                    with bench.stepper.held():
                        feed.give(message)
                    bench.settle()
                outlet.drain()
                self._progress(message.arrived)
                if self._is_over():
                    break
            self._reach(self._bag.end)
            outlet.drain()
            bench.settle()
        finally:
            counts = feed.counts
            result.inputs = [Input(name, topic.type, counts[name]) for name, topic in inputs.items()]
            feed.close()

    def _wire(self, outlet: Outlet) -> dict[str, Topic]:
        """Find out who says what, then and now. Returns what is fed."""
        seats, manifest = self._bench.seats, self._order.others
        recorded, nodes = publishers_of(self._bag), set(self._names())
        tell_changed_parameters(self._bag, nodes, self._note)
        self._others = others_of(recorded, manifest, nodes)
        self._result.said_then = said_then(recorded, self._others, nodes)
        _, outlet.left_out, outlet.qos = outputs_of(seats, self._others, self._note)

        def said_alone(topic: str) -> bool:
            return manifest is not None or topic in recorded.of

        inputs = inputs_of(seats, self._bag.topics, self._others, said_alone, self._note, self._bench.note)
        for seat in seats:
            seat.session.unheard.update(topic for topic in inputs if topic in self._others)
        return inputs

    def _messages(self, inputs: dict[str, Topic]) -> Iterator[BagMessage]:
        """What is fed, in its order; what latched topics had said before comes first."""
        wanted = [*inputs] + ([_CLOCK] if self._simulated is not None and _CLOCK not in inputs else [])
        if not wanted:
            return
        latched = [name for name, topic in inputs.items() if topic.qos.latched]
        begin, early = self._bag.begin, 0
        if latched:
            for message in self._bag.messages(latched):
                if message.published < begin:
                    early += 1
                    yield message
        for message in self._bag.messages(wanted):
            if early and message.topic.qos.latched and message.published < begin:
                continue
            self._reach(message.arrived)
            yield message

    # -- the end -----------------------------------------------------------------------------------------------------

    def _is_over(self) -> bool:
        over = [seat for seat in self._bench.seats if seat.ended]
        for seat in over:
            if seat.node.full_name not in self._ended and not seat.node.exit_code:
                after = (self._bench.now - self._bag.begin) * 1e-9
                self._note(f"{seat.node.full_name} ended by itself after {after:.3f} s")
            self._ended.add(seat.node.full_name)
        return len(over) == len(self._bench.seats)

    def _hung(self, stuck: Hung) -> None:
        names_ = ", ".join(self._names())
        self._bench.note(names_, f"does not come back: {stuck}")

    def _finish(self, outlet: Outlet) -> None:
        result = self._result
        for topic, why in outlet.unwritable.items():
            self._note(f"{topic} is not compared: {why}")
        # Now, for callbacks may have made publishers too.
        nodes, _, _ = outputs_of(self._bench.seats, self._others, self._note)
        for node, service, topics in map(msgspec.structs.astuple, nodes):
            writable = [topic for topic in topics if topic not in outlet.unwritable]
            result.nodes.append(NodeTopics(node, service, writable))
            result.outputs += writable
        for node, topics in result.said_then.items():
            result.said_then[node] = [topic for topic in topics if topic not in outlet.unwritable]
        periods: dict[str, float] = {}
        for seat in self._bench.seats:
            for loop in seat.node._ends.timers:
                with suppress(RoboError):
                    periods[f"robo-timer-{loop.name}"] = loop.period()
        for topic, threads in outlet.threads.items():
            (thread, *more) = threads
            if not more and thread in periods and topic in result.outputs:
                result.periods[topic] = periods[thread]
        result.troubles = self._bench.troubles
        result.notes = list(dict.fromkeys(result.notes))

    def _names(self) -> list[str]:
        return [seat.node.full_name for seat in self._bench.seats]

    def _progress(self, arrived: int) -> None:
        now = time.monotonic()
        if now - self._told >= _TELL:
            self._told = now
            self._tell(Line(done=(arrived - self._bag.begin) / max(self._bag.end - self._bag.begin, 1)))


if __name__ == "__main__":
    main()
