"""Pictures in docs/images that robo draws of recordings and logs: `python -m docs_tools.site.drawn [LOG]`.

They are committed; made again where what they show has changed. LOG is that of the Intel Research Lab, not part of
this repository: where it is not there, its picture is left as it is.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "images"
ROOM = ROOT / "logs" / "room.log.gz"
INTEL = ROOT.parent / "shared" / "data" / "intel.log.gz"


def robo(*words: str | Path) -> None:
    """Run a verb, with the clock's zone that all have."""
    subprocess.run([sys.executable, "-m", "robo", *map(str, words)], check=True, env=os.environ | {"TZ": "UTC"})


def main(words: Sequence[str]) -> None:
    """Make all of them."""
    with tempfile.TemporaryDirectory() as folder:
        drive = Path(folder) / "room.mcap"
        robo("bag", "convert", ROOM, "-o", drive, "--robot-name", "r1")
        names = ("pose.pose.position.x", "pose.pose.position.y", "twist.twist.linear.x")
        fields = [word for name in names for word in ("--field", name)]
        robo("bag", "plot", drive, "odom", *fields, "-o", FOLDER / "speed.svg")
    log = Path(words[0]) if words else INTEL
    if log.exists():
        robo("map", log, "--corrected", "-o", FOLDER / "intel.svg")
    else:
        print(f"{FOLDER / 'intel.svg'} stays as it is: {log} is not there")


if __name__ == "__main__":
    main(sys.argv[1:])
