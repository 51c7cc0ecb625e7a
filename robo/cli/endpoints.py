"""The endpoints that a command line names."""

from collections.abc import Sequence

from robo.errors import NetworkError, UsageError
from robo.wire.network import Network, zenoh_config


def check_endpoints(connect: Sequence[str], listen: Sequence[str] = ()) -> None:
    """Refuse words that are not valid endpoints before anything is started or dialled.

    Raises:
        UsageError: Zenoh does not accept one.
    """
    try:
        zenoh_config(Network(connect=tuple(connect), listen=tuple(listen)))
    except NetworkError as error:
        raise UsageError(str(error)) from None
