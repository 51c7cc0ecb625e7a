"""Types of users as ROS has them: their fields, text, hash and bytes."""

import enum
import math
import re
from typing import Annotated, Any, ClassVar, Literal

import msgspec
import pytest
from msgspec import Meta, field

from robo.errors import ContractError, MessageError
from robo.interfaces import cdr
from robo.interfaces.ros_names import full_name, ros_name
from robo.interfaces.ros_shape import shape_of
from robo.interfaces.ros_text import ros_text, whole_text
from robo.interfaces.type_hash import type_hash
from robo_messages import Header, Message, Point, Time, message
from robo_messages._types import Float32, UInt8
from tests.random_messages import SHIPPED

HEAD = b"\x00\x01\x00\x00"


class Colour(enum.Enum):
    RED = "red"
    BLUE = "blue"


class Level(enum.IntEnum):
    LOW = 1
    HIGH = 2


@message("test_ros/Wide")
class Wide(Message, kw_only=True):
    """All that Python has and ROS has not."""

    LARGE: ClassVar[int] = 1000

    colour: Colour = Colour.RED
    levels: list[Level] = field(default_factory=list)
    mode: Literal["slow", "fast"] = "slow"
    maybe: float | None = None
    place: Point | None = None
    """m."""
    code: Annotated[str, Meta(pattern="^[a-z]*$")] = ""
    few: Annotated[list[Float32], Meta(max_length=3)] = field(default_factory=list)
    some: Annotated[list[Point], Meta(min_length=0, max_length=2)] = field(default_factory=list)
    share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    percent: Annotated[int, Meta(ge=0, le=100)] = 0
    percents: list[Annotated[int, Meta(ge=0, le=100)]] = field(default_factory=list)
    pair: tuple[float, float] = (0.0, 0.0)
    names: tuple[str, str] = ("", "")
    corners: Annotated[list[Point], Meta(min_length=2, max_length=2)] = field(
        default_factory=lambda: [Point(), Point()]
    )
    blob: Annotated[bytes, Meta(max_length=4)] = b""
    raw: bytearray = field(default_factory=bytearray)
    table: dict[str, float] = field(default_factory=dict)
    nested: list[list[float]] = field(default_factory=list)
    mixed: int | str | None = None
    anything: Any = None
    things: list[Any] = field(default_factory=list)
    unset: float = math.nan
    renamed: int = field(default=0, name="called")


FULL = Wide(
    colour=Colour.BLUE, levels=[Level.HIGH, Level.LOW], mode="fast", maybe=1.5, place=Point(1.0), code="abc",
    few=[1.0, math.inf], some=[Point(2.0)], share=0.5, percent=100, percents=[1, 2], pair=(1.0, 2.0), names=("a", "b"),
    corners=[Point(3.0), Point(4.0)], blob=b"1234", raw=bytearray(b"xy"), table={"a": 1.0}, nested=[[1.0], []],
    mixed="x", anything=[1, 2], things=[None, "a", 1.5], unset=1.0, renamed=7,
)  # fmt: skip

WIDE = """\
# test_ros/Wide
# All that Python has and ROS has not.
int32 LARGE=1000
string colour "red"
int64[] levels
string mode "slow"
float64[<=1] maybe
# m.
geometry_msgs/Point[<=1] place
string code
float32[<=3] few
geometry_msgs/Point[<=2] some
float64 share
int64 percent
int64[] percents
float64[2] pair
string[2] names
geometry_msgs/Point[2] corners
uint8[<=4] blob
uint8[] raw
# As JSON.
string table
# As JSON.
string nested
# As JSON.
string mixed
rcl_interfaces/ParameterValue anything
rcl_interfaces/ParameterValue[] things
# By default nan.
float64 unset
int64 called
"""


def test_a_type_of_a_user_has_a_text() -> None:
    text = whole_text("test_ros/Wide")
    assert text.startswith(WIDE)
    assert re.findall(r"^={80}\nMSG: (.*)$", text, re.MULTILINE) == [
        "geometry_msgs/Point", "rcl_interfaces/ParameterValue",
    ]  # fmt: skip
    assert ros_text("test_ros/Wide") == WIDE.rstrip("\n")


@pytest.mark.parametrize("value", [Wide(), FULL], ids=["defaults", "full"])
def test_a_type_of_a_user_is_read_as_it_was_written(value: Wide) -> None:
    back = cdr.decoder(Wide)(cdr.encoder(Wide)(value))
    assert repr(back) == repr(value)


@pytest.mark.parametrize(
    ("attribute", "value", "said"),
    [
        ("colour", "green", "test_ros/Wide.colour: .*'green'.*"),
        ("levels", [3], "test_ros/Wide.levels: .*3.*"),
        ("mode", "medium", "test_ros/Wide.mode: .*'medium'.*"),
        ("maybe", "x", r"test_ros/Wide.maybe\[0\]: expected a number, got str 'x'"),
        ("code", "A", "test_ros/Wide.code: Expected `str` matching regex .*"),
        ("few", [1.0] * 4, "test_ros/Wide.few: expected at most 3 elements, got 4"),
        ("some", [Point()] * 3, "test_ros/Wide.some: expected at most 2 elements, got 3"),
        ("share", 2.0, "test_ros/Wide.share: Expected `float` <= 1.0"),
        ("percent", 101, "test_ros/Wide.percent: expected int from 0 to 100, got int 101"),
        ("percents", [101], "test_ros/Wide.percents: Expected `int` <= 100.*"),
        ("pair", (1.0,), "test_ros/Wide.pair: expected 2 elements, got 1"),
        ("names", ("a", "\0"), r"test_ros/Wide.names\[1\]: a text in CDR ends at its first NUL.*"),
        ("corners", [Point()], "test_ros/Wide.corners: expected 2 elements, got 1"),
        ("blob", b"12345", "test_ros/Wide.blob: expected at most 4 elements, got 5"),
        ("table", {"a": object()}, "test_ros/Wide.table: .* object .*"),
        ("renamed", 2**63, "test_ros/Wide.called: expected int from -9223372036854775808 .*"),
    ],
)
def test_what_does_not_fit_is_named(attribute: str, value: object, said: str) -> None:
    wide = Wide()
    setattr(wide, attribute, value)
    with pytest.raises(MessageError, match=f"^{said}$"):
        cdr.encoder(Wide)(wide)


@message("test_ros/Loose")
class Loose(Message):
    """The same bytes as `Strict`, and any values."""

    colour: str = ""
    levels: list[int] = field(default_factory=list)
    place: list[Point] = field(default_factory=list)
    code: str = ""
    share: float = 0.0
    table: str = ""


@message("test_ros/Strict")
class Strict(Message):
    colour: Colour = Colour.RED
    levels: list[Level] = field(default_factory=list)
    place: Point | None = None
    code: Annotated[str, Meta(pattern="^[a-z]*$")] = ""
    share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    table: dict[str, int] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("loose", "said"),
    [
        (Loose("green", table="{}"), "test_ros/Strict.colour: Invalid enum value 'green'"),
        (Loose("red", [3], table="{}"), r"test_ros/Strict.levels: Invalid enum value 3.*"),
        (Loose("red", [], [Point()] * 2, table="{}"), "test_ros/Strict.place: expected at most 1 elements, got 2"),
        (Loose("red", [], [], "A", table="{}"), "test_ros/Strict.code: Expected `str` matching regex .*"),
        (Loose("red", [], [], "", 1.5, "{}"), "test_ros/Strict.share: Expected `float` <= 1.0"),
        (Loose("red", [], [], "", 0.5, "{"), "test_ros/Strict.table: .*truncated"),
        (Loose("red", [], [], "", 0.5, '{"a": "b"}'), "test_ros/Strict.table: Expected `int`, got `str`.*"),
        (Loose("red", [], [], "", 0.5, "[" * 100_000), "test_ros/Strict.table: .*"),
    ],
)
def test_what_is_read_is_held_to_the_type(loose: Loose, said: str) -> None:
    with pytest.raises(MessageError, match=f"^{said}$"):
        cdr.decoder(Strict)(cdr.encoder(Loose)(loose))


@message("test_ros/Checked")
class Checked(Message):
    low: float = 0.0
    high: float = 0.0

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise ValueError("low is above high")


@message("test_ros/Holder")
class Holder(Message):
    both: list[Checked] = field(default_factory=list)


def test_what_a_class_refuses_is_told_with_its_place() -> None:
    wrong = Holder([Checked(), Checked(1.0, 2.0)])
    wrong.both[1].high = 0.0
    with pytest.raises(MessageError, match=r"^test_ros/Holder.both\[1\]: low is above high$"):
        cdr.decoder(Holder)(cdr.encoder(Holder)(wrong))


def test_a_type_that_holds_itself_is_none_of_ros() -> None:
    namespace: dict[str, Any] = {"Message": Message, "message": message, "field": field}
    source = '@message("test_ros/Tree")\nclass Tree(Message):\n    below: "list[Tree]" = field(default_factory=list)\n'
    exec(source, namespace | {"__name__": __name__}, namespace)
    globals()["Tree"] = namespace["Tree"]
    with pytest.raises(ContractError, match=r"^test_ros/Tree.below: ROS has no type that holds itself$"):
        cdr.encoder(namespace["Tree"])


def test_what_ros_cannot_have_is_named() -> None:
    @message("test_ros/Untouched")
    class Untouched(Message):
        rest: msgspec.Raw = msgspec.Raw(b"\xc0")

    with pytest.raises(
        ContractError, match=r"^test_ros/Untouched.rest: ROS has no type for what is left as it travels"
    ):
        shape_of(Untouched)

    @message("test_ros/Odd")
    class Odd(Message):
        number: Annotated[int, Meta(extra={"ros": "float32"})] = 0

    with pytest.raises(ContractError, match=r"^test_ros/Odd.number: int cannot be ROS's 'float32'; choose of int8, "):
        shape_of(Odd)

    @message("test_ros/Kebab")
    class Kebab(Message, rename="kebab"):
        two_words: int = 0

    with pytest.raises(ContractError, match=r"^test_ros/Kebab.two-words: ROS's names of fields are letters, digits"):
        shape_of(Kebab)


def test_names() -> None:
    assert ros_name("std/Trigger_Request") == "std_srvs/Trigger_Request"
    assert full_name("std/Trigger_Response") == "std_srvs/srv/Trigger_Response"
    assert full_name("std/Trigger", "service") == "std_srvs/srv/Trigger"
    assert full_name("example/Fibonacci_Goal") == "example_interfaces/action/Fibonacci_Goal"
    assert full_name("my_robot/Gripper") == "my_robot/msg/Gripper"
    assert full_name("action/UUID") == "unique_identifier_msgs/msg/UUID"


HASHES = {
    "std/Time": "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
    "std/Header": "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    "std/Empty": "20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312",
    "std/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "std/Char": "3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9",
    "std/Bool": "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    "geometry/Twist": "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry/PoseWithCovariance": "9a7c0fd234b7f45c6098745ecccd773ca1085670e64107135397aee31c02e1bb",
    "geometry/TransformStamped": "0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206",
    "nav/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "nav/Path": "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
    "nav/OccupancyGrid": "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    "sensor/LaserScan": "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "sensor/Imu": "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "sensor/BatteryState": "4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
    "sensor/Range": "b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    "sensor/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor/CompressedImage": "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    "sensor/NavSatFix": "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
    "sensor/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "sensor/Joy": "0d356c79cad3401e35ffeb75a96a96e08be3ef896b8b83841d73e890989372c5",
    "diagnostic/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "system/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "system/Log": "e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
    "system/ParameterEvent": "043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
    "std/SetBool": "abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
    "std/SetBool_Request": "c62fbb99d94e1b25e8ef9e109f9581956bb1b3361a45a4e5810c36a90d29932e",
    "std/SetBool_Response": "d0814e7f7b4880ab77e9c57426c7aa1562ab69f11eef8e2e968812f9cbd0b059",
    "std/Trigger": "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    "std/Trigger_Request": "d010825374ce8918e72bfd826c82603e60f45419e932ea976f807b74a863a199",
    "example/Fibonacci": "9508051da1ea4658de144b09bd0690ff3de52104683d847aed764d2915906f51",
    "example/Fibonacci_Goal": "226cb437e4355dcd3e914f930382a3b0cc1da81545bd319ed554e95a03255f51",
}
"""As ROS ships them."""


@pytest.mark.parametrize("name", HASHES)
def test_a_type_has_the_hash_that_ros_gives_it(name: str) -> None:
    assert type_hash(name) == f"RIHS01_{HASHES[name]}"


def test_the_text_of_a_type_has_all_messages_in_it_once() -> None:
    text = whole_text("nav/Odometry")
    assert text.splitlines()[0] == "# nav_msgs/Odometry"
    assert re.findall(r"^={80}\nMSG: (.*)$", text, re.MULTILINE) == [
        "std_msgs/Header", "builtin_interfaces/Time", "geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose",
        "geometry_msgs/Point", "geometry_msgs/Quaternion", "geometry_msgs/TwistWithCovariance", "geometry_msgs/Twist",
        "geometry_msgs/Vector3",
    ]  # fmt: skip
    service = whole_text("lifecycle/GetState")
    assert service.startswith("# lifecycle_msgs/GetState\n# Nothing to say.\n---\n# The state.\n")
    assert re.findall("^MSG: (.*)$", service, re.MULTILINE) == ["lifecycle_msgs/State"]


@pytest.mark.parametrize("name", SHIPPED)
def test_each_line_of_a_text_is_one_that_readers_know(name: str) -> None:
    word = r"[a-z]\w*(/[A-Za-z]\w*)?(\[(<=)?\d*\])?"
    number = r"-?\d+(\.\d+)?"
    line = re.compile(rf"(#.*|={{80}}|MSG: \w+/\w+|{word} [A-Z]\w*={number}|{word} \w+( ({number}|true|\".*\"))?)?")
    assert [one for one in whole_text(name).splitlines() if not line.fullmatch(one)] == []


def test_fields_that_are_not_named_as_in_python() -> None:
    @message("test_ros/Camel")
    class Camel(Message, rename="camel"):
        at_time: Time = field(default_factory=Time)
        some_byte: UInt8 = 0
        header: Header = field(default_factory=Header)

    assert [one.name for one in shape_of(Camel).fields] == ["atTime", "someByte", "header"]
    value = Camel(Time(1, 2), 3, Header(frame_id="x"))
    data = cdr.encoder(Camel)(value)
    assert data.startswith(HEAD + b"\1\0\0\0\2\0\0\0\3")
    assert cdr.decoder(Camel)(data) == value
