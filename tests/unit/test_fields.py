"""Parts of messages, conditions on them, short forms."""

import math

import pytest

from robo.errors import UsageError
from robo.interfaces.parts import Field, Missing
from robo.tools.fields import FieldFilter, cell, flattened, truncated
from robo_messages import LaserScan

MESSAGE = {
    "header": {"frame_id": "odom", "stamp": {"sec": 3}},
    "ranges": [1.0, 2.5, math.inf],
    "poses": [{"x": 1.0}, {"x": 2.0}],
    "ok": True,
}


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("header.frame_id", "odom"),
        ("header.stamp.sec", 3),
        ("ranges[1]", 2.5),
        ("ranges[-1]", math.inf),
        ("poses[1].x", 2.0),
        ("ok", True),
    ],
)
def test_a_field_is_found(path: str, value: object) -> None:
    assert Field(path).of(MESSAGE) == value


def test_a_list_may_be_the_message() -> None:
    assert Field("[0]").of([7]) == 7
    assert Field("[0][1]").of([[7, 8]]) == 8


def test_a_message_is_as_its_plain_data() -> None:
    scan = LaserScan(ranges=[1.0, 2.0])
    assert Field("ranges[-1]").of(scan) == 2.0
    assert Field("header.frame_id").of(scan) == ""
    for path, text, may_come in (
        ("ranges[7]", r"ranges has 2 items, no \[7\]", True),
        ("rangs", "did you mean ranges", False),
        ("header.frame_id.x", "header.frame_id has no fields", False),
    ):
        with pytest.raises(Missing, match=text) as error:
            Field(path).of(scan)
        assert error.value.may_come == may_come


@pytest.mark.parametrize("path", ["", ".", "a.", ".a", "a..b", "a[", "a[x]", "a b", "a[0]b", "1a", "a]"])
def test_what_is_no_path_is_refused(path: str) -> None:
    with pytest.raises(UsageError, match="write names and indexes"):
        Field(path)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("heder", "it has no field 'heder'; did you mean header?"),
        ("header.frame", "header has no field 'frame'; did you mean frame_id?"),
        ("ok.x", "ok has no fields"),
        ("ok[0]", "ok is no list"),
        ("ranges[3]", r"ranges has 3 items, no \[3\]"),
    ],
)
def test_what_is_missing_is_told(path: str, text: str) -> None:
    with pytest.raises(Missing, match=text):
        Field(path).of(MESSAGE)


def test_a_long_filter_is_not_echoed_whole() -> None:
    with pytest.raises(UsageError) as error:
        FieldFilter(f"{'ok and ' * 1_000} !")
    assert "cannot read '!'" in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("ranges[0] < 1.5", True),
        ("ranges[0] > 1.5 or ok", True),
        ("header.frame_id == 'map'", False),
        ("m.header.stamp.sec >= 3 and not (poses[1].x == 1.0)", True),
        ("header.frame_id in ['odom', 'map']", True),
    ],
)
def test_a_filter_decides(text: str, holds: bool) -> None:
    assert FieldFilter(text).holds(MESSAGE) is holds


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ranges[0] <", "something is missing"),
        ("heder.x == 1", "did you mean header?"),
        ("ranges", "neither true nor false"),
        ("header.frame_id > 3", "have no order"),
        ("__import__('os').system('x') == 1", "cannot read"),
    ],
)
def test_a_filter_that_makes_no_sense_is_told_with_its_place(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as caught:
        FieldFilter(text).holds(MESSAGE)
    assert str(caught.value).endswith("^")


def test_a_message_as_columns() -> None:
    columns = dict(flattened(MESSAGE))
    assert list(columns) == ["header.frame_id", "header.stamp.sec", "ranges", "poses", "ok"]
    assert cell(columns["ranges"]) == '[1.0,2.5,"inf"]'
    assert (cell(True), cell(None), cell(b"\x00"), cell(math.nan), cell(1.5)) == ("true", "", "AA==", "nan", "1.5")


def test_long_parts_are_cut_short_and_say_so() -> None:
    short = truncated({"a": list(range(100)), "b": "x" * 200, "c": b"123", "d": [1]})
    assert isinstance(short, dict)
    assert short["a"][:2] == [0, 1]
    assert short["a"][-1] == "… 84 more"
    assert short["b"].endswith("… 72 more")
    assert short["c"] == "<3 bytes>"
    assert short["d"] == [1]
