"""What the processes of a run find in their environment."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from robo.environment import (
    CONNECT_VARIABLE,
    LOG_LEVEL_VARIABLE,
    NAMESPACE_VARIABLE,
    OWNER_VARIABLE,
    SPEC_VARIABLE,
    SUPERVISED_VARIABLE,
)
from robo.launch.plan import ProcessPlan
from robo.node.memory import file_name
from robo.process.spec import NodeSpec


class RunEnvironment:
    """Makes the environment of each start of each process."""

    def __init__(
        self,
        base: Mapping[str, str],
        folder: Path,
        router: str,
        shows_token: Callable[[str], bool],
        *,
        direct: bool,
    ) -> None:
        """
        Args:
            base: of every process.
            folder: for the sockets of nodes, and for what they keep over restarts.
            router: the endpoint of the robot's router.
            shows_token: whether a process, by full name, is a node whose token others can wait for.
            direct: whether nodes link to each other, or are clients of the router.
        """
        self._base = dict(base)
        self._folder = folder
        self._router = router
        self._shows_token = shows_token
        self._direct = direct
        self._starts = 0
        self._memories: dict[str, str] = {}

    def of(self, plan: ProcessPlan) -> dict[str, str]:
        """A command learns its name and its network there, in any language; a service its whole spec."""
        self._starts += 1
        spec = NodeSpec(
            service=plan.service or "",
            name=plan.name,
            namespace=plan.namespace,
            settings=plan.settings,
            remappings=plan.remap,
            qos=plan.qos,
            memory=self._memory_of(plan.full_name),
            needs=tuple(name for name, until in plan.needs.items() if until == "ready" and self._shows_token(name)),
            autostart=plan.autostart,
            mode="peer" if self._direct else "client",
            connect=(self._router,),
            # A name of its own for each start: what was killed leaves its socket behind.
            listen=(f"unixsock-stream/{self._folder}/{self._starts}.sock",) if self._direct else (),
        )
        variables = {
            SPEC_VARIABLE: spec.as_json(),
            OWNER_VARIABLE: plan.full_name,
            SUPERVISED_VARIABLE: "1",
        }
        if plan.service is None:
            variables |= {NAMESPACE_VARIABLE: plan.namespace, CONNECT_VARIABLE: self._router}
        if plan.log.level is not None:
            variables[LOG_LEVEL_VARIABLE] = plan.log.level
        return self._base | variables | plan.env

    def _memory_of(self, full_name: str) -> str:
        """The file for what a node keeps, made once: one that is gone later tells the node that something is lost."""
        if full_name not in self._memories:
            file = self._folder / file_name(full_name)
            with suppress(OSError):  # the node finds none, and takes it that something is lost
                file.write_text("{}")
            self._memories[full_name] = str(file)
        return self._memories[full_name]
