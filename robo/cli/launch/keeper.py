"""`robo keeper`: containers that are killed by hand come back."""

import signal
from pathlib import Path

from robo.cli.printing import note
from robo.export.compose.engine import SOCKET, Engine
from robo.export.compose.keeper import Keeper
from robo.process.endings import raised_by_signals


def run_keeper(*, project: str, socket: Path | None, ready_file: Path | None) -> None:
    """Keep the containers of a Compose project, until Ctrl-C or SIGTERM.

    Raises:
        EngineError: there is no engine, or it is gone.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with raised_by_signals():
            Keeper(Engine(socket or SOCKET), project, note).run(ready_file)
    except KeyboardInterrupt:
        note("the keeper ends")
