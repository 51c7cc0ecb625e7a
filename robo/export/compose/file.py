"""A plan as a Compose file: a router for each robot, a container for each process, a keeper on request. Pure.

What is left out, because Compose has no word for it: `required`, promises about topics, and what tells of readiness
beside a node's own token, a port or a probe.
"""

import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

import msgspec
import yaml

from robo.environment import (
    CONNECT_VARIABLE,
    IMAGE_VARIABLE,
    LOG_LEVEL_VARIABLE,
    MEMORY_VARIABLE,
    MODE_VARIABLE,
    NAMESPACE_VARIABLE,
    PORT_VARIABLE,
    SPEC_VARIABLE,
)
from robo.export.placeholders import Placeholders
from robo.launch.expression import as_text
from robo.launch.find import SHARE
from robo.launch.plan import Plan, ProcessPlan
from robo.parameters import files as parameter_files
from robo.parameters.words import parse_value
from robo.process.spec import NodeSpec

PORT = 7447
FILES = "/etc/robo"
"""Where the files that processes read stand in their containers."""

PROJECT = "/srv"
"""Where folders that processes run in stand in theirs."""

PACKAGES = "/opt/robo/site-packages"
"""Where the image has the packages that are installed in it; its Dockerfile makes this link."""

MEMORY = "/var/lib/robo"
"""What a node keeps over restarts of its container: a volume without a name, which is as old as the container."""

_CONDITIONS = {"started": "service_started", "ready": "service_healthy", "completed": "service_completed_successfully"}
_RESTARTS = {"never": "no", "on-failure": "on-failure", "always": "always"}

_COMMON: dict[str, Any] = {
    "networks": ["robot"],
    # The name of a container that is down is nobody else's to know: without these an engine asks the outside for it,
    # and where there is no internet, each try to reach a router that is just starting again would hang for 10 s.
    "dns_opt": ["ndots:1"],
    "dns_search": ".",
    "read_only": True,
    "cap_drop": ["ALL"],
    "security_opt": ["no-new-privileges:true"],
    "tmpfs": ["/tmp"],
    "stop_signal": "SIGINT",
    "stop_grace_period": "3s",
    "logging": {"driver": "json-file", "options": {"max-size": "10m", "max-file": "3"}},
    "deploy": {"resources": {"limits": {"cpus": "1.0", "memory": "256M"}}},
}
_KEEPER = "keeper"
_KEEPS = "/tmp/keeps"
"""There while the keeper watches."""
_ABOUT_THE_KEEPER = """\
  # Only with --profile {profile}: starts again what was killed by hand. It holds the engine's socket, and whoever
  # holds that is root on the host."""
_HEALTH = {"interval": "5s", "timeout": "3s", "start_period": "10s", "retries": 3}
_USUAL = {"<<": "*health"}
"""Takes in what stands at `x-health`."""


def export(
    plan: Plan,
    more: Mapping[str, Sequence[ProcessPlan]],
    names: Placeholders,
    *,
    folder: Path,
    made_by: str,
    image: str = "robo:latest",
    build: bool = True,
    keeper: bool = False,
) -> str:
    """The text of a Compose file.

    Args:
        plan: what always runs.
        more: by profile, what runs with it.
        names: words in the plan that stand for variables.
        folder: where the file will stand; paths in it are relative to it.
        made_by: the command that makes it, for its first line.
        image: what the containers are made of, where ROBO_IMAGE names nothing else.
        build: whether a Dockerfile in `context(folder)` makes it.
        keeper: with a profile for a container that starts the others again when somebody kills them by hand.
    """
    return _Export(plan, more, names, folder, build=build, keeper=keeper).text(image, made_by)


def context(folder: Path) -> Path:
    """Where the Dockerfile of a Compose file in this folder stands: here, if the folder is further below."""
    return Path.cwd() if folder.absolute().is_relative_to(Path.cwd()) else folder


class _Export:
    def __init__(
        self,
        plan: Plan,
        more: Mapping[str, Sequence[ProcessPlan]],
        names: Placeholders,
        folder: Path,
        *,
        build: bool,
        keeper: bool,
    ) -> None:
        self._plan = plan
        self._names = names
        self._folder = folder
        self._build = build
        self._configs: dict[str, dict[str, str]] = {}
        self._profiles: dict[str, str | None] = {process.full_name: None for process in plan.processes}
        self._profiles |= {process.full_name: profile for profile, own in more.items() for process in own}
        self._processes = [*plan.processes, *(process for own in more.values() for process in own)]
        self._robots: dict[str, str | None] = {}
        for process in self._processes:
            robot = _robot_of(process)
            self._robots.setdefault(robot, self._profiles[process.full_name])
        if not self._robots:
            self._robots[plan.robot] = None
        self._first = next(iter(self._robots))
        # Robots by their routers, processes by their full names; no two services are called alike.
        taken = {_KEEPER} if keeper else set()
        self._keeper_profile = _take(_KEEPER, set(more)) if keeper else None
        self._routers = {robot: _take(f"{self._prefix(robot)}router", taken) for robot in self._robots}
        self._services = {
            process.full_name: _take(f"{self._prefix(_robot_of(process))}{_slug(self._inner_name(process))}", taken)
            for process in self._processes
        }

    def text(self, image: str, made_by: str) -> str:
        services: dict[str, dict[str, Any]] = {}
        for robot, profile in self._robots.items():
            services[self._routers[robot]] = self._router_service(robot, profile)
        for process in self._processes:
            services[self._services[process.full_name]] = self._service(process)
        if self._keeper_profile is not None:
            services[_KEEPER] = _keeper_service(self._keeper_profile)
        about = self._plan.description or self._plan.manifest
        lines = [*(f"# {line}".rstrip() for line in about.splitlines()), f"# Made by: {made_by}", ""]
        common = {"image": f"${{{IMAGE_VARIABLE}:-{image}}}", **_COMMON}
        lines += [_block({"x-robo": common}, anchor="&robo"), _block({"x-health": _HEALTH}, anchor="&health")]
        lines.append("services:")
        for name, service in services.items():
            if name == _KEEPER and self._keeper_profile is not None:
                lines.append(_ABOUT_THE_KEEPER.format(profile=self._keeper_profile))
            lines.append(f"  {name}:\n    <<: *robo\n{_indented(_dumped(service), 4)}")
        lines.append("networks:\n  robot: {}\n")
        if self._configs:
            lines.append(_dumped({"configs": dict(sorted(self._configs.items()))}))
        return "\n".join(lines)

    # -- names -----------------------------------------------------------------------------------

    def _inner_name(self, process: ProcessPlan) -> str:
        return process.full_name.strip("/").removeprefix(_robot_of(process)).strip("/") or process.name

    def _prefix(self, robot: str) -> str:
        if robot == self._first:
            return ""
        profile = self._robots[robot]
        if profile is not None and list(self._robots.values()).count(profile) == 1:
            return f"{_slug(profile)}_"
        return f"{_slug(self._names.without(robot)).strip('_') or 'robot'}_"

    # -- services --------------------------------------------------------------------------------

    def _router_service(self, robot: str, profile: str | None) -> dict[str, Any]:
        service: dict[str, Any] = {} if profile is None else {"profiles": [profile]}
        if robot == self._first and self._build:
            # Compose builds each section by itself, and the image once is enough for all.
            service["build"] = {"context": self._source(context(self._folder)), "network": "host"}
        command = ["router", "--name", self._names.shown(robot), "--listen", f"tcp/0.0.0.0:{PORT}"]
        if robot == self._first:
            # From the host only; other hosts are let in by a router of their own choice.
            service["ports"] = [f"127.0.0.1:${{{PORT_VARIABLE}:-{PORT}}}:{PORT}"]
        else:
            command += ["--connect", f"tcp/{self._routers[self._first]}:{PORT}"]
        service["command"] = command
        service["restart"] = "always"
        service["healthcheck"] = {"test": ["CMD", "robo", "health"], **_USUAL}
        return service

    def _service(self, process: ProcessPlan) -> dict[str, Any]:
        shown = self._names.shown
        profile = self._profiles[process.full_name]
        service: dict[str, Any] = {} if profile is None else {"profiles": [profile]}
        files: dict[str, str] = {}
        volumes: dict[str, str] = {}
        if process.service is not None:
            command = self._node_command(process, files, volumes)
            if process.prefix:
                # By the interpreter, as `robo up` does it: a debugger takes no script.
                before = (self._brought_word(word, process, files) for word in process.prefix)
                service["entrypoint"] = ["tini", "-g", "--", *map(shown, before), "python", "-m", "robo"]
        else:
            command = [self._brought_word(word, process, files) for word in process.command()]
            service["entrypoint"] = ["tini", "-g", "--"]
        service["command"] = [shown(word) for word in command]
        service["environment"] = self._environment(process)
        if files:
            service["configs"] = [{"source": name, "target": target} for name, target in files.items()]
        if process.cwd is not None:
            service["working_dir"] = self._working_folder(process.cwd, volumes)
        mounts = [f"{source}:{target}:ro" for source, target in volumes.items()]
        if process.service is not None and process.restart.policy != "never":
            mounts.append(MEMORY)
            service["environment"][MEMORY_VARIABLE] = MEMORY
        if mounts:
            service["volumes"] = mounts
        service["depends_on"] = self._needs(process)
        service["restart"] = _RESTARTS[process.restart.policy]
        if process.stop.signal != "INT":
            service["stop_signal"] = f"SIG{process.stop.signal}"
        if process.stop.timeout > 1.0:
            service["stop_grace_period"] = f"{process.stop.timeout:g}s"
        if process.cpus:
            service["cpuset"] = ",".join(map(str, process.cpus))
        service["healthcheck"] = self._health(process)
        return service

    def _node_command(self, process: ProcessPlan, files: dict[str, str], volumes: dict[str, str]) -> list[str]:
        """The words after `robo`."""
        assert process.service is not None
        command = ["run", process.service, "--name", process.name]
        command += ["--robot-name", process.namespace] if process.namespace else []
        from_files: dict[str, object] = {}
        for path in process.parameter_files:
            command += ["--params-file", self._file(Path(path), files)]
            from_files |= parameter_files.load(path).values_for(process.namespace, process.name)
        for name, given in process.parameters.items():
            value = self._brought_in(given, files, volumes)
            if name not in from_files or from_files[name] != given or value != given:
                command += ["-p", f"{name}:={_as_word(value)}"]
        for old, new in process.remap.items():
            command += ["-r", f"{old}:={new}"]
        return [*command, *process.args]

    def _environment(self, process: ProcessPlan) -> dict[str, str]:
        # Clients of the router, not peers with links to each other: Zenoh dials a router again and again when a
        # cable or a container is gone for a while, and peers that it has once found and lost not always.
        router = f"tcp/{self._routers[_robot_of(process)]}:{PORT}"
        environment = {CONNECT_VARIABLE: router}
        if process.service is not None:
            environment[MODE_VARIABLE] = "client"
        if process.log.level is not None:
            environment[LOG_LEVEL_VARIABLE] = process.log.level
        if process.service is None:
            spec = NodeSpec(
                name=process.name,
                namespace=process.namespace,
                settings=process.settings,
                remappings=process.remap,
                mode="client",
                connect=(router,),
            )
            environment[NAMESPACE_VARIABLE] = self._names.shown(process.namespace)
            environment[SPEC_VARIABLE] = self._names.shown(spec.as_json())
        return environment | {name: self._names.shown(value) for name, value in process.env.items()}

    def _needs(self, process: ProcessPlan) -> dict[str, dict[str, Any]]:
        needs: dict[str, dict[str, Any]] = {self._routers[_robot_of(process)]: {"condition": "service_healthy"}}
        by_name = {other.full_name: other for other in self._processes}
        for name, until in process.needs.items():
            condition = _CONDITIONS[until]
            if condition == "service_healthy" and not self._tests(by_name[name]):
                condition = "service_started"
            needs[self._services[name]] = {"condition": condition}
            if process.restart.propagate:
                needs[self._services[name]]["restart"] = True
        return needs

    def _health(self, process: ProcessPlan) -> dict[str, Any]:
        # One that tells nothing is well while it runs. With its check disabled `docker compose up --wait` would fail.
        return {"test": ["CMD", *(self._tests(process) or ["true"])], **_USUAL}

    def _tests(self, process: ProcessPlan) -> list[str]:
        """The command that tells whether a process is well; none where nothing tells it."""
        shown = self._names.shown
        if process.ready.probe:
            return [shown(word) for word in process.ready.probe]
        if process.service is not None and process.ready.when == "node":
            return ["robo", "health", shown(process.full_name)]
        if process.ready.port is not None:
            host, _, port = process.ready.port.rpartition(":")
            return ["python", "-c", f"import socket; socket.create_connection(({host!r}, {port}), 1)"]
        return []

    # -- files -----------------------------------------------------------------------------------

    def _file(self, path: Path, files: dict[str, str]) -> str:
        """Where a file stands in the container."""
        path = Path(os.path.abspath(path))
        packaged = self._packaged(path)
        if packaged is not None:
            return packaged
        within = self._within_project(path)
        source = {"file": str(path) if within is None else self._source(path)}
        wanted = path.name if within is None else within
        name = next((name for name, known in self._configs.items() if known == source), None)
        if name is None:
            name = _take(_slug(wanted).strip("_"), set(self._configs))
            self._configs[name] = source
        if name not in files:
            target = f"{FILES}/{wanted}"
            files[name] = target if target not in files.values() else f"{FILES}/{name}/{path.name}"
        return files[name]

    def _brought_word(self, word: str, process: ProcessPlan, files: dict[str, str]) -> str:
        """A word of a command; a file of the project that it names is brought into the container."""
        portable = _portable(word)
        if portable == word and (os.path.isabs(word) or process.cwd is None):
            path = Path(os.path.abspath(word))
            if path.is_file() and (self._within_project(path) or self._packaged(path)) is not None:
                return self._file(path, files)
        return portable

    def _working_folder(self, folder: str, volumes: dict[str, str]) -> str:
        """Where a process runs: a folder of the project is mounted, another is the container's own."""
        path = Path(os.path.abspath(folder))
        packaged = self._packaged(path)
        if packaged is not None:
            return packaged
        within = self._within_project(path)
        if within is None or not path.is_dir():
            return self._names.shown(folder)
        target = os.path.normpath(f"{PROJECT}/{within}")
        volumes[self._source(path)] = target
        return target

    def _packaged(self, path: Path) -> str | None:
        """Where the image has a file that belongs to an installed package; None for any other file."""
        for number, part in enumerate(path.parts):
            if part in ("site-packages", "dist-packages"):
                return "/".join((PACKAGES, *path.parts[number + 1 :]))
        if path.is_relative_to(SHARE) and self._within_project(path) is None:
            return f"{PACKAGES}/robo/share/{path.relative_to(SHARE)}"
        return None

    def _within_project(self, path: Path) -> str | None:
        """A path as it is called in the project: below the folder of the Compose file, or below this one."""
        for folder in (self._folder.absolute(), Path.cwd()):
            if path.is_relative_to(folder):
                return str(path.relative_to(folder))
        return None

    def _source(self, path: Path) -> str:
        """A path of the project as the Compose file names it."""
        relative = os.path.relpath(path, self._folder.absolute())
        return relative if relative.startswith(".") else f"./{relative}"

    def _brought_in(self, value: object, files: dict[str, str], volumes: dict[str, str]) -> object:
        """A parameter's value, with the path of a file as it is within the container."""
        if not isinstance(value, str):
            return value
        if os.path.isabs(value) and self._names.holds(value):
            source = self._names.shown(self._names.from_word(value))
            volumes[source] = f"{FILES}/{_slug(source.partition(':')[0]).strip('_').lower()}"
            return volumes[source]
        if os.path.isabs(value) and Path(value).is_file():
            return self._file(Path(value), files)
        return value


def _keeper_service(profile: str) -> dict[str, Any]:
    """Root within its container, because the engine's socket is root's; nothing on a network can speak to it."""
    return {
        "profiles": [profile],
        "networks": {},
        "network_mode": "none",
        "user": "root",
        "command": ["keeper", "--project", "${COMPOSE_PROJECT_NAME}", "--ready-file", _KEEPS],
        "volumes": ["${DOCKER_SOCKET:-/var/run/docker.sock}:/var/run/docker.sock"],
        "restart": "always",
        "healthcheck": {"test": ["CMD", "test", "-e", _KEEPS], **_USUAL},
    }


def _robot_of(process: ProcessPlan) -> str:
    return process.namespace.partition("/")[0]


def _portable(word: str) -> str:
    """A word of a command without where things are on this machine."""
    if word == sys.executable:
        return "python"
    path = Path(word)
    installed = path == Path(sys.executable).with_name("robo") or (
        path.parents[1:] and _is_environment(path.parents[1])
    )
    return path.name if installed else word


def _is_environment(folder: Path) -> bool:
    """Whether it is a virtual environment of Python."""
    return (folder / "pyvenv.cfg").is_file()


def _as_word(value: object) -> str:
    """A value as `-p` reads it: text that would be read as something else stands in quotes."""
    if isinstance(value, str):
        return value if isinstance(parse_value(value), str) and value[:1] not in ("'", '"') else repr(value)
    if isinstance(value, (list, dict)):
        return msgspec.json.encode(value).decode()
    return as_text(value)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]", "_", text)


def _take(name: str, taken: set[str]) -> str:
    """A name, or the first of name_2, name_3 … that is not taken; it is then."""
    free = next(one for one in chain([name], (f"{name}_{number}" for number in count(2))) if one not in taken)
    taken.add(free)
    return free


def _block(tree: Mapping[str, Any], *, anchor: str) -> str:
    """A map at the top level that others refer to."""
    name, _, rest = _dumped(tree).partition(":")
    return f"{name}: {anchor}{rest}"


def _dumped(tree: Mapping[str, Any]) -> str:
    text: str = yaml.dump(dict(tree), Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=120)
    return text.replace("'<<': '*health'", "<<: *health")


class _Dumper(yaml.SafeDumper):
    """Writes each value out where it stands."""

    def ignore_aliases(self, data: Any) -> bool:
        del data
        return True


def _indented(text: str, width: int) -> str:
    lines: Iterable[str] = text.splitlines()
    return "\n".join(f"{' ' * width}{line}" if line else line for line in lines) + "\n"
