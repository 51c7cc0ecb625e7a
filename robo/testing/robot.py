"""A robot that a test has started: real processes at a port of their own."""

from __future__ import annotations

import itertools
import os
import signal
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

import msgspec
import zenoh

from robo.errors import NodeNotFound, RunError
from robo.interfaces import catalogue
from robo.machine import orphans
from robo.node.services import ask
from robo.testing.cut import Cut
from robo.testing.heard import Heard
from robo.testing.run import LaunchFailed, Run
from robo.text.suggestions import suggest
from robo.tools import nodes, parameters, runs
from robo.wire import codec, names
from robo.wire.keys import NodeToken
from robo.wire.reports import Exit, ProcessStatus
from robo_messages import Message

TIMEOUT = 10.0
"""How long a test waits for a robot, s, unless it says otherwise."""

_LOOK = 0.05
"""How often a robot is asked how it is, s."""

_FINE = ("ready", "completed", "stopped")


class NodeDied(AssertionError):
    """A process of a robot ended, or hung, and the test has not brought that about."""


class Robot:
    """A robot under test.

    Names are relative to the namespace that all its nodes share (`odom`), or absolute (`/clock`).
    """

    def __init__(self, run: Run, session: zenoh.Session, may_die: Sequence[str]) -> None:
        self.name = run.robot
        """What it is called."""
        self.endpoint = run.endpoint
        """Where it is reached: for `robo … --connect`, and for plain Zenoh clients."""
        self.session = session
        """A session on its network."""
        self._run = run
        self._may_die = set(may_die)
        self._heard = Heard(session, "**")
        self._numbers = itertools.count(1)
        self._cuts: dict[str, Cut] = {}
        self._paused: dict[str, int] = {}
        self._run_id = ""
        self._namespace = ""

    # -- messages ----------------------------------------------------------------------------------------------------

    def messages(self, topic: str) -> list[Any]:
        """What was published on a topic since the start, or since `clear`, as far as it came here; in order."""
        return self._heard.messages(self._key(topic))

    def wait_for(self, topic: str, condition: Callable[[Any], bool] = lambda _: True, timeout: float = TIMEOUT) -> Any:
        """Wait for a message.

        Args:
            topic: where.
            condition: what it has to fulfil.
            timeout: how long to wait, s.

        Returns:
            The first such message since the start, or since `clear`: it may be there already.
        """
        try:
            return self._heard.wait_for(self._key(topic), condition, timeout)
        except LookupError:
            count = len(self.messages(topic))
            came = f"{count} others came" if count else f"none came; {suggest(self._key(topic), self._heard.topics())}"
            raise AssertionError(f"no such message on {topic} within {timeout:g} s: {came}") from None

    def clear(self) -> None:
        """Forget the messages so far."""
        self._heard.clear()

    def send(self, topic: str, message: Message) -> None:
        """Publish one message, as a plain Zenoh client."""
        payload, stamp = msgspec.msgpack.encode(message), codec.pack_attachment(next(self._numbers), time.time_ns())
        self.session.put(self._key(topic), payload, encoding=codec.encoding_of(type(message)), attachment=stamp)

    # -- nodes -------------------------------------------------------------------------------------------------------

    def call(self, service: str, request: Message, timeout: float = TIMEOUT) -> Any:
        """Call a service, once there is one.

        Raises:
            ServiceError: its handler raised.
            ServiceTimeout: nobody serves it, or it took longer than `timeout` seconds.
        """
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
        return runs.processes(self.session, self.name)

    def wait_until_ready(self, timeout: float = 30.0) -> None:
        """Wait until all processes are ready, again where one was killed.

        Raises:
            LaunchFailed: one fails, the run ends, or it takes longer than `timeout` seconds.
        """
        end = time.monotonic() + timeout
        while True:
            there = self._processes_so_far()
            if there and all(one.state in _FINE for one in there):
                self._run_id, self._namespace = there[0].run, _shared_namespace(one.node for one in there)
                return
            broken = [one for one in there if self._is_broken(one)]
            unready = [one for one in there if one.state not in _FINE]
            if broken:
                raise LaunchFailed(f"{self._run.manifest}: {'; '.join(map(_state, broken))}")
            if self._run.is_over():
                raise LaunchFailed(f"{self._run.manifest}: the run has ended\n{self._run.printed()}")
            if time.monotonic() > end:
                what = "; ".join(map(_state, unready)) or "its supervisor does not answer"
                raise LaunchFailed(f"{self._run.manifest}: not ready within {timeout:g} s: {what}")
            time.sleep(_LOOK)

    # -- faults ------------------------------------------------------------------------------------------------------

    def kill(self, node: str) -> None:
        """End a process as SIGKILL does, and wait until its supervisor has seen it, which does as the manifest says."""
        pid = self._expected(node)
        os.kill(pid, signal.SIGKILL)
        end = time.monotonic() + TIMEOUT
        while any(one.pid == pid for one in self._processes_so_far()):
            if time.monotonic() > end:
                raise LaunchFailed(f"the supervisor has not seen within {TIMEOUT:g} s that {node} was killed")
            time.sleep(_LOOK)

    def pause(self, node: str) -> None:
        """Stop a process where it is, until `resume`; a watchdog finds that it hangs."""
        pid = self._expected(node)
        self._paused[node] = pid
        os.kill(pid, signal.SIGSTOP)

    def resume(self, node: str) -> None:
        """Let a paused process go on."""
        with suppress(ProcessLookupError):  # its watchdog was quicker
            os.kill(self._paused.pop(node), signal.SIGCONT)

    def cut(self, node: str) -> None:
        """Cut a node off the network, until `mend`: its connections break, and it gets no new ones (Linux).

        Raises:
            CannotCut: the system does not let one process do that to another.
        """
        self._cuts[node] = Cut(self._expected(node))

    def mend(self, node: str) -> None:
        """Let a node that was cut off join the network again."""
        self._cuts.pop(node).mend()

    # -- the end -----------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """What helps where a test fails: each node's state and last lines, each topic's last message."""
        lines = [f"{self._run.manifest} as {self.name}, at {self.endpoint}"]
        with suppress(RunError, zenoh.ZError):
            lines += [f"  {_state(one)}" for one in self.processes()]
        return "\n".join(
            [*lines, self._run.last_lines(), "last messages:", *(f"  {one}" for one in self._heard.last())]
        )

    def close(self) -> None:
        """End the robot, and look how it was.

        Raises:
            NodeDied: a process had died or hung, and the test has not brought that about.
            LaunchFailed: it did not end as it should, or left processes behind.
        """
        with ExitStack() as ends:
            ends.callback(self._end)
            for node in list(self._paused):
                ends.callback(self.resume, node)
            for node in list(self._cuts):
                ends.callback(self.mend, node)
            ends.callback(self._heard.close)
            died = self._deaths()
        if died:
            raise NodeDied("\n".join([*died, "if that is meant: launch(…, may_die=[NODE])"]))

    def _end(self) -> None:
        late = self._run.end()
        left = orphans.sweep(self._run_id) if self._run_id else []
        if late:
            raise LaunchFailed(f"{self._run.manifest}: {late}\n{self._run.printed()}")
        if left:
            raise LaunchFailed(f"{self._run.manifest}: it has left the processes {', '.join(map(str, left))} behind")

    def _deaths(self) -> list[str]:
        """What has died by itself, with its last words."""
        if not self._run_id:
            return []  # it never was ready, and the test has been told
        if self._run.is_over():
            return [f"{self._run.manifest}: the run has ended by itself\n{self._run.printed()}"]
        found = []
        for one in runs.explain(self.session, runs.Target(self.name), []):
            bad = [end for end in one.exits if end.exit_code]
            if bad and not self._is_expected(one.process):
                found.append(_death(one.process, bad[-1]))
        return found

    def _is_broken(self, process: ProcessStatus) -> bool:
        return process.state == "failed" or (process.state == "degraded" and not self._is_expected(process))

    def _is_expected(self, process: ProcessStatus) -> bool:
        return any(process.name.is_meant(name) for name in self._may_die)

    def _expected(self, node: str) -> int:
        """The process of a node; what becomes of it now is the test's doing."""
        there = self.processes()
        meant = [one for one in there if one.name.is_meant(node)]
        if len(meant) != 1:
            raise NodeNotFound(f"{self.name} has no node {node}; {suggest(node, (one.name.label for one in there))}")
        if meant[0].pid is None:
            raise RunError(f"{node} does not run: {_state(meant[0])}")
        self._may_die.add(meant[0].node)
        return meant[0].pid

    def _processes_so_far(self) -> list[ProcessStatus]:
        try:
            return self.processes()
        except RunError:  # it is just coming, or going
            return []

    def _node(self, name: str) -> NodeToken:
        return nodes.find_node(nodes.list_nodes(self.session), name if name.startswith("/") else self._full(name))

    def _full(self, name: str) -> str:
        return names.absolute(name, self._namespace)

    def _key(self, name: str) -> str:
        return names.absolute(name, self._namespace).strip("/")


def _shared_namespace(full_names: Iterable[str]) -> str:
    """The namespace that nodes have in common, without outer slashes; empty for the root."""
    return os.path.commonpath([name.rpartition("/")[0] or "/" for name in full_names]).strip("/")


def _state(one: ProcessStatus) -> str:
    hangs = f", {one.running} has been running for {one.running_for:.1f} s" if one.running else ""
    return f"{one.name.label} is {one.state}{f', {one.reason}' if one.reason else ''}{hangs}"


def _death(process: ProcessStatus, end: Exit) -> str:
    return "\n".join([f"{process.name.label} has died: {end.reason}", *(f"  {line}" for line in end.last_lines)])
