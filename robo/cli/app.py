"""The command, with all its verbs in the order in which help lists them."""

from robo.cli.tree import root
from robo.cli.verbs import manifests, networks, packages, processes, start_stop, system

app = root((start_stop.verbs, processes.verbs, system.verbs, manifests.verbs, packages.verbs, networks.verbs))
