"""What `robo create` refuses, and the texts that it makes; that tools accept them is in test_create_tools."""

import ast
import datetime
import keyword
import re
import tomllib
from pathlib import Path

import pytest
import yaml

import robo
from robo.cli.views.create import run_create
from robo.create import licenses, names
from robo.create.asked import Asked, NodePlan, about_faults, contents
from robo.create.files import conflicts, write
from robo.create.licenses import LICENSES, license_text
from robo.create.project import find_project
from robo.create.render import PackagePlan, node_files, package_files
from robo.create.template import FOLDER, Filling, filled, sample_files
from robo.errors import CreateError, UsageError
from tests.pages import ROOT


def made(asked: Asked, name: str = "my_robot", license_: str | None = None) -> dict[str, str]:
    """The files of a package."""
    found = contents(asked, name)
    return package_files(PackagePlan(name, 'A "fine" robot', license_, found.nodes, found.messages))


GRIPPER = Asked(
    nodes=("gripper",),
    publishes=("grip:std/String", "~/state:my_robot/Grip"),
    subscribes=("scan:sensor/LaserScan", "/clock:system/Clock"),
    services=("close:std/Trigger", "open:std/Empty"),
    messages=("Grip",),
)


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("my_robot", None),
        ("r2d2", None),
        ("arm_2", None),
        ("class", "try class_robot"),
        ("match", None),  # a word of Python's in some places only
        ("json", "Python has a module of this name"),
        ("test", "of this name"),
        ("tests", "a folder of every package"),
        ("robo", "is installed"),
        ("robo_messages", "is installed"),
        ("zenoh", "is installed"),
        ("geometry", "are message types that ship"),
        ("MyRobot", "did you mean my_robot?"),
        ("my-robot", "did you mean my_robot?"),
        ("2wheels", "a letter first"),
        ("_hidden", "did you mean hidden?"),
        ("my__robot", "did you mean my_robot?"),
        ("röbi", "did you mean robi?"),
        ("", "use lower case letters"),
        ("a" * 41, "more than 40 letters"),
        ("../up", "use lower case letters"),
    ],
)
def test_the_name_of_a_package(name: str, advice: str | None) -> None:
    fault = names.package_fault(name)
    assert (fault is None) == (advice is None)
    assert advice is None or advice in (fault or "")


@pytest.mark.parametrize(
    "name",
    [
        "node",
        "messages",
        "manifest",
        "share",
        "lambda",
        "Gripper",
        "gripper_logic",
        "test_it",
        "publisher",
        "a-b",
        "clock",
        "o",
    ],
)
def test_names_that_no_node_can_have(name: str) -> None:
    assert names.node_fault(name)


@pytest.mark.parametrize("name", ["grip", "Message", "None", "my_robot/Grip", "Grip_State", "3D", "I", "G" * 41])
def test_names_that_no_message_can_have(name: str) -> None:
    assert names.message_fault(name)


def test_what_is_advised_is_a_name_that_works() -> None:
    for wrong in ("MyRobot", "my-robot", "json", "class", "geometry", "_x_"):
        advised = re.findall(r"(?:try|did you mean) (\w+)", names.package_fault(wrong) or "")
        assert advised, wrong
        assert names.package_fault(advised[0]) is None


def test_a_module_of_the_standard_library_is_no_robot() -> None:
    assert all(names.package_fault(name) for name in ("os", "logging", "this", "__future__"))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (Asked(publishes=("grip:std/String",)), "name the node that it belongs to"),
        (Asked(nodes=("a", "b"), publishes=("grip:std/String",)), "for example a:grip:std/String"),
        (Asked(nodes=("a",), publishes=("b:grip:std/String",)), "there is no --node 'b'"),
        (Asked(nodes=("a",), publishes=("grip",)), "write NAME:group/Type"),
        (Asked(nodes=("a",), publishes=("a b:std/String",)), "use letters, digits and _"),
        (Asked(nodes=("a",), publishes=("~:std/String",)), "name it"),
        (Asked(nodes=("a",), publishes=("grip:std/Strin",)), "did you mean std/String?"),
        (Asked(nodes=("a",), publishes=("grip:std/Trigger",)), "is the type of a service"),
        (Asked(nodes=("a",), publishes=("grip:my_robot/Grip",)), "--message Grip makes one"),
        (Asked(nodes=("a",), publishes=("grip:Grip",), messages=("Grip",)), "did you mean my_robot/Grip?"),
        (Asked(nodes=("a",), services=("close:std/String",)), "services have types such as std/Trigger"),
        (Asked(nodes=("a",), services=("close:std/Trigge",)), "did you mean std/Trigger?"),
        (Asked(nodes=("a",), publishes=("x:std/String", "x:std/String")), "--publishes x stands twice"),
        (
            Asked(nodes=("a",), publishes=("x/y_z:std/String", "x_y/z:std/Bool", "q/z:std/Bool", "q/y_z:std/Bool")),
            "both",
        ),
        (Asked(nodes=("a",), publishes=("on_x:std/Bool",), subscribes=("x:std/Bool",)), "would both be on_x"),
        (
            Asked(nodes=("a",), publishes=("timer:std/Bool", "timer_publisher:std/Bool")),
            "would both be timer_publisher",
        ),
        (Asked(nodes=("a",), publishes=("x:std/String",), subscribes=("x:std/Bool",)), "two types"),
        (Asked(nodes=("a",), publishes=("x:std/String",), services=("x:std/Empty",)), "called like a topic"),
        (Asked(nodes=("a", "a")), "--node a stands twice"),
        (Asked(messages=("Grip", "GRIP")), "differ only in capitals"),
    ],
)
def test_words_that_make_no_sense(asked: Asked, said: str) -> None:
    with pytest.raises(UsageError, match=re.escape(said)):
        contents(asked, "my_robot")


def test_all_mistakes_come_at_once() -> None:
    with pytest.raises(UsageError) as error:
        contents(Asked(nodes=("node",), messages=("grip",), publishes=("x",), services=("y:std/Nothing",)), "my_robot")
    assert len(str(error.value).splitlines()) == 4


def test_licenses_and_descriptions() -> None:
    assert about_faults(Asked(license="LicenseRef-Ours", description="A robot, ünd more")) == []
    assert "did you mean MIT?" in about_faults(Asked(license="mit"))[0]
    assert "did you mean MIT?" in about_faults(Asked(license="mitt"))[0]
    assert LICENSES[0] in about_faults(Asked(license="mine"))[0]
    assert len(about_faults(Asked(description="two\nlines"))) == 1


@pytest.mark.parametrize(
    ("license_", "said"),
    [
        ("MIT", "arm/LICENSE names the authors of arm as holders of the copyright; write your name there\n"),
        ("Apache-2.0", ""),
        ("MPL-2.0", "The text of MPL-2.0 is yours to add, as arm/LICENSE\n"),
    ],
)
def test_what_is_left_of_a_license_is_told(
    license_: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run_create("arm", Asked(license=license_), dry_run=False)
    printed = capsys.readouterr()
    assert printed.err.partition("Next:")[0] == said
    assert ("arm/LICENSE" in printed.out.splitlines()) == Path("arm/LICENSE").is_file() == (license_ != "MPL-2.0")


def test_a_license_comes_with_its_text_where_it_is_here() -> None:
    year = datetime.date.today().year
    mit, bsd, apache = (license_text(name, "arm") or "" for name in ("MIT", "BSD-3-Clause", "Apache-2.0"))
    assert f"Copyright (c) {year} the authors of arm\n" in mit
    assert f"Copyright (c) {year}, the authors of arm\n" in bsd
    assert apache == (ROOT / "LICENSE").read_text(), "it is left as it is"
    assert not re.search(r"<\w", mit + bsd)
    assert license_text("GPL-3.0-only", "arm") is None
    assert license_text("LicenseRef-../../x", "arm") is None
    assert {file.stem for file in licenses.FOLDER.iterdir()} <= set(LICENSES)


def test_each_file_of_the_sample_is_in_a_package_and_nothing_of_the_sample_is_left() -> None:
    files = made(GRIPPER, license_="MIT")
    assert len(files) == len(sample_files())
    assert {".gitignore", ".dockerignore", ".github/workflows/test.yml", "my_robot/py.typed"} <= files.keys()
    for path, text in files.items():
        assert not re.search(r"sample|# (each|if|end)\b", text, re.IGNORECASE), path
        assert "sample" not in path
        assert text.endswith("\n") or not text
        assert not text.endswith("\n\n")
        if path.endswith(".py"):
            ast.parse(text)


def test_a_package_says_what_it_is() -> None:
    said = tomllib.loads(made(GRIPPER, license_="MIT")["pyproject.toml"])
    assert said["project"]["name"] == "my_robot"
    assert said["project"]["description"] == 'A "fine" robot'
    assert said["project"]["license"] == "MIT"
    assert said["project"]["entry-points"]["robo.packages"] == {"my_robot": "my_robot"}
    assert "license" not in tomllib.loads(made(GRIPPER)["pyproject.toml"])["project"]


def test_the_manifest_names_the_nodes_and_what_comes_from_outside() -> None:
    files = made(GRIPPER)
    group = yaml.safe_load(files["launch/robot.yaml"].replace("${", "$").replace("}]", "]"))["groups"]["my_robot"]
    assert group["nodes"] == {"gripper": {"service": "my_robot.gripper"}}
    assert group["topics"]["scan"] == {"type": "sensor/LaserScan", "external": True}
    parameters = yaml.safe_load(files["config/robot.yaml"])
    assert parameters == {"gripper": {"ros__parameters": {"rate": 1.0, "log_period": 1.0}}}
    talker = made(Asked(nodes=("talker",)))
    assert "topics:" not in talker["launch/robot.yaml"]
    assert yaml.safe_load(talker["config/robot.yaml"]) == {"talker": {"ros__parameters": {"rate": 1.0}}}


def test_names_in_code_are_nobody_elses() -> None:
    asked = Asked(
        nodes=("eye",),
        publishes=(
            "status:std/String",
            "timer:std/Bool",
            "/_5:std/Bool",
            "class:std/String",
            "jointStates:system/Clock",
        ),
        subscribes=("start:std/String", "a/state:std/Bool", "b/state:std/Bool"),
    )
    files = made(asked)
    code = files["my_robot/eye.py"]
    for line in (
        'status_publisher = Publisher(String, "status")',
        'timer_publisher = Publisher(Bool, "timer")',
        'publisher_5 = Publisher(Bool, "/_5")',
        'class_publisher = Publisher(String, "class")',
        'joint_states = Publisher(ClockMessage, "jointStates")',
        "def on_start_message(self, message: String)",
        "def on_a_state(self, message: Bool)",
    ):
        assert line in code
    assert "from robo_messages import Clock as ClockMessage" in code


def test_nothing_that_a_node_has_is_hidden_by_a_publisher() -> None:
    node = robo.Node(name="talker")
    for name in (*vars(node), *dir(node)):
        assert name.startswith("_") or names.attribute(name) != name, name


def test_labels_are_names_of_python() -> None:
    for topic in ("scan", "/r1/Scan", "~/state", "a/B2c", "HTTPServer", "_x", "__"):
        (label,) = names.labels([topic]).values()
        assert f"on_{label}".isidentifier()
        assert not keyword.iskeyword(f"on_{label}")


def test_marks_nest_and_what_was_put_in_is_not_looked_at_again() -> None:
    text = "# each x\n# if warm\nsample a\n# end\n# end\nsample b\n"
    inner = [
        Filling(words={"a": "b"}, true=frozenset({"warm"})),
        Filling(words={"a": "c"}),
        Filling(words={"a": "sample"}, true=frozenset({"warm"})),
    ]
    assert filled(text, Filling(words={"sample": "a"}, each={"x": inner})) == "a b\na sample\na b\n"


def test_nothing_is_overwritten_and_all_that_is_in_the_way_is_named(tmp_path: Path) -> None:
    files = made(GRIPPER)
    (tmp_path / "launch").mkdir()
    (tmp_path / "launch" / "robot.yaml").write_text("mine")
    (tmp_path / "tests").write_text("no folder")
    (tmp_path / "README.md").symlink_to("nowhere")
    assert len(conflicts(tmp_path, files)) == 3
    with pytest.raises(CreateError, match="nothing is overwritten"):
        write(tmp_path, files)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["README.md", "launch", "tests"]


def test_what_cannot_be_written_whole_is_not_written(tmp_path: Path) -> None:
    changed = tmp_path / "old.txt"
    changed.write_text("as it was")
    with pytest.raises(CreateError, match="changed meanwhile"):
        write(tmp_path, {"a/b/new.txt": "new"}, {changed: ("as it was not", "other")})
    with pytest.raises(CreateError, match="cannot be written"):
        write(tmp_path, {"a/b/new.txt": "new", "a/" + 300 * "x": "too long a name"}, {})
    assert list(tmp_path.iterdir()) == [changed]
    write(tmp_path, {"a/b/new.txt": "new"}, {changed: ("as it was", "other")})
    assert changed.read_text() == "other"


def test_where_a_package_is_found(tmp_path: Path) -> None:
    assert find_project(tmp_path) is None
    root = tmp_path / "my_robot"
    write(root, made(GRIPPER))
    for here in (root, root / "launch", root / "my_robot"):
        project = find_project(here)
        assert project is not None
        assert (project.name, project.folder, project.package) == ("my_robot", root, root / "my_robot")
    (root / "my_robot" / "__init__.py").unlink()
    assert find_project(root) is None
    (root / "pyproject.toml").write_text("[project")
    with pytest.raises(CreateError, match="cannot be read"):
        find_project(root)


def test_the_sample_is_read_and_not_found_as_a_package() -> None:
    assert (FOLDER / "sample_robot" / "sample_node.py").is_file()
    assert not (FOLDER / "__init__.py").exists()


def test_a_node_without_anything_publishes() -> None:
    (node,) = contents(Asked(nodes=("idle",)), "my_robot").nodes
    assert [end.topic for end in node.publishes] == ["idle"]
    assert isinstance(node, NodePlan)
    assert len(node_files("my_robot", node)) == 3
