"""One service of a Compose file: a robot's router, a process, the keeper."""

import shlex
from pathlib import Path
from typing import Any

from robo.environment import (
    CONNECT_VARIABLE,
    LOG_LEVEL_VARIABLE,
    MEMORY_VARIABLE,
    MODE_VARIABLE,
    NAMESPACE_VARIABLE,
    PORT_VARIABLE,
    SPEC_VARIABLE,
)
from robo.errors import ParameterError
from robo.export.compose.baggage import Baggage, Project
from robo.export.compose.layout import Layout, robot_of
from robo.export.compose.yaml_text import MERGE, Alias, Anchored, inline, quoted
from robo.export.profiles import Profiles
from robo.launch.expression import as_text
from robo.launch.plan import ProcessPlan, ReadyPlan
from robo.parameters import files as parameter_files
from robo.parameters.shape import declared_as
from robo.parameters.words import parse_value
from robo.process.spec import NodeSpec
from robo.wire.network import PORT
from robo.wire.reports import Setting

MEMORY = "/var/lib/robo"
"""What a node keeps over restarts of its container: a volume without a name, which is as old as the container."""

DASHBOARD = "robo_services.dashboard"
DASHBOARD_PORT = 8080
"""Of the page within its container; on the machine it is the same, or what a variable says."""
DASHBOARD_PORT_VARIABLE = "ROBO_DASHBOARD_PORT"

GRACE = 3.0
"""How long a process has between the first signal and SIGKILL where its manifest grants it no longer, s."""

HEALTH = Anchored("health", {"interval": "5s", "timeout": "3s", "start_period": "10s", "retries": 3})
"""How often health is looked at, of every service."""

Service = dict[Any, Any]

_CONDITIONS = {"started": "service_started", "ready": "service_healthy", "completed": "service_completed_successfully"}
_RESTARTS = {"never": "no", "on-failure": "on-failure", "always": "always"}
_INIT = ("tini", "-g", "--")
_FOR_EVER = 86_400.0
_KEEPS = "/tmp/keeps"
"""There while the keeper watches."""


class Services:
    """Makes each service of a layout, as plain data."""

    def __init__(self, layout: Layout, project: Project, profiles: Profiles) -> None:
        self._layout = layout
        self._project = project
        self._names = profiles.names
        self._types = profiles.types

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
        command = ["router", "--name", self._names.shown(robot), "--listen", f"tcp/0.0.0.0:{PORT}"]
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
        if process.service is not None:
            command = self._node_command(process, baggage)
            if process.prefix:
                # By the interpreter, as `robo up` does it: a debugger takes no script.
                prefix = self._words(process.prefix, process, baggage)
                service["entrypoint"] = [*_INIT, *prefix, "python", "-m", "robo"]
        else:
            command = self._words(process.command(), process, baggage)
            service["entrypoint"] = list(_INIT)
        service["command"] = command
        if process.service == DASHBOARD:
            service["ports"] = [f"127.0.0.1:${{{DASHBOARD_PORT_VARIABLE}:-{DASHBOARD_PORT}}}:{DASHBOARD_PORT}"]
        health = self._health_command(process, baggage)
        service["environment"] = self._environment(process)
        if baggage.configs:
            service["configs"] = baggage.configs
        if process.cwd is not None:
            service["working_dir"] = baggage.folder(process.cwd)
        volumes = baggage.volumes
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
        return f"tcp/{self._layout.router(robot)}:{PORT}"

    def _words(self, words: tuple[str, ...], process: ProcessPlan, baggage: Baggage) -> list[str]:
        return [self._names.shown(baggage.word(word, process.cwd)) for word in words]

    def _node_command(self, process: ProcessPlan, baggage: Baggage) -> list[str]:
        """The words after `robo`."""
        assert process.service is not None
        command = ["run", process.service, "--name", process.name]
        command += ["--robot-name", process.namespace] if process.namespace else []
        from_files: dict[str, object] = {}
        for path in process.parameter_files:
            command += ["--params-file", baggage.file(Path(path))]
            from_files |= parameter_files.load(path).values_for(process.namespace, process.name)
        types = self._types.get(process.full_name, {})
        for name, given in process.parameters.items():
            value = baggage.value(given)
            if name not in from_files or from_files[name] != given or value != given:
                kind = types.get(declared_as(name, types) or name)
                command += ["-p", f"{name}:={as_word(value, kind)}"]
        for old, new in process.remap.items():
            command += ["-r", f"{old}:={new}"]
        command += ["--no-autostart"] if not process.autostart else []
        if process.service == DASHBOARD:
            # Within its container it listens to all, so that the machine's own port leads to it.
            command += ["-p", "host:=0.0.0.0", "-p", f"port:={DASHBOARD_PORT}"]
        return [self._names.shown(word) for word in (*command, *process.args)]

    def _environment(self, process: ProcessPlan) -> dict[str, str]:
        # Clients of the router, not peers with links to each other: Zenoh dials a router again and again when a
        # cable or a container is gone for a while, and peers that it has once found and lost not always.
        router = self._endpoint(robot_of(process))
        environment = {CONNECT_VARIABLE: router}
        if process.service is not None:
            environment[MODE_VARIABLE] = "client"
        if process.log.level is not None:
            environment[LOG_LEVEL_VARIABLE] = process.log.level
        if process.service is not None and process.qos:
            environment[SPEC_VARIABLE] = NodeSpec(qos=process.qos).as_json()
        if process.service is None:
            spec = NodeSpec(
                name=process.name,
                namespace=process.namespace,
                # Where each was said is a place on this machine.
                settings={name: [Setting(value, "Compose file")] for name, value in process.parameters.items()},
                remappings=process.remap,
                autostart=process.autostart,
                qos=process.qos,
                mode="client",
                connect=(router,),
            )
            environment[NAMESPACE_VARIABLE] = self._names.shown(process.namespace)
            environment[SPEC_VARIABLE] = self._names.shown(spec.as_json())
        return environment | {name: self._names.shown(value) for name, value in process.env.items()}

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

    def _health_command(self, process: ProcessPlan, baggage: Baggage) -> list[str]:
        """The command that tells whether a process is well, by all that its manifest names; none where nothing does."""
        ready = process.ready
        commands: list[list[str]] = []
        if _told_by_token(process):
            commands.append(["robo", "health", self._names.shown(process.full_name)])
        if ready.port is not None:
            host, _, port = ready.port.rpartition(":")
            address = self._names.shown(repr((host.strip("[]"), int(port))))
            commands.append(["python", "-c", f"import socket; socket.create_connection({address}, 1)"])
        if ready.probe:
            commands.append(self._words(ready.probe, process, baggage))
        if len(commands) > 1:
            return ["sh", "-c", " && ".join(map(shlex.join, commands))]
        return commands[0] if commands else []


def _told_by_token(process: ProcessPlan) -> bool:
    # A command's own token is not enough for `robo health`, which also asks for the counters that a node has.
    # A node that waits in unconfigured shows none until somebody has activated it.
    return process.service is not None and process.ready.when == "node" and process.autostart


def _tells_health(process: ProcessPlan) -> bool:
    return _told_by_token(process) or process.ready.port is not None or bool(process.ready.probe)


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


def as_word(value: object, declared: str | None) -> str:
    """A value as `-p` reads it for a parameter of a type: text that would be read as something else is quoted."""
    if isinstance(value, str):
        return value if declared == "str" or _reads_as_itself(value) else quoted(value)
    if isinstance(value, (list, dict)):
        return inline(value)
    return as_text(value)


def _reads_as_itself(text: str) -> bool:
    try:
        return parse_value(text) == text
    except ParameterError:  # a bracket or a quote that is not closed
        return False
