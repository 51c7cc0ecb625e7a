"""How `robo topic echo` prints a message: as text, YAML, JSON Lines or a table, whole or in part."""

import json
from typing import Any

import pytest
import yaml

from robo.cli.views.echo import EchoOptions, Printer
from robo.errors import UsageError
from robo.samples.records import Received
from robo.samples.stream import Arrival
from robo.wire.codec import Attachment

ODOM = {"pose": {"x": 1.5, "y": -0.5}, "ranges": [0.1, float("inf"), float("nan")], "frame": "map\x1b[2J"}


def received(
    message: object = ODOM,
    key: str = "r1/odom",
    number: int | None = 7,
    type_name: str = "nav/Odometry",
    error: str = "",
) -> Received:
    attachment = Attachment(number, 10**18) if number is not None else None
    nothing: Any = None
    return Received(Arrival(key, 10**18 + 5, 100, attachment, nothing), type_name, message, error)


def shown(capsys: pytest.CaptureFixture[str], *messages: Received, one_topic: bool = True, **options: Any) -> list[str]:
    printer = Printer(EchoOptions(**options), one_topic=one_topic)
    for message in messages:
        printer.show(message)
    return capsys.readouterr().out.splitlines()


def test_text_is_yaml_with_a_head(capsys: pytest.CaptureFixture[str]) -> None:
    head, *lines, end = shown(capsys, received())
    assert (head, end) == ("# r1/odom  nav/Odometry", "---")
    tree = yaml.safe_load("\n".join(lines))
    assert tree["pose"] == {"x": 1.5, "y": -0.5}
    assert "\x1b" not in "".join(lines)


def test_bytes_are_told_in_text_and_kept_in_yaml(capsys: pytest.CaptureFixture[str]) -> None:
    image = received({"data": b"\x00\x01\xff", "parts": [b"ab"]})
    assert "data: <3 bytes>" in shown(capsys, image)
    assert "!!binary" in "".join(shown(capsys, image, form="yaml"))


def test_one_field_stands_alone_on_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert shown(capsys, received(), fields=["pose.x"]) == ["1.5"]
    assert shown(capsys, received(), fields=["frame"]) == ["map\\x1b[2J"]
    assert shown(capsys, received(), fields=["pose.x"], form="yaml")[0].startswith("# r1/odom")


def test_parts_are_called_by_their_paths(capsys: pytest.CaptureFixture[str]) -> None:
    _, *lines, _ = shown(capsys, received(), fields=["pose.x", "ranges[0]"])
    assert yaml.safe_load("\n".join(lines)) == {"pose.x": 1.5, "ranges[0]": 0.1}


def test_json_has_a_line_for_each_with_when_and_which(capsys: pytest.CaptureFixture[str]) -> None:
    first, second = shown(capsys, received(), received(number=None), form="json", fields=["ranges"])
    assert json.loads(first) == {
        "key": "r1/odom",
        "type": "nav/Odometry",
        "time": 10**18,
        "sequence_number": 7,
        "message": {"ranges": [0.1, "inf", "nan"]},
    }
    assert json.loads(second)["time"] == 10**18 + 5, "when it came, where nobody says when it was sent"


def test_a_table_has_a_head_and_then_rows(capsys: pytest.CaptureFixture[str]) -> None:
    lines = shown(capsys, received(), received(number=None), form="csv", fields=["pose.x", "frame"])
    assert lines[0] == "time,key,sequence_number,pose.x,frame"
    assert lines[1].startswith(f"{10**18},r1/odom,7,1.5,")
    assert lines[2].startswith(f"{10**18 + 5},r1/odom,,1.5,")
    whole = shown(capsys, received({"a": {"b": [1, 2]}}), form="csv")
    assert whole == ["time,key,sequence_number,a.b", f'{10**18},r1/odom,7,"[1,2]"']


def test_a_table_of_two_types_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UsageError, match=r"r1/b .* has other columns than the first message"):
        shown(capsys, received({"a": 1}), received({"b": 1}, key="r1/b"), form="csv")


def test_a_filter_leaves_out_and_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    printer = Printer(EchoOptions(condition="pose.x > 1", fields=["pose.x"]), one_topic=True)
    assert printer.show(received())
    assert not printer.show(received({"pose": {"x": 0.5}}))
    assert capsys.readouterr() == ("1.5\n", "")


def test_a_field_that_is_not_there_ends_one_topic_and_is_told_once_of_many(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UsageError, match=r"r1/odom \(nav/Odometry\): "):
        shown(capsys, received(), fields=["pose.z"])
    others = received({"z": 1}, key="r1/other"), received({"z": 2}, key="r1/other")
    printer = Printer(EchoOptions(fields=["pose.x"]), one_topic=False)
    assert [printer.show(one) for one in (*others, received())] == [False, False, True]
    out, told = capsys.readouterr()
    assert out == "1.5\n"
    assert told.count("r1/other (nav/Odometry) is left out: ") == 1


def test_what_cannot_be_read_is_told_in_its_place(capsys: pytest.CaptureFixture[str]) -> None:
    lines = shown(capsys, received(None, type_name="", error="not MessagePack\x1b[2J"))
    assert lines == ["# r1/odom  type not said", "# cannot be read: not MessagePack\\x1b[2J", "---"]


def test_long_things_are_cut_short_where_that_is_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    long = received({"text": "x" * 10_000, "list": list(range(10_000))})
    assert len("".join(shown(capsys, long, form="json", truncate=True))) < 2_000
    assert len("".join(shown(capsys, long, form="yaml"))) > 20_000
