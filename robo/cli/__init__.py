"""The command line: parse, call, print. Each verb imports what it needs when it runs."""

import gc
import sys

_COLLECT_AFTER = 20_000
"""Objects between two looks for garbage. Importing makes as many, none of them garbage: a tenth of a start."""


def main() -> None:
    """The `robo` command."""
    try:
        _run()
    except KeyboardInterrupt:  # while it was still being imported
        sys.exit(130)


def _run() -> None:
    if sys.argv[1:2] == ["help"]:
        sys.argv[1:] = [*sys.argv[2:], "--help"]
    if sys.argv[1:2] == ["run"]:
        # A node's process carries no command-line library: hand over before one is imported.
        from robo.cli.launch.run import hand_over

        hand_over(sys.argv[2:])
    from robo.text import terminal

    terminal.guard()
    if sys.argv[1:2] == ["health"]:
        from robo.process.health import main as check_health  # it runs every few seconds

        sys.exit(check_health(sys.argv[2:]))
    gc.set_threshold(_COLLECT_AFTER)
    from robo.cli.app import app
    from robo.cli.tree import keep_only

    keep_only(app, sys.argv[1] if len(sys.argv) > 1 else "")
    try:
        app(prog_name="robo")
    except SystemExit as end:
        if "zenoh" in sys.modules and isinstance(end.code, int | None):
            from robo.process.endings import leave

            leave(end.code or 0)
        raise
