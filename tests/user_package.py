"""A package as a user has it: as a project, installed by hand into a folder on Python's path, and as a wheel."""

import shutil
import zipfile
from pathlib import Path

NODE = '''
import robo
from robo_messages import String


class Gripper(robo.Node):
    """Tell how wide the gripper is."""

    grip = robo.Publisher(String, "grip")

    @robo.timer(rate=10.0)
    def tell(self) -> None:
        self.grip.publish(String("half open"))
'''
MESSAGES = '''
from robo_messages import Message, message


@message("my_robot/Grip")
class Grip(Message):
    """How wide a gripper is."""

    width: float = 0.0
    """m."""
'''
MANIFEST = """
description: a gripper
groups:
  arm:
    namespace: ${robot_name}
    nodes:
      gripper: {service: my_robot.gripper, params: ../config/robot.yaml}
"""
PROJECT = """
[project]
name = "my-robot"
version = "1.0"
description = "A robot with a gripper."
[project.entry-points."robo.packages"]
my_robot = "my_robot"
"""
METADATA = "Metadata-Version: 2.1\nName: my-robot\nVersion: 1.0\nSummary: A robot with a gripper.\n"
ANNOUNCED = "[robo.packages]\nmy_robot = my_robot\n"


def write(folder: Path, files: dict[str, str]) -> Path:
    """Write files below a folder."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def project(folder: Path) -> Path:
    """The folder of a user's project."""
    return write(
        folder,
        {
            "pyproject.toml": PROJECT,
            "my_robot/__init__.py": "",
            "my_robot/messages.py": MESSAGES,
            "my_robot/gripper.py": NODE,
            "my_robot/logic.py": "import dataclasses\n",
            "launch/robot.yaml": MANIFEST,
            "config/robot.yaml": "/**: {ros__parameters: {use_sim_time: false}}\n",
            "tests/test_gripper.py": "raise SystemExit('a test is no node')\n",
        },
    )


def announce(site: Path, name: str, entry_points: str, metadata: str = "", direct_url: str = "") -> Path:
    """What is written down of a distribution that is installed."""
    metadata = metadata or f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
    files = {"METADATA": metadata, "entry_points.txt": entry_points}
    if direct_url:
        files["direct_url.json"] = direct_url
    return write(site / f"{name.replace('-', '_')}-1.0.dist-info", files)


def install(site: Path, source: Path) -> None:
    """Install a project as its wheel would."""
    for name, file in _contents(source).items():
        (site / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, site / name)
    announce(site, "my-robot", ANNOUNCED, METADATA)


def wheel(source: Path, folder: Path) -> Path:
    """The wheel of a project."""
    info = "my_robot-1.0.dist-info"
    about = {
        f"{info}/METADATA": METADATA,
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/entry_points.txt": ANNOUNCED,
    }
    path = folder / "my_robot-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, file in _contents(source).items():
            archive.write(file, name)
        for name, text in about.items():
            archive.writestr(name, text)
        record = "".join(f"{name},,\n" for name in [*archive.namelist(), f"{info}/RECORD"])
        archive.writestr(f"{info}/RECORD", record)
    return path


def _contents(source: Path) -> dict[str, Path]:
    """The files of a project, by where a wheel has them."""
    found = {str(file.relative_to(source)): file for file in source.glob("my_robot/**/*.py")}
    for folder in ("launch", "config"):
        found |= {f"my_robot/share/{folder}/{file.name}": file for file in (source / folder).glob("*.yaml")}
    return found
