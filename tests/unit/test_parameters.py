import enum
import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

import robo
from robo.errors import ContractError, ParameterError, ParameterFileError
from robo.node.loading import load_node_class
from robo.parameters import files as parameter_files
from robo.parameters.model import build, change, describe, flat
from robo.parameters.words import parse_assignment, parse_value, sides_of, sorted_out
from robo.process import options as node_options
from robo.text.tree import Problem
from robo.text.yaml_tree import lines_of


class Tuning(robo.Parameters):
    rate: Annotated[float, Meta(gt=0, description="Hz")] = 10.0
    name: str = "base"
    count: Annotated[int, Meta(ge=1, le=5)] = 1
    gains: list[float] = msgspec.field(default_factory=lambda: [1.0, 2.0])
    enabled: bool = True


def test_words_are_told_from_assignments() -> None:
    assert sides_of("rate:=2.0") == ("rate", "2.0")
    assert sides_of("name:=a:=b") == ("name", "a:=b")
    assert sides_of(":=x") == ("", "x")
    assert sides_of("a:b=c") is None
    words = ["robot.yaml", "rate:=1", "arm", "rate:=2", "empty:="]
    assert sorted_out(words) == (["robot.yaml", "arm"], {"rate": "2", "empty": ""})


def test_values_go_over_defaults_and_an_int_is_a_float() -> None:
    tuning = build(Tuning, {"rate": 5, "gains": [1, 2.5]}, "/r1/base")
    assert tuning.rate == 5.0
    assert isinstance(tuning.rate, float)
    assert tuning.gains == [1.0, 2.5]
    assert tuning.name == "base"


def test_every_mistake_is_named_with_what_was_expected() -> None:
    with pytest.raises(ParameterError) as error:
        build(Tuning, {"rate": 0, "nmae": "x", "count": 9, "enabled": "yes", "gains": [math.inf]}, "/r1/base")
    text = str(error.value)
    assert "rate = 0: expected float > 0.0 (Hz; > 0)" in text
    assert "no parameter 'nmae'; did you mean name?" in text
    assert "count = 9: expected int <= 5" in text
    assert "enabled = 'yes': expected bool" in text
    assert "gains = [inf]: expected a finite number" in text
    assert len(text.splitlines()) == 5


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nan_and_infinities_are_refused(value: float) -> None:
    with pytest.raises(ParameterError, match=r"rate = (nan|-?inf)"):
        build(Tuning, {"rate": value}, "x")


anything = st.none() | st.booleans() | st.text() | st.lists(st.floats())


@given(st.dictionaries(st.sampled_from(["rate", "name", "count", "x"]), anything))
def test_whatever_is_given_is_taken_or_refused_by_name(values: dict[str, Any]) -> None:
    known = {field: getattr(Tuning(), field) for field in Tuning.__struct_fields__}
    try:
        tuning = build(Tuning, values, "node")
    except ParameterError as error:
        complaints = str(error).splitlines()
    else:
        complaints = []
        assert {field: getattr(tuning, field) for field in known} == known | values
    assert all(line.startswith("node") for line in complaints)
    assert len(complaints) <= len(values)


class Mode(enum.Enum):
    SLOW = "slow"
    FAST = "fast"


def test_choices_and_what_is_allowed_on_purpose() -> None:
    class Chosen(robo.Parameters):
        mode: Mode = Mode.SLOW
        side: Literal["left", "right"] = "left"
        limit: Annotated[float, robo.NON_FINITE] = math.inf

    class Several(robo.Parameters):
        limits: Annotated[list[float], robo.NON_FINITE] = msgspec.field(default_factory=list)

    chosen = build(Chosen, {"mode": "fast", "side": "right", "limit": -math.inf}, "x")
    assert (chosen.mode, chosen.side, chosen.limit) == (Mode.FAST, "right", -math.inf)
    assert build(Chosen, {"limit": "-inf"}, "x").limit == -math.inf
    assert build(Several, {"limits": [1, "inf", "-inf"]}, "x").limits == [1.0, math.inf, -math.inf]
    assert flat(chosen) == {"mode": "fast", "side": "right", "limit": -math.inf, "use_sim_time": False}
    assert [info.type for info in describe(Chosen)][:2] == ["slow or fast", "left or right"]
    with pytest.raises(ParameterError) as error:
        build(Chosen, {"mode": "x", "side": "up"}, "n")
    assert str(error.value).splitlines() == [
        "n: mode = 'x': invalid enum value 'x'; use slow or fast",
        "n: side = 'up': invalid enum value 'up'; use left or right",
    ]


class Inner(msgspec.Struct, frozen=True):
    p: Annotated[float, Meta(ge=0)] = 1.0
    i: float = 0.0


def test_nested_parameters_have_names_with_dots() -> None:
    class Nested(robo.Parameters):
        gains: Inner = Inner(2.0)
        frame: Annotated[str, robo.READ_ONLY] = "base"

    first = build(Nested, {"gains": {"i": 3}}, "n")
    assert first.gains == Inner(2.0, 3.0)
    second = change(first, {"gains.p": 4}, "n")
    assert (first.gains.p, second.gains) == (2.0, Inner(4.0, 3.0))
    assert list(flat(second)) == ["gains.p", "gains.i", "frame", "use_sim_time"]
    assert change(second, {"frame": "base"}, "n") == second
    for changes, reason in (
        ({"gains.p": -1}, "gains.p = -1: expected float >= 0.0"),
        ({"gains.d": 1}, "no parameter 'gains.d'; did you mean gains.p?"),
        ({"gains": 5}, "no parameter 'gains'"),
        ({"frame": "x"}, "frame is read-only"),
    ):
        with pytest.raises(ParameterError, match=re.escape(reason)):
            change(second, changes, "n")


def test_steps() -> None:
    class Stepped(robo.Parameters):
        speed: Annotated[float, Meta(ge=0.05, le=2), robo.Step(0.1)] = 0.05
        angle: Annotated[int, robo.Step(15)] = 0

    assert build(Stepped, {"speed": 0.35, "angle": -30}, "x").speed == 0.35
    with pytest.raises(ParameterError, match=r"speed = 0.3: expected a multiple of 0.1 \(0.05 to 2\)"):
        build(Stepped, {"speed": 0.3}, "x")
    with pytest.raises(ParameterError, match="angle = 20: expected a multiple of 15"):
        build(Stepped, {"angle": 20}, "x")
    assert describe(Stepped)[0].constraints == {"ge": 0.05, "le": 2, "step": 0.1}


def test_parameters_are_not_assigned_one_by_one() -> None:
    with pytest.raises(AttributeError, match="cannot be assigned"):
        Tuning().rate = 3.0


def test_description() -> None:
    infos = {info.name: info for info in describe(Tuning)}
    assert list(infos) == ["rate", "name", "count", "gains", "enabled", "use_sim_time"]
    assert infos["rate"].description == "Hz"
    assert infos["rate"].constraints == {"gt": 0}
    assert infos["count"].constraints == {"ge": 1, "le": 5}
    assert infos["gains"].default == [1.0, 2.0]

    class NoDefault(robo.Parameters):
        rate: float

    with pytest.raises(ContractError, match="rate has no default"):
        describe(NoDefault)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("true", True), ("false", False), ("3", 3), ("-2.5", -2.5), ("1e3", 1000.0), ("no", "no"), ("hello", "hello"),
        ("[1, 2.5]", [1, 2.5]), ("{a: 1}", {"a": 1}), ("'3'", "3"), ("", ""),
    ],
)  # fmt: skip
def test_values_of_the_command_line(text: str, value: object) -> None:
    assert parse_value(text) == value
    assert type(parse_value(text)) is type(value)


def test_assignments() -> None:
    assert parse_assignment("rate:=2.0", Tuning) == ("rate", 2.0)
    assert parse_assignment("name:=2.0", Tuning) == ("name", "2.0")
    for bad in ("rate", "rate=2", ":=2"):
        with pytest.raises(ParameterError, match="write name:=value"):
            parse_assignment(bad)
    with pytest.raises(ParameterError):
        parse_value("[1, 2")


FILE = """\
/**:
  ros__parameters:
    use_sim_time: false
    rate: 1.0
tracker:
  ros__parameters:
    rate: 2.0
/r1/tracker:
  ros__parameters:
    rate: 3.0
r2:
  tracker:
    ros__parameters:
      rate: 4.0
/fleet/*:
  rate: 5.0
/**/guard:
  rate: 6.0
"""


@pytest.mark.parametrize(
    ("namespace", "node", "rate"),
    [
        ("", "other", 1.0), ("r9", "tracker", 2.0), ("r1", "tracker", 3.0), ("r2", "tracker", 4.0),
        ("fleet", "any", 5.0), ("a/b", "guard", 6.0), ("", "guard", 6.0),
    ],
)  # fmt: skip
def test_the_more_specific_entry_wins(tmp_path: Path, namespace: str, node: str, rate: float) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(FILE)
    values = parameter_files.load(path).values_for(namespace, node)
    assert values == {"use_sim_time": False, "rate": rate}


def test_order_in_the_file_does_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text("tracker: {rate: 2.0}\n/**: {rate: 1.0}\n")
    assert parameter_files.load(path).values_for("r1", "tracker") == {"rate": 2.0}


def test_mistakes_in_a_file_are_all_named_with_their_place(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text("a: 1\nb:\n  ros__parameters: [1]\nc: {x: 1, x: 2}\n")
    with pytest.raises(ParameterFileError) as error:
        parameter_files.load(path)
    lines = str(error.value).splitlines()
    assert sorted(line.removeprefix(str(path)).split(": ")[0] for line in lines) == [":1:1", ":3:20", ":4:11"]


def read_file(text: str) -> tuple[parameter_files.ParameterFile, list[str], list[str]]:
    problems: list[Problem] = []
    file = parameter_files.read(text, "f.yaml", problems)
    return file, list(map(str, problems)), list(map(str, file.warnings))


def test_the_spellings_of_infinity_and_nan_are_those_of_ros() -> None:
    words = "[.inf, .Inf, .INF, +.inf, +.Inf, +.INF, -.inf, -.Inf, -.INF, .nan, .NaN, .NAN]"
    file, problems, _ = read_file(f"test_node:\n  ros__parameters:\n    numbers: {words}\n")
    assert not problems
    numbers = file.values_for("", "test_node")["numbers"]
    assert isinstance(numbers, list)
    assert numbers[:9] == [math.inf] * 6 + [-math.inf] * 3
    assert all(isinstance(number, float) and math.isnan(number) for number in numbers[9:])
    file, _, _ = read_file("n: {ros__parameters: {words: [.nananan, .nAN, .Nan, .infinf, .INf, .infinity]}}")
    assert file.values_for("", "n")["words"] == [".nananan", ".nAN", ".Nan", ".infinf", ".INf", ".infinity"]


PARTLY = ["/foo**", "/**foo", "/f**oo", "/foo*", "/*foo", "/f*oo", "/**/node**", "/**/*node", "/**/n*ode", "foo*/node"]


@pytest.mark.parametrize(
    ("text", "place", "expected"),
    [
        ("node1: {ros__parameters: {a: 1}}\nros__parameters: {id: 10}", "2:1", "where no node is named"),
        ("lidar_ns//lidar_w: {ros__parameters: {id: 10}}", "1:1", "one / separates two names"),
        ("a:\n  b//c: {ros__parameters: {id: 10}}", "2:3", "has an empty name"),
        ("/foo:\n  /*:\n    ros__parameters: {id: 10}", "2:3", "within a namespace a name has no / before it"),
        ("/ns/: {ros__parameters: {id: 10}}", "1:1", "names a namespace and no node; write /ns/NAME"),
        ("/: {ros__parameters: {id: 10}}", "1:1", "names a namespace and no node"),
        ("'': {ros__parameters: {id: 10}}", "1:1", "without a name"),
        ("ns/robot-1: {speed: 1}", "1:1", "'robot-1' is not a valid name"),
        *((f"{key}: {{ros__parameters: {{id: 10}}}}", "1:1", "not for part of a name") for key in PARTLY),
        ("n:\n  ros__parameters:\n    a:\n    b: 1", "3:5", "a has no value"),
        ("n: {a: ~}", "1:5", "a has no value"),
        ("n: {a: {b: null}}", "1:9", "a.b has no value"),
        ("n: {a: [1, null]}", "1:12", "a has no value"),
        ("lidar_ns:\nlidar_1: {ros__parameters: {id: 10}}", "1:1", "lidar_ns: expected a map of parameters"),
        ("n: {ros__parameters: {a: 1}, b: 2}", "1:30", "b stands beside ros__parameters"),
        ("n: {a: {b: 1}, a.b: 2}", "1:16", "parameter 'a.b' stands twice; it is already in line 1"),
        ("n: {a: [{b: 1, b: 2}]}", "1:16", "'b' stands twice"),
    ],
)
def test_what_ros_refuses_is_a_mistake_with_its_place(text: str, place: str, expected: str) -> None:
    _, problems, _ = read_file(text)
    (problem,) = problems
    assert problem.startswith(f"f.yaml:{place}: ")
    assert expected in problem


WILDCARDS = """\
/**: {ros__parameters: {id: 1, rate: 1.0}}
/*: {ros__parameters: {id: 2}}
/**/one: {ros__parameters: {id: 3}}
/**: {two: {ros__parameters: {id: 4}}}
/foo1/**: {ros__parameters: {id: 5}}
/foo2/*: {ros__parameters: {id: 6}}
/foo3: {"*": {ros__parameters: {id: 7}}}
/foo4/**/bar: {bar1/bar2/**: {ros__parameters: {id: 8}}}
/: {three: {ros__parameters: {id: 9}}}
/**: {ros__parameters: {id: 1, more: true}}
"""


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("a/b/any", 1), ("any", 2), ("a/one", 3), ("two", 4), ("a/two", 4), ("foo1/a/b", 5), ("foo2/a", 6),
        ("foo2/a/b", 1), ("foo3/a", 7), ("foo4/x/y/bar/bar1/bar2/a", 8), ("three", 9), ("a/three", 1),
    ],
)  # fmt: skip
def test_wildcards_and_a_pattern_that_stands_twice_are_read_as_in_ros(name: str, number: int) -> None:
    file, problems, warnings = read_file(WILDCARDS)
    assert (problems, warnings) == ([], [])
    namespace, _, node = name.rpartition("/")
    values = file.values_for(namespace, node)
    assert (values["id"], values["more"], values["rate"]) == (number, True, 1.0)


def test_a_pattern_that_contradicts_itself_is_told_and_the_last_one_holds() -> None:
    text = "ns/n: {id: 1, x: .nan, y: 1}\n/ns/n: {id: 2}\nns:\n  n: {ros__parameters: {id: 3, x: .NaN, y: 1.0}}\n"
    file, problems, warnings = read_file(text)
    assert not problems
    assert file.values_for("ns", "n")["id"] == 3
    assert warnings == [
        "f.yaml:2:9: /ns/n: id is 2 here and 1 in line 1; the last one holds",
        "f.yaml:4:25: ns/n: id is 3 here and 2 in line 2; the last one holds",
    ]
    # A node anywhere and the node of the root are not the same.
    assert read_file("n: {id: 1}\n/n: {id: 2}\n")[1:] == ([], [])


def test_a_node_that_is_run_alone_tells_of_a_contradiction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "params.yaml"
    path.write_text("/**: {log_rate: 1.0}\n/**: {log_rate: 2.0}\n")
    spec = node_options.parse(load_node_class("robo_services.position_tracker"), ["--params-file", str(path)])
    assert spec.parameters["log_rate"] == 2.0
    assert "log_rate is 2.0 here and 1.0 in line 1; the last one holds" in capsys.readouterr().err


PIECES = [
    "/**",
    "/*",
    "n",
    "ns/n",
    "ros__parameters",
    ":",
    "\n",
    "  ",
    "    ",
    "{",
    "}",
    "1",
    ".inf",
    "~",
    "- ",
    "&a ",
    "*a",
    "'",
]


@given(st.text(max_size=100) | st.lists(st.sampled_from(PIECES), max_size=40).map("".join))
def test_any_text_is_a_parameter_file_or_mistakes_with_places(text: str) -> None:
    problems: list[Problem] = []
    file = parameter_files.read(text, "f.yaml", problems)
    file.values_for("ns", "n")
    for problem in (*problems, *file.warnings):
        assert problem.text
        assert 1 <= problem.position.line <= len(lines_of(text))


def test_nodes_beside_values_aliases_and_the_plain_form_are_read_too() -> None:
    text = """\
ns:
  ros__parameters: {id: 1}
  n: {ros__parameters: &same {id: 2}}
  m: {ros__parameters: *same}
k: {id: 3}
"""
    file, problems, _ = read_file(text)
    assert not problems
    assert [file.values_for(*node)["id"] for node in (("", "ns"), ("ns", "n"), ("ns", "m"), ("x", "k"))] == [1, 2, 2, 3]


def test_a_missing_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ParameterFileError, match=r"nope\.yaml does not exist"):
        parameter_files.load(tmp_path / "nope.yaml")
