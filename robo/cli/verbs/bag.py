"""`robo bag`: recordings."""

from robo.cli.tree import group

verbs = group()
