"""Users' packages: which are found, where their files are, what they have; a broken one is named and hides no other."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from robo.cli import completion
from robo.cli.views import pkg
from robo.errors import ManifestError, UsageError
from robo.launch.executables import look_into
from robo.launch.find import find_manifest, manifests_of
from robo.packages import announced
from robo.packages import find as packages
from robo.packages.folders import spec_of
from tests import user_package
from tests.pages import ROOT
from tests.unit.test_verbs import said


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on Python's path, as site-packages is one; one works in another one, which is empty."""
    folder, here = tmp_path / "site", tmp_path / "here"
    folder.mkdir()
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.syspath_prepend(str(folder))
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return user_package.project(tmp_path / "project")


def test_what_is_installed_is_found_from_any_folder(site: Path, project: Path) -> None:
    user_package.install(site, project)
    found = packages.known().there["my_robot"]
    assert (found.source, found.distribution, found.version) == ("installed", "my-robot", "1.0")
    assert (found.folders, found.share) == ((site / "my_robot",), site / "my_robot" / "share")
    assert found.description == "A robot with a gripper."
    assert find_manifest("my_robot:robot.yaml") == site / "my_robot" / "share" / "launch" / "robot.yaml"
    assert "my_robot" not in sys.modules, "a list imports nothing"


def test_what_is_installed_editable_is_told_apart(site: Path, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(project))
    origin = f'{{"url": "file://{project}", "dir_info": {{"editable": true}}}}'
    user_package.announce(site, "my-robot", user_package.ANNOUNCED, direct_url=origin)
    found = packages.known().there["my_robot"]
    assert (found.source, found.folders, found.share) == ("editable", (project / "my_robot",), project)
    assert find_manifest("my_robot:robot.yaml") == project / "launch" / "robot.yaml"


@pytest.mark.usefixtures("site")
def test_the_project_of_this_folder_needs_no_installation(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    found = packages.known().there["my_robot"]
    assert (found.source, found.distribution, found.version, found.share) == ("folder", "", "1.0", project)
    assert find_manifest("my_robot:robot.yaml") == Path("launch/robot.yaml")
    assert "  from     this folder, not installed" in said("pkg", "show", "my_robot")[1]


def test_the_project_of_this_folder_hides_what_is_installed(
    site: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    user_package.install(site, project)
    monkeypatch.chdir(project)
    found = packages.known().there["my_robot"]
    assert (found.source, found.hides, found.folders) == ("folder", "my-robot 1.0", (project / "my_robot",))
    assert "this folder, not installed; hides my-robot 1.0" in said("pkg", "list")[1]


def test_an_environment_in_this_folder_is_not_this_folder(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    user_package.write(site, {"bare/__init__.py": ""})
    monkeypatch.chdir(site.parent)
    assert packages.find("bare").source == "path"


@pytest.mark.parametrize("place", ["my_robot", "src/my_robot"])
def test_the_share_folder_of_a_checkout_is_the_project(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    del site  # the folder one works in
    files = {f"{place}/__init__.py": "", "pyproject.toml": "", "launch/a.yaml": "nodes: {}\n"}
    project = user_package.write(tmp_path / "other", files)
    monkeypatch.syspath_prepend(str((project / place).parent))
    found = packages.find("my_robot")
    assert (found.source, found.share) == ("path", project)
    assert manifests_of(found) == [project / "launch" / "a.yaml"]


def test_a_folder_of_the_same_name_is_no_package_where_one_is_installed(site: Path, project: Path) -> None:
    user_package.install(site, project)
    (Path.cwd() / "my_robot").mkdir()  # a checkout, for example
    assert packages.find("my_robot").source == "installed"


def test_finding_a_module_imports_none_of_its_parents(site: Path) -> None:
    loud = "raise RuntimeError('imported')"
    user_package.write(site, {"loud/__init__.py": loud, "loud/inner/__init__.py": loud})
    spec = spec_of("loud.inner")
    assert spec is not None
    assert spec.origin == str(site / "loud/inner/__init__.py")
    assert (spec_of("loud.absent"), spec_of("absent.inner"), spec_of("loud.inner.deep.deeper")) == (None, None, None)


BROKEN = {
    "bad-name = my_robot": "package bad-name, which ruined 1.0 announces, has no valid name: ",
    "a = my_robot:main": "package a, which ruined 1.0 announces, names no module: 'my_robot:main'; write a = \"a\"",
    "b": "package b, which ruined 1.0 announces, names no module: ''",
    "c = absent": "package c, which ruined 1.0 announces, is not there: there is no module absent",
    "d = absent.inner": "package d, which ruined 1.0 announces, is not there: there is no module absent.inner",
    "e = single": "package e, which ruined 1.0 announces, is a single module, single; make it a folder",
    "my_robot = other": "package my_robot of ruined 1.0: that of my-robot 1.0 goes first",
}


def test_each_broken_package_is_named_and_hides_no_other(site: Path, project: Path) -> None:
    user_package.install(site, project)
    user_package.write(site, {"single.py": "", "other/__init__.py": ""})
    user_package.announce(site, "ruined", "[robo.packages]\n" + "\n".join(BROKEN))
    (site / "torn-1.0.dist-info").mkdir()
    (site / "torn-1.0.dist-info" / "entry_points.txt").write_bytes(b"[robo.packages]\n\xff = \xff\n")
    (site / "nameless-1.0.dist-info").mkdir()
    (site / "nameless-1.0.dist-info" / "entry_points.txt").write_text("\n[robo.packages\nf = single\n=\n; no\n")
    there, broken = packages.known()
    assert "my_robot" in there
    for begin in BROKEN.values():
        assert [text for text in broken.values() if text.startswith(begin)], begin
    code, out = said("pkg", "list")
    assert code == 0
    assert out.count("left out: ") == len(broken)
    # Elsewhere: it imports what is announced.
    command = [sys.executable, "-m", "robo", "interface", "list"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "my_robot/Grip" in listed.stdout
    assert f"left out: {BROKEN['c = absent']}\n" in listed.stderr
    assert completion.packages("my_") == ["my_robot"]
    with pytest.raises(LookupError, match=r"which ruined 1\.0 announces, is not there"):
        packages.find("c")
    assert said("pkg", "show", "c") == (2, f"error: {BROKEN['c = absent']}\n")


@pytest.mark.parametrize("text", ["[project", "project = 3", '[project]\nentry-points = {"robo.packages" = 3}', "\0"])
def test_a_project_file_that_makes_no_sense_hides_nothing(site: Path, project: Path, text: str) -> None:
    user_package.install(site, project)
    Path("pyproject.toml").write_text(text)
    there, broken = packages.known()
    assert "my_robot" in there
    assert not broken or broken["pyproject.toml"].startswith("the pyproject.toml of this folder cannot be read: ")


def test_a_package_without_manifests_says_where_they_would_be(site: Path) -> None:
    user_package.write(site, {"bare/__init__.py": ""})
    user_package.announce(site, "bare", "[robo.packages]\nbare = bare\n")
    with pytest.raises(ManifestError, match=r"package bare has no manifest 'robot\.yaml'; it has none \(looked in "):
        find_manifest("bare:robot.yaml")
    with pytest.raises(UsageError, match=r"package bare has no folder .*site/bare/share"):
        pkg.print_prefix("bare", share=True)
    assert said("pkg", "prefix", "bare") == (0, f"{site}/bare\n")
    assert said("pkg", "prefix", "bar") == (2, "error: there is no package 'bar'; did you mean bare?\n")


def test_nodes_are_found_and_broken_modules_are_named(site: Path, project: Path) -> None:
    user_package.write(
        project / "my_robot",
        {
            "arms/__init__.py": "",
            "arms/two.py": f"{user_package.NODE}\nclass Left(Gripper): pass\n",
            "broken.py": "class A(int): pass\nraise RuntimeError('no hardware')",
            "crashes.py": "import os\nclass A(int): pass\nos.abort()",
            "exits.py": "class A(int): pass\nraise SystemExit('no')",
            "leaves.py": "import os\nclass A(int): pass\nprint('}{'); os._exit(3)",
            "needs.py": "import absent\nclass A(int): pass",
            "__main__.py": "class A(int): pass\nraise SystemExit('run by nobody')",
            "plain.py": "raise RuntimeError('no class, so nobody needs to import it')",
        },
    )
    user_package.install(site, project)
    found = look_into([packages.find("my_robot"), packages.find("robo_services")])
    mine = [(one.node, one.service, one.class_name) for one in found.executables if one.package == "my_robot"]
    assert mine == [
        ("arms.two:Gripper", "my_robot.arms.two:Gripper", "Gripper"),
        ("arms.two:Left", "my_robot.arms.two:Left", "Left"),
        ("gripper", "my_robot.gripper", "Gripper"),
    ]
    assert "safety_monitor" in [one.node for one in found.executables], "packages behind a broken one are there"
    assert found.messages == ["my_robot/Grip"]
    module = "module my_robot.{} cannot be imported: "
    assert [text.removeprefix(f"{site}/") for text in found.broken] == [
        f"{module.format('broken')}{site}/my_robot/broken.py:2: RuntimeError: no hardware",
        f"{module.format('crashes')}it ends the process with SIGABRT",
        f"{module.format('exits')}{site}/my_robot/exits.py:2: SystemExit: no",
        f"{module.format('leaves')}it ends the process with exit code 3",
        f"{module.format('needs')}{site}/my_robot/needs.py:1: No module named 'absent'",
    ]
    assert not {name for name in sys.modules if name.startswith("my_robot")}


def test_a_module_whose_import_does_not_end_is_named(site: Path) -> None:
    user_package.write(site, {"slow/__init__.py": "", "slow/zz.py": "class A(int): pass\nimport time; time.sleep(600)"})
    found = look_into([packages.find("slow")], patience=2.0)
    assert found.broken == ["module slow.zz cannot be imported: it has not come to its end within 2 s"]


def test_what_is_shown(site: Path, project: Path) -> None:
    user_package.install(site, project)
    assert said("pkg", "executables", "my_robot") == (0, "my_robot gripper\n")
    assert said("pkg", "executables", "my_robot", "--full-path") == (0, f"{site}/my_robot/gripper.py\n")
    code, text = said("pkg", "show", "my_robot")
    assert (code, text.splitlines()) == (
        0,
        [
            "my_robot: A robot with a gripper.",
            "  from          installed",
            "  distribution  my-robot 1.0",
            "  module        my_robot",
            f"  folder        {site}/my_robot",
            f"  share         {site}/my_robot/share",
            "  manifests",
            f"    my_robot:robot.yaml  {site}/my_robot/share/launch/robot.yaml",
            "  nodes",
            "    gripper  Tell how wide the gripper is.",
            "  messages",
            "    my_robot/Grip",
        ],
    )
    assert '"executables":[{"package":"my_robot","node":"gripper"' in said("pkg", "show", "my_robot", "--json")[1]


def test_a_package_with_a_broken_module_is_shown_all_the_same(site: Path, project: Path) -> None:
    (project / "my_robot" / "messages.py").write_text(f"{user_package.MESSAGES}\nraise RuntimeError('no')")
    user_package.install(site, project)
    for words in (("pkg", "show", "my_robot"), ("pkg", "executables", "my_robot")):
        code, text = said(*words)
        assert code == 1
        assert "gripper" in text
        assert f"left out: module my_robot.messages cannot be imported: {site}/my_robot/messages.py:" in text
    assert said("pkg", "executables")[0] == 0, "another package's fault is none of all others"
    assert completion.manifests("my_robot:") == ["my_robot:robot.yaml"]


def test_a_shell_completes_packages_manifests_and_nodes(
    site: Path, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    user_package.install(site, project)
    assert "my_robot" in completion.packages("")
    assert completion.manifests("my_") == ["my_robot:robot.yaml"]
    assert "robot.yaml" in completion.manifests("ro")
    monkeypatch.setenv("COMP_WORDS", "robo up my_robot : ro")
    monkeypatch.setenv("COMP_CWORD", "4")
    assert completion.manifests("ro") == ["robot.yaml"], "bash has taken the word apart at its colon"
    monkeypatch.setenv("COMP_CWORD", "3")
    assert completion.manifests(":") == ["robot.yaml"]


def completed(*words: str) -> list[str]:
    """What bash gets for a command line whose last word is being typed."""
    told = {"_ROBO_COMPLETE": "complete_bash", "COMP_WORDS": " ".join(words), "COMP_CWORD": str(len(words) - 1)}
    result = subprocess.run(
        [sys.executable, "-c", "from robo.cli import main; main()"],
        env={**os.environ, **told},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stderr == ""
    return result.stdout.split()


def test_a_shell_completes_what_runs(site: Path, project: Path) -> None:
    (project / "my_robot" / "broken.py").write_text("class A(int): pass\nraise RuntimeError('no hardware')")
    user_package.install(site, project)
    assert completed("robo", "run", "my_") == ["my_robot"]
    assert completed("robo", "run", "my_robot", "g") == ["gripper"]
    assert completed("robo", "check", "my_robot", ":", "r") == ["robot.yaml"]
    assert completed("robo", "up", "my_robot", ":") == ["robot.yaml"]
    assert completed("robo", "pkg", "show", "my_") == ["my_robot"]


def test_robo_announces_the_nodes_that_ship() -> None:
    (shipped,) = announced.of_folder(ROOT)
    assert (shipped.name, shipped.value) == ("robo_services", "robo_services")
    assert [one.node for one in look_into([packages.find("robo_services")]).executables] == [
        "bag_player",
        "calibrate_base",
        "camera",
        "carmen_player",
        "dashboard",
        "diagnostic_aggregator",
        "diff_drive_controller",
        "diff_drive_sim",
        "ekf_filter",
        "emulated_board",
        "emulated_lidar",
        "flight_recorder",
        "joy",
        "ld_lidar",
        "mujoco_sim",
        "nmea_gps",
        "position_tracker",
        "recorder",
        "robot_state_publisher",
        "ros2_bridge",
        "safety_monitor",
        "serial_base",
        "static_transform_publisher",
        "teleop_joy",
        "teleop_keyboard",
        "twist_mux",
        "velocity_controller",
        "velocity_smoother",
        "waypoint_follower",
    ]
