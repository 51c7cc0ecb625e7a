"""The parts of the bridge to viewers that know no network."""

import asyncio
import struct
import threading
from collections.abc import Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.bridges.foxglove import protocol
from robo.bridges.foxglove.calls import by_node, message_from, shown_parameter
from robo.bridges.foxglove.client import Client, Subscription
from robo.bridges.foxglove.drivers import ENDED, PAUSE, Drivers
from robo.bridges.foxglove.layouts import VIEWERS, layout_of
from robo.bridges.foxglove.offered import Ends, Numbers, graph_changes, offer, robots_drawn_into_one
from robo.bridges.foxglove.outbox import MOST_BYTES_OF_ONE, MOST_BYTES_OF_WORDS, MOST_OF_ONE, MOST_WORDS, Full, Outbox
from robo.bridges.foxglove.playback import Place
from robo.bridges.foxglove.protocol import (
    Call,
    Control,
    GetParameters,
    Offered,
    Publish,
    Subscribe,
    Unreadable,
    Wanted,
)
from robo.bridges.foxglove.publications import Publications, type_of
from robo.bridges.foxglove.publishing import Publishing
from robo.bridges.foxglove.server import is_viewer
from robo.bridges.foxglove.trail import MOST_POSES, STEP, Trail
from robo.dashboard.lease import ZEROS
from robo.errors import MessageError, UsageError
from robo.wire.keys import EndpointKind, EndpointToken
from robo.wire.qos import QoS
from robo_messages import Header, Odometry, SetBool, Time, Trigger, Twist, Vector3


def test_words_and_bytes_of_clients_are_read() -> None:
    said = '{"op":"subscribe","subscriptions":[{"id":1,"channelId":2}]}'
    assert protocol.read(said) == Subscribe([Wanted(1, 2)])
    assert protocol.read('{"op":"getParameters","id":null}') == GetParameters([], None)
    assert protocol.read(b"\x01" + struct.pack("<I", 7) + b"abc") == Publish(7, b"abc")
    assert protocol.read(b"\x02" + struct.pack("<III", 1, 2, 3) + b"cdrxyz") == Call(1, 2, "cdr", b"xyz")
    frame = b"\x03" + struct.pack("<BfBQI", 1, 2.0, 1, 5, 2) + b"id"
    assert protocol.read(frame) == Control(False, 2.0, 5, "id")


@given(
    st.one_of(st.text(), st.binary(), st.sampled_from([b"\x02", b"\x03"]).flatmap(lambda b: st.binary().map(b.__add__)))
)
def test_whatever_a_client_says_it_is_read_or_refused(said: str | bytes) -> None:
    with suppress(Unreadable):
        protocol.read(said)


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("put"), st.integers(1, 4), st.integers(0, 3_000)),
            st.tuples(st.just("take"), st.just(0), st.just(0)),
            st.tuples(st.just("forget"), st.integers(1, 4), st.just(0)),
        ),
        max_size=300,
    )
)
def test_of_each_subscription_the_newest_come_in_order_in_bounded_memory(steps: list[tuple[str, int, int]]) -> None:
    outbox = Outbox(most_bytes=10_000)
    put: dict[int, list[int]] = {}
    taken: dict[int, list[int]] = {}
    for time, (what, number, size) in enumerate(steps):
        if what == "put":
            outbox.put(number, time, b"x" * size)
            put.setdefault(number, []).append(time)
        elif what == "forget":
            outbox.forget(number)
            put.pop(number, None), taken.pop(number, None)
        elif (frame := outbox.take()) is not None:
            of, at = _head(frame)
            taken.setdefault(of, []).append(at)
        assert outbox.waiting <= 10_000
    while (frame := outbox.take()) is not None:
        of, at = _head(frame)
        taken.setdefault(of, []).append(at)
    assert outbox.waiting == 0
    for number, times in put.items():
        found = taken[number]
        assert found == sorted(set(found))
        assert found[-1] == times[-1], "the newest always comes"
        assert len(found) + outbox.left_out[number] == len(times), "what does not come is counted"


def _head(frame: str | bytes) -> tuple[int, int]:
    assert isinstance(frame, bytes)
    found: tuple[int, int] = struct.unpack_from("<IQ", frame, 1)
    return found


def test_a_client_that_takes_nothing_for_long_fills_no_memory() -> None:
    outbox = Outbox()
    for time in range(20 * MOST_OF_ONE):
        outbox.put(1, time, b"x")
    assert len(outbox._order) <= 2 * MOST_OF_ONE + 1_001
    outbox.put(2, 0, b"x" * (2 * MOST_BYTES_OF_ONE))  # one waits however large it is
    outbox.put(2, 1, b"x" * (2 * MOST_BYTES_OF_ONE))
    assert outbox.waiting <= 2 * MOST_BYTES_OF_ONE + MOST_OF_ONE
    for _ in range(MOST_WORDS):
        outbox.say("word")
    with pytest.raises(Full):
        outbox.say("word")


def test_a_client_that_takes_no_words_fills_no_memory() -> None:
    outbox = Outbox()
    outbox.say(word := "x" * MOST_BYTES_OF_WORDS)  # one is said however long it is
    with pytest.raises(Full):
        outbox.say("word")
    assert outbox.take() == word
    outbox.say("word")


def told(client: Client) -> list[dict[str, object]]:
    return [msgspec.json.decode(said) for said in iter(client.outbox.take, None) if isinstance(said, str)]


def test_a_slow_client_is_told_once_and_once_more_when_it_is_well_again() -> None:
    async def run() -> list[list[dict[str, object]]]:
        drivers = Drivers()
        publications = Publications(cast(Any, None), "viewer 1", drivers, lambda _: True)
        client = Client("viewer 1", publications, drives=True, knows_playback=True)
        offered = offer([end("pub", "r1/a", "std/String")], Numbers())
        client.subscriptions[1] = Subscription(next(iter(offered.topics)))
        said = []
        for now in (0.0, 2.0, 4.0, 20.0, 40.0):
            if now < 5.0:
                for at in range(2 * MOST_OF_ONE):
                    client.put(1, at, b"x")
            client.tell_left_out(offered, now)
            said.append(told(client))
        return said

    first, *others = asyncio.run(run())
    assert str(first[0]["message"]).endswith("most of /r1/a")
    assert others == [[], [], [{"op": "removeStatus", "statusIds": ["left_out"]}], []]


def test_words_come_first_and_of_times_the_last() -> None:
    outbox = Outbox()
    outbox.put(1, 1, b"message")
    outbox.say_newest("time", b"1")
    outbox.say_newest("time", b"2")
    outbox.say("word")
    frames = [outbox.take() for _ in range(4)]
    assert frames[:2] == ["word", b"2"]
    assert frames[2:] == [protocol.message(1, 1, b"message"), None]


def end(kind: EndpointKind, topic: str, type_name: str, node: str = "base", qos: QoS = QoS.DEFAULT) -> EndpointToken:
    return EndpointToken("r1", node, kind, type_name, qos, topic)


def test_topics_keep_their_numbers_and_get_others_where_their_type_is_another() -> None:
    numbers = Numbers()
    first = offer([end("pub", "r1/a", "std/String"), end("pub", "r1/b", "std/Bool")], numbers)
    again = offer([end("pub", "r1/b", "std/Bool")], numbers)
    other = offer([end("pub", "r1/b", "std/String")], numbers)
    assert {topic.key: number for number, topic in first.topics.items()}["r1/b"] in again.topics
    assert not {*other.topics} & {*again.topics}


def test_what_is_hidden_of_others_or_unknown_is_not_offered_as_if_it_were_known() -> None:
    tokens = [
        end("pub", "r1/fibonacci/_action/status", "action/GoalStatusArray"),
        end("pub", "r2/odom", "nav/Odometry"),
        end("pub", "tf", "tf2/TFMessage"),
        end("pub", "r1/odom", "nav/Odometry"),
        end("pub", "r1/secret", "no/Such"),
        end("srv", "r1/greet", "no/Such"),
        end("srv", "r1/lights", "std/SetBool"),
    ]
    found = offer(tokens, Numbers(), lambda key: key.startswith("r1/"))
    topics = {topic.key: topic for topic in found.topics.values()}
    assert {*topics} == {"tf", "r1/odom", "r1/odom_trail", "r1/tf", "r1/secret"}
    assert topics["r1/tf"].sources == ("r1/odom",)
    assert topics["r1/secret"].channel.encoding == "json"
    assert [one.key for one in found.services.values()] == ["r1/lights"]
    assert {*found.unknown} == {"/r1/secret", "/r1/greet"}


def test_transforms_that_somebody_publishes_are_a_source_beside_odometry() -> None:
    found = offer([end("pub", "r1/odom", "nav/Odometry"), end("pub", "r1/tf", "tf2/TFMessage", "arm")], Numbers())
    (tf,) = (topic for topic in found.topics.values() if topic.key == "r1/tf")
    assert tf.sources == ("r1/tf", "r1/odom")


_NAMES = st.dictionaries(st.sampled_from(["/a", "/b", "/c"]), st.sampled_from([("/n",), ("/m", "/n")]))
_ENDS = st.builds(Ends, _NAMES, _NAMES, _NAMES)


@given(st.lists(_ENDS, max_size=5))
def test_a_viewer_that_follows_the_changes_of_the_graph_knows_the_graph(states: list[Ends]) -> None:
    """It keeps what it was told, and forgets topics and services that are gone, as viewers do."""
    known: tuple[dict[str, tuple[str, ...]], ...] = ({}, {}, {})
    before: Ends | None = None
    for after in states:
        changes = graph_changes(before, after)
        assert (changes is None) == (after == before)
        if changes is not None:
            said = msgspec.json.decode(msgspec.json.encode(changes))
            rows = zip(
                known, ("published", "subscribed", "advertised"), ("publisher", "subscriber", "provider"), strict=True
            )
            for kept, what, who in rows:
                of = "Services" if what == "advertised" else "Topics"
                kept.update({one["name"]: tuple(one[f"{who}Ids"]) for one in said[f"{what}{of}"]})
                for gone in said["removedServices" if what == "advertised" else "removedTopics"]:
                    kept.pop(gone, None)
        before = after
        assert [{name: nodes for name, nodes in kept.items() if nodes} for kept in known] == list(after)


def odometry(x: float, at: int = 0, frame: str = "odom") -> Odometry:
    message = Odometry(Header(Time(at), frame), "base_link")
    message.pose.pose.position.x = x
    return message


def driven(trail: Trail, places: Iterator[tuple[float, int]]) -> list[list[float]]:
    """The paths that are told, a second apart."""
    paths = [trail.take(odometry(x, at), at * 10**9) for x, at in places]
    return [[pose.pose.position.x for pose in path.poses] for path in paths if path is not None]


def test_a_trail_has_a_pose_each_few_centimetres_and_an_end() -> None:
    trail = Trail()
    assert driven(trail, iter([(0.0, 1), (STEP / 2, 2), (STEP, 3)])) == [[0.0], [0.0], [0.0, STEP]]
    path = driven(trail, ((STEP * number, 3 + number) for number in range(2, 2 * MOST_POSES)))[-1]
    assert len(path) == MOST_POSES
    assert driven(trail, iter([(0.0, 1)])) == [[0.0]], "time has gone back: another one"
    assert trail.take(odometry(float("nan"), 9), 10**12) is None


def test_a_trail_goes_through_no_wall() -> None:
    trail = Trail()
    assert driven(trail, iter([(0.0, 1), (0.8, 2)])) == [[0.0], [0.0, 0.8]]
    assert driven(trail, iter([(2.5, 60)])) == [[2.5]], "nobody has looked"
    assert driven(trail, iter([(20.0, 61)])) == [[20.0]], "the pose was set anew"
    assert driven(trail, iter([(22.0, 62)])) == [[20.0, 22.0]]


def test_robots_that_a_panel_draws_into_one_are_named() -> None:
    one = [end("pub", "r1/odom", "nav/Odometry"), end("pub", "tf", "tf2/TFMessage")]
    assert robots_drawn_into_one(offer(one, Numbers())) == []
    two = [*one, end("pub", "r2/tf", "tf2/TFMessage")]
    assert robots_drawn_into_one(offer(two, Numbers())) == ["r1", "r2"]


def test_pages_of_viewers_and_of_this_machine_may_connect_and_no_others() -> None:
    for origin in (None, "https://app.foxglove.dev", "file://", "http://localhost", "http://127.0.0.1:8080"):
        assert is_viewer(origin)
    for origin in (
        "",
        "null",
        "http://evil.example",
        "https://app.foxglove.dev.evil.example",
        "http://[",
        "ftp://localhost",
    ):
        assert not is_viewer(origin)
        assert is_viewer(origin, ("*",))
    assert is_viewer("http://viewer.example", ("http://viewer.example",))


def test_one_viewer_drives_and_each_is_told_to_stand_once() -> None:
    drivers = Drivers()
    assert drivers.command("r1/cmd_vel", "one", 0.0) == ""
    assert drivers.command("r1/cmd_vel", "two", 0.5) == "one drives"
    assert not drivers.is_to_stand("r1/cmd_vel", "one", 0.1)
    assert not drivers.is_over("r1/cmd_vel", "one")
    looks = [0.6 + 0.05 * number for number in range(ZEROS + 1)]
    assert [drivers.is_to_stand("r1/cmd_vel", "one", now) for now in looks] == [True] * ZEROS + [False]
    assert drivers.is_over("r1/cmd_vel", "one")
    assert drivers.command("r1/cmd_vel", "two", 1.5) == ""
    assert not drivers.is_to_stand("r1/cmd_vel", "one", 5.0), "that is another one's now"
    drivers.forget("r1/cmd_vel")
    drivers.leave("r1/cmd_vel", "two")
    assert drivers.is_to_stand("r1/cmd_vel", "two", 1.5)


def held(drivers: Drivers, at: float, *, delay: float = 0.0, key: str = "r1/cmd_vel") -> str:
    """Why a command is refused that comes at a time, and may have been said a while before."""
    drivers.hold(key, "one", at - delay, at)
    return drivers.command(key, "one", at)


def test_a_grip_that_a_stop_has_ended_counts_no_more_until_it_was_let_go() -> None:
    drivers = Drivers()
    for key in ("r1/cmd_vel", "r1/arm/cmd_vel", "r10/cmd_vel"):
        assert held(drivers, 0.0, key=key) == ""
    drivers.end("r1", 0.1)
    assert drivers.is_to_stand("r1/cmd_vel", "one", 0.1)
    assert held(drivers, 0.2, key="r10/cmd_vel") == ""
    assert held(drivers, 0.2, key="r1/arm/cmd_vel") == ENDED
    assert [held(drivers, at) for at in (0.2, 1.2, 2.2)] == [ENDED] * 3, "a pad that speaks once a second is held"
    assert held(drivers, 2.2 + PAUSE + 0.1, delay=0.2) == ENDED, "a link that was held up is no pause"
    assert held(drivers, 2.4 + 2 * PAUSE) == ""


def test_a_grip_that_may_have_begun_before_a_stop_is_ended_by_it() -> None:
    drivers = Drivers()
    drivers.end("r1", 1.0)
    assert held(drivers, 1.1, delay=0.2) == ENDED
    assert held(drivers, 1.1, delay=0.2, key="r2/cmd_vel") == ""
    drivers.end("", 2.0)
    assert held(drivers, 2.1, key="r2/cmd_vel") == ENDED
    assert held(drivers, 2.1, delay=0.05, key="r3/cmd_vel") == ""


class Panic(BaseException):
    """As Zenoh's, which is no Exception."""


class Panicking:
    """Publications of which one panics as the network does."""

    drives = False
    closed = False

    def stand_where_nothing_is_said(self) -> None:
        """Nothing is driven."""

    def publish(self) -> None:
        raise Panic("of Zenoh's")

    def close(self) -> None:
        self.closed = True


def test_a_panic_of_the_network_ends_no_publishing_and_keeps_no_zeros() -> None:
    publications, told, done = Panicking(), list[str](), threading.Event()
    publishing = Publishing(cast(Any, publications), told.append)
    assert publishing.do(publications.publish)
    assert publishing.do(done.set)
    assert done.wait(20)
    assert "of Zenoh's" in told[0]
    over = publishing.close()
    assert over is not None
    over.result(20)
    assert publications.closed


def test_a_topic_that_panics_as_the_client_goes_keeps_no_other_from_its_zeros() -> None:
    closed = list[str]()

    class Ending:
        def __init__(self, key: str) -> None:
            self.key = key

        def close(self) -> None:
            closed.append(self.key)
            raise Panic("of Zenoh's")

    publications = Publications(cast(Any, None), "viewer 1", Drivers(), lambda _: True)
    for number, key in enumerate(("r1/cmd_vel", "r2/cmd_vel")):
        publications._of[number] = cast(Any, SimpleNamespace(sender=Ending(key), key=key))
    publications.close()
    assert closed == ["r1/cmd_vel", "r2/cmd_vel"]


def test_a_topic_whose_name_would_end_the_process_is_refused() -> None:
    publications = Publications(cast(Any, None), "viewer 1", Drivers(), lambda _: True)
    with pytest.raises(MessageError, match="200 characters at most"):
        publications.add(Offered(1, f"/{'x' * 60_000}/cmd_vel", "json", "geometry_msgs/Twist"))


@pytest.mark.parametrize("name", ["geometry_msgs/msg/Twist", "geometry_msgs/Twist", "geometry/Twist"])
def test_viewers_name_types_as_they_like(name: str) -> None:
    assert type_of(name) is Twist


@pytest.mark.parametrize("name", ["", "Twist", "no_msgs/msg/Such", "geometry_msgs/msg/", "a/b/c"])
def test_a_type_that_is_not_known_is_told(name: str) -> None:
    with pytest.raises(MessageError, match="robo interface list"):
        type_of(name)


def test_requests_of_both_encodings_are_read_or_refused() -> None:
    assert message_from(Trigger.Request, "cdr", b"") == Trigger.Request()
    assert message_from(Twist, "json", b'{"linear": {"x": 1}}') == Twist(Vector3(x=1.0))
    for encoding, data in (("cdr", b"\x00"), ("json", b"{"), ("json", b'{"data": "yes"}'), ("ros1", b"")):
        with pytest.raises(MessageError):
            message_from(SetBool.Request, encoding, data)


def test_parameters_are_named_by_their_node() -> None:
    assert by_node(["/r1/base.a.b", "r1/base.c"]) == {"/r1/base": ["a.b", "c"]}
    assert shown_parameter("/r1/base", "speed", 1, "float").type == "float64"
    assert (
        msgspec.json.encode(shown_parameter("/r1/base", "name", "x", "str")) == b'{"name":"/r1/base.name","value":"x"}'
    )


def test_a_player_that_goes_on_as_it_did_has_not_jumped() -> None:
    second = 10**9
    place = Place(0, 100 * second, 10 * second, 2.0, False, 0)
    assert place.at(5 * second) == 20 * second
    assert place._replace(position=20 * second, asked=5 * second).continues(place)
    assert not place._replace(position=25 * second, asked=5 * second).continues(place)
    assert not place._replace(paused=True).continues(place)
    assert place.at(500 * second) == 100 * second


def test_layouts_are_of_the_robot_that_is_named() -> None:
    for viewer in VIEWERS:
        text = layout_of(viewer, "r1")
        assert "my_robot" not in text
        assert '"/r1/scan"' in text
        assert '"/my_robot/scan"' in layout_of(viewer)
    with pytest.raises(UsageError, match="lichtblick"):
        layout_of("lichtblik")


def test_layouts_of_both_viewers_differ_by_the_name_of_titles_alone() -> None:
    """By which Lichtblick 1.29 and Foxglove know them."""
    foxglove, lichtblick = map(layout_of, ("foxglove", "lichtblick"))
    assert foxglove.replace('"foxglovePanelTitle"', '"lichtblickPanelTitle"') == lichtblick
    assert lichtblick.count("lichtblickPanelTitle") == 5
