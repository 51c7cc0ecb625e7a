"""Regression by replay, with runs as processes of their own."""

import re
from pathlib import Path

import msgspec
import pytest

from robo import bag
from robo.bag.regression.report import ReplayReport
from robo.errors import UsageError
from robo.recording.about import parameters_yaml
from robo.testing import ReplayDiffers, replay
from robo.testing.regression.judge import Request, judge
from robo.wire.qos import QoS
from robo_messages import Clock, LaserScan, String, Time
from robo_services.diff_drive_controller import DiffDriveController
from robo_services.position_tracker import PositionTracker
from tests import replays
from tests.bags import MS, START

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
def birds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with nodes and a manifest, in which one works, and a recording of words."""
    monkeypatch.chdir(replays.nodes(tmp_path))
    replays.words(tmp_path / "words.mcap")
    return tmp_path


def accepted(recording: Path, *nodes: str | type, **more: object) -> Path:
    """A reference."""
    from robo.testing.regression.judge import nodes_of

    output = recording.with_name("reference.mcap")
    asked = {"bag": str(recording), "nodes": nodes_of(nodes), "accept": True, "output": str(output), **more}
    assert judge(msgspec.convert(asked, Request)).verdict == "accepted"
    return output


def different(recording: Path, *nodes: str | type, **more: object) -> ReplayReport:
    """What a replay finds that does not pass."""
    with pytest.raises(ReplayDiffers) as raised:
        replay(recording, *nodes, **more)  # type: ignore[arg-type]
    assert not raised.value.report.fine
    return raised.value.report


def test_the_tracker_says_what_it_said_bit_for_bit_each_time(tmp_path: Path) -> None:
    reference = accepted(replays.odometry(tmp_path / "drive.mcap"), PositionTracker)
    report = replay(reference, PositionTracker, runs=6)
    assert (report.verdict, report.runs, report.troubles) == ("same", 6, [])
    (topic,) = report.topics
    assert (topic.name, topic.counts, topic.compared) == ("r1/current_position", (100, 100), 100)
    assert (topic.shift, topic.fields) == (0.0, [])
    assert [(one.topic, one.type, one.count) for one in report.inputs] == [("r1/odom", "nav/Odometry", 100)]
    assert any("reset_distance" in note for note in report.notes)


def test_a_wheel_base_that_is_one_percent_off_is_told(tmp_path: Path) -> None:
    recording = replays.wheels(tmp_path / "wheels.mcap")
    reference = accepted(recording, DiffDriveController)
    assert replay(reference, DiffDriveController).verdict == "same"
    report = different(reference, DiffDriveController, parameters={"wheel_separation": 0.303}, plots=tmp_path / "plots")
    topics = {topic.name: topic for topic in report.topics}
    assert not topics["r1/odom"].same
    fields = {field.field: field for field in topics["r1/odom"].fields}
    turned = fields["twist.twist.angular.z"]
    assert isinstance(turned.first.expected, float)
    assert isinstance(turned.first.actual, float)
    assert turned.first.expected / turned.first.actual == pytest.approx(1.01)
    assert START < turned.first.time < START + 200 * MS
    assert turned.largest is not None
    assert turned.largest.size == pytest.approx(turned.first.expected * (1 - 1 / 1.01), rel=1e-6)
    assert (tmp_path / "plots" / "r1_odom.twist.twist.angular.z.svg").read_text().startswith("<svg")
    assert report.plots
    tolerances = tmp_path / "tolerances.yaml"
    tolerances.write_text('topics:\n  "r1/*":\n    fields:\n      "**": {absolute: 0.1}\n')
    assert replay(
        reference, DiffDriveController, parameters={"wheel_separation": 0.303}, tolerances=tolerances
    ).fine  # fmt: skip


@pytest.mark.parametrize(("node", "field"), [("WallClock", "data"), ("Dice", "data"), ("Set", "data")])
def test_a_node_that_is_not_deterministic_is_named_with_its_field(birds: Path, node: str, field: str) -> None:
    report = different(birds / "words.mcap", f"birds:{node}", robot_name="r1")
    assert report.verdict == "not deterministic"
    (topic,) = report.topics
    assert (topic.name, [one.field for one in topic.fields]) == ("r1/said", [field])
    (who,) = report.nodes
    assert who.node == f"/r1/{ {'WallClock': 'wall_clock'}.get(node, node.lower()) }"
    if node == "Dice":
        assert topic.fields[0].first.index == 10
    request = Request(
        bag=str(birds / "words.mcap"), nodes=[f"birds:{node}"], accept=True, output=str(birds / "no.mcap")
    )
    assert judge(request).verdict == "not deterministic"
    assert not (birds / "no.mcap").exists()


def test_what_a_node_raises_is_told(birds: Path) -> None:
    report = different(birds / "words.mcap", "birds:Raises")
    assert report.verdict == "failed"
    (trouble,) = report.troubles
    assert (trouble.node, trouble.text) == ("/r1/raises", "raised ValueError: seven is too much")
    assert trouble.time == START + 700 * MS + replays.LATE


def test_a_process_that_dies_is_told_with_its_last_words(birds: Path) -> None:
    report = different(birds / "words.mcap", "birds:Dies")
    assert "SIGABRT" in report.troubles[0].text
    assert "goodbye" in report.troubles[0].text


def test_a_node_that_hangs_is_told(birds: Path) -> None:
    report = different(birds / "words.mcap", "birds:Hangs", patience=1.0)
    assert re.search("does not come back.*Event", report.troubles[0].text, re.DOTALL)


def test_a_call_that_nobody_answers_fails_at_once(birds: Path) -> None:
    reference = accepted(birds / "words.mcap", "birds:Asks")
    report = replay(reference, "birds:Asks")
    assert report.seconds < 20
    assert any("it calls r1/reset, which nobody serves" in note for note in report.notes)
    with bag.open(reference) as said:
        assert [message.value for message in said.messages("r1/said")] == [String("nobody")] * 20


def test_nodes_of_a_manifest_and_what_one_says_to_another(birds: Path) -> None:
    reference = accepted(birds / "words.mcap", "cage", manifest=str(birds / "birds.yaml"))
    with bag.open(reference) as said:
        assert {name: topic.count for name, topic in said.topics.items()} == {
            "r1/passed": 20, "r1/said": 20, "r1/scan": 20, "r1/word": 20,
        }  # fmt: skip
    report = replay(reference, "parrot", "relay", manifest="birds.yaml")
    assert [one.topic for one in report.inputs] == ["r1/word"]
    assert [(topic.name, topic.same) for topic in report.topics] == [("r1/said", True), ("r1/passed", True)]
    relay = replay(reference, "birds:Relay", manifest="birds.yaml")
    assert [one.topic for one in relay.inputs] == ["r1/said"]
    (birds / "birds.yaml").write_text((birds / "birds.yaml").read_text().replace("birds:Relay}", "birds:Parrot}"))
    shared = different(reference, "relay", manifest="birds.yaml")
    assert any("r1/said is not compared: /r1/parrot publishes it too" in note for note in shared.notes)
    (gone,) = shared.topics
    assert (gone.name, gone.counts, gone.missing) == ("r1/passed", (20, 0), 20)


def test_ages_and_numbers_are_those_of_the_recording(birds: Path) -> None:
    reference = accepted(birds / "words.mcap", "birds:Ages")
    with bag.open(reference) as said:
        values = [str(message.value.data) for message in said.messages("r1/said")]  # type: ignore[union-attr]
    assert values[0] == f"0.000300 /replay 1 {START}"
    assert values[-1].endswith(f"/replay 20 {START + 1900 * MS}")


def test_timers_tick_as_they_were_recorded(birds: Path) -> None:
    """A reference from a live robot: ticks at another phase than that of the first message."""
    path = birds / "live.mcap"
    with bag.Recording(path, replays.PLAIN) as recording:
        log = replays.Log(recording)
        for number in range(200):
            at = number * 10 * MS
            if number % 10 == 0:
                log.write("r1/word", String(str(number // 10)), at)
            elif number % 5 == 2:
                tick = at + 5 * MS + number % 7 * 1_000
                log.write("r1/said", String(f"{number // 10} {START + tick}"), tick, late=0)
    report = different(path, "birds:Ticks")
    assert any("timers tick as those of r1/said were recorded, every 0.05 s" in note for note in report.notes)
    (topic,) = report.topics
    assert topic.counts[0] - topic.missing == topic.compared
    assert topic.shift < 0.001
    assert topic.fields[0].first.size is None


def test_a_new_reference_takes_the_place_of_the_old_one(birds: Path) -> None:
    recording = birds / "words.mcap"
    assert judge(Request(bag=str(recording), nodes=["birds:Parrot"], accept=True)).accepted == str(recording)
    assert replay(recording, "birds:Parrot").verdict == "same"
    assert sorted(one.name for one in birds.glob("*.mcap")) == ["words.mcap"]
    assert not [one for one in birds.iterdir() if one.name.startswith(".")]
    source = (birds / "birds.py").read_text()
    (birds / "birds.py").write_text(source.replace("self.said.publish(String(word.data))", "pass"))
    report = different(recording, "birds:Parrot")
    assert (report.topics[0].missing, report.topics[0].counts) == (20, (20, 0))


def test_parameters_come_from_the_recording_unless_a_manifest_says_them(birds: Path) -> None:
    with bag.Recording(birds / "with.mcap", replays.PLAIN) as recording:
        said = parameters_yaml({"/r1/ticks": {"rate": 5.0, "gone": 1}})
        recording.attach("parameters.yaml", said.encode(), "text/yaml", START)
        log = replays.Log(recording)
        for number in range(11):
            log.write("r1/word", String("a"), number * 100 * MS)
    reference = accepted(birds / "with.mcap", "birds:Ticks")
    with bag.open(reference) as recorded:
        assert recorded.topic("r1/said").count == 5
        assert "parameters.yaml" in recorded.attachments
    report = replay(reference, "birds:Ticks")
    assert any("birds:Ticks has no parameter gone any more" in note for note in report.notes)
    faster = different(reference, "birds:Ticks", parameters={"rate": 10.0})
    assert faster.topics[0].additional == 5


def test_mistakes_are_told(birds: Path) -> None:
    words = birds / "words.mcap"
    for nodes, told in {
        (): "say which node",
        ("birds:Parot",): "has no node class 'Parot'",
        ("parot",): "has no node parot; did you mean parrot",
    }.items():
        with pytest.raises(UsageError, match=told):
            replay(words, *nodes, manifest="birds.yaml" if nodes == ("parot",) else None)
    with pytest.raises(UsageError, match="has no output of /r1/parrot: it publishes r1/said; --accept"):
        replay(words, "birds:Parrot")
    with pytest.raises(UsageError, match="no input of /r2/parrot, which listens to r2/word; did you mean r1/word"):
        replay(words, "birds:Parrot", robot_name="r2")
    with pytest.raises(UsageError, match="stands in a function"):
        replay(words, type("Local", (), {"__qualname__": "f.<locals>.Local"}))
    with pytest.raises(UsageError, match="0 runs"):
        replay(words, "birds:Parrot", runs=0)


def test_what_is_latched_comes_first(birds: Path) -> None:
    path = birds / "latched.mcap"
    with bag.Recording(path, replays.PLAIN) as recording:
        log = replays.Log(recording)
        log.write("r1/scan", LaserScan(), 0)
        log.write("r1/word", String("said long ago"), -60_000 * MS, QoS.LATCHED, late=60_010 * MS)
        log.write("r1/word", String("said now"), 20 * MS, QoS.LATCHED)
    reference = accepted(path, "birds:Ages")
    with bag.open(reference) as said:
        first, second = said.messages("r1/said")
        assert first.published == START + replays.LATE
        assert f"/replay 1 {START - 60_000 * MS}" in str(first.value)
        assert second.published == START + 20 * MS + replays.LATE


def test_nodes_in_simulated_time_follow_the_recorded_clock(birds: Path) -> None:
    """At half the speed of the wall clock: timers tick where the clock steps over their time."""
    path = birds / "simulated.mcap"
    with bag.Recording(path, replays.PLAIN) as recording:
        log = replays.Log(recording)
        for number in range(101):
            log.write("clock", Clock(Time.from_nanoseconds(7_000_000_000 + number * 10 * MS)), number * 20 * MS)
            if number % 10 == 5:
                log.write("r1/word", String(str(number)), number * 20 * MS + 5 * MS)
    reference = accepted(path, "birds:Ticks", parameters={"use_sim_time": True})
    with bag.open(reference) as said:
        told = [(message.published - START, str(message.value)) for message in said.messages("r1/said")]
    assert len(told) == 20
    assert told[0] == (100 * MS + replays.LATE, "String(data=' 7050000000')")
    assert told[1] == (200 * MS + replays.LATE, "String(data='5 7100000000')")
    assert replay(reference, "birds:Ticks", parameters={"use_sim_time": True}).verdict == "same"
    with bag.Recording(birds / "back.mcap", replays.PLAIN) as recording:
        log = replays.Log(recording)
        for number in (5, 6, 3):
            log.write("clock", Clock(Time(number)), number * MS, late=(20 - number) * MS)
            log.write("r1/word", String(str(number)), number * MS, late=(20 - number) * MS)
    with pytest.raises(UsageError, match="/clock steps back at"):
        replay(birds / "back.mcap", "birds:Ticks", parameters={"use_sim_time": True})


def test_a_topic_of_another_type_is_told(birds: Path) -> None:
    path = birds / "other.mcap"
    with bag.Recording(path, replays.PLAIN) as recording:
        replays.Log(recording).write("r1/word", LaserScan(), 0)
    report = different(path, "birds:Parrot")
    assert report.troubles[0].text == (
        "r1/word cannot be fed: it is a sensor/LaserScan in the recording, and /r1/parrot takes String"
    )
