"""A robot that a test has started: real processes at a port of their own."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

import msgspec
import zenoh

from robo.errors import RunError
from robo.interfaces import catalogue
from robo.node.services import ask
from robo.testing import ending
from robo.testing.heard import Heard
from robo.testing.nodes import Nodes
from robo.testing.run import Run
from robo.text.suggestions import suggest
from robo.tools import nodes, parameters
from robo.wire import codec, names
from robo.wire.keys import NodeToken
from robo.wire.reports import ProcessStatus
from robo_messages import Message

_LOOK = 0.05
"""How often it is looked whether there is a service, s."""


class Robot:
    """A robot under test.

    Names are relative to the namespace that all its nodes share (`odom`), or absolute (`/clock`).
    """

    def __init__(self, run: Run, session: zenoh.Session, may_die: Sequence[str], patience: float) -> None:
        self.name = run.robot
        """What it is called."""
        self.endpoint = run.endpoint
        """Where it is reached: for `robo … --connect`, and for plain Zenoh clients."""
        self.session = session
        """A session on its network."""
        self.patience = patience
        """How long a test waits for it, s, where it does not say otherwise."""
        self._run = run
        self._nodes = Nodes(run, session, may_die)
        self._heard = Heard(session, "**")
        self._numbers = itertools.count(1)

    # -- messages ----------------------------------------------------------------------------------------------------

    def messages(self, topic: str) -> list[Any]:
        """What was published on a topic since the start, or since `clear`, as far as it came here; in order."""
        return self._heard.messages(self._key(topic))

    def wait_for(
        self,
        topic: str,
        condition: Callable[[Any], bool] = lambda _: True,
        timeout: float | None = None,
        *,
        new: bool = False,
    ) -> Any:
        """Wait for a message.

        Args:
            topic: where.
            condition: what it has to fulfil.
            timeout: how long to wait, s; by default `patience`.
            new: whether it has to come from now on.

        Returns:
            The first such message since the start, or since `clear`: it may be there already, unless it has to be new.
        """
        timeout = self._limit(timeout)
        try:
            return self._heard.wait_for(self._key(topic), condition, timeout, anew=new)
        except LookupError:
            count = len(self.messages(topic))
            came = f"{count} others came" if count else f"none came; {suggest(self._key(topic), self._heard.topics())}"
            raise AssertionError(f"no such message on {topic} within {timeout:g} s: {came}") from None

    def wait_for_count(self, topic: str, count: int, timeout: float | None = None) -> list[Any]:
        """All messages since the start, or since `clear`, once there are so many."""
        timeout = self._limit(timeout)
        try:
            self._heard.wait_for_count(self._key(topic), count, timeout)
        except LookupError:
            there = len(self.messages(topic))
            raise AssertionError(f"{there} messages on {topic} within {timeout:g} s, not {count}") from None
        return self.messages(topic)

    def clear(self) -> None:
        """Forget the messages so far."""
        self._heard.clear()

    def send(self, topic: str, message: Message) -> None:
        """Publish one message, as a plain Zenoh client."""
        payload, stamp = msgspec.msgpack.encode(message), codec.pack_attachment(next(self._numbers), time.time_ns())
        self.session.put(self._key(topic), payload, encoding=codec.encoding_of(type(message)), attachment=stamp)

    # -- nodes -------------------------------------------------------------------------------------------------------

    def call(self, service: str, request: Message, timeout: float | None = None) -> Any:
        """Call a service, once there is one.

        Raises:
            ServiceError: its handler raised.
            ServiceTimeout: nobody serves it, or it took longer than `timeout` seconds.
        """
        timeout = self._limit(timeout)
        end, key = time.monotonic() + timeout, self._key(service)
        querier = self.session.declare_querier(key, target=zenoh.QueryTarget.ALL_COMPLETE)
        status: Any = querier.matching_status  # Zenoh's stub says bool, it is an object
        while not status.matching and time.monotonic() < end:
            time.sleep(_LOOK)
            status = querier.matching_status
        querier.undeclare()
        asked = msgspec.msgpack.encode(request), codec.pack_attachment(next(self._numbers), time.time_ns())
        left = max(end - time.monotonic(), 0.1)
        sample = ask(self.session, key, asked, codec.encoding_of(type(request)), left, timeout)
        payload, encoding = sample.payload.to_bytes(), str(sample.encoding)
        return codec.Decoder(catalogue.find(encoding.partition(";")[2])).decode(payload, encoding)

    def set(self, node: str, **values: object) -> None:
        """Change parameters of a node: all of them, or none.

        Raises:
            NodeNotFound: there is no such node.
            ParameterError: a name is unknown, or a value was refused.
        """
        parameters.set_all(self.session, self._node(node), values)

    def get(self, node: str, name: str) -> object:
        """A parameter of a node.

        Raises:
            NodeNotFound: there is no such node.
            ParameterError: it has no such parameter.
        """
        return parameters.get(self.session, self._node(node), [name])[name]

    def processes(self) -> list[ProcessStatus]:
        """Its processes, as `robo ps` shows them."""
        return self._nodes.processes()

    def process(self, node: str) -> ProcessStatus:
        """One of its processes.

        Raises:
            NodeNotFound: there is no such node.
        """
        return self._nodes.process(node)

    def wait_until(
        self, node: str, condition: Callable[[ProcessStatus], bool], timeout: float | None = None
    ) -> ProcessStatus:
        """Wait until something is true of a process: `robot.wait_until("arm", lambda arm: arm.restarts == 1)`.

        Returns:
            The process as it is then.
        """
        return self._nodes.wait_until(node, condition, self._limit(timeout))

    def wait_until_ready(self, timeout: float | None = None) -> None:
        """Wait until all processes are ready, again where one was killed; of those that may die, until they are down.

        Raises:
            LaunchFailed: one fails, the run ends, or it takes longer than `timeout` seconds.
        """
        self._nodes.wait_until_ready(self._limit(timeout))

    def wait_until_over(self, timeout: float | None = None) -> int:
        """Wait until the run ends by itself, as one does that plays a log.

        Returns:
            Its exit code.

        Raises:
            LaunchFailed: it goes on for longer than `timeout` seconds.
        """
        return self._run.wait_until_over(self._limit(timeout))

    # -- output ------------------------------------------------------------------------------------------------------

    @property
    def output(self) -> str:
        """What the run has printed so far: the lines of its nodes and its supervisor."""
        return self._run.printed()

    def wait_for_line(self, text: str, timeout: float | None = None) -> str:
        """The first line of the output that holds a text, be it there already."""
        return self._run.wait_for_line(text, self._limit(timeout))

    # -- faults ------------------------------------------------------------------------------------------------------

    def kill(self, node: str) -> None:
        """End a process as SIGKILL does, and wait until its supervisor has seen it, which does as the manifest says."""
        self._nodes.kill(node)

    def pause(self, node: str) -> None:
        """Stop a process where it is, until `resume`; a watchdog finds that it hangs."""
        self._nodes.pause(node)

    def resume(self, node: str) -> None:
        """Let a paused process go on."""
        self._nodes.resume(node)

    def cut(self, node: str) -> None:
        """Cut a node off the network, until `mend`: its connections break, and it gets no new ones (Linux).

        Raises:
            CannotCut: the system does not let one process do that to another.
        """
        self._nodes.cut(node)

    def mend(self, node: str) -> None:
        """Let a node that was cut off join the network again."""
        self._nodes.mend(node)

    # -- the end -----------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """What helps where a test fails: each node's state and last lines, each topic's last message."""
        lines = [f"{self._run.manifest} as {self.name}, at {self.endpoint}"]
        with suppress(RunError, zenoh.ZError):
            lines += [f"  {ending.state_of(one)}" for one in self.processes()]
        return "\n".join(
            [*lines, self._run.last_lines(), "last messages:", *(f"  {one}" for one in self._heard.last())]
        )

    def close(self) -> None:
        """End the robot, and look how it was.

        Raises:
            NodeDied: a process had died or hung, and the test has not brought that about.
            Leak: a node had left processes of its own behind.
            LaunchFailed: it did not end as it should.
        """
        with ExitStack() as ends:
            ends.callback(self._heard.close)
            ends.callback(self._nodes.undo)
            faults = list(ending.died(self._run, self.session, self._nodes.is_expected)) if self._nodes.run_id else []
        faults += ending.ended(self._run, self.session, self._nodes.run_id, self._nodes.is_expected)
        if faults:
            for other in faults[1:]:
                faults[0].add_note(f"{type(other).__name__}: {other}")
            raise faults[0]

    def _limit(self, timeout: float | None) -> float:
        return self.patience if timeout is None else timeout

    def _node(self, name: str) -> NodeToken:
        there = nodes.list_nodes(self.session, inactive=True)
        return nodes.find_node(there, name if name.startswith("/") else self._full(name))

    def _full(self, name: str) -> str:
        return names.absolute(name, self._nodes.namespace)

    def _key(self, name: str) -> str:
        return names.absolute(name, self._nodes.namespace).strip("/")
