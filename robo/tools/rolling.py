"""Robots or nodes started again one after another, by their supervisors, and looked at until they are healthy."""

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from queue import Empty, SimpleQueue

import msgspec
import zenoh

from robo.errors import NodeNotFound, RoboError
from robo.text.patterns import matcher
from robo.text.suggestions import suggest
from robo.tools import runs
from robo.tools.fleet import FINE, natural, robot_of
from robo.tools.rollout import Rollout, Stage, Terms
from robo.tools.runs import Target
from robo.wire.reports import Explanation, ProcessStatus

_PERIOD = 0.3
"""How often those that are under way are looked at, s."""
_WHY_WITHIN = 10.0
"""How long a supervisor may take to tell why one has failed, s: its machine may be busy, and this is asked once."""

LEFT_ALONE = frozenset({"stopped", "completed"})
"""States of processes that nobody wants to run just now: they are not started."""


class Unit(msgspec.Struct, frozen=True):
    """What is started again at once: a robot, or a node."""

    name: str
    nodes: dict[str, list[str]]
    """Full names, by the runs of which they are."""
    tells: frozenset[str] = frozenset()
    """Those that tell how well they are: until they have, they are not known to be healthy."""

    def is_silent(self, status: ProcessStatus) -> bool:
        """Whether a node that tells how well it is has not done so since it was started."""
        return status.health is None and status.node in self.tells

    def is_well(self, status: ProcessStatus) -> bool:
        """Whether nothing is wrong with a node of it."""
        return not _ails(status) and not self.is_silent(status)


class Choice(msgspec.Struct, frozen=True):
    """Who is meant."""

    units: list[Unit]
    left_alone: dict[str, str]
    """Nodes that are not started again, and why."""


class Change(msgspec.Struct, frozen=True):
    """One has come further, or lacks something else."""

    time: int
    """ns since the epoch."""
    name: str
    stage: Stage
    reason: str


def choose(there: Sequence[ProcessStatus], words: Sequence[str], robot: str = "") -> Choice:
    """Who is meant by words: robots, or else nodes. Pure.

    Args:
        there: all processes.
        words: names or patterns of robots, or of nodes, or of groups; none for all robots, or for the robot's nodes.
        robot: within which robot; empty for all.

    Raises:
        UsageError: a pattern makes no sense.
        NodeNotFound: nobody is meant.
    """
    within = [one for one in there if not robot or robot_of(one) == robot or one.robot == robot]
    chosen: dict[str, list[ProcessStatus]] = {}
    for word in words or ["**" if robot else "*"]:
        found = {} if robot else _robots(within, word)
        found = found or {one.node: [one] for one in within if _is_node(one, word, robot)}
        if not found:
            robots = [] if robot else sorted({robot_of(one) for one in within})
            nodes = sorted(one.node.strip("/") for one in within)
            raise NodeNotFound(f"no robot and no node is {word}; {suggest(word, [*robots, *nodes])}")
        chosen |= found
    units: list[Unit] = []
    left_alone: dict[str, str] = {}
    for name, processes in chosen.items():
        run = [one for one in processes if one.run and one.state not in LEFT_ALONE]
        for one in processes:
            if one not in run:
                left_alone[one.node] = f"it is {one.state}" if one.run else "no supervisor runs it"
        if run:
            units.append(_unit(name, run))
    return Choice(units, left_alone)


def _robots(there: Sequence[ProcessStatus], word: str) -> dict[str, list[ProcessStatus]]:
    is_meant = matcher([word], what="robot")
    found: dict[str, list[ProcessStatus]] = {}
    for one in there:
        if is_meant(robot_of(one)):
            found.setdefault(robot_of(one), []).append(one)
    return {name: found[name] for name in sorted(found, key=natural)}


def _is_node(one: ProcessStatus, word: str, robot: str) -> bool:
    if "*" in word:
        return matcher([word], robot=robot, what="node")(one.node.strip("/"))
    return one.name.is_meant(word)


def _unit(name: str, processes: Sequence[ProcessStatus]) -> Unit:
    nodes: dict[str, list[str]] = {}
    for one in processes:
        nodes.setdefault(one.robot, []).append(one.node)
    return Unit(name, nodes, frozenset(one.node for one in processes if one.health is not None))


def _ails(status: ProcessStatus) -> bool:
    return status.state not in FINE or status.health not in (None, "ok")


class Look:
    """What looks at one unit show, one after the other. Pure."""

    def __init__(self, unit: Unit) -> None:
        self._unit = unit
        self._starts: dict[str, tuple[int, int | None]] = {}
        """How often each node had been started again, and its process, when it was looked at last."""

    def trouble(self, there: Mapping[str, ProcessStatus]) -> tuple[str, bool]:
        """What is wrong with it first, empty where nothing is; and whether that stays so without a command."""
        troubles = [self._of(node, there.get(node)) for nodes in self._unit.nodes.values() for node in nodes]
        wrong = sorted((one for one in troubles if one[0]), key=lambda one: not one[1])
        return wrong[0] if wrong else ("", False)

    def _of(self, node: str, status: ProcessStatus | None) -> tuple[str, bool]:
        if status is None:
            return f"the supervisor of {node} does not answer", False
        before, now = self._starts.get(node), (status.restarts, status.pid)
        self._starts[node] = now
        if status.state not in FINE:
            reason = f": {status.reason}" if status.reason else ""
            return f"{node} is {status.state}{reason}", status.state in ("failed", "stopped")
        if before is not None and before != now and None not in (before[1], now[1]):
            return f"{node} has ended, and was started again", False
        if _ails(status):
            return f"{node}: {status.trouble or status.health}", False
        if self._unit.is_silent(status):
            return f"{node} has not told yet how well it is", False
        return "", False


class Rolling:
    """Starts units again, one batch after the other."""

    def __init__(self, session: zenoh.Session, units: Sequence[Unit], terms: Terms, timeout: float) -> None:
        """
        Args:
            session: the network.
            units: whom, in their order.
            terms: what is asked of each.
            timeout: how long a supervisor may take to tell how its processes are, s.
        """
        self.rollout = Rollout([unit.name for unit in units], terms)
        self._session, self._timeout = session, timeout
        self._units = {unit.name: unit for unit in units}
        self._looks = {unit.name: Look(unit) for unit in units}
        self._told: dict[str, tuple[Stage, str]] = {}
        self._answers: SimpleQueue[tuple[str, str]] = SimpleQueue()
        """Who was started again, and why not; empty where it was."""

    def changes(self) -> Iterator[Change]:
        """Do it, and tell what becomes of each, until all are done or one has failed."""
        rollout = self.rollout
        while not rollout.over:
            for name in rollout.due(time.monotonic()):
                threading.Thread(target=self._restart, args=(name,), name=f"robo-restart-{name}", daemon=True).start()
            yield from self._changed()
            self._take_answer()
            for name in rollout.looked_after:
                self._look_at(name)
            rollout.elapsed(time.monotonic())
            yield from self._changed()

    def why(self) -> list[Explanation]:
        """Why the nodes of those that have failed are as they are, as far as their supervisors tell."""
        found: list[Explanation] = []
        for name in self.rollout.account().failed:
            unit = self._units[name]
            for run, nodes in unit.nodes.items():
                try:
                    told = runs.explain(self._session, Target(run), nodes, _WHY_WITHIN)
                except RoboError:
                    continue  # that it does not answer is the reason
                found += [one for one in told if not unit.is_well(one.process)]
        return found

    def _restart(self, name: str) -> None:
        why = ""
        try:
            for run, nodes in self._units[name].nodes.items():
                runs.command(self._session, Target(run), "restart", nodes)
        except (RoboError, zenoh.ZError) as error:  # the latter where the command was interrupted
            why = str(error)
        self._answers.put((name, why))

    def _take_answer(self) -> None:
        try:
            name, why = self._answers.get(timeout=_PERIOD)
        except Empty:
            return
        gate = self.rollout.gates[name]
        if why:
            gate.refused(why)
        else:
            gate.carried_out(time.monotonic())

    def _look_at(self, name: str) -> None:
        there: dict[str, ProcessStatus] = {}
        for run in self._units[name].nodes:
            try:
                there |= {one.node: one for one in runs.processes(self._session, run, self._timeout)}
            except RoboError:
                continue  # `Look` tells who is missing
        trouble, for_good = self._looks[name].trouble(there)
        gate, now = self.rollout.gates[name], time.monotonic()
        if not trouble:
            gate.healthy(now)
        elif for_good:
            gate.lost(trouble)
        else:
            gate.ill(trouble, now)

    def _changed(self) -> Iterator[Change]:
        for name, gate in self.rollout.gates.items():
            now = gate.stage, gate.reason
            if now != self._told.get(name, ("untouched", "")):
                self._told[name] = now
                yield Change(time.time_ns(), name, *now)
