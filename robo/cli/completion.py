"""What a shell completes: names that live on the network just now, types and manifests.

Each function is given the command line so far and what is typed of the word; where no robot answers at
once there is nothing to complete, and never an error.
"""

import os
from collections.abc import Callable, Iterable
from contextlib import redirect_stderr, suppress
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    import zenoh

TIMEOUT = 0.3
"""How long whoever pressed Tab waits for a robot, s."""
PATIENCE = 3.0
"""How long he waits for a module of his own, s."""
_RECORDED = (".mcap", ".csv", ".jsonl", ".ndjson", ".log", ".log.gz")
"""How names of recordings end, and of what can be made one."""


def topics(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys of topics."""
    from robo.tools import topics as tools

    return _live(ctx, incomplete, lambda session: [topic.key for topic in tools.list_topics(session, TIMEOUT, ())])


def services(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys of services."""
    from robo.tools import offers as tools

    return _live(ctx, incomplete, lambda session: [service.key for service in tools.list_services(session, TIMEOUT)])


def actions(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys of actions."""
    from robo.tools import offers as tools

    return _live(ctx, incomplete, lambda session: [action.key for action in tools.list_actions(session, TIMEOUT)])


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


def managed_nodes(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of managed nodes, active or not, where they say enough; else full names."""
    from robo.tools import lifecycle as tools

    def find(session: "zenoh.Session") -> list[str]:
        found = tools.managed_nodes(session, TIMEOUT)
        short = [name.rpartition("/")[2] for name in found]
        whole = incomplete.startswith("/")
        return [name if whole or short.count(own) > 1 else own for name, own in zip(found, short, strict=True)]

    return _live(ctx, incomplete, find)


def transitions(ctx: typer.Context, incomplete: str) -> list[str]:
    """Transitions of the managed node that the line names."""
    from robo.tools import lifecycle as tools

    def find(session: "zenoh.Session") -> Iterable[str]:
        node = tools.find(tools.managed_nodes(session, TIMEOUT), ctx.params["node"])
        return [way.label for way in tools.ways(session, node, TIMEOUT)]

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
        there = tools.list_nodes(session, TIMEOUT, inactive=True)
        return values.get(session, tools.find_node(there, ctx.params["node"]))

    return _live(ctx, incomplete, find)


def manifests(incomplete: str) -> list[str]:
    """Manifests where `robo up` looks for them: here, in ./launch, those that ship, and those of packages."""
    from robo.launch.find import SHARE, manifests_in, manifests_of
    from robo.packages import find

    typed = _whole(incomplete)
    package, colon, _ = typed.partition(":")
    if colon:
        found = []
        with suppress(LookupError):
            found = [f"{package}:{path.name}" for path in manifests_of(find.find(package))]
    elif "/" in typed:
        folder = typed.rpartition("/")[0]
        found = [f"{folder}/{path.name}" for path in manifests_in(Path(folder or "/"))]
    else:
        folders = (Path.cwd(), Path.cwd() / "launch", SHARE / "launch")
        there = find.known().there.values()
        found = sorted({path.name for folder in folders for path in manifests_in(folder)})
        found += [f"{one.name}:{path.name}" for one in there for path in manifests_of(one)]
    matching = [name for name in found if name.startswith(typed)]
    return matching if typed == incomplete else [_Behind(name[len(package) + 1 :]) for name in matching]


def recordings(incomplete: str) -> list[str]:
    """Recordings, what can be made one, and folders, which may hold such."""
    folder, slash, begin = incomplete.rpartition("/")
    found = []
    with suppress(OSError):
        for entry in os.scandir(f"{folder}{slash}" or "."):
            name = f"{entry.name}/" if entry.is_dir() else entry.name
            fits = name.startswith(begin) and (begin.startswith(".") or not name.startswith("."))
            if fits and name.endswith(("/", *_RECORDED)):
                found.append(f"{folder}{slash}{name}")
    return sorted(found)


def packages(incomplete: str) -> list[str]:
    """Names of packages that are announced."""
    from robo.packages import find

    return [name for name in find.known().there if name.startswith(incomplete)]


def services_to_run(ctx: typer.Context, incomplete: str) -> list[str]:
    """Packages that have nodes, and behind one of them its nodes."""
    from robo.launch.executables import look_into
    from robo.packages import find

    words = ctx.params.get("words") or []
    if not words:
        return packages(incomplete)
    if len(words) > 1:
        return []
    try:
        package = find.find(words[0])
    except LookupError:
        return []
    found = [one.node for one in look_into([package], PATIENCE).executables]
    return sorted(node for node in found if node.startswith(incomplete))


def types(incomplete: str) -> list[str]:
    """Names of message types."""
    from robo.interfaces import apart

    return sorted(name for name in apart.types(PATIENCE).listed if name.startswith(incomplete))


class _Behind(str):
    """What bash is to put behind a colon. It takes that colon for the word, and Typer asks whether this begins so."""

    __slots__ = ()

    def startswith(self, *_: object) -> bool:
        return True


def _whole(incomplete: str) -> str:
    """The word of which this is typed: bash takes words apart at colons, other shells do not."""
    before = os.environ.get("COMP_WORDS", "").split()[: int(os.environ.get("COMP_CWORD", 0))]
    if incomplete == ":" and before:
        return f"{before[-1]}:"
    if before[-1:] == [":"]:
        return f"{before[-2]}:{incomplete}"
    return incomplete


def _live(ctx: typer.Context, incomplete: str, find: "Callable[[zenoh.Session], Iterable[str]]") -> list[str]:
    from robo.cli.connection import connect_to_robot
    from robo.cli.reach import Reach
    from robo.errors import RoboError
    from robo.text.terminal import visible

    given: dict[str, Any] = ctx.params
    with suppress(RoboError), redirect_stderr(StringIO()):  # what is told on the way is not for a shell
        reach = Reach.of(given.get("connect"), given.get("robot_name"), TIMEOUT)
        with connect_to_robot(reach) as session:
            # A name with control characters, which a shell would print, is a stranger's.
            return sorted(name for name in find(session) if name.startswith(incomplete) and name == visible(name))
    return []
