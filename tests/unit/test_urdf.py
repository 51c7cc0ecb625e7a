"""What a URDF says of frames, against matrices computed here; and its mistakes, each with its place."""

import math
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.tf import IDENTITY, Transform3
from robo_services import urdf_files
from robo_services.urdf_model import Model, UrdfError, is_position, parse
from robo_services.urdf_xml import MOST

Matrix = list[list[float]]
Vector = tuple[float, float, float]


def robot(*lines: str) -> str:
    """A URDF whose line n is `lines[n - 2]`."""
    return "\n".join(['<robot name="r">', *lines, "</robot>"])


def joint(name: str, parent: str, child: str, rest: str = "", kind: str = "fixed") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{rest}</joint>'


def links(*names: str) -> str:
    return "".join(f'<link name="{name}"/>' for name in names)


# What the format says, with matrices: it shares no code with the module.


def product(a: Matrix, b: Matrix) -> Matrix:
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def moved(x: float, y: float, z: float) -> Matrix:
    return [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]]


def turned(axis: Vector, angle: float) -> Matrix:
    """Rodrigues' formula, component by component."""
    n = math.sqrt(sum(a * a for a in axis))
    x, y, z = (a / n for a in axis)
    c, s = math.cos(angle), math.sin(angle)
    d = 1 - c
    return [
        [c + x * x * d, x * y * d - z * s, x * z * d + y * s, 0],
        [y * x * d + z * s, c + y * y * d, y * z * d - x * s, 0],
        [z * x * d - y * s, z * y * d + x * s, c + z * z * d, 0],
        [0, 0, 0, 1],
    ]


def origin_matrix(xyz: Vector, rpy: Vector) -> Matrix:
    roll, pitch, yaw = rpy
    turn = product(product(turned((0, 0, 1), yaw), turned((0, 1, 0), pitch)), turned((1, 0, 0), roll))
    return product(moved(*xyz), turn)


def joint_matrix(kind: str, axis: Vector, position: float) -> Matrix:
    if kind == "prismatic":
        n = math.sqrt(sum(a * a for a in axis))
        return moved(*(position * a / n for a in axis))
    return turned(axis, position) if kind in ("revolute", "continuous") else moved(0, 0, 0)


def near(transform: Transform3, matrix: Matrix) -> None:
    for row, wanted in zip(transform.matrix(), matrix, strict=True):
        assert row == pytest.approx(wanted, abs=1e-11)


lengths = st.floats(-3, 3)
vectors = st.tuples(lengths, lengths, lengths)
axes = vectors.filter(lambda v: math.hypot(*v) > 1e-3)
kinds = st.sampled_from(["fixed", "revolute", "continuous", "prismatic"])
steps = st.lists(st.tuples(kinds, vectors, vectors, axes, st.floats(-10, 10)), min_size=1, max_size=6)


def words(vector: Vector) -> str:
    return " ".join(map(repr, vector))


def where(model: Model, link: str, positions: dict[str, float]) -> Transform3:
    """Where a link stands in the root."""
    placed = model.transforms(positions)
    held = {j.child: (j.parent, j.at(0.0)) for j in model.fixed}
    held |= {model.moving[name].child: (model.moving[name].parent, found) for name, found in placed.items()}
    found = IDENTITY
    while link != model.root:
        link, step = held[link]
        found = step @ found
    return found


@given(steps)
def test_a_chain_of_joints_ends_where_matrices_say(chain: list[tuple[str, Vector, Vector, Vector, float]]) -> None:
    text, wanted, told = links("l0"), moved(0, 0, 0), {}
    for i, (kind, xyz, rpy, axis, position) in enumerate(chain):
        rest = f'<origin xyz="{words(xyz)}" rpy="{words(rpy)}"/><axis xyz="{words(axis)}"/>'
        text += links(f"l{i + 1}") + joint(f"j{i}", f"l{i}", f"l{i + 1}", rest, kind)
        wanted = product(wanted, product(origin_matrix(xyz, rpy), joint_matrix(kind, axis, position)))
        told[f"j{i}"] = position
    near(where(parse(robot(text)), f"l{len(chain)}", told), wanted)


@given(st.permutations(range(4)), st.lists(st.tuples(lengths, lengths), min_size=3, max_size=3), lengths)
def test_mimics_follow_in_whatever_order_they_stand(
    order: list[int], laws: list[tuple[float, float]], q: float
) -> None:
    """j3 follows j2, that follows j1, that follows j0."""
    joints = [joint("j0", "base", "l0", '<axis xyz="0 0 1"/>', "continuous")]
    wanted = [q]
    for i, (multiplier, offset) in enumerate(laws):
        mimic = f'<mimic joint="j{i}" multiplier="{multiplier!r}" offset="{offset!r}"/>'
        joints.append(joint(f"j{i + 1}", "base", f"l{i + 1}", f'<axis xyz="0 0 1"/>{mimic}', "continuous"))
        wanted.append(multiplier * wanted[-1] + offset)
    model = parse(robot(links("base", "l0", "l1", "l2", "l3"), *(joints[i] for i in order)))
    assert model.positions({"j0": q}) == {f"j{i}": value for i, value in enumerate(wanted)}
    assert model.positions({"j0": q, "j2": 7.0}) == {
        "j0": q, "j1": wanted[1], "j2": 7.0, "j3": laws[2][0] * 7.0 + laws[2][1],
    }, "its own position goes before"  # fmt: skip
    assert model.positions({}) == {}


@given(st.dictionaries(st.sampled_from(["turn", "slide", "follow", "other"]), st.floats()))
def test_whatever_positions_come_transforms_are_finite(told: dict[str, float]) -> None:
    far = f'<origin xyz="{MOST} {MOST} {MOST}" rpy="1 1 1"/><axis xyz="1 1 1"/>'
    model = parse(
        robot(
            links("base", "a", "b", "c"),
            joint("turn", "base", "a", far, "continuous"),
            joint("slide", "a", "b", far, "prismatic"),
            joint("follow", "b", "c", f'{far}<mimic joint="slide" multiplier="-{MOST}" offset="{MOST}"/>', "prismatic"),
        )
    )
    assert all(map(is_position, model.positions(told).values())), "also of what follows"
    placed = model.transforms(told)
    for name, value in told.items():
        assert (name in placed) == (name != "other" and is_position(value)) or name == "follow"
    for found in placed.values():
        assert all(map(math.isfinite, found))
        assert math.hypot(*found[3:]) == pytest.approx(1.0)


def test_what_is_left_out_has_the_values_of_the_format() -> None:
    model = parse(
        robot(
            links("base", "wheel", "mast"),
            joint("spin", "base", "wheel", "", "continuous"),
            joint("hold", "base", "mast", '<origin xyz="1 2 3"/>'),
        )
    )
    assert model.root == "base"
    assert model.moving["spin"].axis == (1.0, 0.0, 0.0)
    assert [j.origin for j in model.fixed] == [Transform3(1.0, 2.0, 3.0)]
    assert model.warnings == (
        "robot_description:3:1: joint 'spin' has no axis; URDF takes that of x, 1 0 0",
    )  # fmt: skip


def test_an_origin_may_be_turned_by_a_quaternion() -> None:
    quarter = '<origin quat_xyzw="0 0 0.70710678 0.70710678"/>'
    (hold,) = parse(robot(links("a", "b"), joint("hold", "a", "b", quarter))).fixed
    assert hold.origin == pytest.approx(Transform3.planar(0.0, 0.0, math.pi / 2), abs=1e-12)


def test_what_does_not_concern_frames_is_passed_over() -> None:
    model = parse(
        '<?xml version="1.0" encoding="latin-1"?><!-- grün -->\n'
        + robot(
            '<material name="grey"><color rgba="1 1 1 1"/></material>',
            '<link name="base"><visual><geometry><capsule radius="x"/></geometry></visual></link>',
            links("arm"),
            joint("lift", "base", "arm", '<axis xyz="0 0 1"/><limit lower="x"/><property name="a"/>', "prismatic"),
            '<transmission name="t"><joint name="nowhere"/></transmission>',
            '<gazebo reference="base"><joint name="b"/></gazebo><ros2_control/>',
        )
    )
    assert (model.links, list(model.moving), model.warnings) == (("base", "arm"), ["lift"], ())


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_joint_with_more_than_one_position_is_passed_over_and_told(kind: str) -> None:
    model = parse(
        robot(links("world", "base", "laser"), joint("drive", "world", "base", "", kind), joint("h", "base", "laser"))
    )
    assert (list(model.moving), [j.name for j in model.fixed]) == ([], ["h"])
    assert model.warnings == (
        f"robot_description:3:1: joint 'drive' is {kind} and passed over: where base stands, others say",
    )  # fmt: skip


def test_what_looks_misspelt_is_told() -> None:
    model = parse(
        robot(
            links("a", "b"),
            joint(
                "j",
                "a",
                "b",
                '\n<orgin xyz="1 0 0"/>\n<axis xyz="0 0 1"/><axis xyz="0 1 0"/>\n<origin rpyy="1 0 0"/>',
                "continuous",
            ),
        )
    )
    assert model.moving["j"].axis == (0.0, 0.0, 1.0)
    assert model.warnings == (
        "robot_description:4:1: joint 'j' has <orgin>, which is passed over; did you mean <origin>?",
        "robot_description:5:20: joint 'j' has a second <axis>; the first one counts",
        "robot_description:6:1: joint 'j' has an unknown attribute in <origin>; did you mean rpy?",
    )


def mistakes(text: str) -> list[str]:
    with pytest.raises(UrdfError) as error:
        parse(text, "r.urdf")
    return str(error.value).split("\n")


BASE_ARM = links("base", "arm")
TURN = '<axis xyz="0 0 1"/>'


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([], ["r.urdf: the robot has no link"]),
        (["<link/>"], ["r.urdf:2:1: a link has no name"]),
        ([BASE_ARM], ["r.urdf:2:20: 2 links are held by no joint: 'base', 'arm'; all but one have to be"]),
        (
            [BASE_ARM, joint("a", "base", "arm"), joint("b", "arm", "base")],
            ["r.urdf:3:1: a loop: 'arm' stands in 'base' stands in 'arm'"],
        ),
        ([links("base"), joint("a", "base", "base")], ["r.urdf:3:1: a loop: 'base' stands in 'base'"]),
        (
            [BASE_ARM, joint("a", "bsae", "arm")],
            ["r.urdf:3:1: joint 'a': its parent 'bsae' is no link; did you mean base?"],
        ),
        (
            [BASE_ARM, joint("a", "base", "amr")],
            ["r.urdf:3:1: joint 'a': its child 'amr' is no link; did you mean arm?"],
        ),
        (
            [BASE_ARM, links("arm"), joint("a", "base", "arm")],
            ["r.urdf:3:1: link 'arm' is there already, in line 2"],
        ),
        (
            [BASE_ARM, links("leg"), joint("a", "base", "arm"), joint("a", "base", "leg")],
            ["r.urdf:5:1: joint 'a' is there already, in line 4"],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm"), joint("b", "base", "arm")],
            ["r.urdf:4:1: link 'arm' has two parents: joint 'b' here, and 'a' in line 3"],
        ),
        ([BASE_ARM, joint("", "base", "arm")], ['r.urdf:3:1: a joint has no name: <joint name="…" type="…">']),
        (
            [BASE_ARM, joint("a", "base", "arm", TURN, "revolut")],
            ["r.urdf:3:1: joint 'a' has the type 'revolut'; did you mean revolute?"],
        ),
        (
            [BASE_ARM, '<joint name="a"><parent link="base"/><child link="arm"/></joint>'],
            ["r.urdf:3:1: joint 'a' has no type; there are fixed, revolute, continuous, prismatic, floating, planar"],
        ),
        (
            [BASE_ARM, '<joint name="a" type="fixed"><parent/></joint>'],
            [
                "r.urdf:3:1: joint 'a' has no child: <child link=\"…\"/>",
                "r.urdf:3:30: joint 'a' names no parent: <parent link=\"…\"/>",
            ],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", '\n<axis xyz="0 0 0"/>', "continuous")],
            ["r.urdf:4:1: joint 'a' has an axis of length 0, which has no direction"],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", "\n<axis/>", "continuous")],
            ["r.urdf:4:1: joint 'a' has an axis without a direction: <axis xyz=\"0 0 1\"/>"],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", '\n<origin xyz="1 2" rpy="0 0 x"/>')],
            [
                "r.urdf:4:1: joint 'a' has '1 2' as xyz of <origin>, which takes 3 numbers",
                "r.urdf:4:1: joint 'a' has '0 0 x' as rpy of <origin>, which takes 3 numbers",
            ],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", '\n<origin xyz="nan 0 0" rpy="1e10 0 0"/>')],
            [
                "r.urdf:4:1: joint 'a' has 'nan 0 0' as xyz of <origin>, which takes 3 numbers",
                "r.urdf:4:1: joint 'a' has '1e10 0 0' as rpy of <origin>: beyond 1e+09 is a mistake",
            ],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", '\n<origin rpy="0 0 0" quat_xyzw="0 0 0 0"/>')],
            [
                "r.urdf:4:1: joint 'a' turns its origin by rpy and by quat_xyzw; one of them is enough",
                "r.urdf:4:1: joint 'a' has an origin that is none: (0.0, 0.0, 0.0, 0.0) is no rotation",
            ],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", f'{TURN}<mimic joint="b"/>', "continuous")],
            ["r.urdf:3:1: joint 'a' mimics 'b', which is no joint; there is none"],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", f'{TURN}\n<mimic multiplier="1_0"/>', "continuous")],
            [
                "r.urdf:4:1: joint 'a' has '1_0' as multiplier of <mimic>, which takes a number",
                "r.urdf:4:1: joint 'a' mimics no joint: <mimic joint=\"…\"/>",
            ],
        ),
        (
            [
                BASE_ARM,
                links("leg"),
                joint("a", "base", "arm", f'{TURN}<mimic joint="b"/>', "continuous"),
                joint("b", "base", "leg"),
            ],
            ["r.urdf:4:1: joint 'a' mimics 'b', which is fixed and has no position"],
        ),
        (
            [BASE_ARM, joint("a", "base", "arm", f'{TURN}<mimic joint="a"/>', "continuous")],
            ["r.urdf:3:1: a loop: 'a' mimics 'a'"],
        ),
        (['<xacro:macro name="wheel"/>', BASE_ARM], ["r.urdf:2:1: it holds xacro: give its file a name that ends"]),
    ],
)  # fmt: skip
def test_each_mistake_is_told_with_its_place(lines: list[str], expected: list[str]) -> None:
    told = mistakes(robot(*lines))
    assert [one[: len(wanted)] for one, wanted in zip(told, expected, strict=True)] == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "r.urdf:1:1: this is no XML: no element found"),
        ("wheels: 2", "r.urdf:1:1: this is no XML: syntax error"),
        ('<robot name="r">\n<link', "r.urdf:2:1: this is no XML: unclosed token"),
        ("<sdf/>", "r.urdf:1:1: a URDF begins with <robot>, not with <sdf>"),
        ('<!DOCTYPE r [<!ENTITY a "b">]>\n<robot name="r"/>', "r.urdf:1:25: it declares an entity, 'a', and may not"),
        ("<robot><link name='\0'/></robot>", "r.urdf:1:20: this is no XML: not well-formed (invalid token)"),
        ("<robot><link name='\ud800'/></robot>", "r.urdf:1:1: the robot has no name"),
    ],
)
def test_what_is_no_urdf_is_told(text: str, expected: str) -> None:
    (told,) = mistakes(text)
    assert told.startswith(expected)


def test_all_mistakes_are_told_at_once_in_their_order() -> None:
    told = mistakes(
        '<robot>\n<link/>\n<link name="a"/><link name="b"/>\n'
        + joint("x", "a", "c")
        + "\n"
        + joint("y", "a", "b", '<axis xyz="0 0 0"/><mimic joint="q"/>', "continuous")
        + "\n</robot>"
    )
    assert [line.split(":")[1] for line in told] == ["1", "2", "4", "5"]


@given(st.text(max_size=60) | st.from_regex(r'<robot name="r">(<(link|joint) (name|type)="[ab]"/?>){0,6}</robot>'))
def test_any_text_is_a_model_or_an_error(text: str) -> None:
    try:
        model = parse(text)
    except UrdfError:
        pass
    else:
        assert model.root in model.links


def test_a_large_robot_is_read_soon() -> None:
    """Each link holds the next one, and its joint mimics the one before."""
    count = 5_000
    text = [links("l0")]
    for i in range(count):
        mimic = f'<mimic joint="j{i - 1}"/>' if i else ""
        text.append(links(f"l{i + 1}") + joint(f"j{i}", f"l{i}", f"l{i + 1}", TURN + mimic, "continuous"))
    model = parse(robot(*text))
    assert len(model.positions({"j0": 1.0})) == count


# Files.


def test_a_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(UrdfError, match=r"URDF nope.urdf cannot be read: No such file"):
        urdf_files.load("nope.urdf")
    (tmp_path / "r.urdf").write_bytes(b"<robot>\n\xff")
    with pytest.raises(UrdfError, match=r"it is not text in UTF-8: byte 0xff in line 2"):
        urdf_files.load(str(tmp_path / "r.urdf"))
    (tmp_path / "r.urdf").write_text(robot(links("a")))
    with pytest.raises(UrdfError, match=r"takes no arguments: its name does not end with .xacro"):
        urdf_files.load(str(tmp_path / "r.urdf"), ["a:=1"])


def test_a_file_may_begin_with_a_mark_of_its_encoding(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text("\ufeff" + robot(links("a")), encoding="utf-8")
    text, source = urdf_files.load(str(tmp_path / "r.urdf"))
    assert parse(text, source).root == "a"


XACRO_FILE = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="width" default="0.3"/>
  <xacro:property name="half" value="${0.5 * $(arg width)}"/>
  <link name="base_link"/>
  <xacro:macro name="wheel" params="side y">
    <link name="${side}_wheel"/>
    <joint name="${side}_joint" type="continuous">
      <parent link="base_link"/><child link="${side}_wheel"/><origin xyz="0 ${y} 0"/><axis xyz="0 1 0"/>
    </joint>
  </xacro:macro>
  <xacro:wheel side="left" y="${half}"/>
  <xacro:wheel side="right" y="${-half}"/>
</robot>
"""


def test_xacro_makes_a_urdf_of_what_is_written_for_it(tmp_path: Path) -> None:
    pytest.importorskip("xacro", reason="needs the extra urdf")
    file = tmp_path / "r.urdf.xacro"
    file.write_text(XACRO_FILE)
    for arguments, y in ([], 0.15), (["width:=0.5"], 0.25):
        model = parse(*urdf_files.load(str(file), arguments))
        assert model.moving["left_joint"].origin.y == y
        assert model.moving["right_joint"].origin.y == -y
    file.write_text(XACRO_FILE.replace("${-half}", "${haf}"))
    with pytest.raises(UrdfError, match=r"r.urdf.xacro: xacro: name 'haf' is not defined"):
        urdf_files.load(str(file))
    file.write_text("<robot")
    with pytest.raises(UrdfError, match=r"r.urdf.xacro: xacro: unclosed token"):
        urdf_files.load(str(file))
    with pytest.raises(UrdfError, match=r"an argument of xacro is name:=value, and not 'width=1'"):
        urdf_files.load(str(file), ["width=1"])


def test_without_xacro_its_files_name_the_extra_and_a_plain_urdf_works(tmp_path: Path) -> None:
    (tmp_path / "r.urdf.xacro").write_text(XACRO_FILE)
    (tmp_path / "r.urdf").write_text(robot(links("a")))
    script = """
import sys
sys.modules["xacro"] = None
from robo_services.urdf_files import load
from robo_services.urdf_model import UrdfError, parse
print(parse(*load("r.urdf")).root)
try:
    load("r.urdf.xacro")
except UrdfError as error:
    print(error)
"""
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60, cwd=tmp_path
    )
    assert run.stdout.splitlines() == [
        "a",
        "r.urdf.xacro needs xacro, which is not installed: pip install 'robo-zenoh[urdf]'; a plain URDF needs none",
    ]
