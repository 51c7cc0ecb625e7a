"""Layouts of viewers, which ship with robo: what they show of a robot at once."""

from pathlib import Path

from robo.errors import UsageError
from robo.text.suggestions import suggest

VIEWERS = ("foxglove", "lichtblick")
ROBOT = "my_robot"
"""The robot of the layouts that ship: the reference robot's own name."""
FOLDER = Path(__file__).resolve().parent.parent.parent / "share" / "config"


def layout_of(viewer: str, robot: str | None = None) -> str:
    """A layout, as the viewer imports it.

    Args:
        viewer: foxglove or lichtblick.
        robot: the namespace of the robot that it shows; None for the reference robot's.

    Raises:
        UsageError: there is none for this viewer.
    """
    if viewer not in VIEWERS:
        raise UsageError(f"--layout {viewer}: there is none for it; {suggest(viewer, VIEWERS)}")
    text = (FOLDER / f"{viewer}_layout.json").read_text(encoding="utf-8")
    return text.rstrip("\n").replace(f"/{ROBOT}/", f"/{robot}/" if robot else f"/{ROBOT}/")
