"""ROS's definitions as message types: what is read, what is written, and what is said of mistakes."""

import errno
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robo_messages
from robo.errors import InterfaceError
from robo.interfaces import catalogue, cdr
from robo.interfaces.ros_import.definition import TypeName
from robo.interfaces.ros_import.docs import cleaned, docstring
from robo.interfaces.ros_import.files import find_sources
from robo.interfaces.ros_import.imports import Imports
from robo.interfaces.ros_import.literals import read_literal
from robo.interfaces.ros_import.made import make
from robo.interfaces.ros_import.parse import MOST_ELEMENTS, parse
from robo.interfaces.ros_names import full_name, robo_name, ros_name
from robo.interfaces.ros_text import ros_text, whole_text
from robo.interfaces.type_hash import type_hash
from tests.imported import imported, made_of, types_of, write
from tests.random_messages import SHIPPED
from tests.random_types import definitions

GRIP = """\
# How a gripper stands.

uint8 OPEN=0
uint8 CLOSED = 1  # holds something
string UNIT="m"

std_msgs/Header header
uint8 state 1            # OPEN or CLOSED
float32 width            # Between the fingers, m.
                         # Measured at the tips.
# One for each finger, N.
float64[2] force [0.5, 1.5]
Finger[<=4] fingers
string<=8 name "left"
"""
FINGER = "geometry_msgs/Point tip  # m\n"
MODULE = '''\
"""Message types of arm_msgs; made by `robo interface import`."""

from typing import Annotated, ClassVar

from msgspec import Meta, field
from robo_messages import Header, Message, Point, message
from robo_messages.fields import Float32, UInt8


@message("arm_msgs/Finger")
class Finger(Message):
    """ROS's message arm_msgs/Finger."""

    tip: Point = field(default_factory=Point)
    """m"""


_Floatx2 = Annotated[tuple[float, ...], Meta(min_length=2, max_length=2)]
_FingerUpTo4 = Annotated[list[Finger], Meta(max_length=4)]
_Str8 = Annotated[str, Meta(max_length=8)]


@message("arm_msgs/Grip")
class Grip(Message):
    """How a gripper stands."""

    OPEN: ClassVar[UInt8] = 0
    CLOSED: ClassVar[UInt8] = 1
    """holds something"""
    UNIT: ClassVar[str] = "m"

    header: Header = field(default_factory=Header)
    state: UInt8 = 1
    """OPEN or CLOSED"""
    width: Float32 = 0.0
    """Between the fingers, m.
    Measured at the tips.
    """
    force: _Floatx2 = (0.5, 1.5)
    """One for each finger, N."""
    fingers: _FingerUpTo4 = field(default_factory=list)
    name: _Str8 = "left"
'''
ARM = {"arm_msgs/msg/Grip.msg": GRIP, "arm_msgs/msg/Finger.msg": FINGER}

ODD = r"""# Copyright 2020 Somebody
# Licensed under terms.

# Ends with a quote "so"

uint8 ONE=1
float32 RATIO = 0.5
bool YES=true
string GREETING="hi # there"   # A greeting
string BARE=hello world
string LONG="abcdefghijklmnopqrstuvwxyz abcdefghijklmnopqrstuvwxyz abcdefghijklmnopqrstuvwxyz abcdefghijklmnopqrst"
float64 I=2
byte HEX=0xff
char LETTER=65
int64 LEAST=-9223372036854775808
float64 from 1.5        # keyword \back "slash"
string class "it's \"quoted\""
string l 'single "double"'
float64[3] corner [1.0, 2.5, 1e-7]
int32[] list [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23]
string[] names ["a", 'b, c', "d#e"]
string<=5 short "abc"
wstring wide "über"
wstring<=9 bounded_wide
string<=5[<=3] few
uint8[] data
uint8[4] quad [1, 2, 3, 4]
uint8[16] uuid
uint8[<=8] upto [5]
byte[] raw
char[] chars
int8[] signed_bytes [-1, 1]
int8[2] pair [-1, 1]
bool[2] flags [true, false]
bool[1] flag
float32[36] covariance
geometry_msgs/Point[2] points
geometry_msgs/Point[<=2] upto_points
geometry_msgs/msg/Point[] any_points
odd_msgs/Float32 own
std_msgs/Float32 theirs
Float32[] field
float64 nan_value nan
float32 inf_value -inf
float64 huge 1e300
bool bool
None none
Message message
uint8 a_very_long_name_of_a_field_that_takes_more_than_a_line_does_and_goes_on_and_on_for_ever 17
float32[12] a_very_long_name_of_a_field_that_takes_more_than_a_line_does [1,2,3,4,5,6,7,8,9,10,11,12]
string default "a default that is so long that the line which has it takes more than one hundred and twenty letters"
# A comment with triple quotes, and a very long line which has to be broken somewhere, for it has more than 88 letters
#   * indented
#
#   * "\"\"" more
float64 last # ends with a backslash \
    # and goes on here
# behind all
"""
ODD_FILES = {
    "odd_msgs/package.xml": "<package><!-- <name>no</name> --><name> odd_msgs </name></package>",
    "odd_msgs/msg/Odd.msg": ODD,
    "odd_msgs/msg/Float32.msg": "float32 data\n",
    "odd_msgs/msg/None.msg": "",
    "odd_msgs/msg/Message.msg": "# A long line of words that takes a few more letters than a line has\nstring text",
    "odd_msgs/msg/VeryLongNameOfAMessageType.msg": "Odd[10] odds\nVeryLongNameOfAnotherMessageType[<=100] others\n",
    "odd_msgs/msg/VeryLongNameOfAnotherMessageType.msg": "int32 UUID=3\nunique_identifier_msgs/UUID id\n",
    "odd_msgs/srv/Odd.srv": "# asks\nOdd odd\n---\n",
    "odd_msgs/srv/Nothing.srv": "---",
    "odd_msgs/action/Go.action": "# go\nfloat64 x # m\n---\nbool ok\n---\nfloat64 left\n",
    "more_msgs/msg/More.msg": "odd_msgs/VeryLongNameOfAMessageType odd\nodd_msgs/None none\n",
    "bulk_msgs/msg/Bulk.msg": "# Modes:\n#   1 fast\n#     2 slow\n\nwstring<=5[3] few # \"a\" and b\nchar[] chars\n",
    "notice_msgs/msg/Notice.msg": "# Copyright 2020 Somebody\n\nint8[] data # \"a\\b\n",
}  # fmt: skip


def test_a_package_becomes_a_module(tmp_path: Path) -> None:
    made = made_of(tmp_path, ARM)
    assert made.files[""] == MODULE
    assert [(one.name, one.ros_type, one.class_name) for one in made.types] == [
        ("arm_msgs/Finger", "arm_msgs/msg/Finger", "Finger"),
        ("arm_msgs/Grip", "arm_msgs/msg/Grip", "Grip"),
    ]


def test_what_was_made_is_a_message_type_like_any(tmp_path: Path) -> None:
    with imported(tmp_path, made_of(tmp_path / "src", ARM)) as (module,):
        grip = module.Grip(width=0.25, fingers=[module.Finger()])
        assert cdr.decoder(module.Grip)(cdr.encoder(module.Grip)(grip)) == grip
        assert robo_messages.decode(robo_messages.encode(grip), module.Grip) == grip
        described = catalogue.describe(module.Grip)
        assert described.constants == {"OPEN": 0, "CLOSED": 1, "UNIT": "m"}
        assert [field.description for field in described.fields][2] == "Between the fingers, m. Measured at the tips."
        assert ros_text("arm_msgs/Grip").splitlines()[2:6] == [
            "uint8 OPEN=0", "uint8 CLOSED=1", 'string UNIT="m"', "std_msgs/Header header",
        ]  # fmt: skip
        assert 'string<=8 name "left"' in ros_text("arm_msgs/Grip")
        assert "float64[2] force [0.5, 1.5]" in ros_text("arm_msgs/Grip")


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all kinds of definitions as a module, and as a package."""
    folder = tmp_path_factory.mktemp("odd")
    made_of(folder / "src", ODD_FILES)
    for name, files in {
        "module": make([folder / "src"], None, as_folder=False).files,
        "package": make([folder / "src"], None, as_folder=True).files,
    }.items():
        write(folder / name, {file or "odd_all.py": text for file, text in files.items()})
    return folder


def tool(folder: Path, *words: str) -> None:
    result = subprocess.run(
        [sys.executable, "-m", *words, "module", "package"], cwd=folder, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("width", ["88", "120"])
def test_ruff_would_write_it_the_same_way(odd: Path, width: str) -> None:
    tool(odd, "ruff", "format", "--isolated", "--diff", "--no-cache", "--line-length", width)


def test_ruff_finds_nothing(odd: Path) -> None:
    rules = "A,B,C4,E,F,I,N,PIE,RET,RUF,SIM,UP,W"
    tool(odd, "ruff", "check", "--isolated", "--no-cache", "--line-length", "120", "--select", rules)


def test_mypy_finds_nothing(odd: Path) -> None:
    tool(odd, "mypy", "--strict", "--config-file=", f"--cache-dir={odd / 'cache'}")


def test_a_package_has_a_module_for_each_package_of_ros(odd: Path) -> None:
    assert sorted(path.name for path in (odd / "package").iterdir()) == [
        "__init__.py", "bulk_msgs.py", "more_msgs.py", "notice_msgs.py", "odd_msgs.py", "py.typed",
    ]  # fmt: skip
    text = (odd / "package" / "more_msgs.py").read_text()
    assert "\n\nfrom .odd_msgs import None_, VeryLongNameOfAMessageType\n" in text


@pytest.mark.parametrize("as_folder", [False, True])
def test_all_of_it_comes_back_from_its_own_text(tmp_path: Path, as_folder: bool) -> None:
    made = made_of(tmp_path / "src", ODD_FILES, as_folder=as_folder)
    with imported(tmp_path / "out", made) as modules:
        names = sorted(types_of(modules))
        hashes = {name: type_hash(name) for name in names}
        texts = {one.name: ros_text(one.name) for one in made.types if one.class_name != "OddService"}
        for type_ in types_of(modules).values():
            message = type_()
            data = cdr.encoder(type_)(message)
            assert cdr.encoder(type_)(cdr.decoder(type_)(data)) == data
    again = {}
    for one in made.types:
        if one.name in texts:
            again[str(Path(one.source).relative_to(tmp_path / "src"))] = texts[one.name]
    again["odd_msgs/srv/Odd.srv"] = ODD_FILES["odd_msgs/srv/Odd.srv"]
    with imported(tmp_path / "twice", made_of(tmp_path / "text", again, as_folder=as_folder)) as modules:
        assert {name: type_hash(name) for name in types_of(modules)} == hashes
        assert {name: ros_text(name) for name in texts} == texts


@pytest.mark.parametrize("seed", range(5))
def test_random_definitions_come_back_from_their_own_text(seed: int, tmp_path: Path) -> None:
    files = definitions(seed, 12)
    with imported(tmp_path / "out", made_of(tmp_path / "src", files)) as modules:
        names = sorted(types_of(modules))
        hashes = {name: type_hash(name) for name in names}
        texts = {f"random_msgs/msg/{name.partition('/')[2]}.msg": ros_text(name) for name in names}
    assert len(names) == len(files)
    with imported(tmp_path / "twice", made_of(tmp_path / "text", texts)):
        assert {name: type_hash(name) for name in names} == hashes


def test_defaults_and_names(tmp_path: Path) -> None:
    with imported(tmp_path, made_of(tmp_path / "src", ODD_FILES)) as (module,):
        odd = module.Odd()
        assert (odd.from_, odd.class_, odd.l) == (1.5, 'it\'s "quoted"', 'single "double"')
        assert (odd.names, odd.short, odd.wide) == (["a", "b, c", "d#e"], "abc", "über")
        assert (odd.quad, bytes(odd.upto), bytes(odd.signed_bytes), odd.pair) == (
            b"\1\2\3\4",
            b"\5",
            b"\xff\1",
            (-1, 1),
        )
        assert (odd.corner, odd.flags, odd.flag, odd.bool_) == ((1.0, 2.5, 1e-7), (True, False), (False,), False)
        assert odd.list_ == list(range(1, 24))
        assert odd.points == (robo_messages.Point(), robo_messages.Point())
        assert isinstance(odd.own, module.Float32)
        assert isinstance(odd.theirs, robo_messages.Float32)
        assert module.Odd.GREETING == "hi # there"
        assert (module.Odd.HEX, module.Odd.LEAST, module.Odd.YES) == (255, -(2**63), True)
        assert b"from" in robo_messages.encode(odd)
        assert "Copyright" not in (module.Odd.__doc__ or "")


@pytest.mark.parametrize("name", sorted({catalogue.whole_of(name)[0] for name in SHIPPED}))
def test_what_robo_ships_is_read_again_as_the_same(name: str, tmp_path: Path) -> None:
    kind = catalogue.whole_of(catalogue.parts(name)[0])[1]
    if name == "std/Empty":
        kind = "message"
    ending = {"message": "msg", "service": "srv", "action": "action"}[kind]
    package, type_name = ros_name(name).split("/")
    made = made_of(tmp_path, {f"{package}/{ending}/{type_name}.{ending}": ros_text(name)})
    assert (made.shipped, made.differing, made.types) == ([name], [], [])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("float64\n", "1:1: expected a type and a name, such as float64 x, not 'float64'"),
        ("\n  flot64 x\n", "2:3: there is no type 'flot64' in my_msgs; did you mean float64?"),
        ("Point p", "1:1: there is no type 'Point' in my_msgs; did you mean geometry_msgs/Point?"),
        ("Header header", "1:1: there is no type 'Header' in my_msgs; did you mean std_msgs/Header?"),
        ("geometry_msgs/Pont p", "1:1: 'geometry_msgs/Pont' is neither below the paths nor in robo; "
         "did you mean geometry_msgs/Point?"),
        ("moveit_msgs/Grasp g", "1:1: 'moveit_msgs/Grasp' is neither below the paths nor in robo; "
         "add the folder of moveit_msgs to the paths"),
        ("time stamp", "1:1: time is of ROS 1; did you mean builtin_interfaces/Time?"),
        ("a/b/c/D x", "1:1: 'a/b/c/D' is no type; write it as package/Type"),
        ("Abc/D x", "1:1: 'Abc' is no name of a package: lower case letters, digits and _"),
        ("float64 wheelSpeed", "1:9: 'wheelSpeed' is no name of a field: lower case letters, digits and _, "
         "as wheel_speed"),
        ("float64 a__b", "1:9: 'a__b' is no name of a field: lower case letters, digits and _, as a_b"),
        ("uint8 low=1", "1:7: 'low' is no name of a constant: capitals, digits and _, as LOW"),
        ("uint8 A=", "1:9: a constant has a value"),
        ("uint8[] A=[1]", "1:11: a constant is one value and no array"),
        ("uint8 A=256", "1:9: a uint8 is from 0 to 255, not '256'"),
        ("uint8 a -1", "1:9: a uint8 is from 0 to 255, not '-1'"),
        ("bool a maybe", "1:8: expected true or false, not 'maybe'"),
        ("float32 a 1e39", "1:11: '1e39' is beyond float32"),
        ("float64 a 1e999", "1:11: '1e999' is beyond float64"),
        ("float64 a one", "1:11: expected a number, not 'one'"),
        ("int32 a 1.5", "1:9: expected a whole number, not '1.5'"),
        ("int32[2] a [1]", "1:12: expected 2 elements, not 1"),
        ("int32[<=1] a [1, 2]", "1:14: expected at most 1 elements, not 2"),
        ("int32[] a 1", "1:11: expected a list such as [1, 2], not '1'"),
        ('string<=2 a "abc"', "1:13: expected at most 2 letters, not 3"),
        ('string a "a"b"', '1:10: a quote within a text is written \\"'),
        ("builtin_interfaces/Time t 1", "1:27: a builtin_interfaces/Time takes no value here; only ROS's own types do"),
        ("float64<=3 a", "1:1: float64 takes no bound; string and wstring do"),
        ("string<=x a", "1:9: a bound is a number from 1, not 'x'"),
        ("float64[0] a", "1:9: in brackets stands nothing, 3 or <=3, and not '0'"),
        ("float64[n] a", "1:9: in brackets stands nothing, 3 or <=3, and not 'n'"),
        (f"float64[{MOST_ELEMENTS + 1}] a", "1:9: at most 16,777,216 elements are taken, not 16,777,217"),
        ("float64[3 a", "1:1: 'float64[3' is no type; write float64, float64[], float64[3], float64[<=3]"),
        ("int8 a\nint8 a", "2:6: a is there already, in line 1"),
        ("int8 a\n---\nint8 b", "2:1: a .msg file has no line ---; a service is an .srv file, "
         "an action an .action file"),
        ("Wrong[] below", "1:1: my_msgs/Wrong holds itself, which no message can"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_its_place(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InterfaceError) as caught:
        made_of(tmp_path, {"my_msgs/msg/Wrong.msg": text})
    assert str(caught.value).startswith(f"{tmp_path / 'my_msgs/msg/Wrong.msg'}:{said}")


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    files = {
        "a_msgs/msg/One.msg": "flot64 x\nuint8 low=1\nPont p\n",
        "a_msgs/msg/two.msg": "int8 x\n",
        "a_msgs/srv/Three.srv": "int8 x\n---\nint8 x\n---\n",
        "a_msgs/action/Four.action": "---\n",
        "nav/msg/Five.msg": "",
    }
    with pytest.raises(InterfaceError) as caught:
        made_of(tmp_path, files)
    lines = [line.removeprefix(f"{tmp_path}/") for line in str(caught.value).splitlines()]
    assert lines == [
        "a_msgs/action/Four.action:2:1: an action has goal and result and feedback: 2 lines ---, not 1",
        "a_msgs/msg/One.msg:1:1: there is no type 'flot64' in a_msgs; did you mean float64?",
        "a_msgs/msg/One.msg:2:7: 'low' is no name of a constant: capitals, digits and _, as LOW",
        "a_msgs/msg/One.msg:3:1: there is no type 'Pont' in a_msgs; did you mean geometry_msgs/Point?",
        "a_msgs/msg/two.msg:1:1: 'two' is no name of a type: capitals first, letters and digits",
        "a_msgs/srv/Three.srv:4:1: a service has request and response: 1 lines ---, not 2",
        "nav/msg/Five.msg:1:1: robo calls nav_msgs/Five so; give package nav another name",
    ]


def test_messages_that_hold_each_other_and_those_too_deep(tmp_path: Path) -> None:
    with pytest.raises(InterfaceError, match=r"B\.msg:1:1: c_msgs/A holds itself, which no message can"):
        made_of(tmp_path / "circle", {"c_msgs/msg/A.msg": "B b\n", "c_msgs/msg/B.msg": "A[] a\n"})
    deep = {f"d_msgs/msg/A{i}.msg": f"A{i + 1} a\n" for i in range(150)} | {"d_msgs/msg/A150.msg": ""}
    with pytest.raises(InterfaceError, match="more than 100 messages stand in each other"):
        made_of(tmp_path / "deep", deep)


def test_messages_that_are_within_others_in_many_ways_take_no_time(tmp_path: Path) -> None:
    files = {f"w_msgs/msg/A{i}.msg": f"A{i + 1}[] a\nA{i + 1}[] b\n" for i in range(60)} | {"w_msgs/msg/A60.msg": ""}
    begin = time.process_time()
    with imported(tmp_path / "out", made_of(tmp_path / "src", files)):
        assert type_hash("w_msgs/A0").startswith("RIHS01_")
        assert whole_text("w_msgs/A0").count("MSG: ") == 60
    assert time.process_time() - begin < 20


def test_one_name_in_two_packages_wants_two_modules(tmp_path: Path) -> None:
    files = {"a_msgs/msg/State.msg": "int8 a\n", "b_msgs/msg/State.msg": "a_msgs/State b\n"}
    with pytest.raises(InterfaceError, match=r"b_msgs/State and message a_msgs/State would have one .*: -o FOLDER"):
        made_of(tmp_path, files)
    with imported(tmp_path / "out", make([tmp_path], None, as_folder=True)) as modules:
        assert type(modules[1].State().b) is modules[0].State


def test_one_name_for_a_message_a_service_and_an_action(tmp_path: Path) -> None:
    files = {"a_msgs/srv/Go.srv": "int8 a\n---\n", "a_msgs/action/Go.action": "int8 b\n---\n---\n"}
    made = made_of(tmp_path / "two", files)
    assert [(one.kind, one.class_name) for one in made.types] == [("service", "GoService"), ("action", "GoAction")]
    with imported(tmp_path / "out", made) as (module,):
        assert (module.GoService.Request().a, module.GoAction.Goal().b) == (0, 0)
    files |= {"a_msgs/msg/Go.msg": ""}
    assert [one.class_name for one in made_of(tmp_path / "two", files).types] == ["Go", "GoService", "GoAction"]
    files |= {"a_msgs/msg/GoAction.msg": ""}
    said = "action a_msgs/Go and message a_msgs/GoAction would have one name in one module; import one of the files"
    with pytest.raises(InterfaceError, match=said):
        made_of(tmp_path / "two", files)


def test_packages_that_need_each_other_are_one_module(tmp_path: Path) -> None:
    files = {"a_msgs/msg/A.msg": "b_msgs/B b\n", "b_msgs/msg/B.msg": "", "b_msgs/msg/C.msg": "a_msgs/A a\n"}
    assert len(made_of(tmp_path, files).types) == 3
    with pytest.raises(InterfaceError, match=r"packages a_msgs, b_msgs need each other; .*: -o FILE\.py"):
        make([tmp_path], None, as_folder=True)


def test_hostile_files_take_no_time(tmp_path: Path) -> None:
    many = 200_000
    lines = [
        "int32[] a [1" + " " * many + "x]",
        "string[] a ['" + "\"'" * many,
        "#" + "#" * many,
        "string a " + "'# " * many,
    ]
    begin = time.process_time()
    for number, line in enumerate(lines):
        parse(line, "x", "message")
        write(tmp_path, {f"p{number}/package.xml": "<!--" * many, f"p{number}/msg/A.msg": ""})
        with pytest.raises(InterfaceError, match="does not say the name"):
            find_sources([tmp_path / f"p{number}"], None)
    assert time.process_time() - begin < 20


def test_what_robo_has_is_used_and_what_differs_is_told(tmp_path: Path) -> None:
    made = made_of(
        tmp_path,
        {
            "geometry_msgs/msg/Point.msg": "float64 x\nfloat64 y\nfloat64 z\n",
            "geometry_msgs/msg/Vector3.msg": "float64 x\nfloat32 y\n",
            "geometry_msgs/msg/Inertia.msg": "float64 m\ngeometry_msgs/Vector3 com\n",
            "std_srvs/srv/Empty.srv": "---\n",
        },
    )
    assert made.shipped == ["geometry/Point", "geometry/Vector3", "std/Empty"]
    assert [one.partition("Vector3.msg: ")[2] for one in made.differing] == [
        "robo's geometry/Vector3 is used, which has float64 y where the file has float32 y"
    ]
    with imported(tmp_path / "out", made) as (module,):
        assert full_name("geometry/Inertia") == "geometry_msgs/msg/Inertia"
        assert type(module.Inertia().com) is robo_messages.Vector3


@pytest.mark.parametrize(
    ("name", "text"), [("std_srvs/srv/SetBool.srv", "bool data\n"), ("geometry_msgs/msg/Point.msg", "---\n")]
)
def test_what_robo_has_and_cannot_be_read_is_told(name: str, text: str, tmp_path: Path) -> None:
    with pytest.raises(InterfaceError, match=rf"{name}:\d:1: a .* ---"):
        made_of(tmp_path, {name: text})


def test_names_there_and_back() -> None:
    for name in SHIPPED:
        whole = catalogue.whole_of(name)[0]
        assert robo_name(ros_name(whole)) == whole
    assert robo_name("my_msgs/Grip") == "my_msgs/Grip"


def test_files_of_a_workspace_are_found_and_builds_are_not(tmp_path: Path) -> None:
    write(
        tmp_path,
        {
            "src/one/package.xml": "<name>one_msgs</name>",
            "src/one/msg/A.msg": "int8 a\n",
            "src/one/msg/detail/B.msg": "int8 a\n",
            "src/two/msg/C.msg": "int8 a\n",
            "build/COLCON_IGNORE": "",
            "build/two/msg/C.msg": "int8 b\n",
            "src/.hidden/msg/D.msg": "int8 a\n",
        },
    )
    (tmp_path / "src" / "again").symlink_to(tmp_path / "src" / "two")
    found = find_sources([tmp_path, tmp_path / "src" / "two" / "msg" / "C.msg"], None)
    assert [(one.package, one.name) for one in found] == [("one_msgs", "A"), ("one_msgs", "B"), ("two", "C")]


def test_links_to_packages_are_followed_and_circles_end(tmp_path: Path) -> None:
    write(tmp_path, {"elsewhere/one_msgs/msg/A.msg": "int8 a\n", "ws/src/two_msgs/msg/B.msg": "int8 a\n"})
    (tmp_path / "ws/src/one_msgs").symlink_to("../../elsewhere/one_msgs")
    (tmp_path / "ws/src/two_msgs/msg/round").symlink_to("../..")
    found = find_sources([tmp_path / "ws"], None)
    assert [(one.package, one.name) for one in found] == [("one_msgs", "A"), ("two_msgs", "B")]


def test_all_that_cannot_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, {"a/msg/A.msg": "int8 a\n", "locked/msg/B.msg": "int8 a\n", "x.txt": ""})
    (tmp_path / "a/msg/Round.msg").symlink_to("Round.msg")
    (tmp_path / "a/msg/Gone.msg").symlink_to("nowhere")
    scan = os.scandir

    def refuse(path: str) -> object:  # tests may run as root, who may read all
        if "locked" in path:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return scan(path)

    monkeypatch.setattr(os, "scandir", refuse)
    with pytest.raises(InterfaceError) as caught:
        find_sources([tmp_path, tmp_path / "x.txt"], None)
    assert [line.removeprefix(f"{tmp_path}/") for line in str(caught.value).splitlines()] == [
        "a/msg/Gone.msg: No such file or directory",
        "a/msg/Round.msg: Too many levels of symbolic links",
        "locked: Permission denied",
        "x.txt: expected a folder, or a file that ends with .msg, .srv or .action",
    ]


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"x.txt": ""}, "{}: no file below it ends with .msg, .srv or .action"),
        ({"A.msg": ""}, "{}/A.msg: it is in the folder of no ROS package; say which one it is of: --package NAME"),
        (
            {"p/msg/A.msg": "", "p/package.xml": "<package/>"},
            "{}/p/package.xml: it does not say the name of its package",
        ),
    ],
)
def test_files_that_cannot_be_taken(files: dict[str, str], said: str, tmp_path: Path) -> None:
    with pytest.raises(InterfaceError) as caught:
        made_of(tmp_path, files)
    assert str(caught.value).startswith(said.format(tmp_path))


def test_a_package_may_be_said(tmp_path: Path) -> None:
    write(tmp_path, {"A.msg": "int8 a\n"})
    assert [one.package for one in find_sources([tmp_path / "A.msg"], "my_msgs")] == ["my_msgs"]


def test_bytes_that_are_no_text_are_told(tmp_path: Path) -> None:
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "A.msg").write_bytes(b"int8 a # \xff\n")
    with pytest.raises(InterfaceError, match=r"A\.msg: it is not text in UTF-8: byte 0xff in line 1"):
        find_sources([tmp_path], None)


def test_a_definition_that_is_there_twice(tmp_path: Path) -> None:
    write(tmp_path, {"a/two/msg/C.msg": "int8 a\n", "b/two/msg/C.msg": "int8 a\n"})
    assert len(make([tmp_path], None, as_folder=False).types) == 1
    write(tmp_path, {"b/two/msg/C.msg": "int8 b\n"})
    with pytest.raises(
        InterfaceError, match=r"two/C is another one in .*a/two/msg/C\.msg; name the folder that you want"
    ):
        make([tmp_path], None, as_folder=False)


LINES = st.sampled_from(
    ["float64 x", "int8[3] a [1, 2, 3]", "#", "# text", "---", "  # more", "Point[] p", 'string s "a # b"', "X",
     "uint8 A=1", "string<=3[<=2] t ['a', \"b\"]", "\t", "a/B c", "= =", 'string q "', "\ufeff", "bool b true # x",
     "wstring w 'ü'"]
)  # fmt: skip


@settings(max_examples=300, deadline=None, database=None)
@given(st.one_of(st.text(max_size=200), st.lists(st.one_of(LINES, st.text(max_size=20)), max_size=12).map("\n".join)))
def test_any_text_is_read_or_refused(text: str) -> None:
    for kind in catalogue.PARTS:
        parse(text, "x", kind)
    parsed = parse(text, "x", "message")
    assert parsed.sections or parsed.faults
    for fault in parsed.faults:
        assert fault.place.line >= 1
        assert fault.place.column >= 1


@settings(max_examples=300, deadline=None, database=None)
@given(st.lists(st.text(max_size=100), min_size=1, max_size=5))
def test_any_comment_is_a_docstring(lines: list[str]) -> None:
    kept = cleaned(lines)
    if kept:
        source = "\n".join(["class A:", *docstring(kept, "    ")])
        space: dict[str, type] = {}
        exec(compile(source, "x", "exec"), space)
        said = " ".join((space["A"].__doc__ or "").split())
        assert said.removesuffix(".") == " ".join(" ".join(kept).replace('"""', "'''").split()).removesuffix(".")


@settings(max_examples=300, deadline=None, database=None)
@given(st.text(max_size=50), st.sampled_from(["string", "bool", "int8", "float32", "wstring"]), st.booleans())
def test_any_value_is_read_or_refused(text: str, base: str, is_array: bool) -> None:
    with suppress(ValueError):
        read_literal(TypeName(base, is_array=is_array), text)


def test_imports_never_take_a_name_that_is_there() -> None:
    imports = Imports({"Twist", "UUID"})
    assert imports.name("robo_messages", "Twist") == "RoboTwist"
    assert imports.name("robo_messages", "UUID") == "ROBO_UUID"
    assert imports.name("robo_messages", "Float32") == "Float32"
    assert imports.name("robo_messages.fields", "Float32") == "RoboFloat32"
    assert imports.name("robo_messages", "Float32") == "Float32"
