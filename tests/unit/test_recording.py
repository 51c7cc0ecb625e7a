"""What decides what is recorded, and what it is: without a network."""

import os
import random
import signal
import threading
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import robo_messages
from robo.bag.types import topic_of
from robo.cli.reach import Reach
from robo.cli.record_words import RecordWords
from robo.cli.views.bag_record import _options, _Signals, keys_of, missing_so_far, path_of, size_of
from robo.errors import BagError, UsageError
from robo.interfaces import cdr
from robo.machine.log_files import RunInfo
from robo.machine.manifests import manifests_of
from robo.recording.about import parameters_yaml
from robo.recording.conversion import Came, Conversion, Converted, Refused
from robo.recording.latched import LONGEST_HELD, LatchedFirst
from robo.recording.odometry import PATIENCE, TransformsOfOdometry
from robo.recording.offers import Offers
from robo.recording.selection import EVERYTHING, Selection, beside_robot
from robo.recording.senders import Senders
from robo.wire import codec
from robo.wire.keys import EndpointToken
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import Header, Odometry, TFMessage, Time, TransformStamped, Twist
from tests.interrupts import wait_and_be_struck

# -- selection -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "exclude", "wanted", "unwanted"),
    [
        ([EVERYTHING], [], ["odom", "r1/arm/joint_states"], ["r1/dock/_action/feedback", "@robo/x", "a/@adv/b"]),
        ([EVERYTHING], ["**/image", "r2/**"], ["r1/odom"], ["r1/camera/image", "r2/odom"]),
        (["r1/odom", "r*/scan"], [], ["r1/odom"], ["r2/odom", "r1/odom/more"]),
        (["*/cmd_$*"], [], ["r1/cmd_vel", "r2/cmd_vel_raw"], ["cmd_vel", "r1/arm/cmd_vel"]),
        (["r1/dock/_action/feedback"], [], ["r1/dock/_action/feedback"], ["r1/dock/_action/status"]),
        (["r1/**", "r1/dock/_action/*"], [], ["r1/dock/_action/status", "r1/odom"], ["r1/_hidden"]),
    ],
)  # fmt: skip
def test_what_is_wanted(asked: list[str], exclude: list[str], wanted: list[str], unwanted: list[str]) -> None:
    selection = Selection([key.replace("r*", "r$*") for key in asked], exclude)
    assert [key for key in wanted if selection.source(key) < 0] == []
    assert [key for key in unwanted if selection.source(key) >= 0] == []


def test_of_expressions_that_overlap_each_topic_is_taken_once() -> None:
    selection = Selection(["r1/odom", "r1/*", "r1/**", "*/odom"])
    assert selection.keys == ["r1/**", "*/odom"]
    assert [selection.source(key) for key in ("r1/odom", "r2/odom", "r1/scan")] == [0, 1, 0]


def test_what_is_missing_is_what_was_asked_for() -> None:
    selection = Selection(["r1/odom", "r2/**", "r3/scan"], beside=["r1/tf_static"])
    assert selection.missing(["r1/odom", "r2/arm/joint_states"]) == ["r3/scan"]


@pytest.mark.parametrize("asked", [[], ["@robo/**"], ["r1/@adv/x"], ["r1//odom"]])
def test_what_is_no_topic_is_refused(asked: list[str]) -> None:
    with pytest.raises(BagError):
        Selection(asked)


def test_static_transforms_are_looked_for_beside_topics() -> None:
    assert beside_robot(["r1/arm/joint_states"]) == ["r1/arm/tf_static", "r1/tf_static", "tf_static"]
    assert beside_robot(["odom"]) == ["tf_static"]
    assert beside_robot(["*/odom", "r1/scan"]) == ["*/tf_static", "tf_static", "r1/tf_static"]


def test_beside_all_of_a_robot_is_what_all_robots_share() -> None:
    assert beside_robot(["r1/**"]) == ["clock", "tf", "r1/tf_static", "tf_static"]
    assert beside_robot(["r1/**"], transforms=False) == ["clock"]
    assert beside_robot(["r1/odom"], transforms=False) == []


def test_what_is_excluded_is_not_all_that_is_asked_for() -> None:
    selection = Selection(["r1/odom", "r1/scan"], ["r1/scan", "**/tf"])
    assert (selection.excludes("r1/tf"), selection.excludes("r1/odom")) == (True, False)
    with pytest.raises(BagError, match=r"all that is asked for is excluded, by '\*\*'"):
        Selection(["r1/odom", "r2/**"], ["**"])


# -- publishers ------------------------------------------------------------------------------------


def publisher(
    node: str, qos: QoS = QoS.DEFAULT, type_name: str = "geometry/Twist", topic: str = "r1/cmd"
) -> EndpointToken:
    return EndpointToken("r1", node, "pub", type_name, qos, topic, f"session:{node}")


def test_of_several_publishers_the_latched_and_the_deepest_count() -> None:
    offers = Offers()
    assert offers.put(publisher("a", QoS(depth=3, latched=True)))
    assert not offers.put(publisher("b", QoS(depth=1, latched=True)))
    assert not offers.put(publisher("c", QoS(depth=KEEP_ALL)))
    assert offers.of("r1/cmd").qos == QoS(depth=3, latched=True)
    assert offers.of("r1/cmd").type == "geometry/Twist"
    assert offers.put(publisher("d", type_name="std/String"))
    assert offers.of("r1/cmd").type == ""
    assert offers.of("r1/other").publishers == ()


def test_what_turns_out_to_be_latched_is_until_a_node_says_more() -> None:
    offers = Offers()
    assert offers.latch("r1/cmd")
    assert not offers.latch("r1/cmd")
    assert offers.of("r1/cmd").qos.latched
    assert offers.put(publisher("a", QoS(depth=3, latched=True)))
    assert not offers.latch("r1/cmd")
    assert offers.of("r1/cmd").qos == QoS(depth=3, latched=True)


def test_what_was_offered_last_holds_until_somebody_offers_something_else() -> None:
    offers = Offers()
    offers.put(publisher("a", QoS.LATCHED))
    offers.delete(publisher("a", QoS.LATCHED))
    assert offers.of("r1/cmd").qos == QoS.LATCHED
    assert offers.put(publisher("b"))
    assert offers.of("r1/cmd").publishers == ("session:b",)
    offers.delete(publisher("nobody"))
    assert offers.of("r1/cmd").qos == QoS.DEFAULT


class Replaced(list[tuple[str, str]]):
    def __call__(self, topic: str, publisher: str) -> None:
        self.append((topic, publisher))


def again(node: str, number: int) -> EndpointToken:
    """A latched publisher of a node that was started so many times."""
    return msgspec.structs.replace(publisher(node, QoS.LATCHED), id=f"session{number}:1")


def test_a_latched_publisher_is_replaced_where_its_node_comes_again() -> None:
    replaced = Replaced()
    offers = Offers(replaced)
    for number in range(3):
        offers.put(again("a", number))
        offers.put(again("b", 100 + number))
        offers.delete(again("a", number))
    assert replaced == [("r1/cmd", "session0:1"), ("r1/cmd", "session1:1")]
    offers.put(again("a", 2))
    assert len(replaced) == 2, "it was behind a cut cable"


def test_a_latched_publisher_is_replaced_though_its_end_comes_late() -> None:
    replaced = Replaced()
    offers = Offers(replaced)
    offers.put(again("a", 0))
    offers.put(again("a", 1))
    assert replaced == []
    offers.delete(again("a", 0))
    assert replaced == [("r1/cmd", "session0:1")]


class Entity:
    """Zenoh's id of a publisher."""

    def __init__(self, zid: str) -> None:
        self.zid, self.eid = zid, 1


class Payload(bytes):
    def to_bytes(self) -> bytes:
        return self


class Sample:
    """A message of a publisher that signs."""

    def __init__(self, number: int, data: bytes = robo_messages.encode(Twist()), zid: str = "abc") -> None:
        self.encoding = codec.encoding_of(Twist)
        self.payload = Payload(data)
        self.attachment = Payload(codec.pack_attachment(number, 1_000 + number))
        self.source_info = type("Source", (), {"source_id": Entity(zid), "source_sn": number})


def came(number: int, data: bytes = robo_messages.encode(Twist()), *, is_kept: bool = False, key: str = "r1/c") -> Came:
    sample: Any = Sample(number, data)
    return Came(key, 2_000 + number, sample, is_kept)


def test_what_is_refused_is_told_with_its_number() -> None:
    refused: list[Refused] = []
    conversion = Conversion(lambda _: None, refused=refused.append)
    assert conversion.convert(came(1)) is not None
    assert conversion.convert(came(2, b"\x01")) is None
    assert refused == [Refused("r1/c", 2, 1_002, "abc:1")]
    assert conversion.malformed == {"r1/c": 1}


def test_of_malformed_messages_no_more_topics_are_told_apart_than_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.recording.conversion._MOST_FORMS", 3)
    conversion = Conversion(lambda _: None)
    for number in range(10):
        conversion.convert(came(1, b"\x01", key=f"t{number % 6}"))
    assert (len(conversion.malformed), conversion.malformed.total()) == (4, 10)


def test_what_came_before_its_publisher_was_known_to_be_latched_is_there_once() -> None:
    refused: list[Refused] = []
    conversion = Conversion(lambda _: None, refused=refused.append)
    assert conversion.convert(came(1)) is not None
    assert conversion.convert(came(1, is_kept=True)) is None
    found = conversion.convert(came(2, is_kept=True))
    assert found is not None
    assert (found.sequence, refused) == (2, [])


def test_a_publisher_that_does_not_answer_holds_nothing_up() -> None:
    now = [100.0]
    latched = LatchedFirst(lambda: now[0])
    assert latched.keeper("r1/c", "abc:1")
    assert latched.live(came(1)) == []
    assert latched.overdue() == []
    now[0] += LONGEST_HELD
    assert [one.arrived for one in latched.overdue()] == [2_001]
    assert latched.live(came(2))[0].arrived == 2_002
    assert latched.done("abc:1") == []


def test_messages_without_a_name_are_of_the_publisher_whose_numbers_they_go_on() -> None:
    senders = Senders(lambda _: ["a", "b"])
    came = [("a", 5), ("b", 100), (None, 6), (None, 101)]
    assert [senders.sender("t", signed, number) for signed, number in came] == ["a", "b", "a", "b"]
    assert senders.sender("t", None, 9) == "a"  # 7 and 8 are lost
    assert senders.sender("u", None, 3) != senders.sender("u", None, 1)  # of two that nobody has named


def test_a_flood_of_the_only_publisher_is_its_own() -> None:
    senders = Senders(lambda _: ["a"])
    assert [senders.sender("t", None, number) for number in (7, 8, 12)] == ["a", "a", "a"]
    assert senders.sender("t", "a", 13) == "a"


@given(
    st.lists(st.booleans(), min_size=2, max_size=60),
    st.sets(st.integers(2, 59)),
    st.integers(0, 50),
)
def test_what_one_publisher_loses_is_counted_whether_it_signs_or_not(
    signs: list[bool], lost: set[int], begin: int
) -> None:
    senders = Senders(lambda _: ["a"])
    came = [(number + begin, signed) for number, signed in enumerate(signs, 1) if number not in lost]
    assert {senders.sender("t", "a" if signed else None, number) for number, signed in came} == {"a"}


# -- tf of odometry --------------------------------------------------------------------------------

ODOMETRY = {name: topic_of(f"r1/{name}", Odometry) for name in ("odom", "wheels")}
TF = topic_of("r1/tf", TFMessage)


def odometry(at: int, x: float = 0.0, name: str = "odom", frames: tuple[str, str] = ("odom", "base_link")) -> Converted:
    message = Odometry(Header(Time(5, 6), frames[0]), frames[1])
    message.pose.pose.position.x = x
    message.pose.pose.orientation.z = 1.0
    return Converted(ODOMETRY[name], cdr.encoder(Odometry)(message), at, at - 1, 1, "a")


def transform(at: int, child: str = "base_link") -> Converted:
    message = TFMessage([TransformStamped(Header(Time(5, 6), "odom"), child)])
    return Converted(TF, cdr.encoder(TFMessage)(message), at, at, 1, "b")


def test_a_transform_is_made_of_odometry() -> None:
    made = TransformsOfOdometry()
    found = made.take(odometry(1_000, 2.5))
    assert found is not None
    assert (found.topic.name, found.arrived, found.published, found.sequence) == ("r1/tf", 1_000, 999, 1)
    (one,) = cdr.decoder(TFMessage)(found.data).transforms
    assert (one.header, one.child_frame_id) == (Header(Time(5, 6), "odom"), "base_link")
    assert (one.transform.translation.x, one.transform.rotation.z) == (2.5, 1.0)
    second = made.take(odometry(2_000))
    assert second is not None
    assert second.sequence == 2
    assert made.made == {"r1/tf": "r1/odom"}


def test_none_is_made_where_frames_have_no_names_or_another_odometry_tells() -> None:
    made = TransformsOfOdometry()
    assert made.take(odometry(1, frames=("odom", ""))) is None
    assert made.take(odometry(1, frames=("", "base_link"))) is None
    assert made.take(odometry(1, name="wheels")) is not None
    assert made.take(odometry(2, name="odom")) is not None  # it is called so
    assert made.take(odometry(3, name="wheels")) is None


def test_none_is_made_where_it_is_published() -> None:
    made = TransformsOfOdometry(lambda topic: topic == "r1/tf")
    assert made.take(odometry(0)) is None
    assert made.take(transform(1)) is None
    assert made.take(odometry(2 * PATIENCE)) is None
    assert made.made == {}


def test_one_is_made_where_those_who_publish_tell_of_other_frames() -> None:
    made = TransformsOfOdometry(lambda _: True)
    assert made.take(odometry(0)) is None
    assert made.take(transform(1, child="arm")) is None
    assert made.take(odometry(PATIENCE)) is not None
    made.take(transform(PATIENCE + 1))
    assert made.take(odometry(PATIENCE + 2)) is None  # by now somebody tells of it


def test_what_makes_no_sense_or_is_no_cdr_makes_none() -> None:
    made = TransformsOfOdometry()
    assert made.take(odometry(1)._replace(data=random.Random(0).randbytes(20))) is None
    assert made.take(odometry(2)) is not None
    assert made.take(transform(3)._replace(data=b"{}")) is None
    foreign = msgspec.structs.replace(TF, encoding="application/cdr")
    assert made.take(transform(4)._replace(topic=foreign, data=b"{}")) is None
    assert made.take(odometry(5)) is not None, "nobody has said that it publishes this one"


def test_none_is_made_where_nobody_wants_it() -> None:
    made = TransformsOfOdometry(is_wanted=lambda topic: topic != "r1/tf")
    assert made.take(odometry(1)) is None
    assert made.made == {}


# -- the words of the command line -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "size"),
    [("1000", 1000), ("500MB", 500_000_000), ("2 GB", 2_000_000_000), ("1.5k", 1500), ("2MiB", 2_097_152), ("0", 0)],
)
def test_sizes(text: str, size: int) -> None:
    assert size_of(text, "--split-size") == size


@pytest.mark.parametrize("text", ["", "MB", "-1", "5 x", "1e9", "5MBs"])
def test_what_is_no_size(text: str) -> None:
    with pytest.raises(UsageError, match="--least-free"):
        size_of(text, "--least-free")


def test_topics_are_those_of_the_robot_that_is_named() -> None:
    reach = Reach(robot="r1")
    assert keys_of(["odom", "r1/scan", "/r2/odom", "cmd_*"], RecordWords(), reach) == [
        "r1/odom", "r1/scan", "r2/odom", "r1/cmd_$*",
    ]  # fmt: skip
    assert keys_of(None, RecordWords(everything=True), reach) == ["r1/**"]
    assert keys_of(None, RecordWords(everything=True), Reach()) == ["**"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ({"keep": 3}, "^--keep deletes the oldest of several files: say what splits them, such as --split-size$"),
        ({"split_size": "0"}, "^--split-size 0: use a number above 0"),
        ({"split_size": "500"}, "^--split-size '500' is 500 bytes; use 100kB or more, such as 500MB$"),
        ({"split_size": "9" * 400}, "^--split-size '9+.*use a size such as 500MB"),
        ({"when_full": "drop_oldest"}, "^--when-full drop_oldest deletes the oldest"),
        ({"duration": float("nan")}, "^--duration nan: use a number of seconds"),
    ],
)
def test_words_that_make_no_sense_are_told_as_they_are_said(words: dict[str, Any], reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        _options(RecordWords(**words))


@pytest.mark.parametrize(
    ("output", "split", "path"),
    [
        ("drive", None, "drive.mcap"),
        ("to/v1.2", None, "to/v1.2.mcap"),
        ("drive.mcap", None, "drive.mcap"),
        ("drive.mcap", 5.0, "drive"),
        ("v1.2", 5.0, "v1.2"),
    ],
)
def test_a_file_is_called_mcap_and_a_folder_is_not(output: str, split: float | None, path: str) -> None:
    assert path_of(RecordWords(output=output, split_duration=split), 0) == Path(path)


def test_two_recordings_of_one_second_have_two_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    first = path_of(RecordWords(), 0)
    first.touch()
    assert path_of(RecordWords(), 0).name == f"{first.stem}_2.mcap"


def test_the_first_signal_ends_and_no_other_one_disturbs() -> None:
    before = signal.getsignal(signal.SIGTERM)
    both = {signal.SIGHUP, signal.SIGTERM}
    with _Signals() as signals:
        signal.pthread_sigmask(signal.SIG_BLOCK, both)
        for number in both:
            signal.pthread_kill(threading.get_ident(), number)
        with pytest.raises(KeyboardInterrupt), signals.raised():
            signal.pthread_sigmask(signal.SIG_UNBLOCK, both)  # now they come at once
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_signal_that_comes_too_early_ends_it_in_time() -> None:
    with _Signals() as signals:
        os.kill(os.getpid(), signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt), signals.raised():
            pytest.fail("it has ended")


def test_a_signal_that_strikes_as_a_wait_begins_ends_it_as_any_other() -> None:
    with _Signals() as signals, pytest.raises(KeyboardInterrupt), signals.raised():
        wait_and_be_struck()


def test_the_name_is_the_time_where_nobody_says_another() -> None:
    assert path_of(RecordWords(), 0).name.startswith("robo_19")
    assert path_of(RecordWords(), 0).suffix == ".mcap"
    assert path_of(RecordWords(split_duration=5), 0).suffix == ""
    assert path_of(RecordWords(output="a.mcap"), 0) == Path("a.mcap")


# -- what stands beside messages -------------------------------------------------------------------


def nested_lists(depth: int) -> object:
    found: object = 1
    for _ in range(depth):
        found = [found]
    return found


def test_parameters_are_a_file_that_robo_reads() -> None:
    text = parameters_yaml({"/r1/base": {"rate": 5.0, "pid.p": 1, "name": "x"}, "/r1/odd": {"a": 1, "a.b": 2}})
    assert text == (
        "/r1/base:\n  ros__parameters:\n    rate: 5.0\n    pid:\n      p: 1\n    name: x\n"
        "# /r1/odd: its parameters make no sense: AssertionError\n"
    )


@pytest.mark.parametrize("value", [msgspec.msgpack.Ext(5, b"x"), nested_lists(2_000)], ids=["an object", "deep"])
def test_what_one_node_says_costs_no_other_its_parameters(value: object) -> None:
    text = parameters_yaml({"/r1/base": {"rate": 5.0}, "/r1/bad": {"x": value}, "/r1/last": {"x": 1}})
    assert yaml.safe_load(text) == {name: {"ros__parameters": values} for name, values in (
        ("/r1/base", {"rate": 5.0}), ("/r1/last", {"x": 1}),
    )}  # fmt: skip
    assert "# /r1/bad: its parameters make no sense: " in text


def test_the_manifests_of_runs_are_found_by_their_logs(tmp_path: Path) -> None:
    manifest = tmp_path / "robot.yaml"
    manifest.write_text("nodes: []\n")
    for number, where in enumerate((manifest, tmp_path / "gone.yaml", manifest)):
        folder = tmp_path / "log" / "r1" / str(number)
        folder.mkdir(parents=True)
        info = RunInfo(run=f"run{number}", robot="r1", manifest=str(where), begin=0, pid=1, nodes=[])
        (folder / "run.json").write_bytes(msgspec.json.encode(info))
    (tmp_path / "log" / "r1" / "0" / "run.json").with_name("other.json").touch()
    (tmp_path / "log" / "r1" / "3").mkdir()
    (tmp_path / "log" / "r1" / "3" / "run.json").write_text("{")
    assert manifests_of(["run0", "run1"], tmp_path / "log") == {"r1/robot.yaml": b"nodes: []\n"}
    assert manifests_of([], tmp_path / "log") == {}


def test_of_what_has_not_come_it_is_said_who_would_publish_it_or_what_may_have_been_meant() -> None:
    said = missing_so_far(["r1/odum", "r1/cmd", "r2/**"], {"r1/cmd": ["/r1/mux", "/r1/joy"]}, ["r1/odom"])
    assert said == [
        "nothing has come on r1/odum yet: nobody publishes it so far; did you mean r1/odom?",
        "nothing has come on r1/cmd yet: /r1/mux, /r1/joy would publish it",
        "nothing has come on r2/** yet",
    ]
