"""`robo router`: a router by itself, for several robots or hosts to meet at."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.cli.json_text import document
from robo.cli.launch.network import check_listeners, router_network
from robo.cli.printing import note, print_text
from robo.process.router import route
from robo.text.paths import nested
from robo.wire import claims, knocking, listeners, zenoh_threads
from robo.wire.network import FOR_YOURS, settings_of
from robo.wire.session import close_session


def run_router(*, name: str, listen: Sequence[str], connect: Sequence[str], config: Path | None) -> None:
    """Route until Ctrl-C or SIGTERM.

    Raises:
        RoboError: an endpoint is not valid, or the configuration makes no sense.
    """
    zenoh_threads.use_those_of_a_router()  # before the first session of this process
    network = router_network(listen, connect, config, name=name)
    check_listeners(network)
    dials = [endpoint for endpoint in network.connect if endpoint not in network.listen]
    towards = f", linked to {', '.join(dials)}" if dials else ""
    called = f"router {name}" if name != "router" else "router"
    held = list(knocking.answering(network.places, 0.1))
    if held:
        other = claims.meet(held[0], network.security)
        if other is not None:
            close_session(other)
        note(f"{held[0]} is another router's just now; this router takes it over when it is free; Ctrl-C stops")
    there = listeners.in_the_way(network.doors, claims.PATIENCE)
    if not held:
        note(f"{called} {FOR_YOURS if there else network.reached}{towards}; Ctrl-C stops")
    for holder in there:
        note(f"{holder}: this router does not dial it, and others do not find it there before it is free")
    route(network, lambda: False, linger=0.0)


def print_config(*, name: str, listen: Sequence[str], connect: Sequence[str], config: Path | None) -> None:
    """Print the configuration by which `zenohd` does the same."""
    network = router_network(listen, connect, config, name=name)
    tree = nested(settings_of(msgspec.structs.replace(network, shared_memory=False)), "/")  # as `process.router`
    print_text(document(tree))
