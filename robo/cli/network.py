"""The network of a router as command lines and files say it."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.errors import UsageError
from robo.session import Network, zenoh_config


def router_network(listen: Sequence[str], connect: Sequence[str], file: Path | None, *, name: str = "") -> Network:
    """How a router joins the network, with what a file says in Zenoh's own terms.

    Raises:
        UsageError: the file cannot be read or is no map.
        NetworkError: Zenoh does not accept an endpoint or a setting.
    """
    network = Network.from_environment("router", connect, listen)
    network = msgspec.structs.replace(network, name=name, more=_read(file) if file is not None else {})
    zenoh_config(network)  # mistakes are told before anything starts
    return network


def _read(file: Path) -> dict[str, object]:
    import yaml

    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{file} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    except yaml.YAMLError as error:
        raise UsageError(f"{file} is neither YAML nor JSON: {error}") from None
    if not isinstance(tree, dict):
        raise UsageError(f"{file}: expected a map of Zenoh's settings, for example downsampling: [...]")
    return tree
