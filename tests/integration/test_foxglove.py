"""The server of viewers, as a viewer meets it: each part of the protocol, on a network with nodes."""

import asyncio
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Annotated, Any

import msgspec
import pytest
import zenoh
from msgspec import Meta

import robo
import robo_messages
from robo import Node, Publisher, ServiceError, service
from robo.errors import NetworkError
from robo.interfaces import cdr
from robo.samples.publishing import Sender
from robo.samples.stream import Stream
from robo.web.access import Tokens
from robo.wire.qos import QoS
from robo_messages import (
    Clock,
    GetPlayback,
    GetRate,
    Header,
    Odometry,
    Point,
    SetBool,
    String,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Trigger,
    Twist,
    Vector3,
)
from tests import bags
from tests.support import eventually, is_heard

viewers = pytest.importorskip("tests.viewers", reason="the extra foxglove is not installed")
exceptions = pytest.importorskip("websockets.exceptions")

from robo.bridges.foxglove.server import Server, Settings  # noqa: E402 (its library may be missing)
from tests.integration.test_playing import playing  # noqa: E402

pytestmark = pytest.mark.timeout(60)
TOKENS = Tokens(view="look-look-look", drive="drive-drive-drive")


class Base(Node):
    """Has all that is asked for."""

    class Parameters(robo.Parameters):
        speed: Annotated[float, Meta(ge=0, le=5)] = 1.0
        name: str = "base"

    parameters: Parameters
    position = Publisher(Point, "position")
    state = Publisher(String, "state", latched=True)

    def on_start(self) -> None:
        self.state.publish(String("ready"))

    @service("greet")
    def greet(self, _: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(True, "hello")

    @service("lights")
    def lights(self, request: SetBool.Request) -> SetBool.Response:
        if request.data:
            raise ServiceError("there are none")
        return SetBool.Response(True, "dark")

    @service("rate")
    def rate(self, _: GetRate.Request) -> GetRate.Response:
        raise ServiceError("nobody knows")


@pytest.fixture
def base(other: zenoh.Session) -> Iterator[Base]:
    with Base(namespace="r1", session=other) as node:
        yield node


@pytest.fixture
def served(session: zenoh.Session) -> Iterator[Any]:
    with closing(viewers.Served(session)) as found:
        yield found


def decoded(type_: Any, data: bytes) -> Any:
    return cdr.decoder(type_)(data)


def subscribers(session: zenoh.Session, key: str) -> bool:
    """Whether somebody receives a topic."""
    asking = session.declare_publisher(key)
    try:
        return is_heard(asking)
    finally:
        asking.undeclare()


def test_topics_come_as_cdr_with_whole_definitions_and_are_received_only_where_they_are_wanted(
    served: Any, base: Base, other: zenoh.Session
) -> None:
    with served.viewer() as viewer:
        info = viewer.hears("serverInfo")
        assert {"clientPublish", "services", "parameters", "parametersSubscribe", "connectionGraph"} == {
            *info["capabilities"]
        }
        assert info["supportedEncodings"] == ["cdr", "json"]
        channel = viewer.until(lambda: viewer.topics.get("/r1/position"))
        assert (channel["encoding"], channel["schemaName"]) == ("cdr", "geometry_msgs/msg/Point")
        assert channel["schemaEncoding"] == "ros2msg"
        assert "float64 x" in channel["schema"]
        assert not subscribers(other, "r1/position")
        number = viewer.subscribe("/r1/position")
        eventually(lambda: subscribers(other, "r1/position"), "the bridge subscribes")
        base.position.publish(Point(1.0, 2.0, 3.0))
        assert decoded(Point, viewer.next_of(number)) == Point(1.0, 2.0, 3.0)
        viewer.ask("unsubscribe", subscriptionIds=[number])
        eventually(lambda: not subscribers(other, "r1/position"), "the bridge subscribes no more")


def test_each_late_viewer_gets_what_is_latched_once(served: Any, base: Base) -> None:
    for _ in range(2):
        with served.viewer(subprotocol=viewers.PLAIN) as viewer:
            number = viewer.subscribe("/r1/state")
            assert decoded(String, viewer.next_of(number)) == String("ready")
            base.state.publish(String("ready"))
            viewer.next_of(number)
            assert not viewer.messages[number]


def test_static_transforms_of_several_nodes_come_all(served: Any, other: zenoh.Session) -> None:
    senders = [Sender(other, "r1/tf_static", "tf2/TFMessage", QoS(latched=True), f"/r1/{name}") for name in "ab"]
    for sender, child in zip(senders, ("laser", "camera"), strict=True):
        sender.send(
            robo_messages.encode(TFMessage([TransformStamped(Header(frame_id="base_link"), child, Transform())]))
        )
    with served.viewer() as viewer:
        number = viewer.subscribe("/r1/tf_static")
        said = [decoded(TFMessage, viewer.next_of(number)).transforms[0].child_frame_id for _ in range(2)]
        assert {*said} == {"laser", "camera"}
    for sender in senders:
        sender.close()


def test_services_are_called_in_both_encodings_and_refusals_are_told(served: Any, base: Base) -> None:
    del base
    with served.viewer() as viewer:
        viewer.call("/r1/greet", b"\x00\x01\x00\x00", call=3)  # nothing is said: viewers leave out ROS's byte
        call, encoding, data = viewer.answer()
        assert (call, encoding, decoded(Trigger.Response, data).message) == (3, "cdr", "hello")
        viewer.call("/r1/lights", b'{"data": false}', "json")
        assert msgspec.json.decode(viewer.answer()[2]) == {"success": True, "message": "dark"}
        viewer.call("/r1/lights", cdr.encoder(SetBool.Request)(SetBool.Request(True)), call=9)
        call, _, data = viewer.answer()
        assert (call, decoded(SetBool.Response, data).success) == (9, False)
        assert "there are none" in decoded(SetBool.Response, data).message
        assert "there are none" in viewer.hears("status", lambda one: one["level"] == 2)["message"]
        viewer.call("/r1/lights", b'{"data": 3}', "json", 10)
        assert "data" in msgspec.json.decode(viewer.answer()[2])["message"]
        viewer.call("/r1/rate", b"{}", "json", 11)  # whose answer has no place for it
        failure = viewer.hears("serviceCallFailure")
        assert (failure["callId"], "nobody knows" in failure["message"]) == (11, True)


def test_parameters_are_read_set_and_watched_and_refusals_are_told(served: Any, base: Base) -> None:
    with served.viewer() as viewer, served.viewer() as second:
        viewer.until(lambda: viewer.services)
        viewer.ask("getParameters", parameterNames=[], id="all")
        said = {one["name"]: one for one in viewer.hears("parameterValues")["parameters"]}
        assert said["/r1/base.speed"] == {"name": "/r1/base.speed", "value": 1.0, "type": "float64"}
        assert said["/r1/base.name"]["value"] == "base"
        second.ask("subscribeParameterUpdates", parameterNames=["/r1/base.speed"])
        second.ask("getParameters", parameterNames=["/r1/base.speed"], id="one")
        second.hears("parameterValues")
        viewer.ask("setParameters", parameters=[{"name": "/r1/base.speed", "value": 2}], id="set")
        assert viewer.hears("parameterValues")["parameters"][0]["value"] == 2.0
        assert base.parameters.speed == 2.0
        assert second.hears("parameterValues")["parameters"] == [
            {"name": "/r1/base.speed", "value": 2.0, "type": "float64"}
        ]
        viewer.ask("setParameters", parameters=[{"name": "/r1/base.speed", "value": 99}])
        assert "speed" in viewer.hears("status", lambda one: one["level"] == 2)["message"]
        assert viewer.hears("parameterValues")["parameters"][0]["value"] == 2.0
        viewer.ask("getParameters", parameterNames=["/r1/base.nothing"], id="none")
        assert viewer.hears("parameterValues")["parameters"] == [{"name": "/r1/base.nothing"}]


def next_twist(stream: Stream) -> Twist:
    arrival = stream.get()
    assert arrival is not None
    return robo_messages.decode(arrival.sample.payload.to_bytes(), Twist)


def driven(viewer: Any, stream: Stream, data: bytes, twist: Twist) -> None:
    """Command until the robot hears of it: on a busy machine the first commands may be refused as too old."""
    for _ in range(100):
        viewer.send(struct.pack("<BI", 1, 5) + data)
        if (arrival := stream.get(time.monotonic() + 0.2)) is not None:
            break
    assert arrival is not None
    assert robo_messages.decode(arrival.sample.payload.to_bytes(), Twist) == twist


@pytest.mark.parametrize("encoding", ["cdr", "json"])
@pytest.mark.parametrize("schema", ["geometry_msgs/msg/Twist", "geometry_msgs/Twist"])
def test_a_viewer_publishes_and_when_it_is_gone_the_robot_stands(
    served: Any, other: zenoh.Session, encoding: str, schema: str
) -> None:
    twist = Twist(Vector3(x=0.5))
    data = cdr.encoder(Twist)(twist) if encoding == "cdr" else b'{"linear": {"x": 0.5, "y": 0, "z": 0}}'
    with closing(Stream(other, ["r1/cmd_vel_joy"])) as stream:
        with served.viewer() as viewer:
            offered = {"id": 5, "topic": "/r1/cmd_vel_joy", "encoding": encoding, "schemaName": schema}
            viewer.ask("advertise", channels=[offered])
            driven(viewer, stream, data, twist)
        assert [next_twist(stream) for _ in range(3)] == [Twist()] * 3


def test_what_cannot_be_published_is_told(served: Any) -> None:
    with served.viewer() as viewer:
        wrong = [
            {"id": 1, "topic": "/r1/x", "encoding": "cdr", "schemaName": "no_msgs/msg/Such"},
            {"id": 2, "topic": "/r1/x", "encoding": "protobuf", "schemaName": "std_msgs/msg/String"},
            {"id": 3, "topic": "/r1/*", "encoding": "cdr", "schemaName": "std_msgs/msg/String"},
            {"id": 4, "topic": "/@robo/r1", "encoding": "cdr", "schemaName": "std_msgs/msg/String"},
        ]
        viewer.ask("advertise", channels=wrong)
        for part in ("no_msgs/msg/Such", "protobuf", "many topics", "no topic"):
            assert part in viewer.hears("status")["message"]
        viewer.send(struct.pack("<BI", 1, 77) + b"x")
        assert "77" in viewer.hears("status")["message"]
        for said in (b"", b"\x09", b"\x02\x00", b"\x01"):
            viewer.send(said)
            assert "cannot be read" in viewer.hears("status")["message"]
        viewer.socket.send("{")
        assert "cannot be read" in viewer.hears("status")["message"]
        viewer.ask("explode")
        assert "cannot be read" in viewer.hears("status")["message"]


def test_the_graph_shows_who_is_at_which_end(served: Any, other: zenoh.Session) -> None:
    with served.viewer() as viewer:
        with Base(namespace="r1", session=other):
            viewer.until(lambda: viewer.topics.get("/r1/position"))
            viewer.ask("subscribeConnectionGraph")
            said = viewer.hears("connectionGraphUpdate")
            assert {"name": "/r1/position", "publisherIds": ["/r1/base"]} in said["publishedTopics"]
            assert {"name": "/r1/greet", "providerIds": ["/r1/base"]} in said["advertisedServices"]
        gone = viewer.hears("connectionGraphUpdate", lambda one: "/r1/position" in one["removedTopics"])
        assert "/r1/greet" in gone["removedServices"]
        viewer.until(lambda: "/r1/position" not in viewer.topics)


def odometry(x: float, at: int) -> bytes:
    message = Odometry(Header(Time(at), "odom"), "base_link")
    message.pose.pose.position.x = x
    return robo_messages.encode(message)


def test_transforms_and_a_trail_are_made_of_odometry(served: Any, other: zenoh.Session) -> None:
    sender = Sender(other, "r1/odom", "nav/Odometry", QoS.DEFAULT, "/r1/base")
    with served.viewer() as viewer:
        tf, trail = viewer.subscribe("/r1/tf"), viewer.subscribe("/r1/odom_trail")
        assert sender.wait_for_subscriber(20)
        sender.send(odometry(1.0, 1))
        (transform,) = decoded(TFMessage, viewer.next_of(tf)).transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")
        assert transform.transform.translation.x == 1.0
        path = decoded(robo_messages.Path, viewer.next_of(trail))
        assert [pose.pose.position.x for pose in path.poses] == [1.0]
        assert "/r1/odom" in viewer.topics
    sender.close()


def test_messages_of_unknown_types_come_as_json_and_are_told(served: Any, other: zenoh.Session) -> None:
    sender = Sender(other, "r1/secret", "no/Such", QoS.DEFAULT, "/r1/base")
    with served.viewer() as viewer:
        number = viewer.subscribe("/r1/secret")
        channel = viewer.topics["/r1/secret"]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        assert "no/Such" in viewer.hears("status")["message"]
        assert any("/r1/secret" in line for line in served.told)
        assert sender.wait_for_subscriber(20)
        sender.send(msgspec.msgpack.encode({"a": 1.5, "b": [float("nan")]}))
        assert msgspec.json.decode(viewer.next_of(number)) == {"a": 1.5, "b": ["nan"]}
    sender.close()


def test_a_message_that_is_none_is_told_and_left_out(served: Any, base: Base, other: zenoh.Session) -> None:
    with served.viewer() as viewer:
        number = viewer.subscribe("/r1/position")
        eventually(lambda: subscribers(other, "r1/position"), "the bridge subscribes")
        other.put("r1/position", b"\xff", encoding="application/msgpack;geometry/Point")
        assert "/r1/position" in viewer.hears("status")["message"]
        other.put("r1/position", msgspec.msgpack.encode({"data": ""}), encoding="application/msgpack;std/String")
        assert "String" in viewer.hears("status")["message"]
        base.position.publish(Point(1.0))
        assert decoded(Point, viewer.next_of(number)).x == 1.0


def test_the_clock_of_a_simulation_is_the_time_of_messages(served: Any, base: Base, other: zenoh.Session) -> None:
    with served.viewer() as viewer:
        assert "time" not in viewer.hears("serverInfo")["capabilities"]
        sender = Sender(other, "clock", "system/Clock", QoS.DEFAULT, "/r1/simulation")
        viewer.hears("serverInfo", lambda info: "time" in info["capabilities"])
        number = viewer.subscribe("/r1/position")
        assert sender.wait_for_subscriber(20)
        sender.send(robo_messages.encode(Clock(Time(12, 5))))
        viewer.until(lambda: 12 * 10**9 + 5 in viewer.times)
        eventually(lambda: subscribers(other, "r1/position"), "the bridge subscribes")
        base.position.publish(Point(1.0))
        viewer.until(lambda: viewer.messages.get(number))
        assert viewer.messages[number][0][0] == 12 * 10**9 + 5
        sender.close()
        viewer.hears("serverInfo", lambda info: "time" not in info["capabilities"])


@pytest.mark.parametrize("names", [[viewers.PLAIN, viewers.SDK], ["other", viewers.SDK, viewers.PLAIN]])
def test_a_viewer_that_knows_several_protocols_gets_the_one_that_it_names_first(served: Any, names: list[str]) -> None:
    with viewers.client.connect(f"ws://127.0.0.1:{served.port}/", subprotocols=names) as socket:
        assert socket.subprotocol == next(name for name in names if name != "other")


def test_a_viewer_that_knows_none_of_the_protocols_is_refused(served: Any) -> None:
    for names in (None, ["other"]):
        with (
            pytest.raises(exceptions.InvalidStatus) as refused,
            viewers.client.connect(f"ws://127.0.0.1:{served.port}/", subprotocols=names),
        ):
            pass
        assert refused.value.response.status_code == 400


def test_what_is_latched_comes_again_in_a_new_session_and_when_time_goes_back(
    served: Any, base: Base, other: zenoh.Session
) -> None:
    """Viewers forget all then, and ask for nothing: a map would be lost."""
    del base
    with served.viewer() as viewer:
        number = viewer.subscribe("/r1/state")
        assert decoded(String, viewer.next_of(number)) == String("ready")
        sender = Sender(other, "clock", "system/Clock", QoS.DEFAULT, "/r1/simulation")
        viewer.hears("serverInfo", lambda info: "time" in info["capabilities"])
        assert decoded(String, viewer.next_of(number)) == String("ready")
        assert sender.wait_for_subscriber(20)
        for second in (100, 1):
            sender.send(robo_messages.encode(Clock(Time(second))))
            viewer.until(lambda second=second: second * 10**9 in viewer.times)
        assert decoded(String, viewer.next_of(number)) == String("ready")
        sender.close()


class Dozing(Node):
    """Plays a recording, and does not answer for a while."""

    def on_start(self) -> None:
        self.dozes = threading.Event()
        self.dozed = threading.Event()

    @service("get_playback")
    def get_playback(self, _: GetPlayback.Request) -> GetPlayback.Response:
        if self.dozes.is_set():
            self.dozed.set()
            raise ServiceError("later")
        return GetPlayback.Response(Time(100), Time(200), Time(150), 1.0, True)


def test_a_player_that_does_not_answer_once_is_still_there(served: Any, other: zenoh.Session) -> None:
    with served.viewer() as viewer:
        with Dozing(namespace="r1", session=other) as player:
            viewer.hears("serverInfo", lambda info: "playbackControl" in info["capabilities"])
            player.dozes.set()
            assert player.dozed.wait(30)
            player.dozed.clear()
            assert player.dozed.wait(30)  # it is asked again, so that the first one has been judged
            viewer.said.clear()
            viewer.ask("getParameters", parameterNames=[], id="now")
            viewer.hears("parameterValues", lambda one: one.get("id") == "now")
            assert not [said for said in viewer.said if said["op"] == "serverInfo"]
        viewer.hears("serverInfo", lambda info: "playbackControl" not in info["capabilities"])


def test_viewers_are_told_that_the_network_is_lost_and_when_it_is_back(session: zenoh.Session) -> None:
    lost = ["the link to tcp/r1:7447 is lost"]
    with closing(viewers.Served(session, lost=lambda: lost[0])) as served, served.viewer() as viewer:
        said = viewer.hears("status")
        assert ("is lost" in said["message"], said["id"]) == (True, "link")
        with served.viewer() as late:
            assert "is lost" in late.hears("status")["message"]
        lost[0] = ""
        assert viewer.hears("removeStatus")["statusIds"] == ["link"]


def test_where_all_may_look_nobody_drives(session: zenoh.Session, base: Base) -> None:
    del base
    with closing(viewers.Served(session, Settings(port=0, look=True))) as served, served.viewer() as viewer:
        assert "clientPublish" not in viewer.hears("serverInfo")["capabilities"]
        viewer.ask("setParameters", parameters=[{"name": "/r1/base.speed", "value": 2}])
        assert "not to drive" in viewer.hears("status")["message"]


@pytest.mark.parametrize("host", [".foo", "ü..x", "a" * 70])
def test_a_place_that_cannot_be_is_told(session: zenoh.Session, host: str) -> None:
    with pytest.raises(NetworkError, match="--listen says another place"):
        asyncio.run(served_at(session, host))


async def served_at(session: zenoh.Session, host: str) -> None:
    await Server(session, Settings(host=host, port=0)).serve(lambda _: None, asyncio.get_running_loop().create_future())


def control(plays: bool, rate: float, seek: int | None, request: str) -> bytes:
    head = struct.pack("<BBfBQI", 3, 0 if plays else 1, rate, seek is not None, seek or 0, len(request))
    return head + request.encode()


def test_a_viewer_pauses_seeks_and_hurries_who_plays_a_recording(
    served: Any, other: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    with served.viewer() as viewer, served.viewer(subprotocol=viewers.PLAIN) as plain:
        with playing(other, path, paused=True) as running:
            info = viewer.hears("serverInfo", lambda info: "playbackControl" in info["capabilities"])
            begin = info["dataStartTime"]["sec"] * 10**9 + info["dataStartTime"]["nsec"]
            end = info["dataEndTime"]["sec"] * 10**9 + info["dataEndTime"]["nsec"]
            assert bags.START <= begin < end
            assert (
                "playbackControl"
                not in plain.hears("serverInfo", lambda one: "time" in one["capabilities"])["capabilities"]
            )
            viewer.state(lambda state: state[0] == 1)
            middle = begin + 500 * bags.MS
            viewer.send(control(False, 1.0, middle, "seek"))
            assert viewer.state(lambda state: state[4] == "seek")[:4] == (1, middle, 1.0, True)
            viewer.until(lambda: middle in viewer.times)
            viewer.send(control(False, 0.01, None, "slow"))
            assert viewer.state(lambda state: state[4] == "slow")[2] == pytest.approx(0.01)
            viewer.send(control(True, 0.01, None, "play"))
            assert viewer.state(lambda state: state[4] == "play")[0] == 0
            viewer.send(control(True, 0.1, begin, "again"))
            viewer.state(lambda state: state[4] == "again")
            viewer.until(lambda: begin <= viewer.times[-1] < middle)
            seen = len(viewer.times)
            viewer.until(lambda: viewer.times[-1] > begin + 30 * bags.MS)
            assert viewer.times[seen:] == sorted(viewer.times[seen:]), "time never goes back by itself"
            running.player.pause()  # somebody else does
            viewer.state(lambda state: state[0] == 1 and not state[4])
        viewer.hears("serverInfo", lambda info: "playbackControl" not in info["capabilities"])
        assert not plain.frames


def test_a_viewer_that_reads_nothing_holds_up_nobody_and_costs_bounded_memory(
    served: Any, other: zenoh.Session
) -> None:
    sender = Sender(other, "r1/image", "std/String", QoS.DEFAULT, "/r1/camera")
    picture = robo_messages.encode(String("x" * 1_000_000))
    with served.narrow_viewer() as stalled, served.viewer() as viewer:
        stalled.subscribe("/r1/image")
        number = viewer.subscribe("/r1/image")
        assert sender.wait_for_subscriber(20)
        for _ in range(30):
            sender.send(picture)
            viewer.next_of(number)
        told = stalled.hears("status", lambda one: "too slow" in one["message"])["message"]
        assert told.endswith("older messages are left out, most of /r1/image"), "the same each time: viewers list each"
    sender.close()


def test_pages_of_strangers_are_refused(served: Any, session: zenoh.Session) -> None:
    for origin in ("http://evil.example", "null", "http://localhost.evil.example", "https://127.0.0.1.evil.example"):
        with pytest.raises(exceptions.InvalidStatus) as refused, served.viewer(origin=origin):
            pass
        assert refused.value.response.status_code == 403
        assert f"--origin {origin}" in served.told[-1]
    for origin in ("https://app.foxglove.dev", "file://", "http://localhost:8080", "http://[::1]:3000"):
        with served.viewer(origin=origin) as viewer:
            viewer.hears("serverInfo")
    with (
        closing(viewers.Served(session, Settings(port=0, origins=("http://viewer.example",)))) as second,
        second.viewer(origin="http://viewer.example") as viewer,
    ):
        viewer.hears("serverInfo")


@pytest.fixture
def guarded(session: zenoh.Session) -> Iterator[Any]:
    with closing(viewers.Served(session, Settings(port=0, tokens=TOKENS))) as found:
        yield found


def test_without_a_token_nobody_connects_and_guesses_are_slowed_down(guarded: Any) -> None:
    codes = []
    for path in ["/", *(f"/?token=guess{number}" for number in range(8))]:
        with pytest.raises(exceptions.InvalidStatus) as refused, guarded.viewer(path):
            pass
        codes.append(refused.value.response.status_code)
    assert codes == [401] * 7 + [429] * 2


def test_who_may_only_look_changes_nothing(guarded: Any, base: Base) -> None:
    del base
    with guarded.viewer(f"/?token={TOKENS.view}") as viewer:
        info = viewer.hears("serverInfo")
        assert not {"clientPublish", "services", "playbackControl"} & {*info["capabilities"]}
        number = viewer.subscribe("/r1/state")
        assert decoded(String, viewer.next_of(number)) == String("ready")
        assert not viewer.services
        viewer.ask("setParameters", parameters=[{"name": "/r1/base.speed", "value": 2}])
        offered = {"id": 5, "topic": "/r1/cmd_vel", "encoding": "cdr", "schemaName": "geometry_msgs/msg/Twist"}
        viewer.ask("advertise", channels=[offered])
        for _ in range(2):
            assert "not to drive" in viewer.hears("status")["message"]
        viewer.ask("getParameters", parameterNames=["/r1/base.speed"], id="one")
        assert viewer.hears("parameterValues")["parameters"][0]["value"] == 1.0
    with guarded.viewer(f"/?token={TOKENS.drive}", origin="http://viewer.example") as viewer:
        assert "clientPublish" in viewer.hears("serverInfo")["capabilities"]


def test_one_robot_alone_is_offered_with_what_all_share(session: zenoh.Session, other: zenoh.Session) -> None:
    senders = [Sender(other, key, "std/String", QoS.DEFAULT, "/r1/base") for key in ("r1/state", "r2/state", "tf")]
    with (
        closing(viewers.Served(session, covers=lambda key: key.startswith("r1/"))) as served,
        served.viewer() as viewer,
    ):
        viewer.until(lambda: len(viewer.topics) == 2)
        assert {*viewer.topics} == {"/r1/state", "/tf"}
    for sender in senders:
        sender.close()


def test_of_one_robot_alone_nobody_drives_sets_or_follows_another(
    session: zenoh.Session, other: zenoh.Session, base: Base
) -> None:
    with (
        closing(viewers.Served(session, covers=lambda key: key.startswith("r1/"))) as served,
        Base(namespace="r2", session=other) as second,
        served.viewer() as viewer,
    ):
        offered = {"id": 5, "topic": "/r2/cmd_vel_joy", "encoding": "json", "schemaName": "geometry_msgs/Twist"}
        viewer.ask("advertise", channels=[offered])
        assert "not of the robot" in viewer.hears("status")["message"]
        viewer.ask("setParameters", parameters=[{"name": "/r2/base.speed", "value": 3.0}])
        assert "not of the robot" in viewer.hears("status", lambda one: "parameter" not in one["message"])["message"]
        viewer.ask("getParameters", parameterNames=["/r2/base.speed", "/r1/base.speed"], id="both")
        said = viewer.hears("parameterValues", lambda one: one.get("id") == "both")["parameters"]
        assert {one["name"]: one.get("value") for one in said} == {"/r2/base.speed": None, "/r1/base.speed": 1.0}
        viewer.ask("subscribeParameterUpdates", parameterNames=[])
        eventually(lambda: subscribers(other, "r1/parameter_events"), "the bridge listens")
        second.set_parameters(speed=4.0)
        base.set_parameters(speed=2.0)
        assert viewer.hears("parameterValues", lambda one: "id" not in one and one["parameters"][0].get("value"))[
            "parameters"
        ] == [{"name": "/r1/base.speed", "value": 2.0, "type": "float64"}]


def test_it_ends_at_once_while_viewers_are_there(session: zenoh.Session) -> None:
    served = viewers.Served(session)
    with served.viewer() as viewer:
        viewer.hears("serverInfo")
        served.close()
        eventually(lambda: viewer.socket.state.name == "CLOSED", "the socket is closed")


def test_a_bridge_that_ends_leaves_a_robot_that_stands(session: zenoh.Session, other: zenoh.Session) -> None:
    served = viewers.Served(session)
    with closing(Stream(other, ["r1/cmd_vel_joy"])) as stream, served.viewer() as viewer:
        offered = {"id": 5, "topic": "/r1/cmd_vel_joy", "encoding": "json", "schemaName": "geometry_msgs/msg/Twist"}
        viewer.ask("advertise", channels=[offered])
        driven(viewer, stream, b'{"linear": {"x": 0.5}}', Twist(Vector3(x=0.5)))
        served.close()
        assert [next_twist(stream) for _ in range(3)] == [Twist()] * 3


def test_a_clock_before_all_times_ends_nothing(served: Any, base: Base, other: zenoh.Session) -> None:
    sender = Sender(other, "clock", "system/Clock", QoS.DEFAULT, "/r1/simulation")
    with served.viewer() as viewer:
        number = viewer.subscribe("/r1/position")
        assert sender.wait_for_subscriber(20)
        sender.send(robo_messages.encode(Clock(Time(-5))))
        viewer.until(lambda: 0 in viewer.times)
        eventually(lambda: subscribers(other, "r1/position"), "the bridge subscribes")
        base.position.publish(Point(1.0))
        assert decoded(Point, viewer.next_of(number)).x == 1.0
    sender.close()


def test_there_is_room_for_so_many_viewers(served: Any) -> None:
    from robo.bridges.foxglove.server import _MOST_CLIENTS

    with ExitStack() as stack:
        for _ in range(_MOST_CLIENTS):
            stack.enter_context(served.viewer()).hears("serverInfo")
        with pytest.raises(exceptions.InvalidStatus) as refused, served.viewer():
            pass
        assert refused.value.response.status_code == 503
