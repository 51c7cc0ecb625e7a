"""A plan as a Compose file: a router for each robot, a container for each process, a keeper on request. Pure.

What is left out, because Compose has no word for it: `required`, promises about topics, nice values, hangs, delays
between restarts, and what tells of readiness beside a node's own token, a port or a probe.
"""

import textwrap
from pathlib import Path
from typing import Any

from robo.environment import IMAGE_VARIABLE
from robo.errors import UsageError
from robo.export.baggage import Project
from robo.export.compose.layout import KEEPER, Layout
from robo.export.compose.services import GRACE, HEALTH, RUN, Service, Services, resources
from robo.export.profiles import Profiles
from robo.export.yaml_text import MERGE, Alias, Anchored, dumped
from robo.launch.plan import LimitsPlan

_COMMON: dict[str, Any] = {
    "networks": ["robot"],
    # The name of a container that is down is nobody else's to know: without these an engine asks the outside for it,
    # and where there is no internet, each try to reach a router that is just starting again would hang for 10 s.
    "dns_opt": ["ndots:1"],
    "dns_search": ".",
    "read_only": True,
    "cap_drop": ["ALL"],
    "security_opt": ["no-new-privileges:true"],
    "tmpfs": ["/tmp"],
    "stop_signal": "SIGINT",
    "stop_grace_period": f"{GRACE:g}s",
    "logging": {"driver": "json-file", "options": {"max-size": "10m", "max-file": "3"}},
    "deploy": resources(LimitsPlan()),
}
USER = 1000
"""The image's own user, and group."""
_ABOUT_THE_KEEPER = """\
  # Only with --profile {profile}: starts again what was killed by hand. It holds the engine's socket, and whoever
  # holds that is root on the host."""


def export(
    profiles: Profiles,
    *,
    folder: Path,
    made_by: str,
    image: str = "robo:latest",
    build: bool = True,
    keeper: bool = False,
    keys: Path | None = None,
) -> str:
    """The text of a Compose file.

    Args:
        profiles: what always runs, and what runs with a profile.
        folder: where the file will stand; paths in it are relative to it.
        made_by: the command that makes it, for its first line.
        image: what the containers are made of, where ROBO_IMAGE names nothing else.
        build: whether a Dockerfile in `context(folder)` makes it.
        keeper: with a profile for a container that starts the others again when somebody kills them by hand.
        keys: the folder of the robot's name on a secured network, if it is to be on one.

    Raises:
        UsageError: with keys there are several robots.
    """
    plan = profiles.always
    layout = Layout(profiles, keeper=keeper)
    project = Project(folder)
    if keys is not None and (count := len(layout.robots)) > 1:
        raise UsageError(f"--security is one robot's, and the manifest has {count}: each is exported by itself")
    make = Services(layout, project, profiles, keys)
    services: dict[str, Service] = {
        layout.router(robot): make.router(robot, context(folder) if build else None) for robot in layout.robots
    }
    services |= {layout.service(process.full_name): make.process(process) for process in layout.processes}
    about = plan.description or plan.manifest
    common = Anchored("robo", {"image": f"${{{IMAGE_VARIABLE}:-{image}}}", **_COMMON})
    parts = [
        *(f"# {line}".rstrip() for line in about.splitlines()),
        f"# Made by: {made_by}",
        "",
        dumped({"x-robo": common}),
        dumped({"x-health": HEALTH}),
        "services:",
        *(_section(name, service, common) for name, service in services.items()),
    ]
    if layout.keeper_profile is not None:
        parts.append(_ABOUT_THE_KEEPER.format(profile=layout.keeper_profile))
        parts.append(_section(KEEPER, make.keeper(layout.keeper_profile), common))
    parts.append("networks:\n  robot: {}\n")
    if keys is not None:
        options = {"type": "tmpfs", "device": "tmpfs", "o": f"mode=0700,uid={USER},gid={USER}"}
        parts.append(dumped({"volumes": {RUN: {"driver_opts": options}}}))
    if project.configs:
        parts.append(dumped({"configs": project.configs}))
    return "\n".join(parts)


def context(folder: Path) -> Path:
    """Where the Dockerfile of a Compose file in this folder stands: here, if the folder is further below."""
    return Path.cwd() if folder.absolute().is_relative_to(Path.cwd()) else folder


def _section(name: str, service: Service, common: Anchored) -> str:
    """A service in the section `services`, with all that they have in common."""
    return f"  {name}:\n{textwrap.indent(dumped({MERGE: Alias(common.name), **service}), ' ' * 4)}"
