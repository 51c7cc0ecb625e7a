"""Two implementations of rmw_zenoh's wire that are not robo's talk through the bridge, in both directions.

zenoh-ros2-sdk (with rosbags) has all of it: session, tokens, keys, hashes, attachments, CDR. pamoja-ros2 makes keys,
names and CDR of numbers; plain Zenoh carries them.
"""

import dataclasses
import importlib
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
import zenoh

import robo_messages
from robo import Client, Node, Publisher, service
from robo.interfaces import cdr
from robo.interfaces.ros_names import full_name
from robo.interfaces.ros_text import whole_text
from robo.interfaces.type_hash import type_hash
from robo.launch.plan import CrossingPlan
from robo_messages import (
    Bool,
    Float64,
    Header,
    Image,
    Int32,
    LaserScan,
    Odometry,
    Point,
    Quaternion,
    SetBool,
    String,
    Twist,
    Vector3,
)
from robo_messages.std_numbers import Float32, UInt32
from tests.support import eventually

pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from tests.ros2 import Both

pytestmark = pytest.mark.timeout(180)

EVERYTHING = {
    "to_ros/*": CrossingPlan(ros="/to_ros/*"),
    "from_ros/*": CrossingPlan(ros="/from_ros/*", direction="from_ros"),
}
_PICTURE = Image(Header(frame_id="camera"), 500, 700, "rgb8", 0, 2_100, memoryview(bytes(range(250)) * 4_200))
MESSAGES: dict[str, Any] = {
    "string": String("hello"),
    "bool": Bool(True),
    "int32": Int32(-7),
    "float64": Float64(0.1),
    "twist": Twist(Vector3(0.5, 0, 0), Vector3(0, 0, -1)),
    "odometry": Odometry(Header(frame_id="odom"), "base"),
    "scan": LaserScan(
        Header(frame_id="laser"), -1.0, 1.0, 0.5, 0.0, 0.5, 0.25, 8.0, [1.0, 2.0, 3.5, 4.0, float("inf")]
    ),
    "image": _PICTURE,
}


@pytest.fixture
def both() -> Iterator[Both]:
    with ExitStack() as stack:
        yield Both(stack)


@pytest.fixture
def sdk(both: Both) -> Iterator[Any]:
    pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed: pip install zenoh-ros2-sdk")
    module = importlib.import_module("zenoh_ros2_sdk")
    session = importlib.import_module("zenoh_ros2_sdk.session").ZenohSession
    port = int(both.ros_at.rpartition(":")[2])
    session._instance = found = session("127.0.0.1", port)
    yield module
    found.session.close()
    session._instance = None


class Told:
    """What a peer has heard."""

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self._changed = threading.Condition()

    def take(self, message: Any) -> None:
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def take_bytes(self, sample: zenoh.Sample) -> None:
        self.take(sample.payload.to_bytes())

    def wait(self, count: int = 1) -> list[Any]:
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.messages) >= count, 40), len(self.messages)
            return list(self.messages)


def of_sdk(store: Any, message: Any) -> dict[str, Any]:
    """A message's fields in the classes of rosbags."""
    found = store.deserialize_cdr(
        cdr.encoder(type(message))(message), full_name(robo_messages.type_name(type(message)))
    )
    return {field.name: getattr(found, field.name) for field in dataclasses.fields(found) if field.init}


def of_robo(store: Any, found: Any, type_: Any) -> Any:
    data = bytes(store.serialize_cdr(found, full_name(robo_messages.type_name(type_))))
    return cdr.decoder(type_)(data)


def words(type_: Any) -> dict[str, Any]:
    name = robo_messages.type_name(type_)
    return {"msg_type": full_name(name), "msg_definition": whole_text(name), "type_hash": type_hash(name)}


def settled(both: Both, kind: str, *topics: str) -> None:
    """Wait until ROS's side sees the bridge's ends of topics."""
    node = both.watcher
    eventually(
        lambda: all(any(f"/{kind}/" in one and f"/{topic}/" in one for one in node.tokens()) for topic in topics),
        f"{kind} of {topics} are announced",
    )


def test_eight_types_of_the_sdk_come_to_robo(both: Both, sdk: Any) -> None:
    both.bridge(topics=EVERYTHING)
    heard = {name: both.heard(f"/r1/from_ros/{name}", type(message)) for name, message in MESSAGES.items()}
    port = int(both.ros_at.rpartition(":")[2])
    store = sdk.ZenohSession.get_instance().store
    for name, message in MESSAGES.items():
        publisher = sdk.ROS2Publisher(f"/from_ros/{name}", router_port=port, domain_id=0, **words(type(message)))
        settled(both, "MS", f"%from_ros%{name}")
        publisher.publish(**of_sdk(store, message))
        assert heard[name].wait() == [message]
        publisher.close()


def test_eight_types_of_robos_come_to_the_sdk(both: Both, sdk: Any) -> None:
    both.bridge(topics=EVERYTHING)
    port = int(both.ros_at.rpartition(":")[2])
    store = sdk.ZenohSession.get_instance().store
    told = {name: Told() for name in MESSAGES}
    readers = [
        sdk.ROS2Subscriber(
            f"/to_ros/{name}", callback=told[name].take, router_port=port, domain_id=0, **words(type(message))
        )
        for name, message in MESSAGES.items()
    ]

    with both.node({name: (type(message), f"to_ros/{name}") for name, message in MESSAGES.items()}) as publish:
        settled(both, "MP", *(f"%to_ros%{name}" for name in MESSAGES))
        for name, message in MESSAGES.items():
            publish(name, message)
            assert of_robo(store, told[name].wait()[0], type(message)) == message
    for one in readers:
        one.close()


def test_hashes_that_the_sdk_makes_itself_are_those_of_robo(sdk: Any) -> None:
    utils = importlib.import_module("zenoh_ros2_sdk.utils")
    del sdk
    for text, name in (("string data\n", "std/String"), ("bool data\n", "std/Bool"), ("float64 data\n", "std/Float64")):
        assert utils.get_type_hash(full_name(name), msg_definition=text) == type_hash(name)


def test_services_of_the_sdk_and_of_robo_are_called_by_the_other(both: Both, sdk: Any) -> None:
    both.bridge(services={"lights": CrossingPlan(ros="/lights"), "ask": CrossingPlan(ros="/ask", direction="from_ros")})
    port = int(both.ros_at.rpartition(":")[2])
    texts = {
        "request_definition": "bool data\n",
        "response_definition": "bool success\nstring message\n",
        "type_hash": type_hash("std/SetBool"),
    }
    about = {"srv_type": "std_srvs/srv/SetBool", "router_port": port, "domain_id": 0, **texts}

    class Base(Node):
        ask = Client(SetBool.Request, SetBool.Response, "ask", timeout=30.0)

        @service("lights")
        def lights(self, request: SetBool.Request) -> SetBool.Response:
            return SetBool.Response(request.data, "bright")

    with Base(name="base", namespace="r1", session=both.robo) as base:
        settled(both, "SS", "%lights")
        client = sdk.ROS2ServiceClient("/lights", timeout=30.0, **about)
        answer = client.call(data=True)
        assert (answer.success, answer.message) == (True, "bright")

        def answers(request: Any) -> Any:
            return server.response_msg_class(success=request.data, message="from the sdk")

        server = sdk.ROS2ServiceServer("/ask", callback=answers, **about)
        assert base.ask(SetBool.Request(True)) == SetBool.Response(True, "from the sdk")
        client.close()
        server.close()


def test_who_comes_later_gets_what_was_latched_of_robo(both: Both, sdk: Any) -> None:
    # The sdk finds publishers of topics without a namespace alone.
    both.bridge(topics={"state": CrossingPlan(ros="/state")})
    qos = importlib.import_module("zenoh_ros2_sdk.qos")
    port = int(both.ros_at.rpartition(":")[2])

    class Base(Node):
        state = Publisher(String, "state", latched=True)

    with Base(name="base", namespace="r1", session=both.robo) as base:
        base.state.publish(String("ready"))
        liveliness = sdk.ZenohSession.get_instance().session.liveliness()
        # The sdk asks once, and its session links with the bridge a moment after it has begun.
        seen = "@ros2_lv/0/*/*/*/MP/*/*/*/%state/**"
        eventually(lambda: bool(list(liveliness.get(seen, timeout=5.0))), "the sdk sees the publisher")
        told = Told()
        profile = qos.QosProfile(durability=qos.QosDurability.TRANSIENT_LOCAL, history_depth=1)
        late = sdk.ROS2Subscriber(
            "/state", callback=told.take, router_port=port, domain_id=0, qos=profile, **words(String)
        )
        assert told.wait()[0].data == "ready"
        late.close()


def test_a_hundred_a_second_come_through_without_loss(both: Both, sdk: Any) -> None:
    """Both ways at once, for three seconds; a minute of it is `benchmarks.ros2_bridge`."""
    bridge = both.bridge(topics=EVERYTHING)
    port = int(both.ros_at.rpartition(":")[2])
    heard = both.heard("/r1/from_ros/string", String)
    told = Told()
    reader = sdk.ROS2Subscriber("/to_ros/string", callback=told.take, router_port=port, domain_id=0, **words(String))
    publisher = sdk.ROS2Publisher("/from_ros/string", router_port=port, domain_id=0, **words(String))

    class Base(Node):
        text = Publisher(String, "to_ros/string")

    with Base(name="base", namespace="r1", session=both.robo) as base:
        settled(both, "MP", "%to_ros%string")
        settled(both, "MS", "%from_ros%string")
        due = time.monotonic()
        for number in range(300):
            publisher.publish(data=f"{number}")
            base.text.publish(String(f"{number}"))
            due += 0.01
            time.sleep(max(0.0, due - time.monotonic()))
        numbers = [f"{number}" for number in range(300)]
        assert [one.data for one in heard.wait(300)] == numbers
        assert [one.data for one in told.wait(300)] == numbers
        assert all(one.dropped == 0 for one in bridge.status().topics)
    reader.close()
    publisher.close()


NUMBERS: dict[str, tuple[Any, str, list[float]]] = {
    "int32": (Int32(-5), "i32", [-5]),
    "uint32": (UInt32(5), "u32", [5]),
    "float32": (Float32(0.5), "f32", [0.5]),
    "float64": (Float64(0.1), "f64", [0.1]),
    "vector": (Vector3(1, 2, 3), "f64", [1, 2, 3]),
    "point": (Point(1, 2, 3), "f64", [1, 2, 3]),
    "quaternion": (Quaternion(0, 0, 0, 1), "f64", [0, 0, 0, 1]),
    "twist": (Twist(Vector3(1, 2, 3), Vector3(4, 5, 6)), "f64", [1, 2, 3, 4, 5, 6]),
}


def test_eight_types_that_pamoja_writes_and_reads_cross_both_ways(both: Both) -> None:
    pytest.importorskip("pamoja.ros2", reason="pamoja-ros2 is not installed: pip install pamoja-ros2")
    pamoja = importlib.import_module("pamoja.ros2")
    both.bridge(topics=EVERYTHING)
    ros = both.ros("pamoja")
    heard = {name: both.heard(f"/r1/from_ros/{name}", type(one)) for name, (one, _, _) in NUMBERS.items()}
    told = {name: Told() for name in NUMBERS}
    with both.node({name: (type(one), f"to_ros/{name}") for name, (one, _, _) in NUMBERS.items()}) as publish:
        settled(both, "MP", *(f"%to_ros%{name}" for name in NUMBERS))
        for number, (name, (message, word, values)) in enumerate(NUMBERS.items(), 1):
            kind = robo_messages.type_name(type(message))
            about = full_name(kind), type_hash(kind)
            there = ros.session.declare_subscriber(
                pamoja.entity_key(0, f"/to_ros/{name}", *about),
                told[name].take_bytes,
            )
            writer = pamoja.CdrWriter()
            for value in values:
                getattr(writer, f"write_{word}")(value)
            stamp = struct.pack("<qqB16s", number, time.time_ns(), 16, bytes([number] * 16))
            key = pamoja.entity_key(0, f"/from_ros/{name}", *about)
            ros.session.put(key, bytes(writer.bytes), attachment=stamp)
            assert heard[name].wait() == [message]
            publish(name, message)
            reader = pamoja.CdrReader(told[name].wait()[0])
            assert [getattr(reader, f"read_{word}")() for _ in values] == values
            there.undeclare()
        twist = NUMBERS["twist"][0]
        assert bytes(pamoja.twist_to_cdr((1, 2, 3), (4, 5, 6))) == cdr.encoder(Twist)(twist)
        node = next(one for one in ros.tokens() if one.endswith("/publisher"))
        assert f"/{pamoja.percent_mangle('/r1')}/publisher" in node
