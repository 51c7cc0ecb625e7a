"""From manifests to plans: what wins, what is left out, what is repeated."""

import os
from pathlib import Path

import pytest

from robo.errors import ManifestError
from robo.launch import resolve
from robo.launch.faults import ManifestFaults
from robo.launch.plan import Plan, ProcessPlan, RestartPlan
from robo.launch.substitution import Word
from robo.launch.values import Assignment

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def load(
    text: str, *, groups: list[str] | None = None, parameters: dict[str, str] | None = None, **arguments: object
) -> Plan:
    Path("m.yaml").write_text(text)
    assigned = [Assignment(left, Word(value)) for left, value in (parameters or {}).items()]
    given = {name: Word(value) if isinstance(value, str) else value for name, value in arguments.items()}
    return resolve.load(Path("m.yaml"), given, groups=groups or [], parameters=assigned)


def by_name(plan: Plan) -> dict[str, ProcessPlan]:
    return {process.full_name: process for process in plan.processes}


def values(process: ProcessPlan) -> dict[str, object]:
    return process.parameters


# -- the shipped manifests ---------------------------------------------------------------------------


def shipped(name: str, *, robot: str | None = "r1", **arguments: object) -> Plan:
    return resolve.load(ROOT / "launch" / name, arguments, robot=robot)


def test_robot_yaml() -> None:
    found = shipped("robot.yaml")
    assert [p.full_name for p in found.processes] == [
        "/r1/diff_drive_sim", "/r1/position_tracker", "/r1/twist_mux", "/r1/velocity_smoother", "/r1/safety_monitor",
        "/r1/waypoint_follower",
    ]  # fmt: skip
    *_, mux, smoother, monitor, follower = found.processes
    assert follower.remap == {"cmd_vel": "cmd_vel_nav"}
    assert mux.parameters["topics.autonomy.topic"] == "cmd_vel_nav"
    assert mux.remap["cmd_vel_out"] == smoother.remap["cmd_vel"]
    assert smoother.remap["cmd_vel_smoothed"] == "cmd_vel_raw"
    assert monitor.remap == {}
    assert follower.needs == dict.fromkeys(("/r1/safety_monitor", "/r1/velocity_smoother", "/r1/twist_mux"), "ready")
    assert follower.parameters["file"] == f"{ROOT}/config/course.yaml"
    assert found.processes[0].parameters["world"] == f"{ROOT}/config/hall.yaml"


@pytest.mark.parametrize(
    ("demo", "driver", "parameters"),
    [
        ("dock", "waypoint_follower", {"file": f"{ROOT}/launch/../config/dock.yaml"}),
        ("arc", "velocity_controller", {"linear_velocity": 0.5, "angular_velocity": 0.2}),
        ("rotate", "velocity_controller", {"linear_velocity": 0.0, "angular_velocity": 0.5}),
        ("none", "safety_monitor", {"max_speed": 1.0}),
    ],
)
def test_each_demo_is_one_argument(demo: str, driver: str, parameters: dict[str, object]) -> None:
    last = shipped("robot.yaml", demo=Word(demo)).processes[-1]
    assert last.name == driver
    assert parameters.items() <= last.parameters.items()
    if driver == "velocity_controller":
        assert last.settings["publish_rate"][-1].source == f"{ROOT}/config/params.yaml:6:5"


def test_robot_yaml_without_the_simulated_base() -> None:
    assert "diff_drive_sim" not in {p.name for p in shipped("robot.yaml", use_sim=Word("false")).processes}


def test_simulation_yaml_is_the_robot_with_other_values() -> None:
    robot, simulation = shipped("robot.yaml"), shipped("simulation.yaml")
    assert [p.full_name for p in simulation.processes] == [p.full_name for p in robot.processes]
    assert simulation.processes[0].parameters["world"] == f"{ROOT}/config/hall.yaml"
    arc = shipped("simulation.yaml", demo=Word("arc")).processes[-1]
    assert arc.parameters["linear_velocity"] == 0.4
    viewer = by_name(shipped("simulation.yaml", viewer="rates"))["/r1/rates"]
    assert viewer.command() == ("robo", "topic", "hz", "r1/*")
    rerun = by_name(shipped("simulation.yaml", viewer="rerun"))["/r1/rerun"]
    assert rerun.command() == ("robo", "view", "rerun", "--robot-name", "r1")


def test_real_robot_yaml_drives_slower_and_needs_its_safety_monitor() -> None:
    standing = by_name(shipped("real_robot.yaml", base_service="robo_services.diff_drive_sim"))
    assert "/r1/velocity_controller" not in standing, "by itself it does nothing"
    found = by_name(shipped("real_robot.yaml", base_service="robo_services.diff_drive_sim", demo=Word("arc")))
    assert found["/r1/velocity_controller"].parameters["linear_velocity"] == 0.2
    assert found["/r1/safety_monitor"].required
    assert found["/r1/base"].restart.policy == "on-failure"
    topics = {topic.key: topic for topic in shipped("real_robot.yaml").topics}
    assert topics["r1/scan"].external
    assert (topics["r1/scan"].min_rate, topics["r1/scan"].max_age) == (5.0, 0.5)
    blind = shipped("real_robot.yaml", base_service="robo_services.diff_drive_sim", laser=Word("false"))
    (scan,) = (topic for topic in blind.topics if topic.key.endswith("/scan"))
    assert (scan.external, scan.min_rate, scan.max_age) == (True, None, None)
    assert by_name(blind)["/r1/safety_monitor"].parameters["laser"] is False


def test_real_robot_yaml_takes_a_serial_port() -> None:
    plan = shipped("real_robot.yaml", port=Word("/dev/ttyUSB0"))
    found = by_name(plan)
    base = found["/r1/serial_base"]
    assert (base.service, base.restart.policy) == ("robo_services.serial_base", "on-failure")
    assert {"port": "/dev/ttyUSB0", "command_source": "safety_monitor"}.items() <= base.parameters.items()
    monitor = found["/r1/safety_monitor"].parameters
    assert (monitor["laser"], monitor["wait_for_laser"]) == (True, False), "port is all that has to be said"
    topics = {topic.key: topic for topic in plan.topics}
    assert (topics["r1/odom"].external, topics["r1/scan"].external) == (False, True)
    assert not {"/r1/base", "/r1/emulated_board"} & {*found}
    own = by_name(shipped("real_robot.yaml", port=Word("/dev/ttyUSB0"), base_service="robo_services.diff_drive_sim"))
    assert "/r1/serial_base" not in own
    seeing = shipped("real_robot.yaml", port=Word("/dev/ttyUSB0"), lidar_port=Word("10c4:ea60"))
    assert by_name(seeing)["/r1/ld_lidar"].parameters["port"] == "10c4:ea60"
    assert "wait_for_laser" not in by_name(seeing)["/r1/safety_monitor"].parameters
    assert not next(topic for topic in seeing.topics if topic.key == "r1/scan").external


@pytest.mark.parametrize(("port", "link"), [("", "/tmp/r1_board"), ("/tmp/mine", "/tmp/mine")])
def test_real_robot_yaml_plays_board_and_lidar(port: str, link: str) -> None:
    plan = shipped("real_robot.yaml", emulate=Word("true"), port=Word(port))
    found = by_name(plan)
    assert found["/r1/ld_lidar"].parameters["port"] == found["/r1/emulated_lidar"].parameters["port"] == "/tmp/r1_lidar"
    assert found["/r1/emulated_lidar"].parameters["follow"] == "ground_truth"
    assert found["/r1/serial_base"].parameters["port"] == link
    assert found["/r1/emulated_board"].parameters["link"] == link
    assert found["/r1/safety_monitor"].parameters["laser"] is True
    assert "wait_for_laser" not in found["/r1/safety_monitor"].parameters
    assert not [topic.key for topic in plan.topics if topic.key in ("r1/odom", "r1/scan") and topic.external]
    blind = shipped("real_robot.yaml", emulate=Word("true"), laser=Word("false"))
    assert not {"/r1/ld_lidar", "/r1/emulated_lidar"} & {*by_name(blind)}


def test_an_argument_without_a_default_has_to_be_given() -> None:
    with pytest.raises(ManifestError, match=r"m\.yaml needs speed \(of the base\); give it as speed:=VALUE"):
        load("args: {speed: {type: float, description: of the base}}")


def test_replay_yaml_has_a_log_and_takes_a_path_from_the_current_folder(tmp_path: Path) -> None:
    own = shipped("replay.yaml").processes[-1].parameters["log"]
    assert isinstance(own, str)
    assert Path(own).is_file()
    player = shipped("replay.yaml", log=Word("logs/run.log"), rate=Word("0")).processes[-1]
    assert player.parameters["log"] == str(tmp_path / "logs" / "run.log")
    assert player.parameters["rate"] == 0.0
    assert player.required


def test_fleet_yaml_starts_as_many_robots_as_are_asked_for() -> None:
    names = [p.full_name for p in shipped("fleet.yaml", robots=Word("5")).processes]
    assert len(names) == len(set(names)) == 30
    assert {name.split("/")[1] for name in names} == {"r1", "r2", "r3", "r4", "r5"}


# -- precedence ----------------------------------------------------------------------------------------


def test_precedence_entry_by_entry() -> None:
    Path("fleet.yaml").write_text(
        """\
/**/velocity_controller: {ros__parameters: {publish_rate: 12.0, angular_velocity: 0.11}}
/**: {ros__parameters: {publish_rate: 11.0, linear_velocity: 0.11, log_rate: 2.0}}
/r1/inner/velocity_controller: {publish_rate: 13.0}
"""
    )
    Path("later.yaml").write_text("velocity_controller: {angular_velocity: 0.12}\n")
    Path("robot.yaml").write_text(
        """\
args: {robot_name: my_robot, fast: false}
groups:
  control:
    namespace: ${robot_name}
    params: [fleet.yaml, {linear_velocity: 0.2, min_distance: 0.4}]
    remap: {cmd_vel: cmd_vel_raw, odom: base/odom}
    env: {SPEED: slow, MODE: {value: test, if: not fast}}
    groups:
      inner:
        namespace: inner
        params: later.yaml
        nodes:
          velocity_controller:
            service: robo_services.velocity_controller
            params: [{if: fast, linear_velocity: 0.9}, {unless: fast, values: {linear_velocity: 0.3}}]
            remap: {cmd_vel: raw}
            env: {SPEED: fast}
    nodes:
      position_tracker: {service: robo_services.position_tracker, params: {max_distance: 5}}
      safety_monitor: {service: robo_services.safety_monitor, if: fast}
      slow_monitor: {service: robo_services.safety_monitor, unless: fast}
"""
    )
    text = "args: {fast: {default: false}}\ninclude: {file: robot.yaml, args: {fast: '${fast}', robot_name: r1}}\n"
    found = by_name(load(text, parameters={"velocity_controller.max_linear_acceleration": "0.7", "log_rate": "4"}))
    assert list(found) == ["/r1/position_tracker", "/r1/slow_monitor", "/r1/inner/velocity_controller"]
    controller = found["/r1/inner/velocity_controller"]
    assert {name: (said[-1].value, said[-1].source) for name, said in controller.settings.items()} == {
        "publish_rate": (13.0, "fleet.yaml:3:33"),  # the most specific entry of the file
        "angular_velocity": (0.12, "later.yaml:1:23"),  # the later file
        "linear_velocity": (0.3, "robot.yaml:15:80"),  # a value of the node over its group's over all files
        "max_linear_acceleration": (0.7, "command line"),
    }
    assert controller.remap == {"cmd_vel": "raw", "odom": "base/odom"}
    assert {name: str(place) for name, place in controller.sources["remap"].items()} == {
        "cmd_vel": "robot.yaml:16:21", "odom": "robot.yaml:6:35",
    }  # fmt: skip
    assert controller.env == {"SPEED": "fast", "MODE": "test"}
    assert values(found["/r1/position_tracker"]) == {"log_rate": 4.0, "max_distance": 5}
    assert values(found["/r1/slow_monitor"]) == {"min_distance": 0.4}
    fast = by_name(load(text, fast="true"))
    assert "/r1/safety_monitor" in fast
    assert fast["/r1/inner/velocity_controller"].parameters["linear_velocity"] == 0.9
    assert fast["/r1/inner/velocity_controller"].env == {"SPEED": "fast"}


def test_what_comes_from_a_command_line_has_the_type_of_its_parameter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FRAME", "1")
    text = """
groups:
  g:
    nodes:
      base: {service: robo_services.diff_drive_sim, params: {odom_frame: "${env:FRAME}", seed: "${env:FRAME}"}}
"""
    (base,) = load(text, parameters={"base.base_frame": "0.10"}).processes
    assert values(base) == {"odom_frame": "1", "seed": 1, "base_frame": "0.10"}


# -- arguments and substitutions -----------------------------------------------------------------------


def test_substitutions_keep_types_and_conditions_hold() -> None:
    text = """
args: {flag: true, speed: 1.5, name: {default: "${robot_name}_x"}, n: 3}
groups:
  yes:
    if: ${flag}
    namespace: ${robot_name}
    env: {SPEED: "v${speed}", LITERAL: "$${HOME}"}
    nodes:
      a: {run: x, namespace: inner, params: {speed: ${speed}, flag: ${flag}, name: ${name}, n: ${n}}}
  no:
    unless: ${flag}
    nodes: {b: {run: x}}
"""
    (process,) = load(text).processes
    assert process.full_name == "/my_robot/inner/a"
    assert values(process) == {"speed": 1.5, "flag": True, "name": "my_robot_x", "n": 3}
    assert process.env == {"SPEED": "v1.5", "LITERAL": "${HOME}"}
    assert [p.name for p in load(text, flag="false").processes] == ["b"]


def test_what_a_manifest_knows_of_its_surroundings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIDAR_PORT", "/dev/ttyUSB3")
    monkeypatch.delenv("NOT_SET", raising=False)
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "inner.yaml").write_text(
        """
groups:
  g:
    nodes:
      a:
        run: [prog, "${dir}", "${file}", "${workspace}", "${share:robo}/launch"]
        args: ["${env:LIDAR_PORT}", "${env:NOT_SET:-a b}"]
      b: {run: [prog, "${anon:tool}", "${anon:tool}", "${anon:other}"]}
"""
    )
    found = by_name(load("include: deep/inner.yaml"))
    assert found["/a"].command() == (
        "prog", f"{tmp_path}/deep", f"{tmp_path}/deep/inner.yaml", str(tmp_path),
        str(ROOT / "robo" / "share" / "launch"), "/dev/ttyUSB3", "a b",
    )  # fmt: skip
    _, first, again, other = found["/b"].command()
    assert first == again
    assert first.startswith("tool_")
    assert first.removeprefix("tool_") != other.removeprefix("other_")


def test_arguments_have_types() -> None:
    text = """
args:
  version: "1.10"
  n: {type: int, default: 1}
  x: {type: float, default: 2}
  on: {type: bool, default: false}
  p: {type: path, default: x/y}
  mode: {choices: [slow, fast], default: slow}
  level: {type: int, choices: [1, 2], default: 1}
"""
    assert load(text).arguments == {
        "robot_name": "my_robot", "version": "1.10", "n": 1, "x": 2.0, "on": False, "p": f"{os.getcwd()}/x/y",
        "mode": "slow", "level": 1,
    }  # fmt: skip
    given = load(text, version="2.50", n="7", x="1e-3", on="true", p="~/z", mode="fast", level="2").arguments
    assert given["version"] == "2.50"
    assert (given["n"], given["x"], given["on"], given["level"]) == (7, 0.001, True, 2)
    assert given["p"] == os.path.expanduser("~/z")
    assert given["mode"] == "fast"


def test_the_environment_gives_an_argument_of_the_declared_type(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTS", "3")
    text = "args: {n: {type: int, default: '${env:ROBOTS:-1}'}, t: {type: str, default: '${env:ROBOTS}'}}"
    arguments = load(text).arguments
    assert (arguments["n"], arguments["t"]) == (3, "3")


def test_scopes_do_not_leak() -> None:
    Path("inner.yaml").write_text(
        "args: {speed: 1.0}\ngroups: {g: {nodes: {a: {run: x, params: {speed: '${speed}', x: '${outer}'}}}}}\n"
    )
    text = "args: {outer: 5}\ninclude: {file: inner.yaml, args: {speed: 2.0}}\n"
    with pytest.raises(ManifestFaults) as error:
        load(text)
    assert str(error.value).startswith("inner.yaml:2:66: ${outer} is not defined")


# -- groups, includes, loops ---------------------------------------------------------------------------


def test_namespaces_compose_and_an_absolute_one_starts_anew() -> None:
    text = """
groups:
  a:
    namespace: r1
    groups:
      b:
        namespace: arm
        nodes:
          x: {run: x, namespace: left}
          y: {run: x, namespace: /site}
"""
    assert list(by_name(load(text))) == ["/r1/arm/left/x", "/site/y"]


def test_groups_can_be_chosen() -> None:
    text = """
groups:
  a: {nodes: {x: {run: x}}}
  b:
    nodes: {y: {run: x, needs: {x: ready}}}
    groups: {c: {nodes: {z: {run: x, needs: y}}}}
"""
    y, z = load(text, groups=["b"]).processes
    assert (y.needs, z.needs) == ({}, {"/y": "ready"})
    assert [p.name for p in load(text, groups=["c"]).processes] == ["z"]
    assert [p.name for p in load(text, groups=["b/c", "a"]).processes] == ["x", "z"]
    with pytest.raises(ManifestError, match=r"m\.yaml has no group 'd'; it has a, b, b/c"):
        load(text, groups=["d"])


def test_an_include_leaves_nodes_out_and_changes_others() -> None:
    Path("inner.yaml").write_text(
        """
groups:
  g:
    params: {linear_velocity: 0.1}
    nodes:
      velocity_controller: {service: robo_services.velocity_controller, remap: {cmd_vel: raw}, needs: position_tracker}
      position_tracker: {service: robo_services.position_tracker, params: {log_rate: 1}}
"""
    )
    text = """
args: {speed: 0.4}
groups:
  outer:
    include:
      - file: inner.yaml
        namespace: a
        without: position_tracker
      - file: inner.yaml
        namespace: b
        override:
          position_tracker: {params: {log_rate: 9}, required: true, if: speed > 0.3}
          velocity_controller: {params: {linear_velocity: "${speed}"}, remap: {odom: o}, env: {A: b}}
      - {file: inner.yaml, if: speed > 1}
"""
    found = by_name(load(text))
    assert list(found) == ["/a/velocity_controller", "/b/velocity_controller", "/b/position_tracker"]
    assert found["/a/velocity_controller"].needs == {}
    changed = found["/b/velocity_controller"]
    assert values(changed) == {"linear_velocity": 0.4}
    assert changed.remap == {"cmd_vel": "raw", "odom": "o"}
    assert changed.needs == {"/b/position_tracker": "ready"}
    assert values(found["/b/position_tracker"]) == {"log_rate": 9}
    assert found["/b/position_tracker"].required
    assert not by_name(load(text, speed="0.2"))["/b/position_tracker"].required


def test_an_override_may_replace_a_service_by_a_command() -> None:
    Path("inner.yaml").write_text("groups: {g: {nodes: {a: {service: robo_services.position_tracker}}}}")
    (process,) = load("include: {file: inner.yaml, override: {a: {run: sleep 1}}}").processes
    assert process.service is None
    assert process.command() == ("sleep", "1")


def test_replicas_count_and_for_each_names() -> None:
    text = """
groups:
  robots:
    replicas: 2
    namespace: r${index}
    nodes:
      camera: {run: cam, replicas: 2, params: {port: "${index}"}}
      viewer: {run: see, needs: camera}
  fixed:
    for_each: {robot: [{name: a, x: 1.5}, {name: b, x: 2}]}
    namespace: ${robot.name}
    nodes:
      n: {run: x, params: {x: "${robot.x}", i: "${index}"}, name: "n_${robot.name}", if: index > 1}
"""
    found = by_name(load(text))
    assert list(found) == [
        "/r1/camera_1", "/r1/camera_2", "/r1/viewer", "/r2/camera_1", "/r2/camera_2", "/r2/viewer", "/b/n_b",
    ]  # fmt: skip
    assert values(found["/r2/camera_2"]) == {"port": 2}
    assert found["/r1/viewer"].needs == {"/r1/camera_1": "ready", "/r1/camera_2": "ready"}
    assert values(found["/b/n_b"]) == {"x": 2, "i": 2}


def test_no_replicas_are_no_nodes_and_nobody_waits_for_them() -> None:
    text = """
groups:
  g: {nodes: {camera: {run: x, replicas: 0}, a: {run: x, needs: [camera, far]}}}
  h: {replicas: 0, nodes: {far: {run: x}}}
"""
    (process,) = load(text).processes
    assert process.needs == {}


def test_a_need_of_a_node_that_a_condition_leaves_out_is_void() -> None:
    Path("inner.yaml").write_text("groups: {g: {nodes: {far: {run: x}}}}")
    text = """
args: {use_sim: false}
groups:
  sim: {if: use_sim, nodes: {base: {run: x}}, include: inner.yaml}
  rest: {nodes: {a: {run: x, needs: [base, far]}}}
"""
    assert load(text).processes[0].needs == {}
    assert list(by_name(load(text, use_sim="true"))["/a"].needs) == ["/base", "/far"]


# -- how processes run -----------------------------------------------------------------------------------


def test_how_a_process_runs() -> None:
    Path("work").mkdir()
    text = """
groups:
  g:
    restart: {policy: always, max: 3}
    log: file
    nodes:
      a:
        run: driver --port '/dev/tty 1' ${robot_name}
        args: [-v, 3]
        prefix: nice -n 5
        cwd: work
        needs: {b: completed}
        ready: {log: 'listening on \\d+'}
        required: true
        restart: {delay: 2}
        stop: {signal: SIGTERM, timeout: 3}
        priority: 5
        cpus: 0-1,3
        log: {level: debug}
      b: {run: prepare, restart: never, log: both, stop: TERM}
"""
    a, b = load(text).processes
    assert a.command() == ("nice", "-n", "5", "driver", "--port", "/dev/tty 1", "my_robot", "-v", "3")
    assert a.cwd == f"{os.getcwd()}/work"
    assert a.needs == {"/b": "completed"}
    assert (a.ready.when, a.ready.log) == ("started", r"listening on \d+")
    assert a.required
    assert a.restart == RestartPlan(policy="always", delay=2.0, max=3)
    assert (a.stop.signal, a.stop.timeout) == ("TERM", 3.0)
    assert (a.priority, a.cpus) == (5, (0, 1, 3))
    assert (a.log.level, a.log.output) == ("debug", "file")
    assert (b.restart.policy, b.log.output, b.stop.signal) == ("never", "both", "TERM")
    assert b.ready.when == "started"


def test_topic_contracts() -> None:
    text = """
topics: {/clock: {rate: "<= 100"}}
groups:
  g:
    namespace: r1
    topics: {scan: {type: sensor/LaserScan, rate: ">= 5", max_age: 0.5}, odom: {rate: 10}, map: nav/OccupancyGrid}
"""
    found = {topic.key: topic for topic in load(text).topics}
    assert (found["clock"].min_rate, found["clock"].max_rate) == (None, 100.0)
    assert (found["r1/scan"].type, found["r1/scan"].min_rate, found["r1/scan"].max_age) == (
        "sensor/LaserScan",
        5.0,
        0.5,
    )
    assert found["r1/odom"].min_rate == 10.0
    assert found["r1/map"].type == "nav/OccupancyGrid"
