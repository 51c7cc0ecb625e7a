"""Containers of a pod: the router, nodes and commands. Plain data."""

import math
from pathlib import PurePosixPath
from typing import Any

from robo.environment import LISTEN_VARIABLE, MEMORY_VARIABLE, SECURITY_VARIABLE, SHARED_MEMORY_VARIABLE
from robo.errors import UsageError
from robo.export.baggage import FILES, Baggage, Project
from robo.export.commands import DASHBOARD, DASHBOARD_PORT, MEMORY, Commands
from robo.export.kubernetes.variables import Variables
from robo.export.names import inner_name, slug, take
from robo.export.placeholders import Placeholders
from robo.launch.plan import LimitsPlan, ProcessPlan
from robo.wire.network import PORT

Object = dict[str, Any]

ROUTER = "router"
RUN = "/run/robo"
"""Where the processes of a pod meet."""
SECRET, KEYS = "secret", "keys"
"""The volumes with the keys: as the cluster has them, and as the router takes them."""
_SECRET_PLACE, _KEYS_PLACE = "/run/secret", "/run/keys"
_NAME = f"{_KEYS_PLACE}/name"

_CPU, _MEMORY = 0.05, 64 << 20
"""What a container asks for: cores, bytes."""
_MOST_MEMORY = 256 << 20
"""What it may have where its manifest does not say, bytes."""
_ROUTER = 60.0
"""How long a router may take to be there, s."""
_STARTS = 2
"""How often it is asked whether a node is ready, s: each time a Python starts."""
_ANSWER = 6
"""How long that may take, s."""
_PERIOD = 10
_PATIENCE = 6
"""How often a process may say that it is ill before it is started again: one minute. It is asked by way of the router,
and a router that comes back within that time has no node started again."""
_FOR_EVER = 86_400.0
_LONGEST = 48
"""Of a name, letters: a StatefulSet may have 52 (kubernetes#64023), and a number may follow."""


class Containers:
    """Makes each container of an export."""

    def __init__(
        self, commands: Commands, variables: Variables, project: Project, image: str, *, together: bool
    ) -> None:
        """
        Args:
            commands: makes words and environments.
            variables: of this export.
            project: the files of the project.
            image: what containers are made of.
            together: whether they share a pod, where they meet by sockets and shared memory.
        """
        self._commands = commands
        self._variables = variables
        self._project = project
        self._image = image
        self._together = together
        self.left_out: list[str] = []
        """What Kubernetes has no word for, or what cannot come along."""

    def keys(self) -> Object:
        """What hands the router its keys before it starts, as files that are its user's alone.

        Those of a Secret are root's, and links.
        """
        copy = f"umask 077 && mkdir -p {_NAME} && cp {_SECRET_PLACE}/* {_NAME}"
        return {
            **self._common(KEYS, ["-c", copy]),
            "command": ["sh"],
            "env": [],
            "volumeMounts": _mounts({SECRET: _SECRET_PLACE, KEYS: _KEYS_PLACE}),
        }

    def router(self, robot: str, connect: tuple[str, ...], *, secured: bool = False) -> Object:
        """The router of a robot.

        Args:
            robot: its name.
            connect: endpoints that it dials.
            secured: whether others meet it by TLS, with the keys that `keys` has brought.
        """
        words = ["router", "--name", self._variables.shown(robot)]
        words += ["--listen", f"unixsock-stream/{RUN}/router.sock"] if self._together else []
        words += ["--listen", f"{'tls' if secured else 'tcp'}/0.0.0.0:{PORT}"]
        for endpoint in connect:
            words += ["--connect", endpoint]
        health = ["robo", "health"]
        return {
            **self._common(ROUTER, words),
            "env": [
                *self._variables.environment(),
                *([{"name": SECURITY_VARIABLE, "value": _NAME}] if secured else []),
            ],
            "ports": [{"name": "zenoh", "containerPort": PORT}],
            "startupProbe": {**self._startup(health, _ROUTER), "periodSeconds": 1},
            "livenessProbe": self._liveness(health),
            "volumeMounts": _mounts(self._places() | ({KEYS: _KEYS_PLACE} if secured else {})),
        }

    def process(
        self, name: str, process: ProcessPlan, router: str, names: Placeholders
    ) -> tuple[Object, Object | None]:
        """A container, and the volume of the files that it brings; None where it brings none.

        Args:
            name: the container's.
            process: what runs in it.
            router: the endpoint of its robot's.
            names: the words in the plan that stand for variables.
        """
        baggage = Baggage(self._project, names, self._variables.shown)
        more: Object = {}
        begin, words = self._commands.program(process, baggage)
        if begin:
            more["command"] = begin
        checks = self._commands.checks(process, baggage)
        environment = self._commands.environment(process, router, "peer" if self._together else "client")
        places = self._places()
        if self._together and process.service is not None:
            # Nodes of one pod have links of their own, as those of one machine have.
            environment |= {LISTEN_VARIABLE: f"unixsock-stream/{RUN}/{name}.sock", SHARED_MEMORY_VARIABLE: "on"}
            places["shared-memory"] = "/dev/shm"
        if process.service is not None:
            environment[MEMORY_VARIABLE] = MEMORY
            places["memory"] = MEMORY
        if process.cwd is not None:
            more["workingDir"] = self._folder(baggage.folder(process.cwd))
        if process.service == DASHBOARD:
            more["ports"] = [{"name": "dashboard", "containerPort": DASHBOARD_PORT}]
        if checks:
            more["startupProbe"] = self._startup(self._variables.probe(checks), process.ready.timeout)
        if alive := self._commands.alive(process):
            # What else tells that a node is ready need not be so for ever.
            more["livenessProbe"] = self._liveness(self._variables.probe([alive]))
        self._tell(process, baggage)
        files = _files(name, baggage)
        container = {
            **self._common(name, words),
            "resources": resources(process.limits),
            # Variables first: what comes after may refer to them.
            "env": self._environment(environment),
            **more,
            "volumeMounts": _mounts(places),
        }
        if files is not None:
            container["volumeMounts"].append({"name": files["name"], "mountPath": FILES, "readOnly": True})
        return container, files

    def _environment(self, own: dict[str, str]) -> list[Object]:
        """The variables that are filled in, and what the process finds beside them; no name stands twice."""
        for name in self._variables.here & own.keys():
            if own[name] != f"$({name})":
                raise UsageError(
                    f"the variable {name} of this machine, and what `env` says {name} is for a process, are two things "
                    "of one name, and a container has only one"
                )
            del own[name]
        return [*self._variables.environment(), *({"name": key, "value": value} for key, value in own.items())]

    def _common(self, name: str, words: list[str]) -> Object:
        return {
            "name": name,
            "image": self._image,
            "args": words,
            "resources": resources(LimitsPlan()),
            "securityContext": {
                "allowPrivilegeEscalation": False,
                "readOnlyRootFilesystem": True,
                "capabilities": {"drop": ["ALL"]},
            },
        }

    def _places(self) -> dict[str, str]:
        return {"tmp": "/tmp"} | ({"run": RUN} if self._together else {})

    def _folder(self, path: str) -> str:
        """A folder to run in: nothing is filled in there."""
        if "$(" in path.replace("$$", ""):
            raise UsageError(f"cwd {path}: Kubernetes fills in no variable there; say the folder")
        return path.replace("$$", "$")

    def _startup(self, command: list[str], timeout: float) -> Object:
        tries = max(1, math.ceil((timeout or _FOR_EVER) / _STARTS))
        return {
            "exec": {"command": command},
            "periodSeconds": _STARTS,
            "timeoutSeconds": _ANSWER,
            "failureThreshold": tries,
        }

    def _liveness(self, command: list[str]) -> Object:
        return {
            "exec": {"command": command},
            "periodSeconds": _PERIOD,
            "timeoutSeconds": _ANSWER,
            "failureThreshold": _PATIENCE,
        }

    def _tell(self, process: ProcessPlan, baggage: Baggage) -> None:
        """Note what of a process has no place in a pod."""
        folders = [volume.split(":")[:2] for volume in baggage.volumes]
        said = [f"the folder {here} (have it in the image, as {there})" for here, there in folders]
        said += [f"restart: {process.restart.policy}"] if process.restart.policy != "always" else []
        waits = [(needed.rpartition("/")[2], until) for needed, until in process.needs.items() if until != "started"]
        said += [f"needs: {needed} {until}" for needed, until in waits]
        said += ["required"] if process.required else []
        said += [f"stop: {process.stop.signal}"] if process.stop.signal != "INT" else []
        said += [f"ready: {what}" for what in ("log", "topics") if getattr(process.ready, what)]
        said += ["priority"] if process.priority is not None else []
        said += ["cpus"] if process.cpus else []
        said += ["limits: files"] if process.limits.files is not None else []
        if said:
            self.left_out.append(f"{inner_name(process)}: {', '.join(said)}")


def resources(limits: LimitsPlan) -> Object:
    """What a container asks for and may have: never more of the one than of the other."""
    memory = limits.memory if limits.memory is not None else _MOST_MEMORY
    most = {"memory": _size(memory)}
    if limits.cpu is not None:
        most["cpu"] = _cores(limits.cpu)
    cpu = min(_CPU, limits.cpu if limits.cpu is not None else _CPU)
    return {"requests": {"cpu": _cores(cpu), "memory": _size(min(_MEMORY, memory))}, "limits": most}


def _size(size: int) -> str:
    return f"{size >> 20}Mi" if size % (1 << 20) == 0 else str(size)


def _cores(cores: float) -> str:
    return f"{max(1, round(1000 * cores))}m"


def label(text: str, taken: set[str]) -> str:
    """A name as Kubernetes takes one: small letters, digits and `-`, and nobody else's."""
    plain = slug(text).lower().replace("_", "-").strip("-")[:_LONGEST].rstrip("-") or "robot"
    return take(plain, taken, "-")


def _mounts(places: dict[str, str]) -> list[Object]:
    return [{"name": name, "mountPath": path} for name, path in places.items()]


def _files(name: str, baggage: Baggage) -> Object | None:
    items = [
        {"key": one["source"], "path": str(PurePosixPath(one["target"]).relative_to(FILES))} for one in baggage.configs
    ]
    return {"name": f"files-{name}"[:63], "configMap": {"name": "files", "items": items}} if items else None
