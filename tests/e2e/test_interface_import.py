"""`robo interface import`, as it is typed: what it writes, what it refuses, and that the other tools know the types."""

import json
from pathlib import Path

import pytest

from tests.imported import write
from tests.support import run_robo

FILES = {
    "src/arm/package.xml": "<package><name>arm_msgs</name></package>",
    "src/arm/msg/Grip.msg": "# How a gripper stands.\nstd_msgs/Header header\nfloat32 width  # m\n",
    "src/arm/srv/Close.srv": "float32 force  # N\n---\nbool success\n",
    "src/hand_msgs/msg/Hand.msg": "arm_msgs/Grip[5] fingers\n",
}
pytestmark = pytest.mark.timeout(180)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write(tmp_path, FILES)


def said(folder: Path, *words: str, code: int = 0) -> tuple[str, str]:
    """What a command prints, and what it says beside it."""
    result = run_robo("interface", *words, cwd=str(folder))
    assert result.returncode == code, result.stdout + result.stderr
    assert "Traceback" not in result.stderr
    return result.stdout, result.stderr


def test_a_workspace_becomes_a_package_that_tools_know(folder: Path) -> None:
    out, err = said(folder, "import", "src", "-o", "made")
    assert (out, err) == ("", "3 types in made\n")
    assert sorted(path.name for path in (folder / "made").iterdir()) == [
        "__init__.py", "arm_msgs.py", "hand_msgs.py", "py.typed",
    ]  # fmt: skip
    out, _ = said(folder, "show", "hand_msgs/Hand")
    assert "fingers" in out
    out, _ = said(folder, "show", "arm_msgs/Close", "--type-hash")
    assert out.startswith("RIHS01_")
    out, _ = said(folder, "show", "arm_msgs/Close_Event", "--type-hash")
    assert out.startswith("RIHS01_")
    out, _ = said(folder, "show", "arm_msgs/Grip", "--ros")
    assert "# m\nfloat32 width\n" in out
    out, _ = said(folder, "list", "--json")
    assert {"arm_msgs/Close", "arm_msgs/Grip", "hand_msgs/Hand"} <= {
        json.loads(line)["name"] for line in out.splitlines()
    }


def test_a_module_is_printed_or_written_and_written_again(folder: Path) -> None:
    printed, err = said(folder, "import", "src")
    assert err == "3 types\n"
    compile(printed, "printed", "exec")
    said(folder, "import", "src", "-o", "made.py")
    assert (folder / "made.py").read_text() == printed
    write(folder, {"src/arm/msg/Grip.msg": "float64 width\n", "empty.py": '"""What robo create leaves."""\n'})
    said(folder, "import", "src", "-o", "made.py")
    assert "    width: float = 0.0\n" in (folder / "made.py").read_text()
    said(folder, "import", "src", "-o", "empty.py")


def test_what_others_wrote_is_not_written_over(folder: Path) -> None:
    write(folder, {"mine.py": "x = 1\n", "made/hand_msgs.py": "broken(", "made/arm_msgs.py": "y = 1\n"})
    _, err = said(folder, "import", "src", "-o", "mine.py", code=2)
    assert err.startswith("error: mine.py: it was not made by `robo interface import` and is not written over; ")
    _, err = said(folder, "import", "src", "-o", "made", code=2)
    assert err.startswith("error: made/arm_msgs.py, made/hand_msgs.py: ")
    assert not (folder / "made" / "__init__.py").exists()
    _, err = said(folder, "import", "src", "-o", "mine.py/below", code=2)
    assert "mine.py" in err


def test_all_mistakes_are_told_and_nothing_is_written(folder: Path) -> None:
    write(
        folder,
        {"src/arm/msg/Grip.msg": "flot32 width\nuint8 low=1\n", "src/hand_msgs/msg/Hand.msg": "arm_msgs/Grib g\n"},
    )
    _, err = said(folder, "import", "src", "-o", "made.py", code=1)
    assert err.splitlines() == [
        "error: src/arm/msg/Grip.msg:1:1: there is no type 'flot32' in arm_msgs; did you mean float32?",
        "src/arm/msg/Grip.msg:2:7: 'low' is no name of a constant: capitals, digits and _, as LOW",
        "src/hand_msgs/msg/Hand.msg:1:1: 'arm_msgs/Grib' is neither below the paths nor in robo; "
        "did you mean arm_msgs/Grip?",
    ]
    assert not (folder / "made.py").exists()


def test_programs_are_told_what_is_made(folder: Path) -> None:
    out, _ = said(folder, "import", "src/arm", "--json", "-o", "made")
    assert [json.loads(line) for line in out.splitlines()] == [
        {"name": "arm_msgs/Grip", "kind": "message", "ros_type": "arm_msgs/msg/Grip", "class_name": "Grip",
         "source": "src/arm/msg/Grip.msg", "file": "made/arm_msgs.py"},
        {"name": "arm_msgs/Close", "kind": "service", "ros_type": "arm_msgs/srv/Close", "class_name": "Close",
         "source": "src/arm/srv/Close.srv", "file": "made/arm_msgs.py"},
    ]  # fmt: skip
    assert all(path.suffix in (".py", ".typed") for path in (folder / "made").iterdir())


def test_what_robo_has_is_not_made_again(folder: Path) -> None:
    write(folder, {"geometry_msgs/msg/Point.msg": "float64 x\nfloat64 y\n"})
    out, err = said(folder, "import", "geometry_msgs")
    assert out == ""
    assert err.splitlines() == [
        "geometry_msgs/msg/Point.msg: robo's geometry/Point is used, which has float64 z where the file has nothing",
        "0 types; robo has geometry/Point already",
    ]
