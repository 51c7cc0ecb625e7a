"""`python -m robo.testing.regression.run`: one run. Reads its order from stdin, and tells lines of JSON on stdout.

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
from robo.bag.reader import Bag
from robo.bag.replay_report import Input, NodeTopics
from robo.bag.topics import BagMessage, Topic
from robo.errors import BagError, DamagedBag, RoboError, UsageError
from robo.node.contract import contract_of
from robo.node.loading import load_node_class
from robo.node.node import Node
from robo.testing.bench import Seat
from robo.testing.regression.bench import ReplayBench, SimulatedTime
from robo.testing.regression.feed import Feed, type_mistake, wanted_senders
from robo.testing.regression.order import Line, NodeOrder, RunOrder, RunResult
from robo.testing.regression.outlet import Outlet
from robo.testing.stepper import Hung
from robo.text.suggestions import suggest
from robo.wire import names
from robo.wire.keys import PREFIX, SYSTEM_TOPICS
from robo.wire.network import Network
from robo.wire.qos import QoS
from robo.wire.session import close_session, open_session
from robo_messages import Clock as ClockMessage

_TELL = 0.2
"""How often it is told how far it is, s."""

_CLOCK = "clock"


def main() -> None:
    """Read the order, run it, tell the result."""
    lines = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    order = msgspec.json.decode(sys.stdin.buffer.read(), type=RunOrder)

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
        self._result = RunResult(begin=self._begin, first_input=recording.begin)
        self._note = self._result.notes.append

    def run(self) -> RunResult:
        begun = time.monotonic()
        classes = [load_node_class(one.service) for one in self._order.nodes]
        if any(self._is_simulated(one) for one in self._order.nodes):
            self._follow_clock()
        bench = self._bench
        self._outlet = outlet = Outlet(Path(self._order.output), lambda: bench.now, bench.note)
        try:
            for one, class_ in zip(self._order.nodes, classes, strict=True):
                self._start(one, class_)
            if bench.seats and not bench.troubles:
                self._let_calls_fail()
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
        parameters = self._parameters(order, node_class)
        probe = names.join(order.namespace, order.name or node_class.__name__)
        options: dict[str, Any] = {
            "name": order.name,
            "namespace": order.namespace,
            "remappings": order.remappings,
            "parameters": parameters,
        }
        try:
            seat = bench.start(node_class, options, note=outlet.of(f"/{probe}"), qualities=order.qos)
        except RoboError:
            raise
        except Hung as stuck:
            bench.note(f"/{probe}", f"does not come back from its start: {stuck}")
            return
        except Exception as error:
            bench.note(f"/{probe}", f"raised {type(error).__name__} at its start: {error}")
            return
        self._tell_what_is_no_topic(seat.node)

    def _parameters(self, order: NodeOrder, node_class: type[Node]) -> dict[str, Any]:
        known = {about.name for about in contract_of(node_class).parameters}
        gone = sorted(set(order.recorded) - known)
        if gone:
            self._note(f"{order.service} has no parameter {', '.join(gone)} any more, which the recording has")
        recorded = {name: value for name, value in order.recorded.items() if name in known}
        if set(recorded) - set(order.parameters):
            self._note(f"parameters of {order.name or order.service} are those of the recording")
        return {**recorded, **order.parameters}

    def _tell_what_is_no_topic(self, node: Node) -> None:
        contract = node.contract
        for what, found in (
            ("calls of its service", [one.service for one in contract.services]),
            ("goals of its action", [one.action for one in contract.actions]),
        ):
            if found:
                self._note(f"{node.full_name}: {what} {', '.join(found)} are in no recording, and are not made")

    def _let_calls_fail(self) -> None:
        """A call that nobody here answers fails at once, in the place of waiting for its time."""
        nodes = [seat.node for seat in self._bench.seats]
        served = {node.resolve(one.service) for node in nodes for one in node.contract.services}
        acted = {node.resolve(one.action) for node in nodes for one in node.contract.actions}
        for node in nodes:
            lost = [client for client in node._ends.clients if client.key not in served]
            for client in lost:
                client.abandon()
            called = [client.key for client in lost]
            called += [one.action for one in node.contract.action_clients if node.resolve(one.action) not in acted]
            if called:
                self._note(f"{node.full_name}: it calls {', '.join(called)}, which nobody serves here: its calls fail")

    # -- time --------------------------------------------------------------------------------------------------------

    def _is_simulated(self, order: NodeOrder) -> bool:
        return bool({**order.recorded, **order.parameters}.get("use_sim_time"))

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
        else:
            self._bench.settle(arrived - self._begin)

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
        outputs = self._outputs()
        inputs = self._inputs(outputs)
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
            self._result.inputs = [Input(name, topic.type, counts[name]) for name, topic in inputs.items()]
            feed.close()

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

    def _outputs(self) -> dict[str, Seat]:
        """Topics that are compared."""
        outlet = self._outlet
        assert outlet is not None
        found: dict[str, Seat] = {}
        qos: dict[str, QoS] = {}
        for seat in self._bench.seats:
            node = seat.node
            qos |= {node.resolve(one.topic): one.qos for one in node.contract.publishers}
            own = {names.join(node.namespace, topic) for topic in SYSTEM_TOPICS}
            for topic in seat.session.topics:
                shared = self._order.others.get(topic)
                if topic in own or topic.startswith(PREFIX) or topic.endswith("/transition_event"):
                    outlet.left_out.add(topic)
                elif shared:
                    outlet.left_out.add(topic)
                    self._note(f"{topic} is not compared: {', '.join(shared)} publishes it too")
                else:
                    found[topic] = seat
            outputs = [topic for topic, whose in found.items() if whose is seat]
            self._result.nodes.append(NodeTopics(node.full_name, f"{_service_of(node)}", outputs))
        outlet.qos = qos
        self._result.outputs = list(found)
        return found

    def _inputs(self, outputs: dict[str, Seat]) -> dict[str, Topic]:
        """Recorded topics to which nodes listen, unless one of them says them."""
        inputs: dict[str, Topic] = {}
        said = set(outputs) | {topic for seat in self._bench.seats for topic in seat.session.topics}
        for seat in self._bench.seats:
            silent: list[str] = []
            for key in dict.fromkeys(key for key, _ in seat.session.inboxes):
                fitting = [one for one in self._bag.topics.values() if _fits(key, one.name)]
                if not fitting and key not in said:
                    silent.append(key)
                for topic in fitting:
                    if topic.name in said or topic.name in inputs:
                        continue
                    wrong = type_mistake(seat.node, topic) if topic.known is not None else None
                    if topic.known is None:
                        self._note(f"{topic.name} cannot be fed: {topic.unknown}")
                    elif wrong is not None:
                        self._bench.note(seat.node.full_name, f"{topic.name} cannot be fed: {wrong}")
                    else:
                        inputs[topic.name] = topic
            if silent:
                listens = f"{seat.node.full_name} listens to {', '.join(silent)}, of which nothing was recorded"
                self._note(listens if inputs else f"{listens}; {suggest(silent[0], self._bag.topics, 'it has')}")
        if not inputs and any(seat.session.inboxes for seat in self._bench.seats) and not self._bench.troubles:
            raise UsageError(
                f"{self._bag.path} has no input of {', '.join(self._names())}: {'; '.join(self._result.notes)}"
            )
        return inputs

    # -- the end -----------------------------------------------------------------------------------------------------

    def _is_over(self) -> bool:
        over = [seat for seat in self._bench.seats if seat.ended]
        for seat in over:
            if not seat.node.exit_code:
                self._note(f"{seat.node.full_name} ended by itself at {self._bench.now} ns")
        return len(over) == len(self._bench.seats)

    def _hung(self, stuck: Hung) -> None:
        names_ = ", ".join(self._names())
        self._bench.note(names_, f"does not come back: {stuck}")

    def _finish(self, outlet: Outlet) -> None:
        result = self._result
        for topic, why in outlet.unwritable.items():
            self._note(f"{topic} is not compared: {why}")
        result.outputs = [topic for topic in result.outputs if topic not in outlet.unwritable]
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


def _service_of(node: Node) -> str:
    return f"{type(node).__module__}:{type(node).__name__}"


def _fits(key: str, topic: str) -> bool:
    try:
        return zenoh.KeyExpr(key).intersects(zenoh.KeyExpr(topic))
    except zenoh.ZError:
        return False


if __name__ == "__main__":
    main()
