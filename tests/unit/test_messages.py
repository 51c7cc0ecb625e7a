import math
import subprocess
import sys

import msgpack
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import robo_messages
from robo.errors import MessageError
from robo.interfaces.message_input import message_of
from robo.interfaces.ros_text import ros_text
from robo_messages import (
    BatteryState,
    Duration,
    Header,
    Image,
    Imu,
    LaserScan,
    Message,
    Odometry,
    PointCloud2,
    PoseWithCovariance,
    Quaternion,
    Time,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from tests.random_messages import SHIPPED


@pytest.mark.parametrize("name", SHIPPED)
def test_every_type_travels_as_msgpack_and_json_and_has_a_schema(name: str) -> None:
    cls = robo_messages.find_type(name)
    assert robo_messages.type_name(cls) == name
    default = cls()
    # Compared as bytes: NaN, which some defaults are, equals nothing.
    data = robo_messages.encode(default)
    assert robo_messages.encode(robo_messages.decode(data, cls)) == data
    assert robo_messages.encode(robo_messages.decode_json(robo_messages.encode_json(default), cls)) == data
    foreign = msgpack.unpackb(data)
    assert list(foreign) == list(cls.__struct_fields__)
    schema = robo_messages.json_schema(name)
    assert schema == robo_messages.json_schema(cls)
    assert cls.__name__ in schema["$defs"]
    assert cls.__doc__


def test_what_a_battery_does_not_measure_is_nan() -> None:
    battery = BatteryState(voltage=12.5)
    unmeasured = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
    assert all(math.isnan(getattr(battery, name)) for name in unmeasured)
    assert battery.voltage == 12.5
    data = robo_messages.encode_json(battery)
    assert b'"percentage":"nan"' in data
    assert math.isnan(robo_messages.decode_json(data, BatteryState).percentage)
    properties = robo_messages.json_schema("sensor/BatteryState")["$defs"]["BatteryState"]["properties"]
    assert properties["percentage"]["default"] == "nan"
    said = ros_text("sensor/BatteryState")
    assert "# 0 to 1. By default nan.\nfloat32 percentage\n" in said, "Foxglove's reader refuses a default of nan"


def test_the_shapes_of_the_reference_are_there() -> None:
    expected = {
        "std/Time", "std/Duration", "std/Header", "std/String", "std/Bool", "geometry/Vector3", "geometry/Point",
        "geometry/Quaternion", "geometry/Pose", "geometry/PoseStamped", "geometry/PoseWithCovariance",
        "geometry/Twist", "geometry/TwistStamped", "geometry/TwistWithCovariance", "geometry/Transform",
        "geometry/TransformStamped", "nav/Odometry", "nav/Path", "nav/OccupancyGrid", "sensor/LaserScan",
        "sensor/Imu", "sensor/JointState", "sensor/BatteryState", "sensor/Range", "sensor/Image",
        "sensor/CompressedImage", "sensor/NavSatFix", "sensor/PointCloud2", "sensor/Joy",
        "diagnostic/DiagnosticArray", "system/Clock", "system/Log", "system/ParameterEvent",
    }  # fmt: skip
    assert expected <= set(SHIPPED)


def test_field_order_is_that_of_ros() -> None:
    assert Odometry.__struct_fields__ == ("header", "child_frame_id", "pose", "twist")
    assert LaserScan.__struct_fields__ == (
        "header", "angle_min", "angle_max", "angle_increment", "time_increment", "scan_time",
        "range_min", "range_max", "ranges", "intensities",
    )  # fmt: skip


def test_a_quaternion_is_the_identity_by_default() -> None:
    assert Quaternion() == Quaternion(0.0, 0.0, 0.0, 1.0)
    assert Odometry().pose.pose.orientation.w == 1.0


def test_messages_do_not_share_their_parts() -> None:
    first, second = Twist(), Twist()
    first.linear.x = 1.0
    assert second.linear.x == 0.0
    one, two = LaserScan(), LaserScan()
    one.ranges.append(1.0)
    assert two.ranges == []


@pytest.mark.parametrize("cls", [PoseWithCovariance, TwistWithCovariance])
@pytest.mark.parametrize("length", [0, 9, 35, 37])
def test_a_covariance_of_the_wrong_length_is_refused(cls: type[Message], length: int) -> None:
    with pytest.raises(ValueError, match=f"takes 36 numbers, got {length}"):
        cls(covariance=(0.0,) * length)
    payload = msgpack.packb({"covariance": [0.0] * length})
    with pytest.raises(msgspec.ValidationError, match="covariance"):
        robo_messages.decode(payload, cls)


def test_imu_covariances_have_nine_numbers() -> None:
    with pytest.raises(ValueError, match="angular_velocity_covariance takes 9"):
        Imu(angular_velocity_covariance=(1.0,))


@pytest.mark.parametrize("payload", [{"linaer": {"x": 1.0}}, {"linear": {"x": "fast"}}, {"linear": [1, 2, 3]}, [1], 5])
def test_another_shape_is_refused(payload: object) -> None:
    with pytest.raises(msgspec.ValidationError):
        robo_messages.decode(msgpack.packb(payload), Twist)


def test_integers_keep_to_their_width() -> None:
    with pytest.raises(msgspec.ValidationError, match="nanosec"):
        robo_messages.decode(msgpack.packb({"sec": 1, "nanosec": 10**9}), Time)
    with pytest.raises(msgspec.ValidationError, match="height"):
        robo_messages.decode(msgpack.packb({"height": -1}), Image)


@pytest.mark.parametrize("cls", [Image, PointCloud2])
def test_bulk_data_are_decoded_without_a_copy(cls: type[Image] | type[PointCloud2]) -> None:
    payload = robo_messages.encode(cls(data=memoryview(bytes(range(256)) * 100)))
    data = robo_messages.decode(payload, cls).data
    assert data.obj is payload
    assert bytes(data[:3]) == b"\x00\x01\x02"


def test_ranges_keep_infinities_and_nan_and_are_plain_numbers_for_others() -> None:
    ranges = [1.0, math.inf, -math.inf, math.nan]
    payload = robo_messages.encode(LaserScan(ranges=ranges))
    assert str(msgpack.unpackb(payload)["ranges"]) == str(ranges)
    assert str(robo_messages.decode(payload, LaserScan).ranges) == str(ranges)


def test_json_writes_what_it_has_no_number_for_as_text() -> None:
    vector = robo_messages.decode_json('{"x": "nan", "y": "inf", "z": "-inf"}', Vector3)
    assert math.isnan(vector.x)
    assert (vector.y, vector.z) == (math.inf, -math.inf)


@given(st.integers(min_value=-(2**31) * 10**9, max_value=2**31 * 10**9 - 1))
def test_time_is_exact_in_nanoseconds(nanoseconds: int) -> None:
    time = Time.from_nanoseconds(nanoseconds)
    assert time.to_nanoseconds() == nanoseconds
    assert 0 <= time.nanosec < 10**9
    assert robo_messages.decode(robo_messages.encode(time), Time) == time


def test_stamps() -> None:
    assert Time.from_seconds(1.5) == Time(1, 500_000_000)
    assert Duration.from_seconds(-0.25) == Duration(-1, 750_000_000)
    assert Duration(-1, 750_000_000).to_seconds() == -0.25
    before = Time.now()
    header = Header.now("base_link")
    assert before <= header.stamp <= Time.now()
    assert header.frame_id == "base_link"


def test_a_package_adds_types_of_its_own() -> None:
    @robo_messages.message("test_package/Gripper")
    class Gripper(Message):
        width: float = 0.0

    assert robo_messages.find_type("test_package/Gripper") is Gripper
    assert "test_package/Gripper" in robo_messages.type_names()
    with pytest.raises(ValueError, match="belongs to robo_messages"):
        robo_messages.message("geometry/Twist")(Gripper)
    with pytest.raises(ValueError, match="group/Type"):
        robo_messages.message("Gripper")


def run(code: str) -> str:
    """What a fresh Python prints."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_types_that_most_nodes_do_without_are_imported_when_they_are_asked_for() -> None:
    code = (
        "import sys, robo_messages\n"
        "loaded = lambda: [name.partition('.')[2] for name in sys.modules if name.startswith('robo_messages.')\n"
        "                  and name in robo_messages._LATER]\n"
        "'std/Float64' in robo_messages.type_names(), dir(robo_messages), robo_messages.json_schema('geometry/Twist')\n"
        "print(loaded())\n"
        "robo_messages.find_type('geometry/PoseArray')\n"
        "print(loaded())\n"
        "from robo_messages import Float64\n"
        "print(loaded(), robo_messages.type_name(Float64), robo_messages.Float64 is Float64)\n"
    )
    assert run(code).splitlines() == [
        "[]", "['geometry_more']", "['geometry_more', 'std_numbers'] std/Float64 True",
    ]  # fmt: skip


def test_what_is_imported_later_is_what_its_modules_say() -> None:
    said: dict[str, set[str]] = {}
    for ends, later in ((("",), robo_messages._LATER), *robo_messages._PARTS_LATER.items()):
        for module, listed in later.items():
            parts = {name + end.replace("_", ".") for name in listed.split() for end in ends}
            said.setdefault(module, set()).update(parts)
    for module, types in said.items():
        there = {
            cls.__qualname__
            for cls in map(robo_messages.find_type, robo_messages.type_names())
            if cls.__module__ == module
        }
        assert there == types
    names = {name.partition(".")[0] for types in said.values() for name in types}
    assert names <= set(robo_messages.__all__)
    assert {name for name in robo_messages.__all__ if not hasattr(robo_messages, name)} == set()
    assert names <= set(dir(robo_messages))
    with pytest.raises(AttributeError, match="no attribute 'Float65'"):
        robo_messages.Float65  # type: ignore[attr-defined]  # noqa: B018


def test_a_name_that_is_imported_later_is_taken_all_the_same() -> None:
    code = (
        "import robo_messages\n"
        "try:\n"
        "    @robo_messages.message('visualization/Marker')\n"
        "    class Marker(robo_messages.Message): pass\n"
        "except ValueError as error: print(error)\n"
    )
    assert run(code) == "message name 'visualization/Marker' belongs to robo_messages.visualization.Marker"


@pytest.mark.parametrize("bits", [8, 16, 32, 64])
def test_one_whole_number_keeps_to_its_width(bits: int) -> None:
    for name, least, most in (
        (f"std/Int{bits}", -(2 ** (bits - 1)), 2 ** (bits - 1) - 1),
        (f"std/UInt{bits}", 0, 2**bits - 1),
    ):
        cls = robo_messages.find_type(name)
        for value in (least, most):
            payload = msgpack.packb({"data": value})
            assert robo_messages.encode(robo_messages.decode(payload, cls)) == payload
            assert message_of(cls, {"data": value}) == robo_messages.decode(payload, cls)
        for value in (least - 1, most + 1):
            with pytest.raises(MessageError, match=rf"^{name}.data: expected int"):
                message_of(cls, {"data": value})
            if bits < 64:
                with pytest.raises(msgspec.ValidationError, match="data"):
                    robo_messages.decode(msgpack.packb({"data": value}), cls)


def test_unknown_names_and_types_say_what_to_do() -> None:
    with pytest.raises(robo_messages.UnknownType, match="did you mean geometry/Twist"):
        robo_messages.find_type("geometry/Twits")

    class Nameless(Message):
        pass

    with pytest.raises(robo_messages.UnknownType, match="Nameless has no message name"):
        robo_messages.type_name(Nameless)


def test_messages_need_nothing_but_msgspec() -> None:
    code = (
        "import sys, robo_messages\n"
        "found = {name.partition('.')[0] for name in sys.modules} - set(sys.stdlib_module_names)\n"
        "print(sorted(n for n in found if not n.startswith('_')))"
    )
    result = subprocess.run([sys.executable, "-S", "-c", f"import sys; sys.path[:] = {sys.path!r}\n{code}"],
                            capture_output=True, text=True, check=True)  # fmt: skip
    # msgspec itself looks for typing_extensions and does without it.
    assert result.stdout.replace(", 'typing_extensions'", "").strip() == "['msgspec', 'robo_messages']"
