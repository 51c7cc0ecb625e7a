"""The network of a router as command lines and files say it."""

import errno
import socket
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from robo.cli.endpoints import check_endpoints
from robo.errors import NetworkError, UnreadableFile, UsageError
from robo.text.files import read_text
from robo.wire import tcp
from robo.wire.network import Network, zenoh_config


def router_network(listen: Sequence[str], connect: Sequence[str], file: Path | None, *, name: str = "") -> Network:
    """How a router joins the network, with what a file says in Zenoh's own terms.

    Raises:
        UsageError: a word is not a valid endpoint, or the file cannot be read or is no map.
        NetworkError: Zenoh does not accept a setting, or an endpoint of the environment.
    """
    check_endpoints(connect, listen)
    network = Network.from_environment("router", connect, listen, meeting_point=True)
    network = msgspec.structs.replace(network, name=name, more=_read(file) if file is not None else {})
    zenoh_config(network)  # mistakes are told before anything starts
    return network


def check_listeners(network: Network) -> None:
    """With security on, refuse endpoints at which this machine can never listen: Zenoh would try for ever.

    One at which another program listens is no matter of this: who that is shows where it is dialled.

    Raises:
        NetworkError: says which, and why.
    """
    for endpoint in network.listen if network.security else ():
        wrong = _cannot_listen(endpoint)
        if wrong is not None:
            host, port = tcp.address_of(endpoint) or ("", 0)
            why = "there is no host of that name" if isinstance(wrong, socket.gaierror) else wrong.strerror
            raise NetworkError(f"cannot listen at {endpoint}, port {port} on {host}: {why}\n  say another --listen")


def _cannot_listen(endpoint: str) -> OSError | None:
    """Why nobody could listen there; None also where somebody does, or may have just left."""
    end = time.monotonic() + _LEAVES_WITHIN
    while (wrong := tcp.cannot_listen(endpoint)) is not None and wrong.errno == errno.EADDRINUSE:
        if next(tcp.answering([tcp.nearby(endpoint) or endpoint], _LEAVES_WITHIN), None) is not None:
            return None
        if time.monotonic() >= end:
            break
        time.sleep(0.02)
    return wrong


_LEAVES_WITHIN = 2.0
"""How long a port may be held by somebody who does not listen any more, s."""


def shared(network: Network, robot: str, namespaces: Iterable[str]) -> Network:
    """A robot's network in which other users of this machine may do all with it.

    Args:
        network: how its router joins.
        robot: what the run is called.
        namespaces: of its processes.

    Raises:
        UsageError: it has no door for others, or one that is open already.
    """
    if network.security:
        raise UsageError(
            "--share opens the door at which others look; with security on, `robo security allow` says who may"
        )
    if not network.guarded:
        raise UsageError(
            "--share opens the door at which others look; what --listen says is open already, and a robot that dials\n"
            "  a network has no such door: --listen tcp/127.0.0.1:7448 makes one"
        )
    robots = {namespace.partition("/")[0] for namespace in namespaces} | {robot}
    return msgspec.structs.replace(network, shared=tuple(sorted(filter(None, robots))))


def _read(file: Path) -> dict[str, object]:
    from robo.text.tree import Map, Problem, plain
    from robo.text.yaml_tree import parse

    problems: list[Problem] = []
    try:
        tree = parse(read_text(file), file, problems)
    except UnreadableFile as error:
        raise UsageError(f"{file} cannot be read: {error}") from None
    if problems:
        raise UsageError("\n".join(map(str, problems)))
    settings = plain(tree) if isinstance(tree, Map) else None
    if not isinstance(settings, dict):
        raise UsageError(f"{file}: expected a map of Zenoh's settings, for example downsampling: [...]")
    return settings
