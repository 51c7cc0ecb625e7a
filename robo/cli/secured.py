"""`--security DIR`: who this command is on a secured network, for it and for all that it starts."""

import os
from pathlib import Path

from robo.environment import SECURITY_VARIABLE
from robo.errors import SecurityError
from robo.wire import identity


def secure(given: str | None, called: str = "") -> None:
    """Have this process be a name on a secured network, if an option or ROBO_SECURITY says so.

    Args:
        given: the option.
        called: what the robot or router is called: in a keystore, that is its name.

    Raises:
        SecurityError: there is no such name, or something is wrong with its key, its certificate or its folder.
    """
    folder = given or os.environ.get(SECURITY_VARIABLE, "")
    if folder:
        os.environ[SECURITY_VARIABLE] = str(identity.load(identity.folder_of(folder, called)).folder)


def keys_of_robot(given: str | None, robot: str) -> Path | None:
    """The folder of a robot's name, for an export: by an option, or by ROBO_SECURITY where that is a robot's.

    Args:
        given: the option.
        robot: what it is called; empty where that is not said.

    Returns:
        The folder; None where security is off, or where only who runs this command has a name.

    Raises:
        SecurityError: there is no such name, or it is that of a person.
    """
    folder = given or os.environ.get(SECURITY_VARIABLE, "")
    if not folder:
        return None
    found = identity.folder_of(folder, robot)
    about = identity.about_of(found)
    if about.role in ("robot", "router"):
        return found
    if given is None:
        return None
    raise SecurityError(
        f"--security {given}: {about.name} is there as {about.role}, and the router of a robot is to have it; "
        f"`robo security add {robot or 'NAME'} --as robot` makes a name for it"
    )


def name_in_force() -> str:
    """The name that this process has on a secured network, for messages; empty where security is off."""
    folder = os.environ.get(SECURITY_VARIABLE, "")
    return identity.load(identity.folder_of(folder)).about.name if folder else ""
