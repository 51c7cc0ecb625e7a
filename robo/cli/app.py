"""The command, with all its verbs; those of groups are read when one is called."""

from robo.cli.verb import app
from robo.cli.verbs import launch as launching
from robo.cli.verbs import running, system

__all__ = ["app", "launching", "running", "system"]
