"""The network of a router as command lines and files say it."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.cli.endpoints import check_endpoints
from robo.errors import UnreadableFile, UsageError
from robo.text.files import read_text
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
