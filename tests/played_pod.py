"""A pod of Kubernetes on the Docker engine: the same images, commands, settings, volumes and probes."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.docker_engine import docker
from tests.support import eventually


class PlayedPod:
    """The pod of a StatefulSet, started as the kubelet does: init containers first, each until its probe succeeds."""

    def __init__(
        self, name: str, image: str, objects: list[dict[str, Any]], settings: Mapping[str, str], folder: Path
    ) -> None:
        """
        Args:
            name: of what the engine gets.
            image: in the place of that which is named.
            objects: what was exported.
            settings: what an overlay says of variables.
            folder: for the files of the pod.
        """
        self.name, self._image, self._folder = name, image, folder
        self._maps = {one["metadata"]["name"]: dict(one["data"]) for one in objects if one["kind"] == "ConfigMap"}
        self._maps["settings"] |= settings
        (self._pod,) = (one["spec"]["template"]["spec"] for one in objects if one["kind"] == "StatefulSet")
        self.containers: dict[str, dict[str, Any]] = {
            one["name"]: one for one in (*self._pod["initContainers"], *self._pod["containers"])
        }

    def start(self) -> None:
        """Start all of it, and wait until every startup probe has succeeded."""
        for volume in self._pod["volumes"]:
            self._make(volume)
        # What is in memory is there as long as somebody has it: as long as the pod.
        held = [f"--volume={self._called(name)}:/held/{name}" for name in self._empty()]
        words = ("run", "--detach", "--name", self._called("pause"), "--network=none", *held, "--entrypoint=sleep")
        docker(*words, self._image, "inf")
        for container in self._pod["initContainers"]:
            stays = container.get("restartPolicy") == "Always"
            self._run(container, stays=stays)
            if stays:
                self._wait(container)
        for container in self._pod["containers"]:
            self._run(container)
        for container in self._pod["containers"]:
            self._wait(container)

    def run(self, container: str, *words: str, check: bool = True) -> str:
        """What a command in a container prints."""
        return docker("exec", self._called(container), *words, check=check)

    def state(self, container: str) -> str:
        """`running`, `exited`, and how often it has been started again."""
        return docker("inspect", "--format", "{{.State.Status}} {{.RestartCount}}", self._called(container)).strip()

    def stop(self) -> dict[str, int]:
        """End it as the kubelet does; the exit codes."""
        grace = str(self._pod["terminationGracePeriodSeconds"])
        last_first = [*self._pod["containers"], *reversed(self._pod["initContainers"])]
        docker("stop", "--time", grace, *(self._called(one["name"]) for one in last_first))
        code = ("inspect", "--format", "{{.State.ExitCode}}")
        return {one["name"]: int(docker(*code, self._called(one["name"]))) for one in last_first}

    def remove(self) -> None:
        """Leave nothing of it."""
        docker("rm", "--force", "--volumes", *map(self._called, (*self.containers, "pause")), check=False)
        docker("volume", "rm", "--force", *map(self._called, self._empty()), check=False)

    def _called(self, part: str) -> str:
        return f"{self.name}-{part}"

    def _empty(self) -> list[str]:
        """The volumes that are empty when the pod starts."""
        return [volume["name"] for volume in self._pod["volumes"] if "emptyDir" in volume]

    def _make(self, volume: dict[str, Any]) -> None:
        if "emptyDir" in volume:
            options = ("--opt", "type=tmpfs", "--opt", "device=tmpfs", "--opt", "o=uid=1000,gid=1000,mode=0770")
            docker("volume", "create", *options, self._called(volume["name"]))
            return
        if "secret" in volume:
            return  # as files of root's, which whoever plays it has put there
        for item in volume["configMap"]["items"]:
            path = self._folder / volume["name"] / item["path"]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self._maps[volume["configMap"]["name"]][item["key"]])

    def _run(self, container: dict[str, Any], *, stays: bool = True) -> None:
        """Start a container; one that does not stay is waited for."""
        security, pod = container["securityContext"], self._pod["securityContext"]
        words = ["run", "--name", self._called(container["name"])]
        words += ["--detach", "--restart=always"] if stays else []
        words += [f"--network=container:{self._called('pause')}", f"--user={pod['runAsUser']}:{pod['runAsGroup']}"]
        words += ["--read-only"] if security["readOnlyRootFilesystem"] else []
        words += [f"--cap-drop={one}" for one in security["capabilities"]["drop"]]
        words += ["--security-opt=no-new-privileges"] if not security["allowPrivilegeEscalation"] else []
        words += [f"--memory={container['resources']['limits']['memory'].removesuffix('i')}"]
        known: dict[str, str] = {}
        for one in container["env"]:
            source = one.get("valueFrom", {}).get("configMapKeyRef")
            known[one["name"]] = self._maps[source["name"]][source["key"]] if source else _filled(one["value"], known)
        for name, value in known.items():
            words += ["--env", f"{name}={value}"]
        empty = self._empty()
        for mount in container["volumeMounts"]:
            name = mount["name"]
            source = self._called(name) if name in empty else str(self._folder / name)
            words += ["--volume", f"{source}:{mount['mountPath']}{':ro' if mount.get('readOnly') else ''}"]
        if command := container.get("command", []):
            words += [f"--entrypoint={command[0]}"]
        docker(*words, self._image, *command[1:], *(_filled(word, known) for word in container["args"]))

    def _wait(self, container: dict[str, Any]) -> None:
        probe = container.get("startupProbe")
        if probe is None:
            return
        command = ["exec", self._called(container["name"]), *probe["exec"]["command"]]
        eventually(lambda: _ends_well(command), f"{container['name']} is ready")


def _ends_well(command: list[str]) -> bool:
    try:
        docker(*command)
    except AssertionError:
        return False
    return True


def _filled(text: str, known: Mapping[str, str]) -> str:
    """A text in which variables are filled in as the kubelet does."""
    return re.sub(r"\$\$|\$\((\w+)\)", lambda found: known.get(found[1], found[0]) if found[1] else "$", text)
