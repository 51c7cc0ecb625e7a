"""Recording a running robot: what was said is in the file, with all that was lost and all that could not be read."""

import json
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml
import zenoh

import robo_messages
from robo import KEEP_ALL, Node, Publisher, bag
from robo.bag.mcap.index import COUNTS
from robo.bag.of_robot import ABOUT
from robo.recording import about
from robo.recording.intake import _KEEPER, Intake
from robo.recording.recorder import MADE, Recorder, Status
from robo.recording.selection import EVERYTHING, Selection
from robo.wire import codec
from robo.wire.discovery import wait_for_nodes
from robo_messages import Header, Odometry, String, TFMessage, Time, TransformStamped, Twist, Vector3
from tests.support import PATIENCE, eventually, is_heard

TWIST = codec.encoding_of(Twist)


class Driver(Node):
    command = Publisher(Twist, "cmd_vel", depth=KEEP_ALL)
    state = Publisher(String, "state", latched=True)
    steps = Publisher(String, "steps", latched=True, depth=3)
    odom = Publisher(Odometry, "odom", depth=KEEP_ALL)


class Told(list[str]):
    def __call__(self, text: str) -> None:
        self.append(text)


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def driver(session: zenoh.Session) -> Iterator[Driver]:
    with Driver(namespace="r1", session=session) as node:
        yield node


@contextmanager
def recording(
    session: zenoh.Session, path: Path, told: Told, *keys: str, options: bag.Options | None = None, **more: Any
) -> Iterator[Recorder]:
    recorder = Recorder(session, path, Selection(keys or (EVERYTHING,)), options, tell=told, **more)
    try:
        yield recorder
    finally:
        recorder.stop()


def received(recorder: Recorder, topic: str) -> int:
    return next((one.received for one in recorder.status().topics if one.topic == topic), 0)


def has_received(recorder: Recorder, topic: str, count: int) -> bool:
    return received(recorder, topic) == count


def values(path: Path, topic: str) -> list[Any]:
    with bag.open(path) as opened:
        return [one.value for one in opened.messages(topic)]


def latched_of(opened: bag.Bag) -> list[tuple[str, Any]]:
    found: list[Any] = list(opened.messages(["r1/state", "r1/steps"]))
    return [(one.topic.name, one.value.data) for one in found]


def figures(status: Status) -> dict[str, tuple[int, int, int]]:
    return {one.topic: (one.received, one.lost, one.malformed) for one in status.topics}


def heard(node: Driver) -> Callable[[], bool]:
    return lambda: node.command.has_subscribers


def test_what_is_published_is_in_the_file(other: zenoh.Session, driver: Driver, told: Told, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with recording(other, path, told, "r1/cmd_vel") as recorder:
        eventually(heard(driver), "the recorder listens")
        sent = [Twist(linear=Vector3(x=number / 7)) for number in range(500)]
        for twist in sent:
            driver.command.publish(twist)
        eventually(lambda: received(recorder, "r1/cmd_vel") == 500, "all of them")
    assert values(path, "r1/cmd_vel") == sent
    with bag.open(path) as opened:
        messages = list(opened.messages())
        assert [one.sequence for one in messages] == list(range(1, 501))
        assert all(one.arrived >= one.published for one in messages)
        assert opened.topics["r1/cmd_vel"].qos.depth == KEEP_ALL
    assert bag.check(path).findings == []
    status = recorder.stop()
    assert figures(status) == {"r1/cmd_vel": (500, 0, 0)}
    assert (status.missing, status.ended, status.left_out, told) == ([], "", 0, [])


def test_what_did_not_come_is_counted_to_the_message(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    first, second = (session.declare_publisher("r1/cmd_vel", encoding=codec.encoding_of(Twist)) for _ in range(2))
    numbers = [(first, [1, 2, 5, 6, 20]), (second, [7, 9, 10])]
    with recording(other, tmp_path / "a.mcap", told, "r1/*") as recorder:
        eventually(lambda: is_heard(first) and is_heard(second), "the recorder listens")
        for publisher, sequence in numbers:
            for number in sequence:
                publisher.put(
                    robo_messages.encode(Twist()),
                    attachment=codec.pack_attachment(number, 10**18 + number),
                    source_info=zenoh.SourceInfo(publisher.id, number),
                )
        eventually(lambda: received(recorder, "r1/cmd_vel") == 8, "all that was sent")
        assert figures(recorder.status()) == {"r1/cmd_vel": (8, 2 + 13 + 1, 0)}
    assert [one.lost for one in bag.info(tmp_path / "a.mcap").topics] == [16]


def test_what_a_stranger_attaches_is_no_number(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    with recording(other, tmp_path / "a.mcap", told, "r1/*") as recorder:
        for text in ("about 17 bytes ..", "at 18:30 and so on", "nothing"):
            session.put("r1/cmd_vel", robo_messages.encode(Twist()), encoding=TWIST, attachment=text.encode())
        eventually(lambda: received(recorder, "r1/cmd_vel") == 3, "all that was sent")
        assert figures(recorder.status()) == {"r1/cmd_vel": (3, 0, 0)}


def test_latched_topics_come_first_in_every_file(
    other: zenoh.Session, driver: Driver, told: Told, tmp_path: Path
) -> None:
    for number in range(5):
        driver.state.publish(String(str(number)))
        driver.steps.publish(String(str(number)))
    path = tmp_path / "drive"
    with recording(other, path, told, "r1/**", options=bag.Options(split_by_hand=True)) as recorder:
        eventually(heard(driver), "the recorder listens")
        driver.command.publish(Twist())
        eventually(lambda: received(recorder, "r1/cmd_vel") == 1, "it came")
        driver.state.publish(String("now"))
        eventually(lambda: received(recorder, "r1/state") == 2, "that came too")
        recorder.split()
        driver.command.publish(Twist())
        eventually(lambda: received(recorder, "r1/cmd_vel") == 2, "it came")
    status = recorder.stop()
    assert figures(status)["r1/steps"] == (3, 0, 0)
    assert figures(status)["r1/state"] == (2, 0, 0)
    files = sorted(path.glob("*.mcap"))
    assert len(files) == 2
    with bag.open(files[0]) as opened:
        begin = latched_of(opened)[:4]
        first = next(iter(opened.messages()))
    assert first.topic.name in ("r1/state", "r1/steps")
    assert sorted(begin) == [("r1/state", "4"), ("r1/steps", "2"), ("r1/steps", "3"), ("r1/steps", "4")]
    with bag.open(files[1]) as opened:
        again = latched_of(opened)
    assert sorted(again) == [("r1/state", "now"), ("r1/steps", "2"), ("r1/steps", "3"), ("r1/steps", "4")]


def test_of_a_node_that_was_started_again_only_what_it_says_now_is_said_again(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    path = tmp_path / "run"
    with recording(other, path, told, "r1/state", options=bag.Options(split_by_hand=True)) as recorder:
        for number in range(3):
            with Driver(namespace="r1", session=session) as node:
                node.state.publish(String(str(number)))
                eventually(partial(has_received, recorder, "r1/state", number + 1), "it came")
        recorder.split()
    assert [one.data for one in values(path / "run_1.mcap", "r1/state")] == ["2"]


def test_a_latched_publisher_that_comes_later_is_asked_too(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    with (
        recording(other, tmp_path / "a.mcap", told, "r1/**") as recorder,
        Driver(namespace="r1", session=session) as node,
    ):
        node.steps.publish(String("1"))
        node.steps.publish(String("2"))
        eventually(lambda: received(recorder, "r1/steps") == 2, "both")
    assert [one.data for one in values(tmp_path / "a.mcap", "r1/steps")] == ["1", "2"]


def test_what_is_not_known_stays_bytes_and_that_is_said(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    payload = msgspec.msgpack.encode({"width": 3})
    with recording(other, tmp_path / "a.mcap", told, "r1/**") as recorder:
        for _ in range(2):
            session.put("r1/gripper", payload, encoding="application/msgpack;some_robot/Gripper")
            session.put("r1/picture", b"\x89PNG", encoding="image/png")
        eventually(lambda: received(recorder, "r1/picture") == 2, "they came")
    assert values(tmp_path / "a.mcap", "r1/gripper") == [payload, payload]
    with bag.open(tmp_path / "a.mcap") as opened:
        topic = opened.topics["r1/gripper"]
        assert (topic.encoding, topic.schema) == ("msgpack", "some_robot/Gripper")
        assert opened.topics["r1/picture"].encoding == "image/png"
    assert sorted(told) == [
        "r1/gripper is recorded as the bytes that came: type some_robot/Gripper is not known here",
        "r1/picture is recorded as the bytes that came: its messages are in 'image/png', which robo does not read",
    ]
    assert recorder.stop().malformed == 0


def test_what_is_malformed_is_counted_and_told_once(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    with recording(other, tmp_path / "a.mcap", told, "r1/**") as recorder:
        for _ in range(3):
            session.put("r1/cmd_vel", b"\x01", encoding=codec.encoding_of(Twist))
        session.put("r1/cmd_vel", robo_messages.encode(Twist()), encoding=codec.encoding_of(Twist))
        eventually(lambda: received(recorder, "r1/cmd_vel") == 1, "the good one")
    assert figures(recorder.stop()) == {"r1/cmd_vel": (1, 0, 3)}
    with bag.open(tmp_path / "a.mcap") as opened:
        words = {one.name: one.words for one in opened.all_metadata()}
    assert json.loads(words[COUNTS]["r1/cmd_vel"]) == {"received": 1, "lost": 0, "malformed": 3, "left_out": 0}
    assert len(told) == 1
    assert told[0].startswith("r1/cmd_vel: a message cannot be written down, and is counted: not a geometry/Twist")


def test_what_is_malformed_is_not_lost(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    with recording(other, tmp_path / "a.mcap", told, "r1/*") as recorder:
        for number in range(1, 7):
            data = robo_messages.encode(Twist()) if number not in (3, 4) else b"\x01"
            session.put("r1/cmd_vel", data, encoding=TWIST, attachment=codec.pack_attachment(number, 10**18 + number))
        eventually(lambda: received(recorder, "r1/cmd_vel") == 4, "the good ones")
    assert figures(recorder.stop()) == {"r1/cmd_vel": (4, 0, 2)}


def test_what_is_left_out_is_counted_by_topic(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    with recording(other, tmp_path / "a.mcap", told, "r1/*", most_bytes=1) as recorder:
        with recorder._work:  # nothing is taken out
            for _ in range(20):
                session.put("r1/cmd_vel", robo_messages.encode(Twist()), encoding=TWIST)
            eventually(lambda: recorder._intake.left_out().total() == 19, "one may wait")
        eventually(lambda: recorder.status().left_out == 19, "they are counted")
    (topic,) = recorder.stop().topics
    assert (topic.topic, topic.received, topic.left_out) == ("r1/cmd_vel", 1, 19)
    with bag.open(tmp_path / "a.mcap") as opened:
        words = {one.name: one.words for one in opened.all_metadata()}
    assert json.loads(words[COUNTS]["r1/cmd_vel"])["left_out"] == 19


@pytest.mark.parametrize("error", [RuntimeError("odd"), MemoryError("odd"), SystemExit("odd")])
def test_whatever_ends_a_recording_is_told_and_its_file_is_whole(
    session: zenoh.Session,
    other: zenoh.Session,
    told: Told,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
) -> None:
    def fail(_: object) -> None:
        raise error

    path = tmp_path / "a.mcap"
    with recording(other, path, told, "r1/*") as recorder:
        session.put("r1/cmd_vel", robo_messages.encode(Twist()), encoding=TWIST)
        eventually(lambda: received(recorder, "r1/cmd_vel") == 1, "it came")
        monkeypatch.setattr(recorder._conversion, "convert", fail)
        session.put("r1/cmd_vel", robo_messages.encode(Twist()), encoding=TWIST)
        assert recorder.wait(10.0)
        assert recorder.ended == f"the recording has failed: {type(error).__name__}: odd"
    assert recorder.stop().ended
    assert bag.check(path).findings == []
    assert len(values(path, "r1/cmd_vel")) == 1


def test_a_folder_that_somebody_deletes_ends_the_recording(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    options = bag.Options(split_by_hand=True, least_free=1)
    with recording(other, folder, told, "r1/*", options=options) as recorder:
        session.put("r1/cmd_vel", robo_messages.encode(Twist()), encoding=TWIST)
        eventually(lambda: received(recorder, "r1/cmd_vel") == 1, "it came")
        shutil.rmtree(folder)
        assert recorder.wait(10.0)
        assert recorder.ended.endswith("run_0.mcap: somebody has deleted it while it was recorded")


def test_transforms_that_are_none_end_nothing(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    odometry = robo_messages.encode(Odometry(Header(Time(1, 0), "odom"), "base_link"))
    with recording(other, tmp_path / "a.mcap", told, "r1/*") as recorder:
        for number in range(2):
            session.put("r1/odom", odometry, encoding=codec.encoding_of(Odometry))
            session.put("r1/tf", b"{}", encoding="application/cdr;tf2_msgs/msg/TFMessage")
            eventually(partial(has_received, recorder, "r1/odom", number + 1), "it goes on")
    assert recorder.stop().ended == ""


def test_an_excluded_tf_is_not_made_of_odometry(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    odometry = robo_messages.encode(Odometry(Header(Time(1, 0), "odom"), "base_link"))
    recorder = Recorder(other, tmp_path / "a.mcap", Selection(["r1/**"], ["**/tf"]), tell=told)
    try:
        session.put("r1/odom", odometry, encoding=codec.encoding_of(Odometry))
        eventually(lambda: received(recorder, "r1/odom") == 1, "it came")
    finally:
        status = recorder.stop()
    assert figures(status) == {"r1/odom": (1, 0, 0)}


def test_a_latched_message_that_comes_before_its_publisher_is_known_is_there_once(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late: list[Any] | None = []
    post = Intake._post

    def hold_tokens(intake: Intake, kind: int, news: Any = None) -> None:
        if late is None:
            post(intake, kind, news)
        else:
            late.append((kind, news))

    monkeypatch.setattr(Intake, "_post", hold_tokens)  # as where two routers are linking
    with (
        recording(other, tmp_path / "a.mcap", told, "r1/**") as recorder,
        Driver(namespace="r1", session=session) as node,
    ):
        node.steps.publish(String("1"))
        node.steps.publish(String("2"))
        eventually(lambda: received(recorder, "r1/steps") == 2, "both")
        eventually(lambda: any(kind == _KEEPER for kind, _ in late or ()), "then it is known")
        tokens, late = late or [], None
        for kind, news in tokens:
            post(recorder._intake, kind, news)
        node.steps.publish(String("3"))
        eventually(lambda: received(recorder, "r1/steps") >= 3, "and goes on")
    assert [one.data for one in values(tmp_path / "a.mcap", "r1/steps")] == ["1", "2", "3"]


def test_an_interrupt_while_it_is_waited_for_does_not_make_it_seem_ended(
    other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    main = threading.get_ident()
    with recording(other, tmp_path / "a.mcap", told, "r1/*") as recorder:
        threading.Timer(0.1, signal.pthread_kill, (main, signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            recorder.wait(30.0)
        assert not recorder.wait(0.0)
    assert recorder.wait(0.0)


def test_a_recorder_that_cannot_begin_leaves_no_file(
    other: zenoh.Session, told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise zenoh.ZError("closed")

    monkeypatch.setattr("robo.recording.recorder.Watch", fail)
    with pytest.raises(zenoh.ZError):
        Recorder(other, tmp_path / "a.mcap", Selection([EVERYTHING]), tell=told)
    assert list(tmp_path.iterdir()) == []


def test_what_changes_its_quality_of_service_again_and_again_is_one_topic(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo.recording.recorder._MOST_TOPICS", 2)
    with recording(other, tmp_path / "a.mcap", told, "r1/*") as recorder:
        for number in range(6):
            session.put("r1/cmd_vel", robo_messages.encode(Twist()), encoding=TWIST)
            eventually(partial(has_received, recorder, "r1/cmd_vel", number + 1), "it came")
            with recorder._work:
                recorder._offer_changed("r1/cmd_vel")
    assert figures(recorder.stop()) == {"r1/cmd_vel": (6, 0, 0)}


def test_what_is_excluded_or_hidden_or_of_robo_itself_is_not_recorded(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    selection = Selection([EVERYTHING], ["r1/camera/**"])
    recorder = Recorder(other, tmp_path / "a.mcap", selection, tell=told)
    for key in ("r1/camera/image", "r1/dock/_action/feedback", "@robo/r1/output", "r1/cmd_vel"):
        session.put(key, robo_messages.encode(Twist()), encoding=codec.encoding_of(Twist))
    eventually(lambda: received(recorder, "r1/cmd_vel") == 1, "the one that is wanted")
    assert list(figures(recorder.stop())) == ["r1/cmd_vel"]


def test_tf_is_made_of_odometry_where_nobody_publishes_it(
    other: zenoh.Session, driver: Driver, told: Told, tmp_path: Path
) -> None:
    with recording(other, tmp_path / "a.mcap", told, "r1/odom") as recorder:
        eventually(lambda: driver.odom.has_subscribers, "the recorder listens")
        for number in range(10):
            odometry = Odometry(Header(Time(number, 0), "odom"), "base_link")
            odometry.pose.pose.position.x = float(number)
            driver.odom.publish(odometry)
        eventually(lambda: received(recorder, "r1/odom") == 10, "all of them")
    made = values(tmp_path / "a.mcap", "r1/tf")
    assert [one.transforms[0].transform.translation.x for one in made] == [float(number) for number in range(10)]
    assert {one.transforms[0].child_frame_id for one in made} == {"base_link"}
    with bag.open(tmp_path / "a.mcap") as opened:
        assert opened.metadata[MADE] == {"r1/tf": "r1/odom"}
    assert recorder.stop().received == 10
    assert told == ["r1/tf: nobody publishes these transforms, so they are made of odometry"]


def test_what_was_asked_for_and_never_came_is_told(
    other: zenoh.Session, driver: Driver, told: Told, tmp_path: Path
) -> None:
    with recording(other, tmp_path / "a.mcap", told, "r1/scan", "r1/cmd_vel", "r2/**") as recorder:
        eventually(heard(driver), "the recorder listens")
        driver.command.publish(Twist())
        eventually(lambda: received(recorder, "r1/cmd_vel") == 1, "it came")
    assert recorder.stop().missing == ["r1/scan", "r2/**"]


def nodes_in(path: Path) -> str:
    """Of which nodes a recording says that they were there, as far as it has come."""
    with bag.open(path) as opened:
        return opened.metadata.get(ABOUT, {}).get("nodes", "")


def test_parameters_graph_and_versions_are_in_the_file(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    def manifests(_: object) -> dict[str, bytes]:
        return {"robot.yaml": b"nodes: []\n"}

    node = Driver(namespace="r1", session=session)  # one that comes later is told of too
    with recording(other, tmp_path / "a.mcap", told, "r1/**", manifests=manifests) as recorder, node:
        eventually(heard(node), "the recorder listens")
        node.command.publish(Twist())
        eventually(lambda: received(recorder, "r1/cmd_vel") == 1, "it came")
        eventually(lambda: nodes_in(tmp_path / "a.mcap") == "/r1/driver", "the node is in the file")
        recorder.stop()
    with bag.open(tmp_path / "a.mcap") as opened:
        attachments = {name: opened.attachment(name) for name in opened.attachments}
        words = opened.metadata[ABOUT]
    assert words["nodes"] == "/r1/driver"
    assert words["robo"]
    assert yaml.safe_load(attachments["parameters.yaml"])["/r1/driver"]["ros__parameters"]["use_sim_time"] is False
    graph = json.loads(attachments["graph.json"])
    assert "r1/cmd_vel" in [topic["key"] for topic in graph["topics"]]
    assert attachments["manifests/robot.yaml"] == b"nodes: []\n"


def test_a_look_that_lacks_a_node_of_which_was_heard_is_taken_again(
    session: zenoh.Session, other: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine a router may answer late."""
    looks: list[about.About] = []

    def look(whose: zenoh.Session, manifests: about.Manifests) -> about.About:
        seen = real(whose, manifests)
        return seen if looks else seen._replace(metadata={**seen.metadata, "nodes": ""})

    real = about.look
    monkeypatch.setattr(about, "look", look)
    with Driver(namespace="r1", session=session):
        assert not wait_for_nodes(other, ["/r1/driver"], PATIENCE)
        watch = about.Watch(other, looks.append, pytest.fail)
        try:
            eventually(lambda: "/r1/driver" in looks[-1].metadata["nodes"] if looks else False, "it has looked again")
        finally:
            watch.close()
    assert looks[0].metadata["nodes"] == ""


def test_what_waits_has_a_limit_and_what_is_left_out_is_counted(session: zenoh.Session, other: zenoh.Session) -> None:
    intake = Intake(other, Selection(["r1/*"], ["r1/other"]), most_bytes=13_000)
    # Half a megabyte at once: a link that a busy machine is slow to empty would lose some.
    block = zenoh.CongestionControl.BLOCK
    unwanted = session.declare_publisher("r1/other", congestion_control=block)
    publisher = session.declare_publisher("r1/text", congestion_control=block)
    eventually(lambda: is_heard(publisher) and is_heard(unwanted), "it listens")
    for _ in range(50):
        unwanted.put(b"x" * 10_000)  # nobody wants it: it takes no room
        publisher.put(b"x" * 100)
    eventually(lambda: intake.left_out() == {"r1/text": 40}, "ten may wait")
    assert len(intake.take()) == 10
    publisher.put(b"x" * 100)
    eventually(lambda: len(intake.take()) == 1, "then there is room again")
    intake.close()


def test_a_frame_whose_transform_is_published_gets_none_that_is_made(
    session: zenoh.Session, other: zenoh.Session, told: Told, tmp_path: Path
) -> None:
    class Base(Driver):
        tf = Publisher(TFMessage, "tf", depth=KEEP_ALL)

    with (
        Base(namespace="r1", session=session) as base,
        recording(other, tmp_path / "a.mcap", told, "r1/**") as recorder,
    ):
        eventually(lambda: base.tf.has_subscribers and base.odom.has_subscribers, "the recorder listens")
        for number in range(10):
            base.tf.publish(TFMessage([TransformStamped(Header(Time(number, 0), "odom"), "base_link")]))
            base.odom.publish(Odometry(Header(Time(number, 0), "odom"), "base_link"))
        eventually(lambda: received(recorder, "r1/odom") == 10, "all of them")
        assert figures(recorder.status())["r1/tf"] == (10, 0, 0)
    assert told == []
