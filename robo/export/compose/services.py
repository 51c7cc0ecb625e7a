"""One service of a Compose file: a robot's router, a process, the keeper."""

from pathlib import Path
from typing import Any

from robo.environment import MEMORY_VARIABLE, PORT_VARIABLE, SECURITY_VARIABLE
from robo.export.baggage import Baggage, Project
from robo.export.commands import DASHBOARD, DASHBOARD_PORT, MEMORY, Commands, told_by_token
from robo.export.compose.layout import Layout
from robo.export.names import robot_of
from robo.export.profiles import Profiles
from robo.export.yaml_text import MERGE, Alias, Anchored
from robo.launch.plan import LimitsPlan, ProcessPlan, ReadyPlan
from robo.wire.network import PORT

DASHBOARD_PORT_VARIABLE = "ROBO_DASHBOARD_PORT"
"""Where an exported dashboard is on its host."""

GRACE = 3.0
"""How long a process has between the first signal and SIGKILL where its manifest grants it no longer, s."""

USUAL_MEMORY = 256 << 20
"""What a container may have where its manifest does not say, bytes."""
USUAL_CPU = 1.0
"""And how many processors."""

HEALTH = Anchored("health", {"interval": "5s", "timeout": "3s", "start_period": "10s", "retries": 3})
"""How often health is looked at, of every service."""

Service = dict[Any, Any]

RUN = "run"
"""The volume in which the processes of a secured robot meet."""
SOCKET = "unixsock-stream//run/robo/router.sock"
"""Where."""
MEETING = f"{RUN}:/run/robo"
_KEYS = "/run/keys"
"""Where the router has its keys."""

_CONDITIONS = {"started": "service_started", "ready": "service_healthy", "completed": "service_completed_successfully"}
_RESTARTS = {"never": "no", "on-failure": "on-failure", "always": "always"}
_FOR_EVER = 86_400.0
_KEEPS = "/tmp/keeps"
"""There while the keeper watches."""


class Services:
    """Makes each service of a layout, as plain data."""

    def __init__(self, layout: Layout, project: Project, profiles: Profiles, keys: Path | None = None) -> None:
        """`keys` is the folder of a name on a secured network: then processes meet by a socket, and others by TLS."""
        self._keys = keys
        self._layout = layout
        self._project = project
        self._names = profiles.names
        self._commands = Commands(profiles.types, profiles.names.shown, "Compose file")

    def router(self, robot: str, build: Path | None) -> Service:
        """The router of a robot.

        Args:
            robot: its name.
            build: the folder of the Dockerfile that makes the image, if there is one.
        """
        service = _in_profiles(self._layout.profiles_of_router(robot))
        first = self._layout.first
        if robot == first and build is not None:
            # Compose builds each section by itself, and the image once is enough for all.
            service["build"] = {"context": self._project.source(build), "network": "host"}
        command = ["router", "--name", self._names.shown(robot)]
        if self._keys is None:
            command += ["--listen", f"tcp/0.0.0.0:{PORT}"]
        else:
            command += ["--listen", SOCKET, "--listen", f"tls/0.0.0.0:{PORT}"]
            service["environment"] = {SECURITY_VARIABLE: _KEYS}
            service["volumes"] = [f"{self._project.source(self._keys)}:{_KEYS}:ro", MEETING]
        if robot == first:
            # From the host only; other hosts are let in by a router of their own choice.
            service["ports"] = [f"127.0.0.1:${{{PORT_VARIABLE}:-{PORT}}}:{PORT}"]
        else:
            command += ["--connect", self._endpoint(first)]
        service["command"] = command
        service["restart"] = "always"
        service["healthcheck"] = _health(["robo", "health"])
        return service

    def process(self, process: ProcessPlan) -> Service:
        """A process: a node by `robo run`, or a command as it is."""
        service = _in_profiles(self._layout.profiles_of(process))
        baggage = Baggage(self._project, self._names)
        begin, words = self._commands.program(process, baggage)
        if begin:
            service["entrypoint"] = begin
        service["command"] = words
        if process.service == DASHBOARD:
            service["ports"] = [f"127.0.0.1:${{{DASHBOARD_PORT_VARIABLE}:-{DASHBOARD_PORT}}}:{DASHBOARD_PORT}"]
        health = self._commands.health(process, baggage)
        # Clients of the router, not peers with links to each other: Zenoh dials a router again and again when a
        # cable or a container is gone for a while, and peers that it has once found and lost not always.
        service["environment"] = self._commands.environment(process, self._endpoint(robot_of(process)), "client")
        if baggage.configs:
            service["configs"] = baggage.configs
        if process.cwd is not None:
            service["working_dir"] = baggage.folder(process.cwd)
        volumes = [*baggage.volumes, *([MEETING] if self._keys is not None else [])]
        if process.service is not None and process.restart.policy != "never":
            volumes.append(MEMORY)
            service["environment"][MEMORY_VARIABLE] = MEMORY
        if volumes:
            service["volumes"] = volumes
        service["depends_on"] = self._needs(process)
        service["restart"] = _RESTARTS[process.restart.policy]
        if process.stop.signal != "INT":
            service["stop_signal"] = f"SIG{process.stop.signal}"
        if process.stop.timeout > GRACE:
            service["stop_grace_period"] = _seconds(process.stop.timeout)
        if process.cpus:
            service["cpuset"] = ",".join(map(str, process.cpus))
        limits = process.limits
        if limits.memory is not None or limits.cpu is not None:
            service["deploy"] = resources(limits)
        if limits.files is not None:
            service["ulimits"] = {"nofile": limits.files}
        # One that tells nothing is well while it runs. With its check disabled `docker compose up --wait` would fail.
        service["healthcheck"] = _health(health, process.ready.timeout) if health else _health(["true"])
        return service

    def keeper(self, profile: str) -> Service:
        """The keeper: root within its container, because the engine's socket is root's; on no network."""
        return {
            "profiles": [profile],
            "networks": {},
            "network_mode": "none",
            "user": "root",
            "command": ["keeper", "--project", "${COMPOSE_PROJECT_NAME}", "--ready-file", _KEEPS],
            "volumes": ["${DOCKER_SOCKET:-/var/run/docker.sock}:/var/run/docker.sock"],
            "restart": "always",
            "healthcheck": _health(["test", "-e", _KEEPS]),
        }

    def _endpoint(self, robot: str) -> str:
        return SOCKET if self._keys is not None else f"tcp/{self._layout.router(robot)}:{PORT}"

    def _needs(self, process: ProcessPlan) -> dict[str, dict[str, Any]]:
        needs: dict[str, dict[str, Any]] = {
            self._layout.router(robot_of(process)): {"condition": "service_healthy"},
        }
        for name, until in process.needs.items():
            needed = self._layout.process(name)
            condition = _CONDITIONS[until]
            if condition == "service_healthy" and not _tells_health(needed):
                condition = "service_started"
            needs[self._layout.service(name)] = {"condition": condition}
            if needed.restart.propagate:
                needs[self._layout.service(name)]["restart"] = True
        return needs


def resources(limits: LimitsPlan) -> Service:
    """What a container may use, as Compose has it."""
    memory = limits.memory if limits.memory is not None else USUAL_MEMORY
    size = f"{memory >> 20}M" if memory % (1 << 20) == 0 else f"{memory}b"
    cpu = limits.cpu if limits.cpu is not None else USUAL_CPU
    return {"resources": {"limits": {"cpus": str(float(cpu)), "memory": size}}}


def _tells_health(process: ProcessPlan) -> bool:
    return told_by_token(process) or process.ready.port is not None or bool(process.ready.probe)


def _health(command: list[str], start: float = ReadyPlan().timeout) -> Service:
    """A health check, of a service that may take so long to be ready, s; 0 for ever. By default it is as all others."""
    service: Service = {"test": ["CMD", *command], MERGE: Alias(HEALTH.name)}
    if start != ReadyPlan().timeout:
        service["start_period"] = _seconds(start or _FOR_EVER)
    return service


def _in_profiles(profiles: tuple[str, ...]) -> Service:
    return {"profiles": list(profiles)} if profiles else {}


def _seconds(duration: float) -> str:
    """A duration as Compose reads it, to the millisecond: no exponent."""
    return f"{duration:.3f}".rstrip("0").rstrip(".") + "s"
