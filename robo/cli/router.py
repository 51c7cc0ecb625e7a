"""`robo router`: a router by itself, for several robots or hosts to meet at."""

import sys
from collections.abc import Sequence

import msgspec

from robo.cli.connection import note
from robo.router import route
from robo.session import Network, settings_of, zenoh_config


def run_router(*, name: str, listen: Sequence[str], connect: Sequence[str]) -> None:
    """Route until Ctrl-C or SIGTERM.

    Raises:
        NetworkError: an endpoint is none.
    """
    network = _network(name, listen, connect)
    zenoh_config(network)  # mistakes first
    dials = [endpoint for endpoint in network.connect if endpoint not in network.listen]
    towards = f", linked to {', '.join(dials)}" if dials else ""
    note(f"router {name} at {', '.join(network.listen)}{towards}; Ctrl-C stops")
    route(network, lambda: False, linger=0.0)


def print_config(*, name: str, listen: Sequence[str], connect: Sequence[str]) -> None:
    """Print the configuration by which `zenohd` does the same."""
    tree: dict[str, object] = {}
    for path, value in settings_of(_network(name, listen, connect)).items():
        *outer, last = path.split("/")
        place = tree
        for part in outer:
            inner = place.setdefault(part, {})
            assert isinstance(inner, dict)
            place = inner
        place[last] = value
    sys.stdout.write(f"{msgspec.json.format(msgspec.json.encode(tree)).decode()}\n")


def _network(name: str, listen: Sequence[str], connect: Sequence[str]) -> Network:
    return msgspec.structs.replace(Network.from_environment("router", connect, listen), name=name)
