"""The same bytes, hashes and texts as `rosbags`, which reads and writes ROS's bags without ROS."""

import re
from typing import Any

import pytest
from hypothesis import given, settings

import robo_messages
from robo.interfaces.cdr import decoder, encoder
from robo.interfaces.ros_shape import Array, Kind, Part, Shape, Single, shape_of
from robo.interfaces.ros_text import whole_text
from robo.interfaces.type_hash import type_hash
from tests.random_messages import SHIPPED as NAMES
from tests.random_messages import messages

typesys = pytest.importorskip(
    "rosbags.typesys", reason="rosbags is not installed; with numpy it is 76 MB: pip install rosbags"
)
STORES = {name: typesys.get_typestore(typesys.Stores[name]) for name in ("ROS2_JAZZY", "ROS2_KILTED", "ROS2_LYRICAL")}
OLDER = {"lifecycle/TransitionEvent": "ROS2_KILTED"}
"""Types that Lyrical has changed: it has a Time where there was a number."""
CHAR = "std/Char"
"""A char of a `.msg` file is a uint8: ROS's own hash of it says so. Rosbags has it as a type of its own."""
IN_ROS = [name for name in NAMES if shape_of(robo_messages.find_type(name)).ros_name in STORES["ROS2_LYRICAL"].types]


def store_of(name: str) -> Any:
    """ROS's own definition of a type where rosbags has it, else the one that robo writes."""
    known = STORES[OLDER.get(name, "ROS2_LYRICAL")]
    ros_name = shape_of(robo_messages.find_type(name)).ros_name
    if ros_name in known.types:
        return known
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(whole_text(name), as_message(ros_name)))
    return store


def as_message(ros_name: str) -> str:
    """A name that rosbags takes: it knows no parts of services."""
    return re.sub("/(srv|action)/", "/msg/", ros_name)


def test_these_types_are_in_ros() -> None:
    groups = {name.partition("/")[0] for name in NAMES if name not in IN_ROS}
    assert len(IN_ROS) >= 85
    services = {name for name in NAMES if name.endswith(("_Request", "_Response", "_Goal", "_Result", "_Feedback"))}
    assert groups - {name.partition("/")[0] for name in services} == set()
    assert {name for name in NAMES if name not in IN_ROS} - services == {"nav2/WaypointStatus", "flight/Snapshot"}


@pytest.mark.parametrize("store", STORES)
@pytest.mark.parametrize("name", IN_ROS)
def test_the_hash_is_the_same(name: str, store: str) -> None:
    ros_name = shape_of(robo_messages.find_type(name)).ros_name
    if ros_name in STORES[store].types and name != CHAR and store <= OLDER.get(name, store):
        assert type_hash(name) == STORES[store].hash_rihs01(ros_name)


@pytest.mark.parametrize("name", NAMES)
def test_the_text_is_understood(name: str) -> None:
    ros_name = as_message(shape_of(robo_messages.find_type(name)).ros_name)
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(whole_text(name), ros_name))
    if ros_name == shape_of(robo_messages.find_type(name)).ros_name and name != CHAR:
        assert store.hash_rihs01(ros_name) == type_hash(name)
    if name in IN_ROS:
        assert store.fielddefs[ros_name][1] == store_of(name).fielddefs[ros_name][1]


@pytest.mark.parametrize("name", NAMES)
def test_the_bytes_are_the_same(name: str) -> None:
    type_ = robo_messages.find_type(name)
    shape, store = shape_of(type_), store_of(name)
    ros_name = as_message(shape.ros_name) if name not in IN_ROS else shape.ros_name
    write, read = encoder(type_), decoder(type_)

    @settings(max_examples=25, deadline=None, database=None)
    @given(messages(type_))
    def check(message: Any) -> None:
        data = write(message)
        theirs = store.deserialize_cdr(data, ros_name)
        assert bytes(store.serialize_cdr(theirs, ros_name)) == data
        back = read(data)
        assert_alike(shape, back, theirs)
        other_order = bytes(store.serialize_cdr(theirs, ros_name, little_endian=False))
        assert robo_messages.encode(read(other_order)) == robo_messages.encode(back)

    check()


def assert_alike(shape: Shape, ours: Any, theirs: Any) -> None:
    """Each field has the same value."""
    for field in shape.fields:
        value = getattr(ours, field.attribute)
        if field.bridge is not None:
            value = field.bridge.to_ros(value)
        assert_same_value(field.kind, value, getattr(theirs, field.name))


def assert_same_value(kind: Kind, ours: Any, theirs: Any) -> None:
    match kind:
        case Part(shape):
            assert_alike(shape, ours, theirs)
        case Array():
            if isinstance(ours, (bytes, bytearray, memoryview)):
                assert bytes(ours) == theirs.tobytes()
                return
            assert len(ours) == len(theirs)
            for mine, other in zip(ours, theirs, strict=True):
                assert_same_value(kind.item, mine, other)
        case Single("byte"):  # which rosbags gives a sign
            assert ours == theirs % 256
        case _:
            assert ours == theirs or (ours != ours and theirs != theirs)
