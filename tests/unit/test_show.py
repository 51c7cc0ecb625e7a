"""What `robo up --dry-run` and `--show-args` print of a manifest, and what `robo check` says and ends with."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robo.cli.app import app
from robo.cli.launch import show
from robo.launch import resolve
from robo.launch.plan import Plan, ReadyPlan

MANIFEST = """
description: A base and what drives it
args:
  port: {default: /dev/ttyUSB0, description: Of the base}
  speed: {type: float, default: 0.5}
  mode: {choices: [slow, fast], default: slow}
  site: {type: str}
groups:
  drive:
    namespace: ${robot_name}
    params: {gain: 2}
    nodes:
      base:
        run: ./driver ${port}
        cwd: /tmp
        env: {SPEED: "${speed}"}
        remap: {scan: front/scan}
        ready: {log: up, port: 80, probe: test -e /x, topics: odom}
        restart: always
        log: {output: file, level: warn}
        priority: 5
        cpus: [0, 2]
        required: true
      user: {run: use, needs: {base: ready}}
topics:
  ${robot_name}/odom: {type: nav/Odometry, rate: ">= 5", max_age: 0.5, external: true}
"""


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(MANIFEST.replace("${robot_name}/odom:", "odom:"))


def plan() -> Plan:
    return resolve.resolve(Path("mine.yaml"), {"site": "x"}, robot="r1").plan


def said(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, words)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def test_a_plan_is_told_process_by_process() -> None:
    lines = show.plan_text(plan()).splitlines()
    assert lines[:2] == ["mine.yaml: A base and what drives it", "robot r1"]
    assert "  speed:=0.5" in lines
    begin = lines.index("/r1/base  (drive; required)")
    assert lines[begin + 1 : lines.index("/r1/user  (drive; needs /r1/base ready)") - 1] == [
        "  command  ./driver /dev/ttyUSB0",
        "  cwd      /tmp",
        "  remap    scan -> front/scan  # mine.yaml:17:17",
        "  env      SPEED=0.5  # mine.yaml:16:15",
        "  param    gain = 2  # mine.yaml:11:14",
        "  ready    when its output holds 'up' and 127.0.0.1:80 accepts connections and `test -e /x` succeeds and"
        " data come on r1/odom",
        "  restart  always, after 0.5 s, later up to 30 s; degraded from 6 in 60 s",
        "  log      file, from level warn",
        "  nice     5",
        "  cpus     0, 2",
    ]
    assert lines[-1].startswith("topic odom: nav/Odometry, >= 5 Hz, never older than 0.5 s, from outside  # mine.yaml:")


def test_a_plan_as_data_has_the_words_that_start_each_process() -> None:
    data: Any = show.plan_data(plan())
    assert [process["command"] for process in data["processes"]] == [["./driver", "/dev/ttyUSB0"], ["use"]]
    assert json.loads(json.dumps(data)) == json.loads(json.dumps(data, allow_nan=False))


def test_what_is_not_said_is_not_shown() -> None:
    assert show.ready_text(ReadyPlan()) == ""


def test_arguments_are_listed_with_what_they_may_be() -> None:
    code, text = said("up", "mine.yaml", "--show-args")
    assert code == 0
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "port str, default /dev/ttyUSB0" in lines
    assert "Of the base" in lines
    assert "mode choice, default slow, one of slow, fast" in lines
    assert "site str, required" in lines
    assert lines[-1] == "Give them as robo up mine.yaml name:=value"
    found = {one["name"]: one for one in json.loads(said("up", "mine.yaml", "--show-args", "--json")[1])}
    assert found["site"]["required"] is True
    assert found["mode"]["choices"] == ["slow", "fast"]


def test_a_dry_run_starts_nothing_and_tells_all_faults_as_data() -> None:
    assert said("up", "mine.yaml", "site:=x", "--dry-run")[0] == 0
    code, text = said("up", "mine.yaml", "--dry-run", "--json")
    assert code == 1
    assert "site" in json.loads(text)["faults"][0]["message"]
    plan = json.loads(said("up", "mine.yaml", "site:=x", "--dry-run", "--json")[1])
    assert [process["name"] for process in plan["processes"]] == ["base", "user"]


# -- robo check ------------------------------------------------------------------------------------


def test_a_manifest_that_is_fine() -> None:
    Path("fine.yaml").write_text("groups: {all: {namespace: r1, nodes: {a: {run: [sleep, inf]}}}}")
    assert said("check", "fine.yaml") == (0, "fine.yaml: fine\n")
    code, text = said("check", "fine.yaml", "--json")
    assert (code, json.loads(text)) == (0, {"faults": [], "notes": []})


def test_notes_are_no_faults_and_say_what_was_not_given() -> None:
    code, text = said("check", "mine.yaml")
    assert code == 0
    assert "checked without site; give site:=VALUE to check with it" in text
    assert text.splitlines()[-1].startswith("mine.yaml: fine, ")


def test_faults_of_several_manifests_are_counted_together() -> None:
    Path("bad.yaml").write_text("groups: {all: {namespace: r1, nodes: {a: {rnu: x}, b: {run: x, needs: [c]}}}}")
    code, text = said("check", "bad.yaml", "mine.yaml", "site:=x")
    assert code == 1
    assert "did you mean run?" in text
    assert re_count(text, "bad.yaml:1:") >= 2
    assert "2 manifests: " in text.splitlines()[-1]


def re_count(text: str, what: str) -> int:
    return sum(line.startswith(what) for line in text.splitlines())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["site:=x"], "name a manifest"),
        (["nonsense"], "'nonsense' is no manifest and no name:=value"),
        (["nowhere.yaml"], "there is no manifest 'nowhere.yaml'"),
        (["mine.yaml", "--graph", "png"], "--graph png: use one of text, mermaid, dot, json"),
        (["mine.yaml", "--graph", "dot", "--json"], "--graph draws one manifest"),
        (["mine.yaml", "mine.yaml", "--graph", "dot"], "--graph draws one manifest"),
    ],
)
def test_words_that_make_no_sense_to_check(words: list[str], told: str) -> None:
    code, text = said("check", *words)
    assert code == 2
    assert told in text


@pytest.mark.parametrize(("form", "begin"), [("text", "nodes\n"), ("mermaid", "flowchart LR"), ("dot", "digraph")])
def test_a_graph_is_drawn_beside_the_report(form: str, begin: str) -> None:
    result = CliRunner().invoke(app, ["check", "mine.yaml", "site:=x", "--graph", form])
    assert result.exit_code == 0
    assert result.stdout.startswith(begin)
    assert "mine.yaml: fine" in result.stderr
    assert "mine.yaml: fine" not in result.stdout


def test_schemas_are_printed_by_name() -> None:
    assert "groups" in json.loads(said("schema", "manifest")[1])["properties"]
    assert "x" in said("schema", "geometry/Vector3")[1]
    code, text = said("schema", "geometry/Vektor3")
    assert code == 2
    assert "did you mean geometry/Vector3?" in text
    assert text.rstrip().endswith("; or write manifest")
