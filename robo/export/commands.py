"""The commands of processes in containers, and what their environment says: for whatever system starts these."""

import shlex
from collections.abc import Callable, Mapping
from pathlib import Path

from robo.environment import (
    CONNECT_VARIABLE,
    LOG_LEVEL_VARIABLE,
    MODE_VARIABLE,
    NAMESPACE_VARIABLE,
    SPEC_VARIABLE,
)
from robo.errors import ParameterError
from robo.export.baggage import Baggage
from robo.export.yaml_text import inline, quoted
from robo.launch.expression import as_text
from robo.launch.plan import ProcessPlan
from robo.parameters import files as parameter_files
from robo.parameters.shape import declared_as
from robo.parameters.words import parse_value
from robo.process.spec import NodeSpec
from robo.wire.network import Mode
from robo.wire.reports import Setting

INIT = ("tini", "-g", "--")
"""What begins a container of the image whose program is not `robo`."""
MEMORY = "/var/lib/robo"
"""Where a node keeps what outlives a restart of its container."""
DASHBOARD = "robo_services.dashboard"
DASHBOARD_PORT = 8080
"""Of the page within its container."""


class Commands:
    """Words as a system of containers takes them."""

    def __init__(self, types: Mapping[str, dict[str, str]], shown: Callable[[str], str], made_by: str) -> None:
        """
        Args:
            types: by full name, the types of the parameters that a node class declares.
            shown: a word, with its variables as the system has them.
            made_by: the exported file, as where settings are from.
        """
        self._types = types
        self._shown = shown
        self._made_by = made_by

    def words(self, words: tuple[str, ...], process: ProcessPlan, baggage: Baggage) -> list[str]:
        """Words of a command; files that they name are brought."""
        return [self._shown(baggage.word(word, process.cwd)) for word in words]

    def program(self, process: ProcessPlan, baggage: Baggage) -> tuple[list[str], list[str]]:
        """What a container begins with, empty for what its image says, and the words after that."""
        if process.service is None:
            return list(INIT), self.words(process.command(), process, baggage)
        words = self.of_node(process, baggage)
        # By the interpreter, as `robo up` does it: a debugger takes no script.
        prefix = self.words(process.prefix, process, baggage)
        return [*INIT, *prefix, "python", "-m", "robo"] if prefix else [], words

    def of_node(self, process: ProcessPlan, baggage: Baggage) -> list[str]:
        """The words after `robo` that run a service."""
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
            # Within its container it listens to all, so that a port of the outside leads to it.
            command += ["-p", "host:=0.0.0.0", "-p", f"port:={DASHBOARD_PORT}"]
            # Else it would show the container's own name, which nobody else knows.
            command += ["-p", "names:=[127.0.0.1]"] if "names" not in process.parameters else []
        return [self._shown(word) for word in (*command, *process.args)]

    def environment(self, process: ProcessPlan, router: str, mode: Mode) -> dict[str, str]:
        """What the environment of a process says.

        Args:
            process: a node or a command.
            router: the endpoint of its robot's.
            mode: how nodes join the network.
        """
        environment = {CONNECT_VARIABLE: router}
        if process.service is not None:
            environment[MODE_VARIABLE] = mode
        if process.log.level is not None:
            environment[LOG_LEVEL_VARIABLE] = process.log.level
        if process.service is not None and process.qos:
            environment[SPEC_VARIABLE] = NodeSpec(qos=process.qos).as_json()
        if process.service is None:
            spec = NodeSpec(
                name=process.name,
                namespace=process.namespace,
                # Where each was said is a place on this machine.
                settings={name: [Setting(value, self._made_by)] for name, value in process.parameters.items()},
                remappings=process.remap,
                autostart=process.autostart,
                qos=process.qos,
                mode=mode,
                connect=(router,),
            )
            environment[NAMESPACE_VARIABLE] = self._shown(process.namespace)
            environment[SPEC_VARIABLE] = self._shown(spec.as_json())
        return environment | {name: self._shown(value) for name, value in process.env.items()}

    def alive(self, process: ProcessPlan) -> list[str]:
        """The command that tells whether a node is well, as long as it runs; none where nothing does."""
        return ["robo", "health", self._shown(process.full_name)] if told_by_token(process) else []

    def health(self, process: ProcessPlan, baggage: Baggage) -> list[str]:
        """The command that tells whether a process is ready, by all of `checks`; none where nothing does."""
        commands = self.checks(process, baggage)
        if len(commands) > 1:
            return ["sh", "-c", " && ".join(map(shlex.join, commands))]
        return commands[0] if commands else []

    def checks(self, process: ProcessPlan, baggage: Baggage) -> list[list[str]]:
        """The commands that tell, all of them, whether a process is ready: by all that its manifest names."""
        ready = process.ready
        commands: list[list[str]] = []
        if alive := self.alive(process):
            commands.append(alive)
        if ready.port is not None:
            host, _, port = ready.port.rpartition(":")
            address = self._shown(repr((host.strip("[]"), int(port))))
            commands.append(["python", "-c", f"import socket; socket.create_connection({address}, 1)"])
        if ready.probe:
            commands.append(self.words(ready.probe, process, baggage))
        return commands


def told_by_token(process: ProcessPlan) -> bool:
    """Whether `robo health` tells how a process is."""
    # A command's own token is not enough for `robo health`, which also asks for the counters that a node has.
    # A node that waits in unconfigured shows none until somebody has activated it.
    return process.service is not None and process.ready.when == "node" and process.autostart


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
