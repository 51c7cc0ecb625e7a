"""`robo router`: a router by itself, for several robots or hosts to meet at."""

from collections.abc import Sequence
from pathlib import Path

from robo import tcp
from robo.cli.connection import note, print_text
from robo.cli.json_text import document
from robo.cli.network import router_network
from robo.names import nested
from robo.router import route
from robo.session import settings_by_path, settings_of


def run_router(*, name: str, listen: Sequence[str], connect: Sequence[str], config: Path | None) -> None:
    """Route until Ctrl-C or SIGTERM.

    Raises:
        RoboError: an endpoint is none, or the configuration makes no sense.
    """
    network = router_network(listen, connect, config, name=name)
    dials = [endpoint for endpoint in network.connect if endpoint not in network.listen]
    towards = f", linked to {', '.join(dials)}" if dials else ""
    note(f"router {name} at {', '.join(network.listen)}{towards}; Ctrl-C stops")
    if any(tcp.answering(network.listen, 0.1)):
        note("another program has that port just now; this router takes it over when it is free")
    route(network, lambda: False, linger=0.0)


def print_config(*, name: str, listen: Sequence[str], connect: Sequence[str], config: Path | None) -> None:
    """Print the configuration by which `zenohd` does the same."""
    network = router_network(listen, connect, config, name=name)
    tree = nested(settings_of(network) | settings_by_path(network.more), "/")
    print_text(document(tree))
