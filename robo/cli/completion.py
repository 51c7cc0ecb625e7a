"""What a shell completes: names that live on the network just now, types and manifests.

Each function is given the command line so far and what is typed of the word; where no robot answers at
once there is nothing to complete, and never an error.
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    import zenoh

TIMEOUT = 0.3
"""How long whoever pressed Tab waits, s."""


def topics(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys of topics."""
    from robo.tools import topics as tools

    return _live(ctx, incomplete, lambda session: [topic.key for topic in tools.list_topics(session, TIMEOUT)])


def services(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys of services."""
    from robo.tools import nodes as tools

    return _live(ctx, incomplete, lambda session: [service.key for service in tools.list_services(session, TIMEOUT)])


def nodes(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of nodes, where they say enough; else full names."""
    from robo.tools import nodes as tools

    def find(session: "zenoh.Session") -> list[str]:
        found = tools.list_nodes(session, TIMEOUT)
        short = [token.node for token in found]
        return [
            token.full_name if incomplete.startswith("/") or short.count(token.node) > 1 else token.node
            for token in found
        ]

    return _live(ctx, incomplete, find)


def processes(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of processes and groups that supervisors run."""
    from robo.tools import runs

    def find(session: "zenoh.Session") -> set[str]:
        found = runs.processes(session, timeout=TIMEOUT)
        own = {status.node if incomplete.startswith("/") else status.name.label for status in found}
        return own | {status.group for status in found if status.group}

    return _live(ctx, incomplete, find)


def robots(ctx: typer.Context, incomplete: str) -> list[str]:
    """Namespaces of robots."""
    from robo.tools import nodes as tools

    return _live(ctx, incomplete, lambda session: {token.namespace for token in tools.list_nodes(session, TIMEOUT)})


def parameters(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of the parameters of the node that the line names."""
    from robo.tools import nodes as tools
    from robo.tools import parameters as values

    def find(session: "zenoh.Session") -> Iterable[str]:
        return values.get(session, tools.find_node(tools.list_nodes(session, TIMEOUT), ctx.params["node"]))

    return _live(ctx, incomplete, find)


def manifests(incomplete: str) -> list[str]:
    """Manifests where `robo up` looks for them: here, in ./launch, and those that ship."""
    from robo.launch.find import SHARE, manifests_in

    if "/" in incomplete:
        folder = incomplete.rpartition("/")[0]
        found = [f"{folder}/{path.name}" for path in manifests_in(Path(folder or "/"))]
    else:
        folders = (Path.cwd(), Path.cwd() / "launch", SHARE / "launch")
        found = sorted({path.name for folder in folders for path in manifests_in(folder)})
    return [name for name in found if name.startswith(incomplete)]


def types(incomplete: str) -> list[str]:
    """Names of message types."""
    from robo.interfaces import catalogue

    return [name for name in catalogue.known() if name.startswith(incomplete)]


def _live(ctx: typer.Context, incomplete: str, find: "Callable[[zenoh.Session], Iterable[str]]") -> list[str]:
    from robo.cli.connection import connect_to_robot
    from robo.cli.reach import Reach
    from robo.errors import RoboError
    from robo.text.terminal import visible

    given: dict[str, Any] = ctx.params
    with suppress(RoboError):
        reach = Reach.of(given.get("connect"), given.get("robot_name"), TIMEOUT)
        with connect_to_robot(reach) as session:
            # A name with control characters, which a shell would print, is a stranger's.
            return sorted(name for name in find(session) if name.startswith(incomplete) and name == visible(name))
    return []
