"""What is wrong with a manifest: all of it at once, each with its place and what to do."""

import pickle
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robo.cli.launch.words import split_words
from robo.errors import ManifestError, UsageError
from robo.launch import contracts, resolve
from robo.launch.check import check
from robo.launch.faults import ManifestFaults, as_data, as_text
from robo.launch.find import find_manifest
from robo.launch.language import keys_of
from robo.launch.manifest import Manifest
from robo.launch.schema import parts
from robo.launch.substitution import Word
from robo.launch.values import Assignment
from robo.text.tree import Position, Problem
from robo.text.yaml_tree import lines_of


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def mistakes(text: str, *, parameters: dict[str, str] | None = None, **arguments: str) -> list[str]:
    Path("m.yaml").write_text(text)
    assigned = [Assignment(left, Word(value)) for left, value in (parameters or {}).items()]
    given = {name: Word(value) for name, value in arguments.items()}
    with pytest.raises(ManifestFaults) as error:
        resolve.load(Path("m.yaml"), given, parameters=assigned)
    return str(error.value).splitlines()


def node(text: str) -> str:
    return f"groups: {{g: {{nodes: {{a: {{{text}}}}}}}}}"


EIGHT = """\
description: eight mistakes
args:
  speed: {type: float, default: 0.5}
groups:
  control:
    namespce: r1
    params: nowhere.yaml
    nodes:
      velocity_controller:
        service: robo_services.velocity_controller
        params: {linear_velocty: 0.3, angular_velocity: "${sped}"}
        needs: {safety_monitor: ready}
      safety_monitor:
        service: robo_services.safety_monitor
        needs: {velocity_controller: ready}
        remap: [cmd_vel]
      position_tracker: {service: robo_services.position_traker}
      position_tracker: {service: robo_services.position_tracker}
"""


def test_eight_mistakes_are_eight_messages() -> None:
    found = mistakes(EIGHT)
    expected = [
        "m.yaml:6:5: unknown key 'namespce' in group 'control'; did you mean namespace?",
        "m.yaml:7:13: parameter file nowhere.yaml does not exist",
        "m.yaml:11:18: /velocity_controller has no parameter 'linear_velocty'; did you mean linear_velocity?",
        "m.yaml:11:58: ${sped} is not defined; did you mean ${speed}?",
        "m.yaml:12:17: needs go in a circle: /velocity_controller → /safety_monitor → /velocity_controller",
        "m.yaml:16:16: remap: expected a map, not a list",
        "m.yaml:17:35: there is no service 'robo_services.position_traker'; "
        "did you mean robo_services.position_tracker?",
        "m.yaml:18:7: 'position_tracker' stands twice; it is already in line 17",
    ]
    assert found == expected


def test_people_see_the_line_and_a_mark_below() -> None:
    Path("m.yaml").write_text(EIGHT)
    text = as_text(resolve.resolve(Path("m.yaml"), {}).problems)
    shown = "    7 |     params: nowhere.yaml\n      |             ^"
    assert f"m.yaml:7:13: parameter file nowhere.yaml does not exist\n{shown}\n" in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[a, b]", "1:1: a manifest is a map, not a list"),
        ("groups: [a]", "1:9: groups: expected a map, not a list"),
        ("groups: {g: {}}", "1:10: group 'g' starts nothing; give it nodes, groups or an include"),
        ("groups: {g: {nodes: {}, args: {a: 1}}}", "1:31: group 'g' has args but no include that takes them"),
        ("groups: {1g: {nodes: {}}}", "1:10: group '1g': use letters, digits, _ and -, not starting with a digit"),
        ("groups: {g: {nodes: {a: 5}}}", "1:25: node 'a', which has a service or a run: expected a map, not 5"),
        (node("cwd: ."), "1:22: node 'a' has no service and no run"),
        (node("service: robo_services.position_tracker, run: x"), "1:72: node 'a' has both a service and a run"),
        (node("run: x, name: 3d"), "1:40: node name '3d': use letters"),
        (node("run: x, namespace: a b"), "1:45: namespace 'a b' is not valid"),
        (node("run: x, remap: {a b: c}"), "1:42: name 'a b' is not valid"),
        (node("run: x, needs: b"), "1:41: needs 'b': there is no node /b"),
        ("groups: {g: {nodes: {a: {run: x, needs: {b: redy}}, b: {run: x}}}}", "1:45: needs b: 'redy' is not known"),
        (node("run: x, priority: 20"), "1:44: priority: expected a whole number from -20 to 19, not 20"),
        (node("run: x, cpus: two"), "1:40: cpus: 'two' is no processor"),
        (node("run: x, restart: allways"), "1:43: policy: 'allways' is not known; did you mean always?"),
        (node("run: x, restart: {delay: -1}"), "1:51: delay: expected a number of at least 0, not -1"),
        (node("run: x, stop: KILLL"), "1:40: signal: 'KILLL' is not known; use INT, TERM"),
        (node("run: x, log: scren"), "1:39: log: 'scren' is not known; did you mean screen?"),
        (node("run: x, log: verbose"), "1:39: log: 'verbose' is not known; use debug, info, warn, error, fatal, "),
        (node("run: x, cpus: 3-1"), "1:40: cpus: '3-1' is no processor"),
        (node("run: x, ready: {log: '('}"), "1:47: ready: log: '(' is no pattern"),
        (node("run: x, required: 5"), "1:44: expected true, false or an expression, not 5"),
        (node("run: 'x ''y'"), "1:31: run: \"x 'y\" cannot be split into words: no closing quotation"),
        (node("run: x, env: {A: {vale: 1}}"), "1:44: unknown key 'vale' in env A; did you mean value?"),
        (node("run: x, params: [3]"), "1:43: params: expected a file or a map of values, not 3"),
        (node("run: x, replicas: -1"), "1:44: replicas: expected a whole number from 0 to 2000, not -1"),
        (node("run: x, replicas: 2, name: b"), "1:22: node /b is already in m.yaml:1:22; put ${index} into its name"),
        (node("run: x, for_each: {r: 5}"), "1:48: for_each r: expected a list, not 5"),
        (node("run: x, if: sped > 1"), "1:38: 'sped > 1': ${sped} is not defined"),
        (node("run: x, if: 1 +"), "1:40: '1 +': cannot read '+'"),
        (node("run: x, if: robot_name == gazebo"), "1:52: 'robot_name == gazebo': ${gazebo} is not defined"),
        ("groups:\n  g:\n    nodes:\n      a:\n        run: '${'", "5:14: '${': '${' is never closed"),
        (node("run: '${env:NO_SUCH_VARIABLE}'"), "1:31: environment variable NO_SUCH_VARIABLE is not set"),
        (node("run: '${share:no_such_package}'"), "1:31: ${share:no_such_package}: there is no package"),
        (node("run: '${shere:robo}'"), "1:31: ${shere:…} is not known; there are"),
        (node("service: robo_services.safety_monitor:Safety"), "1:35: module robo_services.safety_monitor has no node"),
        (node("service: os"), "1:35: module os defines no node class"),
        ("args: {dir: 1}", "1:8: argument dir: this name is taken"),
        ("args: {a: {type: number, default: 1}}", "1:18: type: 'number' is not known; use str, int"),
        ("args: {a: {type: int, default: x}}", "1:32: argument a: 'x' is no int"),
        ("args: {a: {choices: [b, c], default: d}}", "1:38: argument a: 'd' is none of b, c"),
        ("args: {a: {type: choice, default: b}}", "1:8: argument a is a choice; add choices"),
        ("args: {a: {default: 1, required: true}}", "1:34: argument a has a default: required: true contradicts"),
        ("args: {a: {type: int}}", "1:8: m.yaml needs a; give it as a:=VALUE"),
        ("include: nothing.yaml", "1:10: there is no manifest 'nothing.yaml'"),
        ("include: m.yaml", "1:10: include goes in a circle: m.yaml → m.yaml"),
        ("include: {args: {}}", "1:10: an include names its file"),
        ("include: {file: robot.yaml, args: {use_simm: true}}", "1:36: robot.yaml has no argument 'use_simm'"),
        ("include: {file: robot.yaml, without: [trackr]}", "1:39: robot.yaml has no node 'trackr'"),
        ("include: {file: robot.yaml, override: {base: {}}}", "1:40: robot.yaml has no node 'base'"),
        ("topics: {scan: {rate: often}}", "1:23: rate: 'often' is no rate; write '>= 5'"),
        ("topics: {a b: {}}", "1:10: name 'a b' is not valid"),
    ],
)  # fmt: skip
def test_each_mistake_is_one_message(text: str, message: str) -> None:
    (found,) = mistakes(text)
    assert found.startswith(f"m.yaml:{message}")


def test_a_parameter_out_of_range_says_the_range() -> None:
    (found,) = mistakes(node("service: robo_services.position_tracker, params: {log_rate: -1}"))
    assert found.startswith(
        "m.yaml:1:86: position_tracker: log_rate = -1: expected float >= 0.001 (reports per second, Hz; 0.001 to 1000)"
    )
    Path("p.yaml").write_text("/**:\n  ros__parameters:\n    log_rate: fast\n")
    (found,) = mistakes(node("service: robo_services.position_tracker, params: p.yaml"))
    assert found.startswith("p.yaml:3:15: position_tracker: log_rate = 'fast': expected float, got str")


def test_parameters_of_the_command_line_are_checked() -> None:
    text = node("service: robo_services.position_tracker")
    assert mistakes(text, parameters={"a.log_rte": "1"}) == [
        "command line: /a has no parameter 'log_rte'; did you mean log_rate?"
    ]
    assert mistakes(text, parameters={"log_rte": "1"}) == [
        "command line: no node has a parameter 'log_rte'; did you mean log_rate?"
    ]
    assert mistakes(text, parameters={"zzz.qqq": "1"}) == ["command line: no node has a parameter 'zzz.qqq'"]
    assert "log_rate = 'x'" in mistakes(text, parameters={"log_rate": "x"})[0]
    assert "there is no node aa; did you mean a?" in mistakes(text, parameters={"aa.log_rate": "1"})[0]


def test_arguments_of_the_command_line_are_checked() -> None:
    text = "args: {n: {type: int, default: 1}, on: {default: true}}\ngroups: {}\n"
    assert mistakes(text, n="two") == ["command line: argument n: 'two' is no int; write a whole number, for example 3"]
    assert mistakes(text, on="yes") == ["command line: argument on: 'yes' is no bool; write true or false"]
    assert mistakes(text, m="1") == [
        "command line: m.yaml has no argument 'm'; did you mean on?".replace("did you mean on?", "it has n, on")
    ]


def test_one_mistake_is_not_followed_by_others() -> None:
    """What a mistake hits is taken as fine."""
    text = """\
args: {n: {type: int, default: many}}
groups:
  g:
    namespace: ${nspace}
    nodes:
      a: {servic: x, needs: c}
      c: {service: robo_services.position_tracker, params: {log_rate: "${n}"}, if: n > 3, cwd: "${n}/x"}
"""
    assert [line.split(" ")[0] for line in mistakes(text)] == ["m.yaml:1:32:", "m.yaml:4:16:", "m.yaml:6:11:"]


def test_what_is_switched_off_is_read_too() -> None:
    text = """\
groups:
  g:
    if: false
    nodes:
      a: {run: "${nothing}", params: nowhere.yaml, servce: x}
      b: {service: no.such.module, for_each: {r: [1]}, name: "b${r}${index}"}
"""
    assert [line.split(" ")[0] for line in mistakes(text)] == ["m.yaml:5:17:", "m.yaml:5:52:"]


@pytest.mark.parametrize("field", ["params: 'config/${name}.yaml'", "cwd: 'work/${name}'"])
def test_no_value_leads_out_of_a_path(field: str) -> None:
    text = node(f"{field}, run: x").replace("groups", "args: {name: x}\ngroups")
    (found,) = mistakes(text, name="../../etc/passwd")
    assert "which leads out of the folder that is meant" in found
    (found,) = mistakes("args: {name: x}\ninclude: 'launch/${name}'", name="/etc/passwd")
    assert found.startswith("m.yaml:2:18: ${name} is '/etc/passwd', which leads out of the folder")


def test_a_module_that_fails_or_ends_the_process_is_a_message(tmp_path: Path) -> None:
    (tmp_path / "raises.py").write_text("1 / 0\n")
    (tmp_path / "leaves.py").write_text("import sys; print('noise'); sys.exit('enough')\n")
    (found,) = mistakes(node("service: raises"))
    assert found.endswith("service 'raises' cannot be imported: raises.py:1: ZeroDivisionError: division by zero")
    (found,) = mistakes(node("service: leaves"))
    assert "enough" in found


MODULES = {
    "types_a": """\
from robo_messages import Header, Message, message


@message("my/A")
class A(Message):
    number: int = 0
    header: Header = Header()
""",
    "types_b": """\
import msgspec
import robo_messages as rm


@rm.message("my/B")
class B(
    rm.Message,
):
    empty: list[int] = []
    header: rm.Header = rm.Header(frame_id="x")
""",
    "types_c": """\
import msgspec


class C(msgspec.Struct):
    empty: list[int] = []
    some: list[int] = [1, 2]
""",
    "deep": "def half(a):\n    return 1 / a\n\nhalf(0)\n",
    "torn": "import robo\nclass N(robo.Node\n    pass\n",
    "misspelt": "import robo\nfrom robo_messages import Twst\n",
    "needy": "import robo\n\nimport no_such_driver\n",
    "library": "import json\njson.loads('{')\n",
}


@pytest.mark.parametrize(
    ("module", "message"),
    [
        ("types_a", "types_a.py:7: header: Header = Header() would be one and the same object in all of them; "
                    "write field(default_factory=Header), with `from msgspec import field`"),
        ("types_b", "types_b.py:10: header: rm.Header = rm.Header(frame_id='x') would be one and the same object in "
                    "all of them; write field(default_factory=lambda: rm.Header(frame_id='x'))"),
        ("types_c", "types_c.py:6: some: list[int] = [1, 2] would be one and the same object in all of them; "
                    "write field(default_factory=lambda: [1, 2])"),
        ("deep", "deep.py:2: ZeroDivisionError: division by zero"),
        ("torn", "torn.py:2:8: '(' was never closed"),
        ("misspelt", "misspelt.py:2: cannot import name 'Twst' from 'robo_messages'"),
        ("needy", "the module 'no_such_driver', which is not installed (needy.py:3)"),
        ("library", "library.py:2: JSONDecodeError: "),
    ],
)  # fmt: skip
def test_what_hinders_an_import_is_told_with_its_place_in_the_users_file(
    module: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in MODULES.items():
        Path(f"{name}.py").write_text(text)
    Path("n.py").write_text(f"import {module}\n")
    monkeypatch.setattr(contracts, "examine_apart", in_new_process)
    (found,) = mistakes(node("service: n"))
    assert message in found
    assert "\n" not in found


def in_new_process(questions: Sequence[contracts.Question]) -> list[contracts.Answer]:
    """As a command does it: this process has several threads, and what it imports stays."""
    code = "import pickle, sys; from robo.launch import contracts as c; "
    code += "sys.stdout.buffer.write(pickle.dumps(c.examine(pickle.load(sys.stdin.buffer))))"
    result = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(questions), capture_output=True, check=True
    )
    answers: list[contracts.Answer] = pickle.loads(result.stdout)
    return answers


@pytest.mark.parametrize("declared", ["", "args: {robot_name: r1}"])
def test_a_robots_name_is_checked_where_it_is_typed(declared: str) -> None:
    nodes = "nodes: {a: {run: 'x ${robot_name}', namespace: '${robot_name}'}, b: {run: x, namespace: '${robot_name}'}}"
    (found,) = mistakes(f"{declared}\ngroups: {{g: {{namespace: '${{robot_name}}', {nodes}}}}}", robot_name="r-1")
    assert found.startswith("command line: robot name 'r-1' is not valid; use letters")
    assert found.endswith("did you mean r_1?")
    (found,) = mistakes("args: {robot_name: my robot}\ngroups: {g: {namespace: '${robot_name}', nodes: {}}}")
    assert found.startswith("m.yaml:1:20: robot name 'my robot'")
    Path("m.yaml").write_text(f"{declared}\ngroups: {{g: {{nodes: {{a: {{run: x, namespace: '${{robot_name}}'}}}}}}}}")
    assert resolve.resolve(Path("m.yaml"), {}, robot="/r7/").plan.processes[0].full_name == "/r7/a"


def test_where_manifests_are_looked_for(tmp_path: Path) -> None:
    assert find_manifest("replay.yaml").is_file()
    (tmp_path / "launch").mkdir()
    (tmp_path / "launch" / "replay.yaml").write_text("groups: {}")
    assert find_manifest("replay.yaml") == Path("launch/replay.yaml")
    (tmp_path / "replay.yaml").write_text("groups: {}")
    assert find_manifest("replay.yaml") == Path("replay.yaml")
    with pytest.raises(ManifestError, match=r"no manifest 'rebot\.yaml'; did you mean robot\.yaml"):
        find_manifest("rebot.yaml")
    with pytest.raises(ManifestError, match="no manifest"):
        find_manifest("x" * 5000)


def package(name: str, *files: str) -> None:
    for file in ("__init__.py", *files):
        path = Path(name, file)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("groups: {g: {nodes: {a: {run: x}}}}\n" if file.endswith("yaml") else "raise SystemExit\n")


def test_a_manifest_of_a_package_is_found_without_importing_it() -> None:
    package(
        "batt", "share/launch/robot.yaml", "launch/robot.yaml", "launch/arm.yaml", "small.yaml", "share/x/deep.yaml"
    )
    assert find_manifest("batt:robot.yaml") == Path("batt/share/launch/robot.yaml")
    assert find_manifest("batt:arm.yaml") == Path("batt/launch/arm.yaml")
    assert find_manifest("batt:small.yaml") == Path("batt/small.yaml")
    assert find_manifest("batt:share/x/deep.yaml") == Path("batt/share/x/deep.yaml")
    assert find_manifest("robo:robot.yaml") == find_manifest("robot.yaml")
    plan = resolve.load(write("include: batt:arm.yaml"), {})
    assert [process.full_name for process in plan.processes] == ["/a"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "batt:robt.yaml",
            r"package batt has no manifest 'robt.yaml'; did you mean batt:robot.yaml\? \(looked in .*batt",
        ),
        ("batt:robot", "did you mean batt:robot.yaml"),
        ("batt:/etc/passwd", "package batt has no manifest '/etc/passwd'"),
        ("bat:robot.yaml", "manifest bat:robot.yaml: there is no package 'bat'; did you mean batt"),
        ("no_such_package:robot.yaml", "there is no package 'no_such_package'; is it installed here"),
        ("empty:robot.yaml", "package empty has no manifest 'robot.yaml'; it has none"),
    ],
)
def test_a_manifest_that_a_package_does_not_have_is_told(name: str, message: str) -> None:
    package("batt", "share/launch/robot.yaml")
    package("empty")
    with pytest.raises(ManifestError, match=message):
        find_manifest(name)
    (found,) = mistakes(f"include: '{name}'")
    assert found.startswith("m.yaml:1:10: ")


def write(text: str) -> Path:
    Path("m.yaml").write_text(text)
    return Path("m.yaml")


def test_mistakes_of_the_command_line_alone_are_told_from_those_of_files() -> None:
    file = write("args: {world: x}\ngroups: {g: {nodes: {a: {run: x}}}}")
    for arguments, groups in (({"worl": "x"}, ()), ({}, ("h",))):
        with pytest.raises(ManifestFaults) as error:
            resolve.load(file, arguments, groups=groups)
        assert error.value.of_command_line
    with pytest.raises(ManifestFaults) as error:
        resolve.load(write("args: {world: x}\ngroups: {g: {nodes: {a: {runn: x}}}}"), {"worl": "x"})
    assert not error.value.of_command_line


def test_words_of_the_command_line() -> None:
    assert split_words(["batt:robot.yaml", "g", "a:=b:c"]) == ("batt:robot.yaml", ["g"], {"a": "b:c"})
    assert split_words(["batt:robot"])[0] == "batt:robot"
    assert split_words([]) == ("robot.yaml", [], {})
    words = ["replay.yaml", "player", "fleet/base", "log:=a b", "rate:=0"]
    assert split_words(words) == ("replay.yaml", ["player", "fleet/base"], {"log": "a b", "rate": "0"})
    with pytest.raises(UsageError, match="two manifests"):
        split_words(["a.yaml", "b.yaml"])


# -- hostile files -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("groups: {" + "a: {" * 1000, "nested more than 100 levels deep"),
        ("x: '" + "y" * 1_000_000 + "'", "longer than 500,000 characters"),
        ("description: x\n" + "".join(f"k{i}: 1\n" for i in range(30_000)), "unknown key 'k0' in a manifest"),
        (
            "groups: &a0 [x, x]\n" + "".join(f"k{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9)),
            "unfolds to more than 200,000 values",
        ),
        (node("run: x, replicas: 2000, name: 'n${index}'").replace("g: {", "g: {replicas: 2000, "), "m.yaml:1:"),
        ("groups: {g: {replicas: 2000, groups: {h: {replicas: 2000, nodes: {}}}}}", "unfolds to more than"),
        (
            "groups: {g: {nodes: {" + ", ".join(f"n{i}: {{run: x, needs: n{i + 1}}}" for i in range(1999)) + "}}}",
            "there is no node /n1999",
        ),
        ("args: {a: !!python/object/apply:os.system [echo]}", "python/object/apply:os.system is not read here"),
        (f"args: {{a: {'9' * 5000}}}\ngroups: {{g: {{if: a < 5, nodes: {{}}}}}}", "have no order"),
        ("if: " + "(" * 500, "unknown key 'if'"),
        (node("run: x, if: '" + "(" * 5000 + "'"), "nested more than 50 levels deep"),
    ],
)  # fmt: skip
def test_hostile_manifests_end_in_a_clear_message(text: str, message: str) -> None:
    begin = time.process_time()
    found = mistakes(text)
    assert time.process_time() - begin < 20
    assert message in "\n".join(found)


def test_values_that_unfold_to_more_than_a_machine_holds_are_refused() -> None:
    big = "x" * 400_000
    (found,) = mistakes(node("run: [x, '${a}${a}${a}']").replace("groups", f"args: {{a: {big}}}\ngroups"))
    assert found.endswith("a text of 1,200,012 characters, once its ${name} are replaced; at most 1,000,000")
    words = ", ".join(["'-${a}'"] * 3_000)
    (found,) = mistakes(node(f"run: [x, {words}]").replace("groups", f"args: {{a: {big}}}\ngroups"))
    assert "the texts of this launch have more than 20,000,000 characters" in found


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\x85", "\u2028", "\u2029"])
def test_a_mistake_is_shown_with_its_line_whatever_ends_lines(end: str) -> None:
    Path("m.yaml").write_bytes(end.join(["groups:", "  g:", "    nodes:", "      a: {servce: x}", ""]).encode())
    problems = resolve.resolve(Path("m.yaml"), {}).problems
    assert str(problems[0]).startswith("m.yaml:4:11: unknown key 'servce'")
    assert as_text(problems).splitlines()[1:3] == ["    4 |       a: {servce: x}", "      |           ^"]


def test_one_mistake_is_no_longer_than_people_read_and_no_more_than_so_many_are_shown() -> None:
    long = "x" * 100_000
    for text in (
        f"{long}: 1",
        f"args: {{a: 1}}\ngroups: {{g: {{if: a == {long[:9_000]}, nodes: {{}}}}}}",
        node(f"run: x, namespace: {long}/-"),
        node(f"run: x, env: {{{long}-: 1}}"),
        node(f"run: x, needs: {long}"),
        node(f"run: x, params: {{a: '${{{long}}}'}}"),
        f"groups: {{g: {{for_each: {{{long}-: [1]}}, nodes: {{}}}}}}",
        f"include: {long}",
    ):
        found = mistakes(text)
        assert found
        assert max(map(len, found)) < 1_200, text[:100]
        faults = as_data(resolve.resolve(Path("m.yaml"), {}).problems)
        assert max(len(str(fault["message"])) for fault in faults) < 1_200
    text = as_text(Problem(Position("m.yaml", line, 1), "wrong") for line in range(1, 1_001))
    assert text.endswith("\n… and 900 more")


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
words = st.sampled_from(
    ["${robot_name}", "${", "${x}", "${dir}/..", "m.yaml", "robot.yaml", "a", "/a", "1", "n > 1", "../p", "~/a", "*"]
)  # fmt: skip
keys = st.sampled_from(
    sorted({"a", "g", "x", *keys_of(Manifest), *(key for part in parts().values() for key in keys_of(part))})
)
trees = st.recursive(
    scalars | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys | words, inner, max_size=5),
    max_leaves=25,
)
nodes = st.dictionaries(st.sampled_from(["a", "b"]), st.dictionaries(keys, trees, max_size=5), max_size=2)
groups = st.dictionaries(
    st.sampled_from(["g", "h"]),
    st.fixed_dictionaries({"nodes": nodes}, optional={"groups": trees, "include": trees}),
    max_size=2,
)  # fmt: skip
manifests = trees | st.fixed_dictionaries(
    {"groups": groups}, optional={"args": st.dictionaries(keys, trees), "topics": trees}
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], deadline=None)
@given(manifests)
def test_any_tree_is_a_plan_or_messages_with_places(tree: object) -> None:
    Path("m.yaml").write_text(yaml.safe_dump(tree, allow_unicode=True), encoding="utf-8")
    found = resolve.resolve(Path("m.yaml"), {})
    check(found)
    for problem in found.problems:
        assert problem.position.line >= 1
        assert problem.position.column >= 1
        assert problem.position.file
        assert problem.text
    as_text(found.problems)


@given(st.text(max_size=200) | st.binary(max_size=200).map(lambda b: b.decode("latin-1")))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_text_is_a_plan_or_messages(text: str) -> None:
    Path("m.yaml").write_text(text, encoding="utf-8", errors="surrogatepass")
    problems = resolve.resolve(Path("m.yaml"), {}).problems
    as_text(problems)
    assert all(1 <= problem.position.line <= len(lines_of(text)) for problem in problems)
