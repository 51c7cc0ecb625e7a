"""A recording is played on a network: what arrives is what was recorded, whoever pauses, jumps or comes late."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

import robo_messages
from robo import bag
from robo.bag.types import nothing, topic_of
from robo.errors import DamagedBag, RoboError, ServiceError
from robo.interfaces import cdr
from robo.node.services import ServiceClient, service_token
from robo.recording.play.outputs import ClockOutput, Outputs
from robo.recording.play.player import Player
from robo.recording.play.services import PlayerServices
from robo.recording.play.tape import BagTape, Window
from robo.recording.play.topics import Choice, select
from robo.recording.recorder import Recorder
from robo.recording.selection import Selection
from robo.samples.publishing import Audience, Sender
from robo.wire import codec
from robo.wire.discovery import tokens
from robo.wire.latched import LatchedSubscriber
from robo.wire.network import Network
from robo.wire.qos import QoS
from robo.wire.session import close_session, open_session
from robo_messages import (
    Clock,
    GetPlayback,
    Header,
    IsPaused,
    LaserScan,
    Seek,
    SetRate,
    String,
    TFMessage,
    Time,
    TransformStamped,
    Trigger,
    Twist,
)
from robo_services.bag_player import BagPlayer
from tests import bags
from tests.bags import MS, START
from tests.plain import hear, samples, sent, so_far
from tests.support import PATIENCE, eventually

pytestmark = pytest.mark.timeout(120)

NODE = "/r2/bag_player"


@pytest.fixture
def tool(session: zenoh.Session, endpoint: str) -> Iterator[zenoh.Session]:
    """A client of the meeting point, as the command line is."""
    del session
    opened = open_session(Network(mode="client", connect=(endpoint,)))
    yield opened
    close_session(opened)


class Running:
    """A player in a thread of its own."""

    def __init__(self, player: Player, tape: BagTape) -> None:
        self.player = player
        self.tape = tape
        self.error: BaseException | None = None
        self.complete = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.complete = self.player.run()
        except BaseException as error:
            self.error = error

    def wait(self) -> None:
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


@contextmanager
def playing(
    session: zenoh.Session,
    path: Path,
    choice: Choice | None = None,
    window: Window | None = None,
    *,
    order: Any = "arrived",
    clock: bool = False,
    find: Any = None,
    **how: Any,
) -> Iterator[Running]:
    more = {} if find is None else {"find": find}
    with bag.open(path, **more) as recording:
        chosen = select(recording.topics, choice or Choice(robot="r2"), str(path))
        tape = BagTape(recording, chosen.played, order, window)
        with closing(Outputs(session, chosen.played, NODE)) as outputs:
            teller = ClockOutput(session, NODE) if clock else None
            player = Player(tape, outputs, clock=teller, **how)
            try:
                with closing(PlayerServices(session, player, NODE, player.stop)):
                    running = Running(player, tape)
                    yield running
                    player.stop()
                    running.wait()
            finally:
                player.close()
                if teller is not None:
                    teller.close()


def recorded(path: Path, robot: str = "r2", find: Any = None, **which: Any) -> list[tuple[str, bytes]]:
    """Keys and messages, in order: what has to arrive."""
    found = []
    with bag.open(path, **({} if find is None else {"find": find})) as opened:
        for message in opened.messages(**which):
            value = message.value
            payload = value if isinstance(value, bytes) else robo_messages.encode(value)
            found.append((f"{robot}/{message.topic.name.removeprefix('r1/')}", payload))
    return found


def told(sample: zenoh.Sample) -> tuple[str, bytes]:
    return str(sample.key_expr), sample.payload.to_bytes()


def test_all_arrives_in_order_as_it_was_with_the_time_of_now(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    heard = hear(session, "r2/**")
    begin = time.time_ns()
    with playing(tool, path) as running:
        running.wait()
        assert running.complete
    found = samples(heard, 122)
    assert [told(sample) for sample in found] == recorded(path)
    assert begin <= sent(found[0]) <= sent(found[-1]) <= time.time_ns()
    assert sent(found[-1]) >= begin + 991 * MS, "no message came too soon"
    by_topic: dict[str, list[int]] = {}
    for sample in found:
        assert sample.attachment is not None
        stamp = codec.unpack_attachment(sample.attachment.to_bytes())
        assert stamp is not None
        if str(sample.key_expr) != "r2/tf_static":  # which two nodes have said
            by_topic.setdefault(str(sample.key_expr), []).append(stamp.sequence_number)
    assert all(numbers == list(range(1, len(numbers) + 1)) for numbers in by_topic.values())
    types = {str(sample.key_expr): str(sample.encoding) for sample in found}
    assert types["r2/scan"] == "application/msgpack;sensor/LaserScan"
    scan = next(sample for sample in found if str(sample.key_expr) == "r2/scan")
    stamp_within = robo_messages.decode(scan.payload.to_bytes(), LaserScan).header.stamp
    assert stamp_within.to_nanoseconds() == START, "the stamps of then"


def test_a_record_of_what_is_played_is_the_same_recording(
    tool: zenoh.Session, other: zenoh.Session, tmp_path: Path
) -> None:
    path, again = tmp_path / "drive.mcap", tmp_path / "again.mcap"
    bags.drive(path)
    counts = {"r1/cmd_vel": 100, "r1/odom": 10, "r1/scan": 10, "r1/tf_static": 2}
    recorder = Recorder(other, again, Selection(counts), tell=lambda _: None)

    def received() -> dict[str, int]:
        return {one.topic: one.received for one in recorder.status().topics if one.topic in counts}

    try:
        with playing(tool, path, Choice(), paused=True) as running:
            waiting = Audience(tool, ["r1/cmd_vel"])
            assert waiting.wait(PATIENCE)
            waiting.close()
            running.player.resume()
            running.wait()
            eventually(lambda: received() == counts, f"all of {counts}")
    finally:
        recorder.stop()
    with bag.open(path) as one, bag.open(again) as two:
        for name in counts:
            assert [message.data for message in one.messages(name)] == [message.data for message in two.messages(name)]
            assert one.topics[name].qos.latched == two.topics[name].qos.latched


def test_as_fast_as_it_goes_a_slow_receiver_that_wants_all_gets_all(
    tool: zenoh.Session, other: zenoh.Session, tmp_path: Path
) -> None:
    count = 3_000
    path = tmp_path / "many.mcap"
    scan = cdr.encoder(LaserScan)(LaserScan(ranges=[1.0] * 360))
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        number = recording.topic(topic_of("scan", LaserScan))
        for at in range(count):
            recording.write(number, scan, START + at * 100 * MS, START, at + 1)
    slow = other.declare_subscriber("r2/scan", zenoh.handlers.FifoChannel(4))
    waiting = Audience(tool, ["r2/scan"])
    assert waiting.wait(PATIENCE)
    waiting.close()
    with playing(tool, path, rate=0.0) as running:
        eventually(lambda: running.player.played > 10, "it has begun")
        for number in range(1, count + 1):
            if number % 500 == 0:
                threading.Event().wait(0.05)
            attachment = slow.recv().attachment
            assert attachment is not None
            stamp = codec.unpack_attachment(attachment.to_bytes())
            assert stamp is not None
            assert stamp.sequence_number == number
        running.wait()
        assert running.complete
        assert running.player.state.position == running.tape.end


def late(session: zenoh.Session, key: str, count: int, depth: int = 1) -> list[zenoh.Sample]:
    """What somebody gets who comes later."""
    subscriber = LatchedSubscriber(session, key, depth, 100)
    found: list[zenoh.Sample] = []
    end = time.monotonic() + PATIENCE
    try:
        while len(found) < count and time.monotonic() < end:
            sample = subscriber.handler.try_recv()
            if sample is not None:
                found.append(sample)
            else:
                time.sleep(0.005)
    finally:
        subscriber.undeclare()
    return found


def latched_drive(path: Path) -> None:
    """Two nodes say static transforms; a floor is said at 0, 0.4 and 0.8 s; commands go on for a second."""
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        static = recording.topic(topic_of("r1/tf_static", TFMessage, QoS.LATCHED))
        floor = recording.topic(topic_of("r1/floor", String, QoS.LATCHED))
        commands = recording.topic(topic_of("r1/cmd_vel", Twist))
        for source in ("base", "laser"):
            message = TFMessage([TransformStamped(Header(frame_id="base_link"), source)])
            recording.write(static, cdr.encoder(TFMessage)(message), START, START, 1, source)
        for number in range(100):
            at = START + number * 10 * MS
            if number % 40 == 0:
                recording.write(floor, cdr.encoder(String)(String(f"{number}")), at, at, number // 40 + 1, "lift")
            recording.write(commands, bags.twist(number), at, at, number + 1)


def floors(found: Sequence[zenoh.Sample]) -> list[str]:
    return [robo_messages.decode(sample.payload.to_bytes(), String).data for sample in found]


def test_who_comes_late_has_what_is_latched_of_each_node_that_said_it(
    session: zenoh.Session, tool: zenoh.Session, other: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "latched.mcap"
    latched_drive(path)
    with playing(tool, path, window=Window(start="0.5"), paused=True) as running:
        eventually(lambda: running.player.played == 3, "what is latched is said though it stands")
        found = late(other, "r2/tf_static", 2)
        frames = {
            one.child_frame_id
            for sample in found
            for one in robo_messages.decode(sample.payload.to_bytes(), TFMessage).transforms
        }
        assert frames == {"base", "laser"}
        assert floors(late(other, "r2/floor", 1)) == ["40"]
        heard = hear(session, "r2/floor")
        running.player.seek(START + 900 * MS)
        assert floors(samples(heard)) == ["80"]
        running.player.seek(START + 100 * MS)
        assert running.player.state.position == START + 500 * MS, "it stays in its window"
        assert floors(samples(heard)) == ["40"]


def test_by_publish_times_what_was_latched_long_before_is_no_beginning(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "published.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        floor = recording.topic(topic_of("r1/floor", String, QoS.LATCHED))
        commands = recording.topic(topic_of("r1/cmd_vel", Twist))
        recording.write(floor, cdr.encoder(String)(String("2")), START, START - 10**13, 1)
        for number, published in enumerate([2, 1, 0, 3]):  # which have overtaken each other on their way
            recording.write(commands, bags.twist(published), START + number * MS, START + published * MS, published + 1)
    heard = hear(session, "r2/**")
    with playing(tool, path, order="published") as running:
        assert (running.tape.begin, running.tape.end) == (START, START + 3 * MS)
        running.wait()
    first, *rest = samples(heard, 5)
    assert floors([first]) == ["2"]
    decoded = [robo_messages.decode(sample.payload.to_bytes(), Twist).linear.x for sample in rest]
    assert decoded == [0.0, 1.0, 2.0, 3.0]


def test_types_that_are_not_known_go_as_their_bytes(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    heard = hear(session, "r2/**")
    with playing(tool, path, rate=0.0, find=nothing) as running:
        running.wait()
    found = samples(heard, 122)
    assert sorted(map(told, found)) == sorted(recorded(path, find=nothing))
    encodings = {str(sample.key_expr): str(sample.encoding) for sample in found}
    assert encodings["r2/cmd_vel"] == "application/cdr;geometry_msgs/msg/Twist"


def test_what_is_no_message_of_its_type_is_left_out_and_counted(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "odd.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        number = recording.topic(topic_of("r1/cmd_vel", Twist))
        for at in range(10):
            recording.write(number, bags.twist(at) if at % 3 else b"\0\1\0\0odd", START + at, START + at)
    heard = hear(session, "r2/**")
    with playing(tool, path) as running:
        running.wait()
        assert running.tape.converter.unreadable == {"r1/cmd_vel": 4}
        assert "r1/cmd_vel" in running.tape.converter.reason
    assert len(samples(heard, 6)) == 6


def test_a_part_that_is_damaged_is_an_error_when_its_time_has_come(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "damaged.mcap"
    bags.drive(path, bag.Options(compression="none", sync=False, chunk_size=1_000))
    data = bytearray(path.read_bytes())
    chunks = [at for kind, at, _ in bags.records_of(bytes(data)) if kind == 6]
    data[chunks[len(chunks) // 2] + 200] ^= 0xFF
    path.write_bytes(data)
    heard = hear(session, "r2/**")
    with playing(tool, path, rate=0.0) as running:
        running.wait()
        assert isinstance(running.error, DamagedBag)
        assert not running.complete
    before = samples(heard, 10)
    assert [told(sample) for sample in before] == recorded(path, end=START + 90 * MS)[:10]


def called(session: zenoh.Session, word: str, service: Any, request: Any) -> Any:
    token = service_token("r2", "somebody", "cli", service.Request, service.Response, f"r2/bag_player/{word}")
    client: ServiceClient[Any, Any] = ServiceClient(session, token, service.Request, service.Response, PATIENCE)
    try:
        return client(request)
    finally:
        client.close()


def test_others_steer_it_by_services(
    session: zenoh.Session, tool: zenoh.Session, other: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    heard = hear(session, "r2/cmd_vel")
    choice = Choice(topics=["cmd_vel"], robot="r2")
    with playing(tool, path, choice, paused=True) as running:

        def call(word: str, service: Any, **request: Any) -> Any:
            return called(other, word, service, service.Request(**request))

        assert call("is_paused", IsPaused).paused
        place = call("get_playback", GetPlayback)
        assert place.begin.to_nanoseconds() == place.position.to_nanoseconds() == START
        assert (place.end.to_nanoseconds(), place.rate, place.paused) == (START + 991 * MS, 1.0, True)
        assert call("step", Trigger).success
        assert len(samples(heard, 1)) == 1
        there = Time.from_nanoseconds(START + 502 * MS)
        assert call("seek", Seek, time=there).success
        assert not call("seek", Seek, time=Time.from_nanoseconds(5)).success
        assert call("seek", Seek, time=there).success
        assert call("step", Trigger).success
        assert [robo_messages.decode(sample.payload.to_bytes(), Twist).linear.x for sample in samples(heard, 1)] == [
            5.1
        ]
        with pytest.raises(ServiceError, match="rate -1: use 1 for as recorded"):
            call("set_rate", SetRate, rate=-1.0)
        assert call("set_rate", SetRate, rate=0.0).success
        assert call("toggle_paused", Trigger).message == "playing"
        running.wait()
        assert running.complete
        assert len(samples(heard, 48)) == 48
        # Whoever asks everybody moves nobody.
        assert [reply.ok for reply in other.get("r2/bag_player/*", timeout=1.0)] in ([], [None] * 11)


def test_stop_ends_it(session: zenoh.Session, tool: zenoh.Session, other: zenoh.Session, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    with playing(tool, path, paused=True) as running:
        assert called(other, "stop", Trigger, Trigger.Request()).success
        running.wait()
        assert not running.complete
    del session


def test_the_clock_says_each_time_before_what_came_then(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "latched.mcap"
    latched_drive(path)
    clock = hear(session, "clock")
    with playing(tool, path, Choice(topics=["cmd_vel", "floor"], robot="r2"), rate=0.0, clock=True) as running:
        running.wait()
    times = [at(sample) for sample in samples(clock, 100)]
    assert times == [START + number * 10 * MS for number in range(100)]
    assert so_far(clock) == []


def test_the_clock_goes_on_while_it_stands_and_jumps_with_it(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    clock = hear(session, "clock")
    with playing(tool, path, clock=True, clock_period=0.01, paused=True) as running:
        first = [at(sample) for sample in samples(clock, 3)]
        assert first == [START, START, START], "who comes later wants to know it too"
        running.player.seek(START + 500 * MS)
        eventually(lambda: any(at(sample) == START + 500 * MS for sample in so_far(clock)), "it has jumped")
        running.player.resume()
        running.wait()
    after: list[int] = []

    def has_come_to_the_end() -> bool:
        after.extend(at(sample) for sample in so_far(clock))
        return after[-1:] == [START + 991 * MS]

    eventually(has_come_to_the_end, "the last one comes")
    assert after == sorted(after)


def at(sample: zenoh.Sample) -> int:
    return robo_messages.decode(sample.payload.to_bytes(), Clock).clock.to_nanoseconds()


def test_it_begins_again_and_says_what_is_latched_first(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "latched.mcap"
    latched_drive(path)
    heard = hear(session, "r2/**")
    window = Window(start="0.905", duration=0.05)
    with playing(tool, path, Choice(topics=["cmd_vel", "floor"], robot="r2"), window, rate=0.0, loop=True):
        found = samples(heard, 12)
    keys = [str(sample.key_expr).removeprefix("r2/") for sample in found]
    assert keys == ["floor", *["cmd_vel"] * 5] * 2


def test_who_waits_for_subscribers_knows_which_are_missing(tool: zenoh.Session, session: zenoh.Session) -> None:
    with closing(Audience(tool, ["r2/a", "r2/b"])) as audience:
        assert not audience.wait(0.0)
        assert audience.missing == ["r2/a", "r2/b"]
        one = hear(session, "r2/a")
        eventually(lambda: audience.missing == ["r2/b"], "one is there")
        other = hear(session, "r2/*")
        assert audience.wait(PATIENCE)
        one.undeclare()
        other.undeclare()
        assert audience.wait(0.0), "somebody has listened"


Make = Callable[[Path], None]


def test_recordings_of_ros_play_as_robos_messages(session: zenoh.Session, tool: zenoh.Session, tmp_path: Path) -> None:
    pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed")
    from rosbags.rosbag2 import StoragePlugin, Writer  # type: ignore[import-not-found, unused-ignore]
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # type: ignore[import-not-found, unused-ignore]

    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("float64 width\n", "gripper_msgs/msg/Grip"))
    folder = tmp_path / "ros"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        vector, twist = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Twist"]
        commands = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        grips = writer.add_connection("/arm/grip", "gripper_msgs/msg/Grip", typestore=store)
        grip = store.types["gripper_msgs/msg/Grip"]
        for step in range(5):
            command = twist(linear=vector(x=float(step), y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0))
            writer.write(commands, START + step * MS, store.serialize_cdr(command, "geometry_msgs/msg/Twist"))
            writer.write(grips, START + step * MS, store.serialize_cdr(grip(width=0.5), "gripper_msgs/msg/Grip"))
    heard = hear(session, "r7/**")
    with playing(tool, folder, Choice(robot="r7")) as running:
        running.wait()
        assert running.complete
    found = samples(heard, 10)
    twists = [sample for sample in found if str(sample.key_expr) == "r7/cmd_vel"]
    grips_played = [sample for sample in found if str(sample.key_expr) == "r7/arm/grip"]
    assert [robo_messages.decode(sample.payload.to_bytes(), Twist).linear.x for sample in twists] == [0, 1, 2, 3, 4]
    assert {str(sample.encoding) for sample in grips_played} == {"application/cdr;gripper_msgs/msg/Grip"}
    assert store.deserialize_cdr(grips_played[0].payload.to_bytes(), "gripper_msgs/msg/Grip").width == 0.5


def test_as_a_node_it_plays_into_its_namespace_and_ends_with_the_recording(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    heard = {name: hear(session, f"r5/{name}") for name in ("cmd_vel", "scan_before", "tf_static", "odom")}
    parameters = {"file": str(path), "rate": 0.0, "exclude": ["odom"]}
    with BagPlayer(session=tool, namespace="r5", parameters=parameters, remappings={"scan": "scan_before"}) as node:
        assert node.wait(PATIENCE), "it ends with the recording"
        assert node.exit_code == 0
        for name, count in (("cmd_vel", 100), ("scan_before", 10), ("tf_static", 2)):
            assert len(samples(heard[name], count)) == count
        assert so_far(heard["odom"]) == []


def test_as_a_node_it_plays_the_part_that_is_named_and_tells_the_time(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    heard, clock = hear(session, "r5/cmd_vel"), hear(session, "clock")
    which = {"topics": ["cmd_vel"], "start": "0.5", "end": "-0.2", "duration": 0.1, "order": "published"}
    parameters = {"file": str(path), "rate": 0.0, "clock_rate": 100.0, **which}
    with BagPlayer(session=tool, namespace="r5", parameters=parameters) as node:
        assert node.wait(PATIENCE)
        assert node.exit_code == 0
    found = [robo_messages.decode(sample.payload.to_bytes(), Twist).linear.x for sample in samples(heard, 10)]
    assert found == [5 + number / 10 for number in range(10)]
    assert so_far(heard) == []
    assert at(samples(clock, 10)[-1]) >= START + 500 * MS


def test_as_a_node_what_cannot_be_read_is_no_success(tool: zenoh.Session, tmp_path: Path) -> None:
    cut, odd, part = (tmp_path / f"{name}.mcap" for name in ("cut", "odd", "part"))
    bags.drive(part)
    cut.write_bytes(part.read_bytes()[:-100])
    with bag.Recording(odd, bag.Options(compression="none", sync=False)) as recording:
        number = recording.topic(topic_of("r1/cmd_vel", Twist))
        recording.write(number, b"\0\1\0\0odd", START, START)
    played: list[dict[str, Any]] = [
        {"file": str(cut)},
        {"file": str(odd)},
        {"file": str(part), "topics": ["odom"], "start": "0.51", "end": "0.59"},
    ]
    for parameters in played:
        with BagPlayer(session=tool, parameters={"rate": 0.0, **parameters}) as node:
            assert node.wait(PATIENCE)
            assert node.exit_code == 1, parameters


def test_as_a_node_it_leaves_what_nodes_say_to_them(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    path = tmp_path / "log.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        for name in ("log", "cmd_vel", "flight_snapshots"):
            recording.write(recording.topic(topic_of(f"r1/{name}", Twist)), bags.twist(1.0), START, START)
    heard = hear(session, "r5/flight_snapshots")
    for topics, count in (([], 0), (["flight_snapshots"], 1)):
        with BagPlayer(session=tool, namespace="r5", parameters={"file": str(path), "topics": topics}) as node:
            assert node.wait(PATIENCE)
        assert len(samples(heard, count) if count else so_far(heard)) == count


def test_as_a_node_a_file_that_is_none_is_told_at_once(
    session: zenoh.Session, tool: zenoh.Session, tmp_path: Path
) -> None:
    drive = tmp_path / "drive.mcap"
    bags.drive(drive)
    told: list[tuple[dict[str, Any], str]] = [
        ({}, "file names no"),
        ({"file": str(tmp_path / "none.mcap")}, "none.mcap"),
        ({"file": str(drive), "start": "soon"}, "--start 'soon' is no time"),
        ({"file": str(drive), "topics": ["odm"]}, "odm: no topic matches"),
        ({"file": str(drive)}, "r1/odom is no nav/Odometry: /r1/base knows it as std/String"),
    ]
    there = Sender(session, "r1/odom", "std/String", node="/r1/base")
    eventually(lambda: "/r1/base" in {one.full_name for one in tokens(tool, 1.0)}, "it is announced")
    for parameters, text in told:
        with pytest.raises(RoboError, match=text), BagPlayer(session=tool, parameters=parameters):
            pass
    there.close()
