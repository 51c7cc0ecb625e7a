"""What can be said once all processes are known: names, needs, parameters, and which are to be started."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from robo.launch import contracts, needs
from robo.launch.arguments import COMMAND_LINE
from robo.launch.contracts import Answer, Question
from robo.launch.manifest import Need
from robo.launch.plan import ProcessPlan
from robo.launch.resolve import Resolution, resolve
from robo.launch.substitution import BROKEN, Broken, Word
from robo.launch.values import Assignment, Mention, NodeFacts, assign, check
from robo.node.contract_data import ContractData
from robo.parameters.hints import ParameterInfo
from robo.text.tree import Position, Problem, Scalar
from robo.wire.reports import Setting


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(contracts, "examine_apart", lambda questions: list(map(answer, questions)))


def contract(name: str, **parameters: str) -> ContractData:
    infos = tuple(
        ParameterInfo(name=key, type=type_, default=None, description="", unit="", constraints={}, read_only=False)
        for key, type_ in parameters.items()
    )
    return ContractData(
        class_name=f"{name}:Node", name=name, description="", publishers=(), subscriptions=(), services=(),
        clients=(), timers=(), parameters=infos,
    )  # fmt: skip


def answer(question: Question) -> Answer:
    """As a node class would: `motor` and `lamp` are there; a speed over 9 is too high."""
    classes = {"motor": contract("motor", speed="float", label="str"), "lamp": contract("lamp", pin="int")}
    if question.service not in classes:
        return Answer(error=f"there is no service {question.service!r}")
    speed = question.values.get("speed")
    refused = {"speed": "speed is too high"} if isinstance(speed, float) and speed > 9 else {}
    return Answer(contract=classes[question.service], mistakes=refused)


def resolution(
    text: str, *, groups: Sequence[str] = (), host: str | None = None, parameters: dict[str, str] | None = None
) -> Resolution:
    Path("m.yaml").write_text(text)
    assigned = [Assignment(left, Word(value)) for left, value in (parameters or {}).items()]
    return resolve(Path("m.yaml"), {}, groups=groups, host=host, parameters=assigned)


def fine(
    text: str, *, groups: Sequence[str] = (), host: str | None = None, parameters: dict[str, str] | None = None
) -> dict[str, ProcessPlan]:
    found = resolution(text, groups=groups, host=host, parameters=parameters)
    assert found.problems == ()
    return {process.full_name: process for process in found.plan.processes}


def mistakes(
    text: str, *, groups: Sequence[str] = (), host: str | None = None, parameters: dict[str, str] | None = None
) -> list[str]:
    return list(map(str, resolution(text, groups=groups, host=host, parameters=parameters).problems))


# -- a parameter is the list of what is said of it ---------------------------------------------------------


def test_all_that_is_said_of_a_parameter_weakest_first() -> None:
    Path("one.yaml").write_text("/**: {speed: 1.0}\nmotor: {speed: 2.0}\n")
    Path("two.yaml").write_text("/r1/motor: {speed: 3.0}\n")
    Path("inner.yaml").write_text(
        """\
groups:
  g:
    namespace: r1
    params: [one.yaml, {speed: 4.0}]
    nodes:
      motor: {service: motor, params: [{speed: 5.0}, two.yaml]}
"""
    )
    text = "include: {file: inner.yaml, override: {motor: {params: {speed: 6.0}}}}"
    (motor,) = fine(text, parameters={"motor.speed": "7"}).values()
    assert motor.settings["speed"] == (
        Setting(1.0, "one.yaml:1:7"),
        Setting(2.0, "one.yaml:2:9"),
        Setting(3.0, "two.yaml:1:13"),
        Setting(4.0, "inner.yaml:4:25"),
        Setting(5.0, "inner.yaml:6:41"),
        Setting(6.0, "m.yaml:1:57"),
        Setting(7, "command line"),
    )
    assert motor.parameters == {"speed": 7}
    assert motor.parameter_files == ("one.yaml", "two.yaml")


def test_a_word_from_outside_is_what_its_parameter_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LABEL", "007")
    text = "groups: {g: {nodes: {m: {service: motor, params: {label: '${env:LABEL}', speed: '${env:LABEL}'}}}}}"
    assert fine(text)["/m"].parameters == {"label": "007", "speed": 7}
    command = "groups: {g: {nodes: {m: {run: x, params: {label: '${env:LABEL}', l: ['${env:LABEL}'], gains: {p: 1}}}}}}"
    assert fine(command)["/m"].parameters == {"label": 7, "l": [7], "gains.p": 1}


def test_what_is_said_of_a_group_is_for_those_that_have_it() -> None:
    text = """\
groups:
  g:
    params: {speed: 1.0, pin: 3}
    nodes: {m: {service: motor}, l: {service: lamp}, c: {run: x}}
"""
    found = fine(text)
    assert found["/m"].parameters == {"speed": 1.0}
    assert found["/l"].parameters == {"pin": 3}
    assert found["/c"].parameters == {"speed": 1.0, "pin": 3}, "a command takes whatever it is given"


def test_what_reaches_nobody_is_loose_unless_it_is_said_of_one_node_or_for_this_start() -> None:
    text = "groups: {g: {params: {sped: 1.0}, nodes: {m: {service: motor}}}}"
    found = resolution(text)
    assert found.problems == ()
    assert [str(problem) for problem in found.loose] == [
        "m.yaml:1:23: no node has a parameter 'sped'; did you mean speed?"
    ]
    assert mistakes("groups: {g: {nodes: {m: {service: motor, params: {sped: 1.0}}}}}") == [
        "m.yaml:1:51: /m has no parameter 'sped'; did you mean speed?"
    ]
    plain = "groups: {g: {nodes: {m: {service: motor}}}}"
    assert mistakes(plain, parameters={"sped": "1"}) == [
        "command line: no node has a parameter 'sped'; did you mean speed?"
    ]
    assert mistakes(plain, parameters={"m.sped": "1"}) == [
        "command line: /m has no parameter 'sped'; did you mean speed?"
    ]


def test_what_a_node_class_refuses_is_told_where_the_value_stands() -> None:
    text = "groups: {g: {params: {speed: 1.0}, nodes: {m: {service: motor, params: {speed: 99.0}}}}}"
    assert mistakes(text) == ["m.yaml:1:80: speed is too high"]
    assert mistakes("groups: {g: {nodes: {m: {service: moter}}}}") == ["m.yaml:1:35: there is no service 'moter'"]


def test_a_value_that_cannot_be_worked_out_is_told_once_and_not_checked() -> None:
    text = "groups: {g: {params: {speed: '${q}'}, nodes: {m: {service: motor}, n: {service: motor}}}}"
    (found,) = mistakes(text)
    assert found.startswith("m.yaml:1:31: ${q} is not defined")


@pytest.mark.parametrize(
    ("left", "name"),
    [
        ("motor.speed", "speed"),
        ("/r1/motor.speed", "speed"),
        ("r1/motor.gains.p", "gains.p"),
        ("lamp.speed", None),
        ("motors.speed", None),
        ("speed", None),
    ],
)
def test_whom_the_command_line_means(left: str, name: str | None) -> None:
    assert Assignment(left, Word("1")).name_for("motor", "/r1/motor") == name


def test_an_assignment_without_a_node_is_for_all() -> None:
    one: dict[str, list[Mention]] = {"speed": [Mention(1, COMMAND_LINE, COMMAND_LINE, False)]}
    two: dict[str, list[Mention]] = {}
    problems: list[Problem] = []
    assign(
        [Assignment("speed", Word("2")), Assignment("a.x", Word("3"))], [("a", "/a", one), ("b", "/b", two)], problems
    )
    assert [mention.value for mention in one["speed"]] == [1, "2"]
    assert [mention.shared for mention in one["speed"]] == [False, True]
    assert [mention.value for mention in one["x"]] == ["3"]
    assert set(two) == {"speed"}
    assert not problems
    assign([Assignment("aa.x", Word("1"))], [("a", "/a", one)], problems)
    assert "there is no node aa; did you mean a?" in problems[0].text


def test_parameters_of_which_nothing_is_known_are_taken() -> None:
    mention = Mention(Word("3"), COMMAND_LINE, COMMAND_LINE, False)
    problems: list[Problem] = []
    (found,) = check([NodeFacts("/a", {"x": [mention]}, Answer(error="it cannot be imported"))], problems, problems)
    assert found == {"x": (Setting(3, "command line"),)}
    assert not problems


# -- names, groups and hosts -------------------------------------------------------------------------------


def test_two_nodes_of_one_name_are_a_mistake() -> None:
    text = "groups: {g: {nodes: {a: {run: x}, b: {run: x, name: a}}}}"
    assert mistakes(text) == ["m.yaml:1:35: node /a is already in m.yaml:1:22"]
    (found,) = mistakes("groups: {g: {nodes: {a: {run: x, replicas: 2, name: a}}}}")
    assert found.endswith("; put ${index} into its name or namespace")


GROUPS = """\
groups:
  base: {hosts: low, nodes: {a: {run: x, needs: b}}}
  arm:
    hosts: high
    nodes: {b: {run: x}}
    groups: {hand: {nodes: {c: {run: x, needs: [a, b]}}}}
"""


@pytest.mark.parametrize(
    ("groups", "host", "started"),
    [
        ([], None, {"/a": ["/b"], "/b": [], "/c": ["/a", "/b"]}),
        (["arm"], None, {"/b": [], "/c": ["/b"]}),
        (["hand"], None, {"/c": []}),
        (["arm/hand", "base"], None, {"/a": [], "/c": ["/a"]}),
        ([], "high", {"/b": [], "/c": ["/a", "/b"]}),
        (["base", "hand"], "high", {"/c": ["/a"]}),
    ],
)
def test_of_some_groups_and_one_host(groups: list[str], host: str | None, started: dict[str, list[str]]) -> None:
    found = fine(GROUPS, groups=groups, host=host)
    assert {name: list(plan.needs) for name, plan in found.items()} == started


def test_groups_and_hosts_that_are_not_there() -> None:
    assert mistakes(GROUPS, groups=["arms"]) == ["command line: m.yaml has no group 'arms'; did you mean arm?"]
    assert mistakes(GROUPS, host="hihg") == ["m.yaml:1:1: there is no host 'hihg' in it; did you mean high?"]
    without = GROUPS.replace("hosts: low, ", "")
    assert mistakes(without) == ["m.yaml:2:18: /a is on no host, and others are: say hosts: high in its group"]


def test_a_group_that_is_a_manifest_says_so() -> None:
    assert mistakes(GROUPS, groups=["replay"]) == [
        "command line: m.yaml has no group 'replay'; did you mean replay.yaml?"
    ]


# -- who comes after whom ----------------------------------------------------------------------------------

HERE = Position("m.yaml", 1, 1)


def needed(*wanted: tuple[str, str], left_out: Sequence[str] = ()) -> tuple[dict[str, list[str]], list[str]]:
    """What processes need, from pairs of a full name and what it needs."""
    told: list[str] = []
    by_node: dict[str, list[Need]] = {}
    for node, other in wanted:
        by_node.setdefault(node, [])
        if other:
            by_node[node].append(Need(Scalar(other, HERE), "ready"))
    dependents = [needs.Dependent(node, node.strip("/").rpartition("/")[0], own) for node, own in by_node.items()]
    by_key = {("r1", "camera"): ["/r1/camera_1", "/r1/camera_2"]}
    found = needs.resolve(dependents, by_key, left_out, lambda _where, text: told.append(text))
    return {node: list(own) for node, own in found.items()}, told


def test_a_name_means_the_node_in_the_same_namespace() -> None:
    found, told = needed(("/r1/a", "b"), ("/r1/b", ""), ("/b", "/r1/b"), ("/r2/c", "/b"))
    assert not told
    assert found == {"/r1/a": ["/r1/b"], "/r1/b": [], "/b": ["/r1/b"], "/r2/c": ["/b"]}


def test_a_node_with_replicas_means_all_of_them() -> None:
    found, told = needed(("/r1/a", "camera"), ("/r1/camera_1", ""), ("/r1/camera_2", ""))
    assert not told
    assert found["/r1/a"] == ["/r1/camera_1", "/r1/camera_2"]


def test_a_node_that_is_left_out_is_not_waited_for_and_another_is_a_mistake() -> None:
    assert needed(("/r1/a", "gone"), left_out=["gone"]) == ({"/r1/a": []}, [])
    _, told = needed(("/r1/a", "elsewhere/x"))
    assert told == ["needs 'elsewhere/x': there is no node /r1/elsewhere/x"]
    _, told = needed(("/r1/a", "b"), ("/r2/b", ""))
    assert told == ["needs 'b': there is no node /r1/b; did you mean /r2/b?"]
    _, told = needed(("/r1/tracker", "trackr"))
    assert told == ["needs 'trackr': there is no node /r1/trackr; did you mean tracker?"]


def test_every_circle_is_told_once_from_its_first_node_on() -> None:
    _, told = needed(("/a", "b"), ("/b", "c"), ("/c", "a"), ("/d", "d"), ("/e", "a"))
    assert sorted(told) == ["needs go in a circle: /a → /b → /c → /a", "needs go in a circle: /d → /d"]


def test_a_need_that_cannot_be_worked_out_is_left_out() -> None:
    told: list[str] = []
    broken = Need(Scalar(Broken((Problem(HERE, "wrong"),)), HERE), "ready")
    silent = Need(Scalar(BROKEN, HERE), "ready")
    found = needs.resolve([needs.Dependent("/a", "", [broken, silent])], {}, (), lambda _where, text: told.append(text))
    assert (found, told) == ({"/a": {}}, ["wrong"])


# -- what comes of it ----------------------------------------------------------------------------------------


def test_a_resolution_knows_what_it_was_made_of() -> None:
    Path("p.yaml").write_text("motor: {speed: 1.0}\nother: {x: 1}\n")
    Path("inner.yaml").write_text("groups: {h: {nodes: {l: {service: lamp}}}}")
    found = resolution(
        "description: both\nargs: {n: 3, file: {type: path, default: p.yaml, exists: true}}\n".replace("file", "where")
        + "include: inner.yaml\ngroups: {g: {nodes: {motor: {service: motor, params: p.yaml, remap: {a: b}}}}}"
    )
    assert found.problems == ()
    assert found.plan.files == ("m.yaml", "inner.yaml", "p.yaml")
    assert (found.plan.description, found.plan.robot, found.plan.arguments["n"]) == ("both", "my_robot", 3)
    assert [entry.pattern for entry in found.unmatched] == ["other"]
    assert [path.path for path in found.paths] == [f"{Path.cwd()}/p.yaml"]
    assert set(found.contracts) == {"/motor", "/l"}
    assert (found.remaps["/motor"]["a"].shared, found.positions["/l"].file) == (False, "inner.yaml")


def test_a_plan_without_a_manifest_is_a_mistake_and_no_crash() -> None:
    found = resolve(Path("nowhere.yaml"), {}, robot="r1")
    assert found.plan.processes == ()
    assert found.plan.robot == "r1"
    (problem,) = found.problems
    assert str(problem).startswith("nowhere.yaml:1:1: manifest nowhere.yaml cannot be read")


# -- nodes that share a process ----------------------------------------------------------------------------------------


def test_nodes_that_name_one_process_share_it_and_each_robot_has_its_own() -> None:
    text = """\
groups:
  g:
    for_each: {robot: [r1, r2]}
    namespace: ${robot}
    process: team
    nodes:
      a: {service: motor, namespace: arm}
      b: {service: lamp, process: '${robot}_other'}
      c: {service: lamp, process: ''}
"""
    found = fine(text)
    shared = {name: plan.process for name, plan in found.items()}
    assert shared == {
        "/r1/arm/a": "/r1/team", "/r1/b": "/r1/r1_other", "/r1/c": None,
        "/r2/arm/a": "/r2/team", "/r2/b": "/r2/r2_other", "/r2/c": None,
    }  # fmt: skip
    assert found["/r1/arm/a"].command()[-3:] == ("-m", "robo.process.shared", "/r1/team")


@pytest.mark.parametrize(
    ("node", "said"),
    [
        ("{run: x}", "a command cannot share the process team; process: '' gives this node one of its own"),
        *(
            (
                f"{{service: motor, {key}: {value}}}",
                f"{key} is for a whole process: a node cannot have it in the process team; process: '' gives this"
                " node one of its own",
            )
            for key, value in (
                ("prefix", "gdb"), ("args", "x"), ("cwd", "."), ("priority", "5"), ("cpus", "[0]"), ("env", "{A: b}"),
            )
        ),
    ],
)  # fmt: skip
def test_what_is_for_a_whole_process_cannot_be_said_of_one_of_its_nodes(node: str, said: str) -> None:
    (found,) = mistakes(f"groups: {{g: {{process: team, nodes: {{a: {node}}}}}}}")
    assert found.split(": ", 1)[1] == said
    alone = node.removesuffix("}") + ", process: ''}"
    fine(f"groups: {{g: {{process: team, nodes: {{a: {alone}}}}}}}")


def test_a_process_is_on_one_host_and_has_a_name_of_its_own() -> None:
    text = """\
groups:
  g: {hosts: pi, process: team, nodes: {a: {service: motor}}}
  h: {hosts: pc, process: team, nodes: {b: {service: lamp}}}
"""
    said = "m.yaml:3:41: /b, on pc, shares the process /team with /a, which is on pi"
    assert mistakes(text) == [said]
    text = "groups: {g: {process: a, nodes: {a: {service: motor}}}}"
    assert mistakes(text) == ["m.yaml:1:34: process /a has the name of a node; call it something else"]
    text = "groups: {g: {process: 1x, nodes: {a: {service: motor}}}}"
    assert mistakes(text) == ["m.yaml:1:23: process: '1x' is no name; use letters, digits and _, no digit first"]
