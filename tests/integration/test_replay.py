"""Regression by replay, with runs as processes of their own."""

import math
import os
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import pytest

from robo import bag
from robo.bag.forms.from_carmen import Setting, from_carmen
from robo.bag.regression.report import ReplayReport, lines
from robo.errors import UsageError
from robo.recording.about import parameters_yaml
from robo.testing import ReplayDiffers, replay
from robo.testing.regression.judge import Request, judge
from robo.wire.qos import QoS
from robo_messages import Clock, LaserScan, Parameter, ParameterEvent, String, Time
from robo_services.diff_drive_controller import DiffDriveController
from robo_services.position_tracker import PositionTracker
from tests import replays, room_log
from tests.bags import MS, START

pytestmark = pytest.mark.timeout(120)

TIMES = int(os.environ.get("REPLAY_RUNS", "10"))
"""How often the tracker is run."""


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
    report = judge(msgspec.convert(asked, Request))
    assert report.verdict == "accepted", list(lines(report))
    return output


def different(recording: Path, *nodes: str | type, **more: object) -> ReplayReport:
    """What a replay finds that does not pass."""
    with pytest.raises(ReplayDiffers) as raised:
        replay(recording, *nodes, **more)  # type: ignore[arg-type]
    assert not raised.value.report.fine
    return raised.value.report


@pytest.mark.timeout(60 + 6 * TIMES)
def test_the_tracker_says_what_it_said_bit_for_bit_each_time(tmp_path: Path) -> None:
    """On the log that ships."""
    drive = tmp_path / "drive.mcap"
    from_carmen(room_log.LOG, drive, Setting(namespace="r1"), "none")
    with bag.open(drive) as recording:
        count = recording.topic("r1/odom").count
    reference = accepted(drive, PositionTracker)
    report = replay(reference, PositionTracker, runs=TIMES)
    assert (report.verdict, report.runs, report.troubles) == ("same", TIMES, [])
    (topic,) = report.topics
    assert count > 300
    assert (topic.name, topic.counts, topic.compared) == ("r1/current_position", (count, count), count)
    assert (topic.shift, topic.fields) == (0.0, [])
    assert [(one.topic, one.type, one.count) for one in report.inputs] == [("r1/odom", "nav/Odometry", count)]
    assert any("reset_distance" in note for note in report.notes)


def test_a_node_that_reckons_with_wheels_one_percent_further_apart_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The node itself has changed: no parameter says so."""
    monkeypatch.chdir(tmp_path)
    changed = """
    from robo_services import diff_drive_controller

    class DiffDriveController(diff_drive_controller.DiffDriveController):
        class Parameters(diff_drive_controller.DiffDriveController.Parameters):
            def drive(self):
                return msgspec.structs.replace(super().drive(), wheel_separation=1.01 * self.wheel_separation)

        parameters: Parameters
    """
    (tmp_path / "wider.py").write_text("import msgspec\n" + textwrap.dedent(changed))
    reference = accepted(replays.wheels(tmp_path / "wheels.mcap"), DiffDriveController)
    report = different(reference, "wider:DiffDriveController")
    assert report.verdict == "different"
    (odometry,) = [topic for topic in report.topics if topic.name == "r1/odom"]
    (turned,) = [field for field in odometry.fields if field.field == "twist.twist.angular.z"]
    first = turned.first
    assert isinstance(first.expected, float)
    assert isinstance(first.actual, float)
    assert START < first.time < START + 200 * MS
    assert first.expected / first.actual == pytest.approx(1.01)
    assert first.size == pytest.approx(first.expected - first.actual)
    assert any(line.startswith(f"    first   at {(first.time - report.begin) * 1e-9:.3f} s") for line in lines(report))


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
    assert (tmp_path / "plots" / "r1-odom.twist.twist.angular.z.svg").read_text().startswith("<svg")
    assert report.plots
    tolerances = tmp_path / "tolerances.yaml"
    tolerances.write_text('topics:\n  "r1/*":\n    fields:\n      "**": {absolute: 0.1}\n')
    assert replay(
        reference, DiffDriveController, parameters={"wheel_separation": 0.303}, tolerances=tolerances
    ).fine  # fmt: skip


@pytest.mark.parametrize(
    ("node", "field"), [("WallClock", "data"), ("Hour", "data"), ("Night", "data"), ("Dice", "data"), ("Set", "data")]
)
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


def test_who_waits_for_the_wall_is_found_and_is_no_reference(birds: Path) -> None:
    """In the time of a run nothing of what it waits for passes: by true clocks both runs say the same."""
    request = Request(bag=str(birds / "words.mcap"), nodes=["birds:Seldom"], robot="r1", accept=True)
    report = judge(request)
    assert report.verdict == "not deterministic"
    assert [(topic.name, topic.missing, topic.counts[0]) for topic in report.topics] == [("r1/said", 0, 0)]
    assert report.topics[0].additional > 0


def test_of_a_group_who_passes_it_on_is_told_after_who_says_it(birds: Path) -> None:
    for name in ("birds.yaml", "birds.py"):
        text = (birds / name).read_text().replace("      relay: {service: birds:Relay}\n", "")
        text = text.replace("    nodes:\n", "    nodes:\n      relay: {service: birds:Relay}\n")
        text = text.replace("service: birds:Parrot", "service: birds:Dicing")
        (birds / name).write_text(text)
    with (birds / "birds.py").open("a") as file:
        file.write(
            "\n\nclass Dicing(Parrot):\n    @robo.subscribe('word')\n    def hear(self, word: String) -> None:\n"
            "        self.said.publish(String(str(random.random())))\n"
        )
    report = different(birds / "words.mcap", "cage", manifest="birds.yaml")
    assert [one.node for one in report.nodes] == ["/r1/relay", "/r1/parrot"]
    assert [topic.name for topic in report.topics] == ["r1/said", "r1/passed"]
    last = list(lines(report))[-1]
    assert last.startswith("NOT DETERMINISTIC: /r1/parrot says something else in each run, in r1/said data, r1/passed")
    assert last.endswith(" So then does /r1/relay, and may only pass it on")


def spoken(path: Path, *more: str, publishers: Mapping[str, Sequence[str]] | None = None) -> Path:
    """A recording of words and what a parrot said then; and of more topics, on which the words were said too."""
    with bag.Recording(path, replays.PLAIN) as recording:
        log = replays.Log(recording)
        if publishers is not None:
            replays.attach_graph(recording, publishers)
        for number in range(20):
            at = number * 100 * MS
            log.write("r1/word", String(str(number)), at)
            for topic in ("r1/said", *more):
                log.write(topic, String(str(number)), at + replays.LATE, late=1000)
    return path


def test_a_topic_that_a_node_publishes_no_more_is_missing(birds: Path) -> None:
    parrot = ["/r1/parrot"]
    recording = spoken(birds / "a.mcap", "r1/more", publishers={"r1/said": parrot, "r1/more": parrot})
    report = different(recording, "birds:Parrot")
    assert [(one.name, one.same, one.counts) for one in report.topics] == [
        ("r1/said", True, (20, 20)), ("r1/more", False, (20, 0)),
    ]  # fmt: skip
    assert report.topics[1].missing == 20
    new = accepted(recording, "birds:Parrot")
    with bag.open(new) as said:
        assert "r1/more" not in said.topics
    assert replay(new, "birds:Parrot").verdict == "same"  # whatever the graph says of then


def test_what_others_said_too_is_not_missing(birds: Path) -> None:
    publishers = {"r1/said": ["/r1/parrot"], "r1/more": ["/r1/parrot", "/r1/magpie"], "r1/other": ["/r1/magpie"]}
    report = replay(spoken(birds / "a.mcap", "r1/more", "r1/other", publishers=publishers), "birds:Parrot")
    assert [one.name for one in report.topics] == ["r1/said"]
    renamed = {"r1/said": ["/r1/poll"]}
    assert [one.name for one in replay(spoken(birds / "b.mcap", publishers=renamed), "birds:Parrot").topics] == [
        "r1/said"
    ]


def test_a_topic_that_a_callback_makes_is_compared(birds: Path) -> None:
    reference = accepted(birds / "words.mcap", "birds:Late")
    with bag.open(reference) as said:
        assert said.topic("r1/more").count == 20
    assert replay(reference, "birds:Late").topics[0].counts == (20, 20)
    report = different(reference, "birds:Late", parameters={"text": "b"})
    assert [(one.name, one.differing) for one in report.topics] == [("r1/more", 20)]


def test_what_a_node_says_and_hears_comes_as_it_was_recorded_where_others_say_it_too(birds: Path) -> None:
    path = birds / "songs.mcap"
    with bag.Recording(path, replays.PLAIN) as recording:
        log = replays.Log(recording)
        replays.attach_graph(recording, {"r1/song": ["/r1/choir", "/r1/soloist"], "r1/heard": ["/r1/choir"]})
        for number in range(10):
            at = number * 100 * MS
            log.write("r1/word", String(str(number)), at)
            for song, later in ((f"choir {number}", replays.LATE), ("solo", 50 * MS)):
                log.write("r1/song", String(song), at + later)
                log.write("r1/heard", String(song), at + later + replays.LATE)
    report = replay(path, "birds:Choir")
    assert {one.topic: one.count for one in report.inputs} == {"r1/word": 10, "r1/song": 20}
    assert [(one.name, one.counts) for one in report.topics] == [("r1/heard", (20, 20))]
    assert "r1/song is not compared: /r1/soloist publishes it too" in report.notes
    assert "r1/song is fed as it was recorded; what /r1/choir says on it now reaches nobody" in report.notes


def test_what_a_node_says_and_hears_is_told_where_nothing_tells_who_else_says_it(birds: Path) -> None:
    path = spoken(birds / "a.mcap", "r1/song")
    reference = accepted(path, "birds:Choir")
    report = replay(reference, "birds:Choir")
    assert [one.topic for one in report.inputs] == ["r1/word"]
    (note,) = [note for note in report.notes if "r1/song" in note]
    assert note == "r1/song is not fed: /r1/choir says it, and nothing tells whether others said it too"
    with bag.open(reference) as said:
        assert said.topic("r1/heard").count == 20


def test_what_no_recording_can_have_is_no_part_of_a_reference(birds: Path) -> None:
    reference = accepted(birds / "words.mcap", "birds:Oddity")
    with bag.open(reference) as said:
        assert said.metadata["robo.replay"]["/r1/oddity"] == "r1/said"
    report = replay(reference, "birds:Oddity")
    assert [one.name for one in report.topics] == ["r1/said"]
    assert any("r1/odd is not compared" in note for note in report.notes)


def test_parameters_need_not_be_finite(birds: Path) -> None:
    limits = {"most": math.inf, "least": -math.inf}
    reference = accepted(birds / "words.mcap", "birds:Limits", parameters=limits)
    with bag.open(reference) as said:
        assert next(said.messages("r1/said")).value == String("-inf inf")
    assert replay(reference, "birds:Limits", parameters=limits).verdict == "same"


def test_parameters_that_were_changed_meanwhile_are_told(birds: Path) -> None:
    path = birds / "tuned.mcap"
    with bag.Recording(path, replays.PLAIN) as recording:
        log = replays.Log(recording)
        for number in range(20):
            log.write("r1/word", String(str(number)), number * 100 * MS)
        for number, node in enumerate(("/r1/ticks", "/r1/other", "/r1/ticks")):
            event = ParameterEvent(node=node, changed_parameters=[Parameter("rate", 5.0 + number)])
            log.write("r1/parameter_events", event, 500 * MS + number)
    request = Request(bag=str(path), nodes=["birds:Ticks"], accept=True)
    notes = [note for note in judge(request).notes if "was changed" in note]
    assert notes == ["/r1/ticks: rate was changed while it was recorded, first after 0.500 s, and stays as it is here"]


def test_a_picture_that_cannot_be_drawn_costs_no_report(birds: Path) -> None:
    recording = replays.wheels(birds / "wheels.mcap", 20)
    reference = accepted(recording, DiffDriveController)
    (birds / "plots").write_text("no folder")
    report = different(
        reference, DiffDriveController, parameters={"wheel_separation": 0.303}, plots=birds / "plots"
    )  # fmt: skip
    assert report.verdict == "different"
    assert any("has no picture" in note and "plots" in note for note in report.notes)


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
    for patience in (0.0, math.nan, math.inf):
        with pytest.raises(UsageError, match="a patience of"):
            replay(words, "birds:Parrot", patience=patience)


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
