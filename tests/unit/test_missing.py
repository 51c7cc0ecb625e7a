"""What a launch needs of this machine and is not there; how mistakes are put in order, shown and told to programs."""

import sys
from pathlib import Path

import pytest

from robo.launch import missing
from robo.launch.arguments import COMMAND_LINE
from robo.launch.contracts import Question, examine, typed
from robo.launch.faults import ManifestFaults, as_data, as_notes, as_text, exit_code, in_order
from robo.launch.find import find_manifest, manifests_in, names_manifest, nearby
from robo.launch.resolve import Resolution, resolve
from robo.launch.substitution import Word
from robo.text.tree import Position, Problem
from tests.support import run_robo


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def resolution(text: str) -> Resolution:
    Path("m.yaml").write_text(text)
    found = resolve(Path("m.yaml"), {})
    assert found.problems == ()
    return found


def program(path: str) -> Path:
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("#!/bin/sh\n")
    file.chmod(0o755)
    return file


def test_a_viewer_that_is_not_installed_is_told_before_anything_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    program("bin/robo")
    found = resolution("groups: {a: {nodes: {rerun: {run: ./bin/robo view rerun --robot-name r1}}}}\n")
    for spec, told in ((None, ["/rerun: Rerun is not installed: pip install 'robo-zenoh[rerun]'"]), (object(), [])):
        monkeypatch.setattr("importlib.util.find_spec", lambda name, spec=spec: spec if name == "rerun" else None)
        assert [problem.text for problem in missing.programs(found, "")] == told


# -- what nodes ask for --------------------------------------------------------------------------------------

PICKY = """\
import robo

class Picky(robo.Node):
    class Parameters(robo.Parameters):
        fast: bool = False

    @classmethod
    def lacking(cls, parameters):
        if parameters.fast is None:
            raise RuntimeError("never")
        return [*super().lacking(parameters), *(["needs a library: pip install it"] if parameters.fast else [])]
"""


def test_a_node_says_what_it_lacks_with_its_parameters(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "picky.py").write_text(PICKY)
    monkeypatch.syspath_prepend(str(tmp_path))
    found = resolution(
        """\
groups:
  g:
    nodes:
      slow: {service: picky}
      fast: {service: picky, params: {fast: true}}
"""
    )
    assert [str(one) for one in missing.for_nodes(found)] == ["m.yaml:5:7: /fast: needs a library: pip install it"]


def test_a_node_that_cannot_say_what_it_lacks_is_a_mistake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "odd_picky.py").write_text(PICKY.replace("is None", "is False"))
    monkeypatch.syspath_prepend(str(tmp_path))
    (answer,) = examine([Question("odd_picky", {})])
    assert answer.error is not None
    assert "'odd_picky' cannot say what it lacks" in answer.error
    assert "never" in answer.error


# -- programs and files --------------------------------------------------------------------------------------


def test_programs_are_looked_for_where_each_process_would() -> None:
    program("bin/driver"), program("other/tool"), program("work/start")
    found = resolution(
        """\
groups:
  g:
    nodes:
      a: {run: driver}
      b: {run: tool}
      c: {run: tool, env: {PATH: other}}
      d: {run: ./start, cwd: work}
      e: {run: ./start}
      f: {run: driver, prefix: no_such_prefix --args}
"""
    )
    assert [str(problem) for problem in missing.programs(found, "bin")] == [
        "m.yaml:5:7: /b: there is no program 'tool'",
        "m.yaml:8:7: /e: there is no program './start'",
        "m.yaml:9:7: /f: there is no program 'no_such_prefix'",
    ]


def test_this_interpreter_is_there() -> None:
    found = resolution("groups: {g: {nodes: {t: {service: robo_services.position_tracker}}}}")
    assert found.plan.processes[0].command()[0] == sys.executable
    assert missing.programs(found, "") == []


def test_a_file_that_an_argument_names_has_to_be_there_for_those_that_are_told_of_it() -> None:
    Path("there.log").write_text("")
    found = resolution(
        """\
args:
  there: {type: path, default: there.log}
  gone: {type: path, default: gone.log}
  unused: {type: path, default: unused.log}
  made: {type: path, default: made.log, exists: false}
groups:
  g:
    nodes:
      a: {run: "x --log=${gone} ${there} ${made}"}
"""
    )
    assert [str(problem) for problem in missing.files(found)] == [
        f"m.yaml:3:31: argument gone: there is no file {Path.cwd()}/gone.log"
    ]


def test_of_a_path_that_is_handed_on_the_place_where_it_comes_from_is_told() -> None:
    Path("inner.yaml").write_text(
        "args: {log: {type: path, default: x}}\ngroups: {g: {nodes: {a: {run: x, params: {log: '${log}'}}}}}"
    )
    found = resolution("args: {log: {type: path, default: gone}}\ninclude: {file: inner.yaml, args: {log: '${log}'}}")
    (problem,) = missing.files(found)
    assert problem.position == Position("m.yaml", 1, 35)


# -- where manifests are -------------------------------------------------------------------------------------


def test_files_that_read_like_manifests() -> None:
    Path("params.yaml").write_text("/**: {log_rate: 1}\n")
    Path("compose.yaml").write_text("services: {a: {}}\n")
    Path("deep.yaml").write_text("x:\n  groups: {}\n")
    for name, text in (("one.yaml", "groups: {}\n"), ("two.yml", "# first\ninclude: one.yaml\n")):
        Path(name).write_text(text)
    Path("folder.yaml").mkdir()
    assert [path.name for path in manifests_in(Path())] == ["one.yaml", "two.yml"]


@pytest.mark.parametrize(
    ("word", "is_manifest"),
    [
        ("robot.yaml", True), ("robot.yml", True), ("pack:robot", True), ("here", True),
        ("control", False), ("control/arm", False), ("speed:=1", False),
    ],
)  # fmt: skip
def test_what_names_a_manifest(word: str, is_manifest: bool) -> None:
    Path("here").write_text("groups: {}")
    assert names_manifest(word) is is_manifest


def test_paths_are_short_where_they_can_be() -> None:
    assert nearby(Path.cwd() / "a" / "b.yaml") == "a/b.yaml"
    assert nearby(Path("/etc/x.yaml")) == "/etc/x.yaml"
    assert nearby(Path("a/../b.yaml")) == "b.yaml"
    Path("sub").mkdir()
    Path("sub/inner.yaml").write_text("groups: {}")
    assert find_manifest("inner.yaml", beside=Path("sub")) == Path("sub/inner.yaml")


# -- mistakes ----------------------------------------------------------------------------------------------------


def problem(file: str, line: int, column: int = 1, text: str = "wrong") -> Problem:
    return Problem(Position(file, line, column), text)


def test_mistakes_are_in_order_and_each_once() -> None:
    given = [problem("b", 3), problem("a", 9), problem("b", 1), problem("b", 3), problem("a", 2), problem("b", 1, 0)]
    assert in_order(given) == (problem("b", 1, 0), problem("b", 1), problem("b", 3), problem("a", 2), problem("a", 9))
    faults = ManifestFaults(given)
    assert str(faults).splitlines()[0] == "b:1:0: wrong"
    assert not faults.of_command_line


def test_the_exit_code_says_whose_mistake_it_is() -> None:
    mine, files = Problem(COMMAND_LINE, "no such group"), problem("m.yaml", 1)
    assert exit_code([mine]) == 2
    assert exit_code([mine, files]) == exit_code([files]) == 1


def test_how_mistakes_look_to_people_and_to_programs() -> None:
    Path("m.yaml").write_text("one\ntwo three\n")
    at = problem("m.yaml", 2, 5)
    assert as_text([at]) == "m.yaml:2:5: wrong\n    2 | two three\n      |     ^"
    assert as_text([problem("m.yaml", 9)]) == "m.yaml:9:1: wrong", "a line that is not there is not shown"
    assert as_text([problem("gone.yaml", 1), Problem(COMMAND_LINE, "x")]) == "gone.yaml:1:1: wrong\ncommand line: x"
    assert as_notes([at], "warning") == "m.yaml:2:5: warning: wrong"
    assert as_data([at]) == [{"file": "m.yaml", "line": 2, "column": 5, "message": "wrong"}]


# -- node classes ------------------------------------------------------------------------------------------------


def test_what_a_node_class_says_of_itself_and_of_values() -> None:
    tracker = "robo_services.position_tracker"
    fine, refused, unknown, absent = examine(
        [
            Question(tracker, {"log_rate": Word("2")}),
            Question(tracker, {"log_rate": -1.0, "max_distance": "far"}),
            Question(tracker, {"no_such": 1}),
            Question("robo_services.no_such", {}),
        ]
    )
    assert (fine.error, fine.mistakes) == (None, {})
    assert fine.contract is not None
    assert fine.contract.parameter_types["log_rate"] == "float"
    assert set(refused.mistakes) == {"log_rate", "max_distance"}
    assert unknown.mistakes == {}, "whether it has such a parameter is asked elsewhere"
    assert absent.contract is None
    assert "there is no service 'robo_services.no_such'" in str(absent.error)


@pytest.mark.parametrize(
    ("value", "parameter_type", "found"),
    [
        (Word("1"), "str", "1"), (Word("1"), "int", 1), (Word("1"), None, 1), (Word("true"), "bool", True),
        ("1", "int", "1"), (1, "str", 1),
    ],
)  # fmt: skip
def test_a_word_is_text_where_its_parameter_is(value: object, parameter_type: str | None, found: object) -> None:
    assert typed(value, parameter_type) == found
    assert type(typed(value, parameter_type)) is type(found)


NEEDY = """\
from typing import ClassVar
from robo import Node

class Needy(Node):
    REQUIRES: ClassVar = {"json": "it-is-there", "no_such": "no-such", "no_such.part": "robo-zenoh[such]"}
"""


def test_modules_that_a_node_class_needs_have_to_be_installed() -> None:
    Path("needy.py").write_text(NEEDY)
    found = resolution("groups: {g: {nodes: {camera: {service: needy}}}}")
    assert found.problems == ()
    assert [str(problem) for problem in missing.for_nodes(found)] == [
        "m.yaml:1:22: /camera: needs the module no_such, which is not installed: pip install no-such",
        "m.yaml:1:22: /camera: needs the module no_such.part, which is not installed: pip install 'robo-zenoh[such]'",
    ]


def test_up_refuses_before_anything_starts_and_check_notes() -> None:
    Path("needy.py").write_text(NEEDY)
    Path("m.yaml").write_text("groups: {g: {nodes: {other: {run: 'touch began'}, camera: {service: needy}}}}")
    done = run_robo("up", "m.yaml")
    assert done.returncode == 1, done.stderr
    assert "/camera: needs the module no_such, which is not installed: pip install no-such" in done.stderr
    assert not Path("began").exists()
    done = run_robo("check", "m.yaml")
    assert done.returncode == 0, done.stdout
    assert "pip install no-such" in done.stdout
    done = run_robo("run", "needy")
    assert (done.returncode, done.stderr) == (
        1, "error: Needy needs the module no_such, which is not installed: pip install no-such\n"
    )  # fmt: skip
