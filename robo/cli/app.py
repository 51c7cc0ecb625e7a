"""The command, with all its verbs."""

from robo.cli.verb import app
from robo.cli.verbs import interface, launching, node, param, running, service, system, topic

__all__ = ["app", "interface", "launching", "node", "param", "running", "service", "system", "topic"]
