"""A manifest as a Compose file."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from robo.cli.launch.export import export_compose, export_dockerfile
from robo.errors import UsageError
from robo.export.commands import MEMORY
from robo.launch import resolve
from robo.node.loading import load_node_class
from robo.process import options as node_options

ROOT = Path(__file__).parents[2]
SHIPPED = sorted(path.name for path in (ROOT / "launch").glob("*.yaml"))
GIVEN = {"replay.yaml": ["log:=logs/room.log.gz"]}


def exported(
    capsys: pytest.CaptureFixture[str], *words: str, robot: str | None = None, keeper: bool = False
) -> dict[str, Any]:
    export_compose(words, robot=robot, output=None, keeper=keeper)
    tree: dict[str, Any] = yaml.safe_load(capsys.readouterr().out)
    return tree


@pytest.fixture(autouse=True)
def _in_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.delenv("ROBO_LOG", raising=False)


def test_the_shipped_compose_file_is_what_is_exported(capsys: pytest.CaptureFixture[str]) -> None:
    export_compose(["launch/docker.yaml"], robot=None, output=None, keeper=True)
    assert capsys.readouterr().out == (ROOT / "docker-compose.yml").read_text()


def test_the_export_is_the_same_in_every_process() -> None:
    command = [sys.executable, "-m", "robo", "export", "compose", "launch/docker.yaml"]
    first, second = (
        subprocess.run(
            command, capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": seed, "PATH": ""}, cwd=ROOT
        ).stdout
        for seed in ("1", "2")
    )
    assert first == second


@pytest.mark.parametrize("name", SHIPPED)
def test_nodes_get_the_parameters_that_robo_up_gives_them(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tree = exported(capsys, name, *GIVEN.get(name, ()), robot="r1")
    arguments = {key: value for key, _, value in (word.partition(":=") for word in GIVEN.get(name, ()))}
    plan = resolve.resolve(ROOT / "launch" / name, arguments, robot="r1").plan
    places = {f"/etc/robo/{config['file'][2:]}": config["file"] for config in tree.get("configs", {}).values()}
    for service in tree["services"].values():
        command = service["command"]
        if command[0] != "run" or "profiles" in service:
            continue
        _, class_name, *options = command
        local = [places.get(word, word) for word in options]
        for variable, value in service["environment"].items():
            monkeypatch.setenv(variable, value)
        spec = node_options.parse(load_node_class(class_name), local)
        process = next(p for p in plan.processes if (p.name, p.namespace) == (spec.name, spec.namespace))
        told = {key: places.get(str(value), value) for key, value in spec.parameters.items()}
        wanted = process.parameters
        for key, value in wanted.items():
            same = told[key] == value or Path(str(told[key])).resolve() == Path(str(value)).resolve()
            assert same, f"{process.full_name} {key}"
        assert spec.remappings == process.remap
        assert spec.mode == "client"


def test_robots_have_routers_that_meet_and_only_the_first_is_seen_from_the_host(
    capsys: pytest.CaptureFixture[str],
) -> None:
    services = exported(capsys, "fleet.yaml", "robots:=3")["services"]
    routers = {name: service for name, service in services.items() if name.endswith("router")}
    assert set(routers) == {"router", "r2_router", "r3_router"}
    assert [name for name, service in services.items() if "ports" in service] == ["router"]
    assert routers["router"]["ports"] == ["127.0.0.1:${ROBO_PORT:-7447}:7447"]
    assert "tcp/router:7447" in routers["r3_router"]["command"]
    assert services["r2_position_tracker"]["environment"]["ROBO_CONNECT"] == "tcp/r2_router:7447"


def test_what_a_manifest_says_of_processes_becomes_what_compose_calls_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(
        """
args: {debug: {default: false}}
groups:
  all:
    namespace: ${robot_name}
    nodes:
      base:
        run: ./driver --port $PORT
        env: {PORT: "${env:PORT:-/dev/ttyUSB0}"}
        ready: {probe: [test, -e, /tmp/x]}
        restart: {propagate: true}
      lamp: {run: [python, lamp.py], params: {pin: 3}, stop: TERM}
      web: {run: serve, ready: {port: 8080}}
      position_tracker:
        service: robo_services.position_tracker
        needs: {base: ready, lamp: ready}
        restart: always
        params: {log_rate: 0.5}
        log: {level: debug}
        cpus: [0, 1]
        stop: {timeout: 5}
  debug:
    if: ${debug}
    namespace: ${robot_name}
    nodes:
      echo: {run: "robo topic echo ${robot_name}/odom"}
"""
    )
    services = exported(capsys, "mine.yaml")["services"]
    assert set(services) == {"router", "base", "lamp", "web", "position_tracker", "echo"}
    base, lamp, tracker, echo = (services[name] for name in ("base", "lamp", "position_tracker", "echo"))
    assert base["command"][-1] == "$$PORT", "a dollar that is the command's own stays one"
    assert base["environment"]["PORT"] == "${PORT:-/dev/ttyUSB0}"
    assert base["healthcheck"]["test"] == ["CMD", "test", "-e", "/tmp/x"]
    assert lamp["command"] == ["python", "lamp.py"]
    assert lamp["stop_signal"] == "SIGTERM"
    assert lamp["healthcheck"]["test"] == ["CMD", "true"], "all are healthy, so that `up --wait` works"
    assert (
        services["web"]["healthcheck"]["test"][-1] == "import socket; socket.create_connection(('127.0.0.1', 8080), 1)"
    )
    assert json.loads(lamp["environment"]["ROBO_NODE"])["parameters"] == {"pin": 3}
    assert lamp["environment"]["ROBO_NAMESPACE"] == "${ROBOT_NAME:-my_robot}"
    assert tracker["depends_on"] == {
        "router": {"condition": "service_healthy"},
        "base": {"condition": "service_healthy", "restart": True},
        "lamp": {"condition": "service_started"},
    }
    assert tracker["command"][-2:] == ["-p", "log_rate:=0.5"]
    assert (tracker["restart"], tracker["cpuset"], tracker["stop_grace_period"]) == ("always", "0,1", "5s")
    assert tracker["environment"]["ROBO_LOG_LEVEL"] == "debug"
    assert tracker["healthcheck"]["test"][-1] == "/${ROBOT_NAME:-my_robot}/position_tracker"
    assert echo["profiles"] == ["debug"]
    assert echo["command"] == ["robo", "topic", "echo", "${ROBOT_NAME:-my_robot}/odom"]


def test_nothing_else_is_called_or_stored_alike(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside = tmp_path / "robot"
    for folder in (inside, tmp_path / "left", tmp_path / "right"):
        folder.mkdir()
        (folder / "params.yaml").write_text(f"position_tracker: {{log_rate: {len(folder.name)}.5}}\n")
    monkeypatch.chdir(inside)
    Path("mine.yaml").write_text(
        """
description: |
  A robot
  in two lines
groups:
  all:
    namespace: ${robot_name}
    nodes:
      router: {run: "sleep inf"}
      keeper: {run: "sleep inf"}
      arm_router: {run: "sleep inf"}
      position_tracker:
        service: robo_services.position_tracker
        params: [params.yaml, ../left/params.yaml, ../right/params.yaml]
    groups:
      arm: {namespace: arm, nodes: {router: {run: "sleep inf"}}}
"""
    )
    tree = exported(capsys, "mine.yaml")
    assert set(tree["services"]) == {
        *("router", "router_2", "keeper", "arm_router", "arm_router_2", "position_tracker")
    }
    with_keeper = exported(capsys, "mine.yaml", keeper=True)["services"]
    assert set(with_keeper) == {*tree["services"], "keeper_2"}
    assert with_keeper["keeper"]["command"][0] == "keeper", "the name belongs to the one that robo brings"
    tracker = tree["services"]["position_tracker"]
    places = {config["target"]: tree["configs"][config["source"]]["file"] for config in tracker["configs"]}
    told = [word for word in tracker["command"] if word.endswith(".yaml")]
    assert [places[word] for word in told] == [
        "./params.yaml",
        *(str(tmp_path / side / "params.yaml") for side in ("left", "right")),
    ]


def test_files_and_folders_of_the_project_come_along(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scripts").mkdir()
    (tmp_path / ".venv" / "bin").mkdir(parents=True)
    for file in ("lamp.sh", "driver", "scripts/horn.py", ".venv/bin/python", ".venv/bin/robo"):
        Path(file).write_text("")
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))
    Path("mine.yaml").write_text(
        """
groups:
  all:
    namespace: ${robot_name}
    nodes:
      lamp: {run: [sh, "${dir}/lamp.sh", --bright]}
      driver: {run: ./driver /dev/ttyUSB0}
      echo: {run: robo topic echo odom}
      python: {run: "python -m http.server"}
      horn: {run: python horn.py, cwd: "${dir}/scripts"}
      here: {run: python scripts/horn.py, cwd: "${dir}"}
      other: {run: /usr/bin/env, cwd: /tmp}
"""
    )
    services = exported(capsys, "mine.yaml")["services"]
    assert services["lamp"]["command"] == ["sh", "/etc/robo/lamp.sh", "--bright"]
    assert services["lamp"]["configs"] == [{"source": "lamp_sh", "target": "/etc/robo/lamp.sh"}]
    assert services["driver"]["command"] == ["/etc/robo/driver", "/dev/ttyUSB0"]
    assert services["echo"]["command"] == ["robo", "topic", "echo", "odom"]
    assert services["python"]["command"] == ["python", "-m", "http.server"]
    assert services["horn"]["command"] == ["python", "horn.py"]
    assert (services["horn"]["working_dir"], services["horn"]["volumes"]) == (
        "/srv/scripts",
        ["./scripts:/srv/scripts:ro"],
    )
    assert (services["here"]["working_dir"], services["here"]["volumes"]) == ("/srv", [".:/srv:ro"])
    assert services["other"]["command"] == ["/usr/bin/env"]
    assert services["other"]["working_dir"] == "/tmp"
    assert str(tmp_path) not in str(services)

    Path("deploy").mkdir()
    Path("Dockerfile").touch()
    export_compose(["mine.yaml"], robot=None, output=Path("deploy/docker-compose.yml"))
    tree = yaml.safe_load(Path("deploy/docker-compose.yml").read_text())
    assert tree["services"]["router"]["build"]["context"] == ".."
    assert tree["configs"]["lamp_sh"] == {"file": "../lamp.sh"}
    assert tree["services"]["horn"]["volumes"] == ["../scripts:/srv/scripts:ro"]


def test_files_of_installed_packages_are_those_of_the_image(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tree = exported(capsys, "robot.yaml")
    assert "configs" not in tree, "the image has what ships with robo"
    base, tracker = tree["services"]["diff_drive_sim"], tree["services"]["position_tracker"]
    shipped = "/opt/robo/site-packages/robo/share/config"
    assert f"world:={shipped}/hall.yaml" in base["command"]
    assert f"{shipped}/params.yaml" in tracker["command"]
    mounted = [volume for service in tree["services"].values() for volume in service.get("volumes", [])]
    assert set(mounted) == {MEMORY}, "nothing of this machine"
    kept = {name for name, service in tree["services"].items() if "volumes" in service}
    assert kept == {name for name, service in tree["services"].items() if service["restart"] == "on-failure"}
    assert all(tree["services"][name]["environment"]["ROBO_MEMORY"] == MEMORY for name in kept)

    environment = tmp_path / ".venv"
    share = environment / "lib" / "python3.11" / "site-packages" / "batt" / "share"
    for file in (share / "params.yaml", share / "bin" / "driver", environment / "bin" / "charge"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("position_tracker: {log_rate: 2.5}\n")
    (environment / "pyvenv.cfg").touch()
    Path("mine.yaml").write_text(
        f"""
groups:
  all:
    namespace: ${{robot_name}}
    nodes:
      position_tracker: {{service: robo_services.position_tracker, params: ["{share}/params.yaml"]}}
      driver: {{run: ["{share}/bin/driver"], cwd: "{share}"}}
      charge: {{run: ["{environment}/bin/charge"]}}
"""
    )
    tree = exported(capsys, "mine.yaml")
    assert "configs" not in tree
    services = tree["services"]
    theirs = "/opt/robo/site-packages/batt/share"
    assert services["position_tracker"]["command"][-2:] == ["--params-file", f"{theirs}/params.yaml"]
    assert (services["driver"]["command"], services["driver"]["working_dir"]) == ([f"{theirs}/bin/driver"], theirs)
    assert services["charge"]["command"] == ["charge"]
    assert ".venv" not in str(tree)


def test_an_image_is_built_where_there_is_a_dockerfile(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = tmp_path / "Batt Robot"
    project.mkdir()
    monkeypatch.chdir(project)
    export_compose(["robot.yaml"], robot=None, output=None)
    said = capsys.readouterr()
    assert "build:" not in said.out
    assert f"there is no {project}/Dockerfile: the file builds no image" in said.err
    assert "robo export dockerfile > Dockerfile" in said.err

    export_dockerfile()
    text = capsys.readouterr().out
    Path("Dockerfile").write_text(text)
    export_compose(["robot.yaml"], robot=None, output=None)
    said = capsys.readouterr()
    assert said.err == ""
    tree = yaml.safe_load(said.out)
    assert tree["services"]["router"]["build"] == {"context": ".", "network": "host"}
    assert tree["x-robo"]["image"] == "${ROBO_IMAGE:-batt-robot:latest}", "not the image that it is built on"
    assert text in (ROOT / "docs" / "hosts.md").read_text()


@pytest.mark.parametrize("name", SHIPPED)
def test_no_container_holds_the_engines_socket_unasked(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    export_compose([name, *GIVEN.get(name, ())], robot=None, output=None)
    assert "docker.sock" not in capsys.readouterr().out
    shipped = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
    assert [name for name, service in shipped.items() if "docker.sock" in str(service)] == ["keeper"]
    assert shipped["keeper"]["profiles"] == ["keeper"]


def test_a_keeper_is_a_profile_and_speaks_to_the_engine_alone(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    export_compose(["robot.yaml"], robot=None, output=None, keeper=True)
    text = capsys.readouterr().out
    keeper = yaml.safe_load(text)["services"]["keeper"]
    assert (keeper["network_mode"], keeper["networks"], keeper["cap_drop"]) == ("none", {}, ["ALL"])
    assert keeper["profiles"] == ["keeper"]
    assert "robo export compose robot.yaml --keeper\n" in text

    manifest = tmp_path / "mine.yaml"
    manifest.write_text(
        """
args: {keeper: {default: false}}
groups:
  all: {namespace: "${robot_name}", if: "${keeper}", nodes: {goal: {run: "sleep inf"}}}
"""
    )
    services = exported(capsys, str(manifest), keeper=True)["services"]
    assert services["goal"]["profiles"] == ["keeper"]
    assert services["keeper"]["profiles"] == ["keeper_2"], "whoever wants a goal keeper gets no other"


def test_the_robots_name_may_be_fixed(capsys: pytest.CaptureFixture[str]) -> None:
    services = exported(capsys, "robot.yaml", robot="r7")["services"]
    assert "${" not in str(services["position_tracker"]["command"])
    assert services["position_tracker"]["healthcheck"]["test"][-1] == "/r7/position_tracker"


def test_words_that_make_no_sense_are_told() -> None:
    with pytest.raises(UsageError, match="name one manifest"):
        export_compose(["robot.yaml", "fleet.yaml"], robot=None, output=None)
    with pytest.raises(UsageError, match="cannot be written"):
        export_compose(["robot.yaml"], robot=None, output=Path("/nowhere/x.yml"))


def test_the_words_before_and_after_a_node_come_along(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = json.dumps([sys.executable, "-X", "importtime"])
    nodes = f"""
      a: {{service: robo_services.position_tracker, prefix: {words}, args: [--log-level, debug]}}
      b: {{run: drive --fast, prefix: nice -n 5, args: [-v]}}
"""
    Path("mine.yaml").write_text("groups:\n  all:\n    namespace: r1\n    nodes:" + nodes)
    services = exported(capsys, "mine.yaml")["services"]
    a, b = services["a"], services["b"]
    assert a["entrypoint"] == ["tini", "-g", "--", "python", "-X", "importtime", "python", "-m", "robo"]
    assert a["command"][:4] == ["run", "robo_services.position_tracker", "--name", "a"]
    assert a["command"][-2:] == ["--log-level", "debug"]
    assert b["entrypoint"] == ["tini", "-g", "--"]
    assert b["command"] == ["nice", "-n", "5", "drive", "--fast", "-v"]
