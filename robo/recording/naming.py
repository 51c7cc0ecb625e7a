"""What recordings are called to which nobody gives a name."""

import os
import time
from pathlib import Path


def name_of(now: float) -> str:
    """The name of a recording that begins now, s since the epoch: `robo_2026_11_23-18_30_00`."""
    return time.strftime("robo_%Y_%m_%d-%H_%M_%S", time.localtime(now))


def unused(path: Path) -> Path:
    """This name, or one with a number where there is something of this name: another may begin within a second."""
    found, number = path, 1
    while os.path.lexists(found):
        number += 1
        found = path.with_name(f"{path.stem}_{number}{path.suffix}")
    return found
