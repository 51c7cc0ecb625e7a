import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.cli.up import plan_text, split_words
from robo.errors import ManifestError, UsageError
from robo.launch import manifest, plan
from robo.launch.find import find_manifest
from robo.yaml_tree import Problem

ROOT = Path(__file__).parents[2]


def load(tmp_path: Path, text: str, *, groups: list[str] | None = None, **arguments: object) -> plan.Plan:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    return plan.load(path, arguments, groups=groups or [])


def mistakes(tmp_path: Path, text: str, **arguments: object) -> list[str]:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(ManifestError) as error:
        plan.load(path, arguments)
    return str(error.value).replace(f"{tmp_path}/", "").splitlines()


def test_robot_yaml() -> None:
    found = plan.load(ROOT / "launch" / "robot.yaml", {}, robot="r1")
    assert [p.full_name for p in found.processes] == [
        "/r1/diff_drive_sim", "/r1/position_tracker", "/r1/safety_monitor", "/r1/velocity_controller",
    ]  # fmt: skip
    controller = found.processes[-1]
    assert controller.remap == {"cmd_vel": "cmd_vel_raw"}
    assert controller.needs == ("/r1/safety_monitor",)
    assert controller.parameters["publish_rate"].value == 10.0
    assert controller.parameters["publish_rate"].source == f"{ROOT}/config/params.yaml:6:5"
    assert found.processes[0].parameters["world"].value == f"{ROOT}/config/room.yaml"


def test_robot_yaml_without_the_simulated_base() -> None:
    found = plan.load(ROOT / "launch" / "robot.yaml", {"use_sim": False}, robot="r1")
    assert "diff_drive_sim" not in {p.name for p in found.processes}


def test_simulation_yaml_is_the_robot_with_other_values() -> None:
    robot = plan.load(ROOT / "launch" / "robot.yaml", {}, robot="r1")
    simulation = plan.load(ROOT / "launch" / "simulation.yaml", {}, robot="r1")
    assert [p.full_name for p in simulation.processes] == [p.full_name for p in robot.processes]
    assert simulation.processes[0].parameters["world"].value == f"{ROOT}/config/hall.yaml"
    assert simulation.processes[-1].parameters["linear_velocity"].value == 0.4


def test_replay_yaml_needs_a_log_and_takes_a_path_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ManifestError, match=r"replay\.yaml needs log"):
        plan.load(ROOT / "launch" / "replay.yaml", {})
    monkeypatch.chdir(tmp_path)
    found = plan.load(ROOT / "launch" / "replay.yaml", {"log": "logs/run.log", "rate": 0})
    player = found.processes[-1]
    assert player.parameters["log"].value == str(tmp_path / "logs" / "run.log")
    assert player.parameters["rate"].value == 0.0
    assert player.required


def test_precedence(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("tracker: {x: 1, y: 1, z: 1}\n")
    (tmp_path / "b.yaml").write_text("/**: {y: 2}\n")
    found = load(
        tmp_path,
        """
groups:
  g:
    params: [a.yaml, {z: 3}, b.yaml]
    nodes:
      tracker: {service: s, params: {w: 4, z: 5}}
      other: {service: s}
""",
    )
    tracker, other = found.processes
    assert {name: said.value for name, said in tracker.parameters.items()} == {"x": 1, "y": 2, "z": 5, "w": 4}
    assert {name: said.value for name, said in other.parameters.items()} == {"y": 2, "z": 3}


def test_substitutions_keep_types_and_conditions_hold(tmp_path: Path) -> None:
    text = """
args: {flag: true, speed: 1.5, name: {default: "${robot_name}_x"}, n: 3}
groups:
  yes:
    if: ${flag}
    namespace: ${robot_name}
    env: {SPEED: "v${speed}", LITERAL: "$${HOME}"}
    nodes:
      a: {service: s, namespace: inner, params: {speed: ${speed}, flag: ${flag}, name: ${name}, n: ${n}}}
  no:
    unless: ${flag}
    nodes: {b: {service: s}}
"""
    (process,) = load(tmp_path, text).processes
    assert process.full_name == "/my_robot/inner/a"
    assert {name: said.value for name, said in process.parameters.items()} == {
        "speed": 1.5, "flag": True, "name": "my_robot_x", "n": 3,
    }  # fmt: skip
    assert process.env == {"SPEED": "v1.5", "LITERAL": "${HOME}"}
    assert [p.name for p in load(tmp_path, text, flag=False).processes] == ["b"]


def test_groups_can_be_chosen(tmp_path: Path) -> None:
    text = "groups:\n  a: {nodes: {x: {service: s}}}\n  b: {nodes: {y: {service: s, needs: {x: ready}}}}\n"
    (process,) = load(tmp_path, text, groups=["b"]).processes
    assert process.name == "y"
    assert process.needs == ()
    with pytest.raises(ManifestError, match="no group 'c'; it has a, b"):
        load(tmp_path, text, groups=["c"])


def test_scopes_do_not_leak(tmp_path: Path) -> None:
    (tmp_path / "inner.yaml").write_text(
        "args: {speed: 1.0}\ngroups: {g: {nodes: {a: {service: s, params: {speed: '${speed}', x: '${outer}'}}}}}\n"
    )
    text = "args: {outer: 5}\ninclude: {file: inner.yaml, args: {speed: 2.0}}\n"
    assert mistakes(tmp_path, text) == ["inner.yaml:2:69: ${outer} is not defined; known are robot_name, speed"]


def test_all_mistakes_come_at_once_each_with_its_place(tmp_path: Path) -> None:
    text = """\
descripton: x
args:
  speed: {type: number}
groups:
  g:
    params: [nowhere.yaml]
    nodes:
      a: {service: s, remap: [x]}
      a: {service: s}
      b: {service: s, needs: {c: ready}, params: {x: ${sped}}}
      d: {servce: s}
      e-1: {service: s, required: maybe}
"""
    found = mistakes(tmp_path, text, speed="1")
    expected = [
        "m.yaml:1:1: unknown key 'descripton' in a manifest; did you mean 'description'?",
        "m.yaml:3:17: type 'number': use one of",
        "m.yaml:6:14: parameter file",
        "m.yaml:8:30: remap: expected a map, not a list",
        "m.yaml:9:7: 'a' stands twice; it is already in line 8",
        "m.yaml:10:31: needs 'c': there is no node /c",
        "m.yaml:10:54: ${sped} is not defined; did you mean ${speed}?",
        "m.yaml:11:7: node 'd' has no service",
        "m.yaml:11:11: unknown key 'servce' in node 'd'; did you mean 'service'?",
        "m.yaml:12:7: node name 'e-1'",
    ]
    for line in expected:
        assert any(mistake.startswith(line) for mistake in found), (line, found)
    assert len(found) == len(expected)


def test_circles_are_found(tmp_path: Path) -> None:
    text = "groups: {g: {nodes: {a: {service: s, needs: [b]}, b: {service: s, needs: [a]}}}}"
    assert "needs go in a circle: /a → /b → /a" in "\n".join(mistakes(tmp_path, text))
    assert "include goes in a circle: m.yaml → m.yaml" in "\n".join(mistakes(tmp_path, "include: m.yaml"))


def test_two_nodes_of_one_name(tmp_path: Path) -> None:
    text = "groups:\n  g: {nodes: {a: {service: s}}}\n  h: {nodes: {a: {service: s}}}\n"
    assert mistakes(tmp_path, text) == ["m.yaml:3:15: node /a is already in m.yaml:2:15"]


def test_arguments_are_checked(tmp_path: Path) -> None:
    text = "args: {n: {type: int, default: 1}, p: {type: path, default: x/y}}\ngroups: {}\n"
    assert "argument n: 'two' is no int" in mistakes(tmp_path, text, n="two")[0]
    assert "m.yaml has no argument 'm'; it has n, p" in mistakes(tmp_path, text, m=1)[0]
    assert load(tmp_path, text).arguments["p"] == str(tmp_path / "x" / "y")
    assert load(tmp_path, text, p="z").arguments["p"] == str(Path.cwd() / "z")


def test_where_manifests_are_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shipped = find_manifest("replay.yaml")
    assert shipped.is_file()
    (tmp_path / "launch").mkdir()
    (tmp_path / "launch" / "replay.yaml").write_text("groups: {}")
    assert find_manifest("replay.yaml") == tmp_path / "launch" / "replay.yaml"
    (tmp_path / "replay.yaml").write_text("groups: {}")
    assert find_manifest("replay.yaml") == tmp_path / "replay.yaml"
    with pytest.raises(ManifestError, match=r"no manifest 'rebot\.yaml'; did you mean robot\.yaml"):
        find_manifest("rebot.yaml")


def test_words_of_the_command_line() -> None:
    assert split_words([]) == ("robot.yaml", [], {})
    assert split_words(["replay.yaml", "player", "log:=a b", "rate:=0"]) == (
        "replay.yaml", ["player"], {"log": "a b", "rate": 0},
    )  # fmt: skip
    with pytest.raises(UsageError, match="two manifests"):
        split_words(["a.yaml", "b.yaml"])


def test_the_plan_as_text() -> None:
    text = plan_text(plan.load(ROOT / "launch" / "robot.yaml", {}, robot="r1"))
    assert "/r1/velocity_controller  (control; needs /r1/safety_monitor)" in text
    assert "remap    cmd_vel -> cmd_vel_raw" in text
    assert f"publish_rate     = 10.0  # {ROOT}{os.sep}config" in text


values = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.sampled_from(["x", "${robot_name}", "${", "m.yaml", "s"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                ["groups", "nodes", "args", "include", "service", "params", "needs", "if", "file", "g", "a"]
            ),
            inner,
            max_size=4,
        )
    ),
    max_leaves=15,
)


@given(values)
def test_any_tree_is_read_or_refused_with_places(tree: object) -> None:
    import yaml

    problems: list[Problem] = []
    manifest.read(yaml.safe_dump(tree), Path("m.yaml"), problems)
    assert all(str(problem).startswith("m.yaml:") for problem in problems)
