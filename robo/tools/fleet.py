"""Robots as a whole: a line for each, whoever runs it and wherever, and what became of those that have gone."""

import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import msgspec
import zenoh

from robo.tools import runs, unsupervised
from robo.tools.nodes import list_nodes
from robo.tools.replies import read, samples
from robo.wire import names
from robo.wire.keys import SupervisorToken, control_key
from robo.wire.reports import HEALTH_LEVELS, HealthLevel, ProcessStatus, RunReport
from robo.wire.targets import OF_ALL

RobotState = Literal["ready", "not ready", "silent", "offline"]
"""`silent`: its supervisor is there and does not answer."""

FINE = frozenset({"ready", "standby", "completed"})
"""States of processes of which none is missing to a robot that is ready."""


class Robot(msgspec.Struct, frozen=True, kw_only=True):
    """One robot."""

    robot: str
    """Its namespace."""
    state: RobotState
    hosts: list[str]
    """The machines that it runs on."""
    run: str
    """The id of its run; empty where no supervisor runs it, as `version`, `manifest` and `digest`."""
    version: str
    """Of robo."""
    manifest: str
    """The name of its file."""
    digest: str
    """Of all files of which the run was made: equal where these are."""
    ready: int
    """How many of its nodes are ready, stand by or have completed."""
    nodes: int
    """How many there are."""
    health: HealthLevel | None
    """The worst of its nodes; null where none has said anything."""
    trouble: str
    """What is wrong first: a node that is not ready, or its worst check; empty where nothing is."""
    uptime: float | None
    """How long its run, or else the oldest of its nodes, has been running, s."""
    last_seen: int
    """When it was there last, ns since the epoch."""


class Told(msgspec.Struct, frozen=True):
    """What a network says of robots at one time."""

    time: int
    """ns since the epoch."""
    supervised: list[ProcessStatus]
    """What supervisors tell."""
    alone: list[ProcessStatus]
    """Nodes of which none tells."""
    runs: list[RunReport]
    supervisors: list[SupervisorToken]
    """Those that are there, whether or not they answer."""


class Watch:
    """Asks all that there is, again and again."""

    def __init__(self, session: zenoh.Session, timeout: float) -> None:
        """`timeout` is how long anybody may take to answer, s."""
        self._session, self._timeout = session, timeout
        self._alone = unsupervised.Processes(session)

    def look(self) -> Told:
        """What there is just now."""
        session, timeout = self._session, self._timeout
        with ThreadPoolExecutor(4) as at_once:  # one that does not answer holds up each of these
            asked = at_once.submit(runs.processes, session, None, timeout)
            about = at_once.submit(reports, session, timeout)
            there = at_once.submit(runs.supervisors, session, timeout=timeout)
            nodes = at_once.submit(list_nodes, session, timeout)
        supervised = asked.result()
        alone = self._alone.look(nodes.result(), supervised)
        return Told(time.time_ns(), supervised, alone, about.result(), there.result())


class Fleet:
    """The robots that were seen since it began. Pure: what was told comes in, with its time."""

    def __init__(self) -> None:
        self._seen: dict[str, Robot] = {}

    def look(self, told: Told) -> list[Robot]:
        """The robots that are there, and as `offline` those that were; sorted by name."""
        there = {robot.robot: robot for robot in robots_of(told)}
        for name, before in self._seen.items():
            now = there.get(name)
            if now is None:
                there[name] = msgspec.structs.replace(before, state="offline", uptime=None)
            elif now.state == "silent":
                there[name] = msgspec.structs.replace(now, last_seen=before.last_seen)
        self._seen = there
        return sorted(there.values(), key=lambda robot: natural(robot.robot))


def robots_of(told: Told) -> list[Robot]:
    """The robots that are there. Pure."""
    members: dict[str, list[ProcessStatus]] = {}
    for status in (*told.supervised, *told.alone):
        members.setdefault(robot_of(status), []).append(status)
    about = {one.run: one for one in told.runs}
    answered = {one.robot for one in told.runs} | {one.robot for one in told.supervised}
    silent = {token.robot: token for token in told.supervisors if token.robot not in answered}
    found = [_robot(name, processes, about, silent.get(name), told.time) for name, processes in members.items()]
    return found + [_robot(name, [], {}, token, told.time) for name, token in silent.items() if name not in members]


def robot_of(status: ProcessStatus) -> str:
    """Which robot a process is of: its run's, or one that has a namespace of its own there, as those of a fleet do."""
    namespace, _ = names.split(status.node)
    if not namespace or namespace == status.robot or namespace.startswith(f"{status.robot}/"):
        return status.robot or namespace
    return namespace.partition("/")[0]


def _robot(
    name: str,
    processes: Sequence[ProcessStatus],
    about: Mapping[str, RunReport],
    silent: SupervisorToken | None,
    now: int,
) -> Robot:
    run = next((one.run for one in processes if one.run), "")
    made = about.get(run)
    hosts = {one.host for one in processes} or {silent.machine if silent is not None else ""}
    ready = sum(one.state in FINE for one in processes)
    ages = [one.uptime for one in processes if one.uptime is not None]
    oldest = (now - made.since) / 1e9 if made is not None else max(ages, default=None)
    state: RobotState = "silent" if silent is not None else "ready" if ready == len(processes) else "not ready"
    return Robot(
        robot=name,
        state=state,
        hosts=sorted(hosts),
        run=run,
        version=made.version if made is not None else "",
        manifest=made.manifest if made is not None else "",
        digest=made.digest if made is not None else "",
        ready=ready,
        nodes=len(processes),
        health=_worst(one.health for one in processes),
        trouble="its supervisor does not answer" if silent is not None else trouble_of(processes),
        uptime=None if oldest is None else max(0.0, round(oldest, 3)),
        last_seen=now,
    )


def _worst(levels: Iterable[HealthLevel | None]) -> HealthLevel | None:
    return max((one for one in levels if one is not None), key=HEALTH_LEVELS.index, default=None)


def trouble_of(processes: Sequence[ProcessStatus]) -> str:
    """What is wrong with some processes first, in words; empty where nothing is. Pure."""
    for one in processes:
        if one.state not in FINE:
            return f"{one.node} is {one.state}{f': {one.reason}' if one.reason else ''}"
    ill = [one for one in processes if one.health not in (None, "ok")]
    if not ill:
        return ""
    worst = max(ill, key=lambda one: HEALTH_LEVELS.index(one.health or "ok"))
    return f"{worst.node}: {worst.trouble}"


class Difference(msgspec.Struct, frozen=True):
    """Something that is not the same of all robots."""

    what: str
    """`robo`, or the name of a manifest."""
    robots: dict[str, list[str]]
    """The robots, by what they have."""

    def __str__(self) -> str:
        parts = [f"{value or 'unknown'} ({_listed(robots)})" for value, robots in sorted(self.robots.items())]
        return f"{self.what} is not the same everywhere: {', '.join(parts)}"


def differences(robots: Iterable[Robot]) -> list[Difference]:
    """Versions of robo, and contents of manifests of one name, that differ between robots which are there. Pure."""
    versions: dict[str, list[str]] = {}
    manifests: dict[str, dict[str, list[str]]] = {}
    for one in robots:
        if one.state in ("ready", "not ready") and one.run:
            versions.setdefault(one.version, []).append(one.robot)
            manifests.setdefault(one.manifest, {}).setdefault(one.digest, []).append(one.robot)
    found = [Difference("robo", versions), *(Difference(name, kinds) for name, kinds in sorted(manifests.items()))]
    return [one for one in found if len(one.robots) > 1]


_MOST_LISTED = 5


def _listed(robots: Sequence[str]) -> str:
    more = len(robots) - _MOST_LISTED
    return ", ".join(robots[:_MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


def reports(session: zenoh.Session, timeout: float) -> list[RunReport]:
    """What the supervisors of all robots tell of their runs; those of an older robo tell nothing."""
    replies = session.get(control_key("**", "about"), timeout=timeout, **OF_ALL)
    return [told for one in samples(replies) if (told := read(one, RunReport)) is not None]


def natural(name: str) -> tuple[str, int, str]:
    """For sorting: `r2` before `r10`."""
    letters = name.rstrip("0123456789")
    digits = name.removeprefix(letters)
    return letters, int(digits or 0), name
