"""The command line: parse, call, print. Each verb imports what it needs when it runs."""

import sys


def main() -> None:
    """The `robo` command."""
    if sys.argv[1:2] == ["run"]:
        # A node's process carries no command-line library: hand over before one is imported.
        from robo.cli.run import hand_over

        hand_over(sys.argv[2:])
    if sys.argv[1:2] == ["health"]:
        from robo.health import main as check_health  # it runs every few seconds

        sys.exit(check_health(sys.argv[2:]))
    from robo.cli.app import app

    app(prog_name="robo")
