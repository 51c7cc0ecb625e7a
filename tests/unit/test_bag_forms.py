"""Recordings in other forms and back: nothing is lost but what is told, and nothing is made up."""

import csv
import io
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robo import bag
from robo.bag.forms.choice import form_of_input, form_of_output
from robo.bag.forms.from_csv import from_csv
from robo.bag.forms.json_lines import from_json_lines, to_json_lines
from robo.bag.forms.to_csv import to_csv
from robo.bag.types import topic_of
from robo.errors import BagError, MessageError
from robo.interfaces import cdr
from robo.samples.publishing import line_of
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import Parameter, Twist, find_type
from tests import bags
from tests.bags import MS, START
from tests.random_messages import SHIPPED, messages

PLAIN = bag.Options(compression="none", sync=False)

Row = tuple[str, str, int, int, int, bytes]


def rows(path: Path) -> list[Row]:
    """Whatever messages say."""
    with bag.open(path) as opened:
        return [(one.topic.name, one.topic.schema, one.arrived, one.published, one.sequence, one.data)
                for one in opened.messages()]  # fmt: skip


def qos(path: Path) -> dict[str, tuple[QoS, str, str]]:
    with bag.open(path) as opened:
        return {name: (topic.qos, topic.text, topic.unknown) for name, topic in opened.topics.items()}


@st.composite
def recordings(draw: st.DrawFn) -> list[tuple[bag.TopicInFile, list[tuple[bytes, int, int, int]]]]:
    """Topics of any type with any messages; some are no messages, of some the type is not known."""
    found = []
    for number in range(draw(st.integers(1, 3))):
        type_ = find_type(draw(st.sampled_from(SHIPPED)))
        name = f"r1/topic_{number}"
        offers = draw(st.sampled_from([QoS.DEFAULT, QoS.LATCHED, QoS(depth=KEEP_ALL), QoS.SENSOR_DATA]))
        topic = topic_of(name, type_, offers)
        datas = []
        for _ in range(draw(st.integers(1, 3))):
            try:
                datas.append(cdr.encoder(type_)(draw(messages(type_))))
            except MessageError:
                datas.append(draw(st.binary(max_size=20)))
        if draw(st.booleans()):
            datas.append(draw(st.binary(max_size=20)))
        if draw(st.integers(0, 4)) == 0:
            topic = bag.TopicInFile(name, f"strange_msgs/msg/Thing{number}", "float64 value\n", qos=offers)
        times = st.integers(START, START + 100)
        found.append((topic, [(data, draw(times), draw(times), draw(st.integers(0, 9))) for data in datas]))
    return found


def written(path: Path, topics: list[tuple[bag.TopicInFile, list[tuple[bytes, int, int, int]]]]) -> None:
    with bag.Recording(path, PLAIN) as recording:
        for topic, said in topics:
            number = recording.topic(topic)
            for data, arrived, published, sequence in said:
                recording.write(number, data, arrived, published, sequence or None)


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(recordings())
def test_json_lines_lose_no_byte(topics: list[tuple[bag.TopicInFile, list[tuple[bytes, int, int, int]]]]) -> None:
    with tempfile.TemporaryDirectory() as name:
        first, lines, again = (Path(name) / one for one in ("a.mcap", "a.jsonl", "b.mcap"))
        written(first, topics)
        with bag.open(first) as opened:
            to_json_lines(opened, lines)
        from_json_lines(lines, again, "none")
        assert sorted(rows(again)) == sorted(rows(first))
        assert qos(again) == qos(first)


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(st.data())
def test_csv_loses_no_value(data: st.DataObject) -> None:
    types = [find_type(data.draw(st.sampled_from(SHIPPED))) for _ in range(data.draw(st.integers(1, 3)))]
    with tempfile.TemporaryDirectory() as name:
        first, folder, again = (Path(name) / one for one in ("a.mcap", "csv", "b.mcap"))
        topics = []
        for number, type_ in enumerate(types):
            said = []
            for _ in range(data.draw(st.integers(1, 3))):
                try:
                    encoded = cdr.encoder(type_)(data.draw(messages(type_)))
                except MessageError:
                    encoded = cdr.encoder(type_)(type_())
                said.append((encoded, START + data.draw(st.integers(0, 9)), START, data.draw(st.integers(0, 9))))
            topics.append((topic_of(f"r1/topic_{number}", type_), said))
        written(first, topics)
        with bag.open(first) as opened:
            to_csv(opened, folder)
        from_csv(folder, again, "none")
        with bag.open(first) as one, bag.open(again) as other:
            for name in one.topics:
                mine, theirs = list(one.messages(name)), list(other.messages(name))
                assert [(x.arrived, x.published, x.sequence) for x in mine] == [
                    (x.arrived, x.published, x.sequence) for x in theirs
                ]
                assert [repr(msgspec.to_builtins(x.value)) for x in mine] == [
                    repr(msgspec.to_builtins(x.value)) for x in theirs
                ], "where NaN is NaN"


def drive(folder: Path) -> Path:
    path = folder / "drive.mcap"
    bags.drive(path)
    return path


def test_lines_are_what_robo_topic_pub_reads(tmp_path: Path) -> None:
    path, lines = drive(tmp_path), tmp_path / "drive.jsonl"
    with bag.open(path) as opened:
        done = to_json_lines(opened, lines, wanted="r1/scan".__eq__)
    assert (done.topics, done.messages) == (1, 10)
    assert done.notes == [
        "attachments stay behind, JSON Lines has no place for them: manifest.yaml",
        "metadata stay behind, JSON Lines has no place for them: robo",
    ]
    first = lines.read_text().splitlines()[0]
    line = line_of(first, None, None)
    assert (line.key, line.type, line.origin) == ("r1/scan", "sensor/LaserScan", (START, 1))
    assert msgspec.json.decode(first)["message"]["ranges"] == [1.0, 2.0, "inf"]


def test_what_robo_topic_echo_wrote_becomes_a_recording(tmp_path: Path) -> None:
    lines, path = tmp_path / "log.jsonl", tmp_path / "log.mcap"
    with lines.open("w") as file:
        for number in range(3):
            record = {"key": "r1/cmd_vel", "type": "geometry/Twist", "time": START + number * MS,
                      "sequence_number": number + 1, "message": {"linear": {"x": number / 2}}}  # fmt: skip
            file.write(json.dumps(record) + "\n\n")
    from_json_lines(lines, path, "none")
    with bag.open(path) as opened:
        assert list(opened.column("r1/cmd_vel", "linear.x")) == [0.0, 0.5, 1.0]
        assert list(opened.times("r1/cmd_vel")) == [START, START + MS, START + 2 * MS]
    assert bag.check(path).findings == []


def test_bytes_beside_a_message_count_until_somebody_changes_it(tmp_path: Path) -> None:
    path, lines, again = tmp_path / "a.mcap", tmp_path / "a.jsonl", tmp_path / "b.mcap"
    data = bags.twist(1.0) + b"more"
    written(path, [(topic_of("r1/cmd_vel", Twist), [(data, START, START, 1)])])
    with bag.open(path) as opened:
        to_json_lines(opened, lines)
    record = json.loads(lines.read_text())
    assert "cdr" in record
    from_json_lines(lines, again, "none")
    assert rows(again)[0][-1] == data
    record["message"]["linear"]["x"] = 2.0
    lines.write_text(json.dumps(record))
    from_json_lines(lines, again, "none", force=True)
    assert rows(again)[0][-1] == bags.twist(2.0)


GOOD: dict[str, Any] = {
    "key": "r1/cmd_vel", "type": "geometry/Twist", "time": START, "sequence_number": 1, "message": {},
}  # fmt: skip


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("nothing", "is no record as `robo topic echo --json` has it"),
        ("[" * 10_000, "is no record"),
        ('{"linear": {"x": 1}}', "missing required field `key`"),
        (json.dumps(GOOD | {"message": {"linear": {"z": "fast"}}}), "Twist.linear.z: expected float, got str 'fast'"),
        (json.dumps(GOOD | {"message": {"speed": 1}}), "has no field 'speed'"),
        (json.dumps(GOOD | {"type": "arm/Joints"}), "'r1/cmd_vel': robo has no type 'arm/Joints'"),
        (json.dumps(GOOD | {"type": ""}), "'r1/cmd_vel': it does not say its type"),
        (json.dumps(GOOD | {"time": -1}), "no recording can hold the time -1 ns"),
        (json.dumps(GOOD | {"sequence_number": -1}), "'r1/cmd_vel': there is no sequence number -1"),
        (json.dumps(GOOD | {"message": None, "error": "bad", "payload": "ä"}), "no base64"),
        (json.dumps(GOOD | {"message": None, "error": "bad", "payload": "AAAA"}), "its payload cannot be read"),
        (
            json.dumps(GOOD | {"type": "arm/J", "message": None, "encoding": "application/cdr;arm/J"}),
            "nothing says what a 'arm/J' is",
        ),
    ],
)
def test_a_line_that_makes_no_sense_is_named_and_no_file_is_left(line: str, reason: str, tmp_path: Path) -> None:
    lines, path = tmp_path / "log.jsonl", tmp_path / "log.mcap"
    lines.write_text(f"{json.dumps(GOOD)}\n{line}\n")
    with pytest.raises(BagError, match=r"log\.jsonl: line 2") as error:
        from_json_lines(lines, path, "none")
    assert reason in str(error.value)
    assert not path.exists()


def test_tables_are_for_pandas(tmp_path: Path) -> None:
    path, folder = drive(tmp_path), tmp_path / "csv"
    with bag.open(path) as opened:
        done = to_csv(opened, folder)
    assert (done.topics, done.messages) == (4, 122)
    assert "CSV does not say that a topic is latched: r1/tf_static" in done.notes
    assert sorted(file.name for file in folder.iterdir()) == [
        "r1.cmd_vel.csv", "r1.odom.csv", "r1.scan.csv", "r1.tf_static.csv",
    ]  # fmt: skip
    table = list(csv.DictReader(io.StringIO((folder / "r1.scan.csv").read_text())))
    assert table[0]["time"] == str(START)
    assert table[0]["arrived"] == str(START + 2 * MS)
    assert (table[0]["key"], table[0]["type"], table[0]["sequence_number"]) == ("r1/scan", "sensor/LaserScan", "1")
    assert json.loads(table[0]["ranges"]) == [1.0, 2.0, float("inf")]
    assert float(table[0]["range_max"]) == 0.0


def test_a_file_has_one_topic(tmp_path: Path) -> None:
    path, table = drive(tmp_path), tmp_path / "a.csv"
    with bag.open(path) as opened:
        with pytest.raises(BagError, match=r"there are 4 \(r1/cmd_vel, r1/odom, .*\): name one, or a folder"):
            to_csv(opened, table)
        assert to_csv(opened, table, wanted="r1/odom".__eq__).messages == 10
        with pytest.raises(BagError, match="it is there already"):
            to_csv(opened, table, wanted="r1/odom".__eq__)
        to_csv(opened, table, wanted="r1/odom".__eq__, force=True)
        with pytest.raises(BagError, match="it is there already; name a folder that is not"):
            to_csv(opened, tmp_path, force=True)


def test_what_csv_cannot_hold_is_told(tmp_path: Path) -> None:
    path, table = tmp_path / "a.mcap", tmp_path / "csv"
    strange = bag.TopicInFile("arm", "arm_msgs/msg/Joints", "float64[] angles\n")
    said = [(bags.twist(1.0), START, START, 1), (b"bad", START, START, 2)]
    written(path, [(topic_of("cmd_vel", Twist), said), (strange, [(b"abc", START, START, 0)])])
    with bag.open(path) as opened:
        done = to_csv(opened, table)
    assert done.messages == 2
    assert done.notes[:2] == [
        "cmd_vel: 1 messages are left out, they are no geometry/Twist",
        "arm stays bytes, in base64: robo has no type 'arm_msgs/msg/Joints'",
    ]
    assert "YWJj" in (table / "arm.csv").read_text()
    with pytest.raises(BagError, match=r"line 2: robo has no type 'arm_msgs/msg/Joints', and CSV does not say"):
        from_csv(table / "arm.csv", tmp_path / "b.mcap", "none")


def test_names_that_some_disks_take_for_one_are_two_files(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    written(path, [(topic_of(name, Twist), [(bags.twist(1.0), START, START, 1)]) for name in ("A", "a")])
    with bag.open(path) as opened:
        to_csv(opened, tmp_path / "csv")
    assert len({file.name.casefold() for file in (tmp_path / "csv").iterdir()}) == 2


def changed(change: Callable[[list[list[str]]], None], folder: Path) -> Path:
    """The CSV of a command, with something changed."""
    path, table = folder / "a.mcap", folder / "a.csv"
    written(path, [(topic_of("r1/cmd_vel", Twist), [(bags.twist(1.5), START, START, 1)])])
    with bag.open(path) as opened:
        to_csv(opened, table)
    cells = list(csv.reader(io.StringIO(table.read_text())))
    change(cells)
    text = io.StringIO()
    csv.writer(text).writerows(cells)
    table.write_text(text.getvalue())
    return table


def swap(cells: list[list[str]]) -> None:
    for row in cells:
        row[5], row[10] = row[10], row[5]


def test_columns_may_stand_in_another_order(tmp_path: Path) -> None:
    table = changed(swap, tmp_path)
    from_csv(table, tmp_path / "b.mcap", "none")
    assert rows(tmp_path / "b.mcap") == rows(tmp_path / "a.mcap")


def drop(cells: list[list[str]]) -> None:
    for row in cells:
        del row[6]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (drop, "line 2: a geometry/Twist has linear.y, and there is no such column"),
        (
            lambda cells: cells[0].__setitem__(6, "linear.x"),
            "there is more than one such column|there is no such column",
        ),
        (lambda cells: [row.append("more") for row in cells], "line 2: a geometry/Twist has no field 'more'"),
        (lambda cells: cells[1].__setitem__(5, "fast"), "line 2: linear.x: 'fast' is no number"),
        (lambda cells: cells[1].__setitem__(5, "1_0"), "line 2: linear.x: '1_0' is no number"),
        (lambda cells: cells[1].__setitem__(0, "1.5"), "line 2: time: '1.5' is no whole number"),
        (lambda cells: cells[1].__setitem__(3, "geometry/Twitch"), "line 2: robo has no type 'geometry/Twitch'"),
        (lambda cells: cells[1].pop(), "line 2: the row has 10 cells, and the file 11 columns"),
        (lambda cells: cells[0].__setitem__(0, "when"), "its first columns are not time, arrived, key, type"),
        (lambda cells: cells.pop(), "it holds no message that a recording could have"),
    ],
)
def test_nothing_is_made_up_of_a_table(change: Any, reason: str, tmp_path: Path) -> None:
    table = changed(change, tmp_path)
    with pytest.raises(BagError, match=reason):
        from_csv(table, tmp_path / "b.mcap", "none")
    assert not (tmp_path / "b.mcap").exists()


def test_a_parameter_of_any_type_stays_what_it_is(tmp_path: Path) -> None:
    path, table, lines = tmp_path / "a.mcap", tmp_path / "a.csv", tmp_path / "a.jsonl"
    far = float("inf")
    values: list[Any] = [True, 3, 0.5, "3", "true", [1, 2], ["a"], far, -far, "inf", "nan", [0.5, far], ["inf"]]
    encode = cdr.encoder(Parameter)
    said = [(encode(Parameter(name="p", value=value)), START + n, START, 1) for n, value in enumerate(values)]
    written(path, [(topic_of("p", Parameter), said)])
    with bag.open(path) as opened:
        to_csv(opened, table)
        to_json_lines(opened, lines)
    from_json_lines(lines, tmp_path / "b.mcap", "none")
    assert rows(tmp_path / "b.mcap") == rows(path)
    from_csv(table, tmp_path / "c.mcap", "none")
    assert rows(tmp_path / "c.mcap") == rows(path)


def test_forms_are_told_by_names_and_contents(tmp_path: Path) -> None:
    path = drive(tmp_path)
    odd = path.rename(tmp_path / "drive.bin")
    assert form_of_input(str(odd)) == "mcap"
    for name, form in (("a.csv", "csv"), ("a.jsonl", "jsonl"), ("a.log.gz", "carmen"), ("a.LOG", "carmen")):
        (tmp_path / name).write_text("x")
        assert form_of_input(str(tmp_path / name)) == form
    (tmp_path / "what").write_text("x")
    with pytest.raises(BagError, match="its name does not say what it is: add --from mcap, carmen, csv or jsonl"):
        form_of_input(str(tmp_path / "what"))
    assert form_of_input(str(tmp_path / "what"), "carmen") == "carmen"
    with pytest.raises(BagError, match="there is no form 'xml'; use mcap, carmen, csv or jsonl"):
        form_of_input(str(tmp_path / "what"), "xml")
    assert (form_of_output("a.ndjson"), form_of_output("a", "csv"), form_of_output("-")) == ("jsonl", "csv", "jsonl")
    for name in ("a.log", "a"):
        with pytest.raises(BagError, match="what is it to be"):
            form_of_output(name)
    with pytest.raises(BagError, match="No such file"):
        form_of_input(str(tmp_path / "nowhere.csv"))
