"""A plan as a folder of Kubernetes' files: a base that `kubectl apply -f` takes, and an overlay for kustomize. Pure.

What is left out, because Kubernetes has no word for it, is told: who waits for whom but for the router, processes that
stay down, required ones, processors. The order of starts is that of readiness: nodes wait for their router.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import yaml

from robo.errors import UsageError
from robo.export.baggage import Project
from robo.export.commands import DASHBOARD, DASHBOARD_PORT, Commands
from robo.export.kubernetes import objects
from robo.export.kubernetes.containers import KEYS, ROUTER, RUN, SECRET, Containers, Object, label
from robo.export.kubernetes.variables import SETTINGS, Variables
from robo.export.names import inner_name, robot_of
from robo.export.profiles import ROBOT_VARIABLE, Profiles
from robo.launch.plan import ProcessPlan
from robo.wire.network import PORT

Form = Literal["pod", "deployments"]

LEAST_GRACE = 5
"""How long a pod has to end at the least, s."""
_CHECKSUM = "robo/settings"
_SHARED_MEMORY = "256Mi"


class Wishes(NamedTuple):
    """How it is to be."""

    image: str
    form: Form = "pod"
    """One pod for a robot, or a deployment for each process."""
    connect: tuple[str, ...] = ()
    """Endpoints that the router dials."""
    secrets: frozenset[str] = frozenset()
    """Variables that come from a Secret."""
    security: str = ""
    """The Secret with the files of a name's folder, for a secured network; empty where security is off."""

    def words(self, robot: str | None) -> list[str]:
        """As a command says them, and the robot's name if it is one."""
        words = ["--robot-name", robot] if robot is not None else []
        words += ["--image", self.image, *(["--deployments"] if self.form == "deployments" else [])]
        for option, values in (("--connect", self.connect), ("--secret", sorted(self.secrets))):
            words += [word for value in values for word in (option, value)]
        return words + (["--security", self.security] if self.security else [])


class Exported(NamedTuple):
    """What has become of a plan."""

    files: dict[str, str]
    """Texts by their path in the folder."""
    left_out: list[str]
    """What has no place in it."""
    unknown: list[str]
    """Variables that somebody has to say."""
    secret: list[str]
    """Variables that have to be in a Secret."""
    namespace: str
    """Where everything is, without an overlay."""

    @property
    def objects(self) -> list[str]:
        """The texts of all objects, without what is kustomize's."""
        return [text for path, text in self.files.items() if not path.endswith("kustomization.yaml")]


def export(profiles: Profiles, wishes: Wishes, *, folder: Path, made_by: str) -> Exported:
    """The files of a robot.

    Args:
        profiles: what runs. What would be a profile is left out: name its argument.
        wishes: how it is to be.
        folder: where they will stand.
        made_by: the command that makes them, for their first line.

    Raises:
        UsageError: there are several robots, files that nodes read are too large or cannot be read, or with security
            something would be in the clear.
    """
    plan = profiles.always
    robots = list(dict.fromkeys(map(robot_of, plan.processes))) or [plan.robot]
    if len(robots) > 1:
        shown = ", ".join(profiles.names.without(robot) or "the robot" for robot in robots)
        raise UsageError(f"the manifest has {len(robots)} robots ({shown}): each is exported by itself")
    if wrong := wishes.secrets - {variable.name for variable in profiles.names.variables}:
        known = ", ".join(sorted(variable.name for variable in profiles.names.variables)) or "none"
        raise UsageError(f"--secret {min(wrong)}: the manifest asks for no such variable; it asks for {known}")
    if wishes.security:
        _check_security(wishes)
    name = label(profiles.names.without(robots[0]), set())
    found = _Objects(profiles, wishes, Project(folder), robots[0], name)
    space = f"robot-{name}" if name != "robot" else name
    for one in (*found.maps, found.policy, *found.workloads, router := objects.service(name)):
        one["metadata"]["namespace"] = space
    base = {
        "namespace.yaml": [objects.namespace(space)],
        "settings.yaml": found.maps,
        "network-policy.yaml": [found.policy],
        "workload.yaml": [router, *found.workloads],
    }
    first = f"# Made by: {made_by}\n"
    files = {f"base/{path}": first + _text(parts) for path, parts in base.items()}
    kustomization = {**_KUSTOMIZATION, "resources": list(base)}
    files["base/kustomization.yaml"] = first + _text([kustomization])
    files["overlays/example/kustomization.yaml"] = _OVERLAY + _text([_overlay(wishes, found.variables)])
    return Exported(files, found.containers.left_out, found.variables.unknown, found.variables.secret, space)


def _check_security(wishes: Wishes) -> None:
    if not _SECRET.fullmatch(wishes.security):
        raise UsageError(
            f"--security {wishes.security}: say the name of a Secret, in small letters, digits, - and .\n"
            "  `kubectl create secret generic r1-keys --from-file=r1/` makes it of what `robo security bundle r1` makes"
        )
    if wishes.form != "pod":
        raise UsageError(
            "--security goes with one pod: pods of a process each would meet in the clear, since a name is a robot's "
            "and not a node's"
        )
    for endpoint in wishes.connect:
        if not endpoint.startswith("tls/"):
            raise UsageError(f"--connect {endpoint} is in the clear, and security is on: write tls/ in its place")


_SECRET = re.compile(r"[a-z0-9]([-a-z0-9.]{0,251}[a-z0-9])?")
_KUSTOMIZATION = {"apiVersion": "kustomize.config.k8s.io/v1beta1", "kind": "Kustomization"}
_OVERLAY = """\
# A robot of its own: copy this folder, name the robot, and `kubectl apply -k overlays/NAME`.
"""


class _Objects:
    """The objects of a robot."""

    def __init__(self, profiles: Profiles, wishes: Wishes, project: Project, robot: str, name: str) -> None:
        plan, together = profiles.always, wishes.form == "pod"
        self.variables = Variables(profiles.names, wishes.secrets)
        commands = Commands(profiles.types, self.variables.shown, "Kubernetes")
        self.containers = Containers(commands, self.variables, project, wishes.image, together=together)
        router = self.containers.router(robot, wishes.connect, secured=bool(wishes.security))
        endpoint = f"unixsock-stream/{RUN}/router.sock" if together else f"tcp/router:{PORT}"
        taken = {ROUTER}
        made = [
            (process, *self.containers.process(label(inner_name(process), taken), process, endpoint, profiles.names))
            for process in plan.processes
        ]
        self.maps = [objects.settings(self.variables.settings)]
        if project.configs:
            sources = {key: project.path(one["file"]) for key, one in project.configs.items()}
            self.maps.append(objects.files(sources))
        served = [DASHBOARD_PORT] if any(process.service == DASHBOARD for process in plan.processes) else []
        self.policy = objects.network_policy([_port(one) for one in wishes.connect], served)
        if together:
            pod = objects.pod(
                [container for _, container, _ in made],
                _volumes(together, [volume for *_, volume in made], wishes.security),
                max([_grace(process) for process in plan.processes], default=LEAST_GRACE),
                # It starts before the others, which wait until it is there, and is started again by itself.
                init=[
                    *([self.containers.keys()] if wishes.security else []),
                    {**router, "restartPolicy": "Always"},
                ],
            )
            self.workloads = [objects.stateful_set(name, name, pod)]
        else:
            pods = [(ROUTER, objects.pod([router], _volumes(together, []), LEAST_GRACE))]
            pods += [
                (container["name"], objects.pod([container], _volumes(together, [volume]), _grace(process)))
                for process, container, volume in made
            ]
            self.workloads = [objects.deployment(called, name, pod) for called, pod in pods]
        for workload in self.workloads:
            template = workload["spec"]["template"]["metadata"]
            template["annotations"] = {_CHECKSUM: objects.checksum(self.maps)}


def _volumes(together: bool, files: Sequence[Object | None], secret: str = "") -> list[Object]:
    memory: dict[str, Any] = {"medium": "Memory"}
    found: list[Object] = [{"name": "tmp", "emptyDir": {}}, {"name": "memory", "emptyDir": {}}]
    if together:
        found.append({"name": "run", "emptyDir": {**memory, "sizeLimit": "1Mi"}})
        found.append({"name": "shared-memory", "emptyDir": {**memory, "sizeLimit": _SHARED_MEMORY}})
    if secret:
        found.append({"name": SECRET, "secret": {"secretName": secret, "defaultMode": 0o440}})
        found.append({"name": KEYS, "emptyDir": {**memory, "sizeLimit": "64Mi"}})
    return [*found, *(one for one in files if one is not None)]


def _grace(process: ProcessPlan) -> int:
    return max(LEAST_GRACE, round(process.stop.timeout) + 2)


def _overlay(wishes: Wishes, variables: Variables) -> Object:
    found: Object = {
        **_KUSTOMIZATION,
        "namespace": "robot-example",
        "resources": ["../../base"],
        "images": [_image(wishes.image)],
    }
    if ROBOT_VARIABLE in variables.used:
        change = [{"op": "replace", "path": f"/data/{ROBOT_VARIABLE}", "value": "example"}]
        target = {"kind": "ConfigMap", "name": SETTINGS}
        found["patches"] = [{"target": target, "patch": yaml.safe_dump(change, sort_keys=False)}]
    return found


def _image(image: str) -> dict[str, str]:
    """An image as kustomize names it, so that people see where another tag is said."""
    named, _, digest = image.partition("@")
    if digest:
        return {"name": named, "digest": digest}
    tagged = ":" in image.rpartition("/")[2]
    name, _, tag = image.rpartition(":") if tagged else (image, "", "latest")
    return {"name": name, "newTag": tag}


def _port(endpoint: str) -> int:
    number = re.search(r":([0-9]{1,5})(?=$|[#?])", endpoint)
    if number is None:
        raise UsageError(f"--connect {endpoint}: an endpoint looks like tcp/192.168.1.20:7447")
    return int(number[1])


def _text(parts: Sequence[Object]) -> str:
    return "---\n".join(yaml.dump(part, Dumper=_Dumper, sort_keys=False, width=120) for part in parts)


class _Dumper(yaml.SafeDumper):
    """Texts of several lines as blocks, and nothing by reference: people read it, and change it."""

    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True


_READ_OTHERWISE = re.compile(
    r"[yYnN]|[-+]?(\.[0-9_]+|[0-9_]+(\.[0-9_]*)?)([eE][-+]?[0-9_]+)?|[-+]?0[bBoOxX][0-9a-fA-F_]+"
)
"""Texts that PyYAML leaves bare, and the reader of Kubernetes takes for truth values and numbers."""


def _block(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    style = "|" if "\n" in text else '"' if _READ_OTHERWISE.fullmatch(text) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _block)
