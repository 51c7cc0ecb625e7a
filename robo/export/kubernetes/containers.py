"""Containers of a pod: the router, nodes and commands. Plain data."""

from pathlib import PurePosixPath
from typing import Any

from robo.environment import LISTEN_VARIABLE, MEMORY_VARIABLE, SHARED_MEMORY_VARIABLE
from robo.export.baggage import FILES, Baggage, Project
from robo.export.commands import DASHBOARD, DASHBOARD_PORT, Commands
from robo.export.kubernetes.variables import Variables
from robo.export.names import inner_name, slug, take
from robo.export.placeholders import Placeholders
from robo.launch.plan import ProcessPlan
from robo.wire.network import PORT

Object = dict[str, Any]

ROUTER = "router"
RUN = "/run/robo"
"""Where the processes of a pod meet."""
MEMORY = "/var/lib/robo"
"""What a node keeps over restarts of its container."""

_INIT = ("tini", "-g", "--")
_RESOURCES: Object = {"requests": {"cpu": "50m", "memory": "64Mi"}, "limits": {"memory": "256Mi"}}
_PERIOD = 10
_PATIENCE = 6
"""How often a process may say that it is ill before it is started again: one minute. It is asked by way of the router,
and a router that comes back within that time has no node started again."""
_FOR_EVER = 86_400.0


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

    def router(self, robot: str, connect: tuple[str, ...]) -> Object:
        """The router of a robot.

        Args:
            robot: its name.
            connect: endpoints that it dials.
        """
        words = ["router", "--name", self._variables.shown(robot)]
        words += ["--listen", f"unixsock-stream/{RUN}/router.sock"] if self._together else []
        words += ["--listen", f"tcp/0.0.0.0:{PORT}"]
        for endpoint in connect:
            words += ["--connect", endpoint]
        probe = {"exec": {"command": ["robo", "health"]}}
        return {
            **self._common(ROUTER, words),
            "env": self._variables.environment(),
            "ports": [{"name": "zenoh", "containerPort": PORT}],
            "startupProbe": {**probe, "periodSeconds": 1, "timeoutSeconds": 3, "failureThreshold": 30},
            "livenessProbe": {**probe, "periodSeconds": _PERIOD, "timeoutSeconds": 3},
            "volumeMounts": _mounts(self._places()),
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
        baggage = Baggage(self._project, names)
        more: Object = {}
        if process.service is not None:
            words = self._commands.of_node(process, baggage)
            if process.prefix:
                prefix = self._commands.words(process.prefix, process, baggage)
                more["command"] = [*_INIT, *prefix, "python", "-m", "robo"]
        else:
            words = self._commands.words(process.command(), process, baggage)
            more["command"] = list(_INIT)
        health = self._commands.health(process, baggage)
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
            more["workingDir"] = baggage.folder(process.cwd)
        if process.service == DASHBOARD:
            more["ports"] = [{"name": "dashboard", "containerPort": DASHBOARD_PORT}]
        if health:
            more |= self._probes(self._variables.probe(health), process.ready.timeout)
        self._tell(process, baggage)
        files = _files(name, baggage)
        container = {
            **self._common(name, words),
            # Variables first: what comes after may refer to them.
            "env": [
                *self._variables.environment(),
                *({"name": key, "value": value} for key, value in environment.items()),
            ],
            **more,
            "volumeMounts": _mounts(places),
        }
        if files is not None:
            container["volumeMounts"].append({"name": files["name"], "mountPath": FILES, "readOnly": True})
        return container, files

    def _common(self, name: str, words: list[str]) -> Object:
        return {
            "name": name,
            "image": self._image,
            "args": words,
            "resources": _RESOURCES,
            "securityContext": {
                "allowPrivilegeEscalation": False,
                "readOnlyRootFilesystem": True,
                "capabilities": {"drop": ["ALL"]},
            },
        }

    def _places(self) -> dict[str, str]:
        return {"tmp": "/tmp"} | ({"run": RUN} if self._together else {})

    def _probes(self, command: list[str], timeout: float) -> Object:
        probe = {"exec": {"command": command}}
        return {
            "startupProbe": {
                **probe,
                "periodSeconds": 1,
                "timeoutSeconds": 3,
                "failureThreshold": max(1, round(timeout or _FOR_EVER)),
            },
            "livenessProbe": {
                **probe,
                "periodSeconds": _PERIOD,
                "timeoutSeconds": 3,
                "failureThreshold": _PATIENCE,
            },
        }

    def _tell(self, process: ProcessPlan, baggage: Baggage) -> None:
        """Note what of a process has no place in a pod."""
        said = [f"the folder {volume.partition(':')[0]} (put it into the image)" for volume in baggage.volumes]
        said += ["restart: never"] if process.restart.policy == "never" else []
        said += [
            f"needs: {needed.rpartition('/')[2]} {until}"
            for needed, until in process.needs.items()
            if until != "started"
        ]
        said += ["required"] if process.required else []
        said += ["cpus"] if process.cpus else []
        if said:
            self.left_out.append(f"{inner_name(process)}: {', '.join(said)}")


def label(text: str, taken: set[str]) -> str:
    """A name as Kubernetes takes one: small letters, digits and `-`, 63 characters, and nobody else's."""
    plain = slug(text).lower().replace("_", "-").strip("-")[:55].rstrip("-") or "robot"
    return take(plain, taken).replace("_", "-")


def _mounts(places: dict[str, str]) -> list[Object]:
    return [{"name": name, "mountPath": path} for name, path in places.items()]


def _files(name: str, baggage: Baggage) -> Object | None:
    items = [
        {"key": one["source"], "path": str(PurePosixPath(one["target"]).relative_to(FILES))} for one in baggage.configs
    ]
    return {"name": f"files-{name}"[:63], "configMap": {"name": "files", "items": items}} if items else None
