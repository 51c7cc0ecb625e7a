"""The same bytes, hashes and texts as `rosbags`, which reads and writes ROS's bags without ROS."""

import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings

import robo_messages
from robo.interfaces.cdr import decoder, encoder
from robo.interfaces.ros_names import full_name
from robo.interfaces.ros_shape import Array, Kind, Part, Shape, Single, shape_of
from robo.interfaces.ros_text import whole_text
from robo.interfaces.type_hash import type_hash
from robo_messages import Message
from tests.imported import imported, made_of, types_of
from tests.random_messages import SHIPPED as NAMES
from tests.random_messages import messages
from tests.random_types import definitions
from tests.random_values import Values

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


def test_ten_thousand_random_messages_have_the_same_bytes() -> None:
    """Of all types that ship, in turn; a seed that fails is told."""
    seed = random.randrange(2**32)
    values = Values(seed)
    known = [(robo_messages.find_type(name), store_of(name), shape_name(name)) for name in NAMES]
    for number in range(10_000):
        type_, store, ros_name = known[number % len(known)]
        message = values.message(type_)
        data = encoder(type_)(message)
        theirs = store.deserialize_cdr(data, ros_name)
        where = f"seed {seed}, number {number}: {message!r}"
        assert bytes(store.serialize_cdr(theirs, ros_name)) == data, where
        assert robo_messages.encode(decoder(type_)(data)) == robo_messages.encode(values.as_written(message)), where


def shape_name(name: str) -> str:
    """What rosbags calls a type."""
    ros_name = shape_of(robo_messages.find_type(name)).ros_name
    return ros_name if name in IN_ROS else as_message(ros_name)


@pytest.fixture(params=range(10))
def random_types(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[list[type[Message]], Any]]:
    """Messages that stand in each other, as robo's types and as rosbags has them. It has no wide texts."""
    files = definitions(request.param, 8, wide=False)
    store = typesys.get_typestore(typesys.Stores.ROS2_LYRICAL)
    for path, text in files.items():
        store.register(typesys.get_types_from_msg(text, path.removesuffix(".msg")))
    with imported(tmp_path / "out", made_of(tmp_path / "src", files)) as modules:
        yield list(types_of(modules).values()), store


def test_types_of_users_have_the_same_bytes_and_hashes(random_types: tuple[list[type[Message]], Any]) -> None:
    types, store = random_types
    values = Values(types[0].__module__)
    for type_ in types:
        name = robo_messages.type_name(type_)
        if "char" not in whole_text(name):
            assert type_hash(name) == store.hash_rihs01(full_name(name))
        for _ in range(40):
            data = encoder(type_)(values.message(type_))
            theirs = store.deserialize_cdr(data, full_name(name))
            assert bytes(store.serialize_cdr(theirs, full_name(name))) == data
            other = bytes(store.serialize_cdr(theirs, full_name(name), little_endian=False))
            assert encoder(type_)(decoder(type_)(other)) == data


@pytest.mark.parametrize("store", STORES)
def test_what_rosbags_knows_and_robo_does_not_ship_is_imported(store: str, tmp_path: Path) -> None:
    known = STORES[store]
    files = {}
    for ros_name in known.types:
        package, folder, name = ros_name.split("/")
        text, _ = known.generate_msgdef(ros_name, ros_version=2)
        files[f"{package}/{folder}/{name}.msg"] = text.partition("=" * 80)[0]
    made = made_of(tmp_path / "src", files, as_folder=True)
    assert len(made.types) + len(made.shipped) == len(files) > 160
    with imported(tmp_path / "out", made) as modules:
        types = types_of(modules)
        wrong = {name for name in types if type_hash(name) != known.hash_rihs01(full_name(name))}
        # They have a char, which rosbags takes for a type of its own: ROS's own hash is that of a uint8.
        assert wrong == {name for name in types if re.search(r"^char\b", whole_text(name), re.MULTILINE)}
        values = Values(store)
        for name, type_ in types.items():
            data = encoder(type_)(values.message(type_))
            assert bytes(known.serialize_cdr(known.deserialize_cdr(data, full_name(name)), full_name(name))) == data


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
