"""The reference robot as containers, on a real Docker engine."""

import json
import os
import shutil
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh

from robo.export.baggage import PACKAGES
from robo.export.compose import file as compose
from robo.export.compose.keeper import DELAY
from robo.export.profiles import profiles_of
from robo.security.keystore import Keystore
from robo.testing.heard import Heard
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port
from tests.docker_engine import built_image, docker
from tests.extras import needs_cryptography
from tests.packages import shared_wheel
from tests.support import PATIENCE, eventually, run_robo

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.timeout(420)


@pytest.fixture(scope="session")
def image() -> str:
    """The image, built from this checkout."""
    return built_image()


@pytest.fixture(scope="session")
def published(image: str) -> None:
    """Ports that the engine publishes are seen here; they are not where tests have a network of their own."""
    port = free_port()
    name = f"robo_test_port_{port}"
    listen = ("router", "--listen", "tcp/0.0.0.0:7447")
    docker("run", "--rm", "--detach", "--name", name, "--publish", f"127.0.0.1:{port}:7447", image, *listen)
    try:
        health = ("inspect", "-f", "{{.State.Health.Status}}", name)
        eventually(lambda: docker(*health).strip() == "healthy", "the router runs in its container")
        socket.create_connection(("127.0.0.1", port), PATIENCE).close()
    except OSError as error:
        pytest.skip(f"ports that the Docker engine publishes are not seen from here: {error}")
    finally:
        docker("rm", "--force", name)


class Project:
    """The Compose project of one test."""

    def __init__(self, image: str) -> None:
        port = free_port()
        self.name = f"robo_test_{port}"
        self.endpoint = f"tcp/127.0.0.1:{port}"
        self.profiles = ""
        """The profiles that commands concern, as COMPOSE_PROFILES names them."""
        self.image = image
        self.dashboard = free_port()
        ports = {"ROBO_PORT": str(port), "ROBO_DASHBOARD_PORT": str(self.dashboard)}
        self._environment = {**ports, "ROBOT_NAME": "r1"}

    def __call__(self, *words: str, check: bool = True) -> str:
        environment = {**self._environment, "ROBO_IMAGE": self.image, "COMPOSE_PROFILES": self.profiles}
        return docker("compose", "--project-name", self.name, *words, check=check, **environment)

    def container(self, service: str) -> str:
        return f"{self.name}-{service}-1"

    def state(self, service: str) -> dict[str, Any]:
        found: list[dict[str, Any]] = json.loads(docker("inspect", self.container(service)))
        return found[0]


@pytest.fixture
def project(image: str) -> Iterator[Project]:
    made = Project(image)
    try:
        yield made
    finally:
        made("down", "--timeout", "3", "--volumes", "--remove-orphans", check=False)


@pytest.fixture
def client(project: Project, published: None) -> Iterator[zenoh.Session]:
    del published
    project("up", "--wait", "--detach")
    session = open_session(Network(mode="client", connect=(project.endpoint,)))
    yield session
    close_session(session)


def crash(project: Project, service: str) -> None:
    """End a node's process within its container, and wait until its policy has started it again."""
    before = project.state(service)["RestartCount"]
    kill = (
        "import os, signal; [os.kill(int(p), signal.SIGKILL) for p in os.listdir('/proc') if p.isdigit() and p != '1' "
    )
    kill += "and b'robo.process.node' in open(f'/proc/{p}/cmdline', 'rb').read()]"
    project("exec", "-T", service, "python", "-c", kill, check=False)
    eventually(lambda: project.state(service)["RestartCount"] > before, "it is started again")


def wait_until_it_drives(odometry: Heard, timeout: float = PATIENCE) -> None:
    odometry.wait_for("r1/odom", lambda message: message.twist.twist.linear.x > 0.05, timeout, anew=True)


def test_the_image_is_small_and_runs_without_rights(image: str) -> None:
    sizes = [int(docker("image", "inspect", "-f", "{{.Size}}", name)) for name in ("python:3.12-slim", image)]
    assert sizes[1] - sizes[0] < 90_000_000
    recipe = (ROOT / "Dockerfile").read_text()
    assert f" {PACKAGES}\n" in recipe, "the link that exports refer to"
    locked = ("run", "--rm", "--read-only", "--cap-drop=ALL", "--network=none")
    assert docker(*locked, image, "--version").strip()
    assert docker(*locked, "--entrypoint", "id", image, "-u").strip() == "1000"


def test_the_robot_drives_in_containers_and_heals(project: Project, client: zenoh.Session) -> None:
    states = [project.state(service)["State"] for service in yaml_services()]
    assert {state["Health"]["Status"] for state in states} == {"healthy"}
    odometry = Heard(client, "r1/odom")
    wait_until_it_drives(odometry)

    changed = run_robo("param", "set", "waypoint_follower", "speed", "0.3", "--connect", project.endpoint)
    assert changed.returncode == 0, changed.stderr
    odometry.wait_for("r1/odom", lambda one: abs(one.twist.twist.linear.x - 0.3) < 0.01, PATIENCE, anew=True)

    # A node that crashes comes back by its policy.
    crash(project, "position_tracker")
    position = Heard(client, "r1/current_position")
    position.wait_for_count("r1/current_position", 1, PATIENCE)

    # One that an operator kills is his to start: nobody here holds the engine's socket.
    project("kill", "position_tracker")
    mounts = docker("inspect", "-f", "{{.HostConfig.Binds}}{{.Mounts}}", *project("ps", "--all", "--quiet").split())
    assert "docker.sock" not in mounts
    position.clear()
    project("start", "position_tracker")
    position.wait_for_count("r1/current_position", 1, PATIENCE)

    # Without its network the base stands still; with it the robot drives on.
    network, base = f"{project.name}_robot", project.container("diff_drive_sim")
    docker("network", "disconnect", network, base)
    time.sleep(3)  # for so long it is gone
    odometry.clear()
    docker("network", "connect", network, base)
    first = odometry.wait_for("r1/odom", lambda _: True, PATIENCE)
    assert first.twist.twist.linear.x < 0.25, "it has stood still, or is just starting"
    wait_until_it_drives(odometry)

    project("restart", "--timeout", "3", "router")
    odometry.clear()
    # Not after the 10 s that looking up a name takes where there is no internet.
    wait_until_it_drives(odometry, timeout=9)
    listed = run_robo("node", "list", "--json", "--connect", project.endpoint)
    assert len(listed.stdout.splitlines()) == 6
    again = run_robo("param", "get", "waypoint_follower", "speed", "--connect", project.endpoint)
    assert again.stdout.strip() == "0.3"

    project("down", "--timeout", "3")
    assert docker("ps", "--all", "--quiet", "--filter", f"name={project.name}") == ""
    assert project.name not in docker("network", "ls")


def test_an_emergency_stop_outlives_the_monitors_container(project: Project, client: zenoh.Session) -> None:
    odometry, state = Heard(client, "r1/odom"), Heard(client, "r1/safety_state")
    wait_until_it_drives(odometry)

    def call(service: str) -> None:
        done = run_robo("service", "call", f"r1/{service}", "--connect", project.endpoint)
        assert done.returncode == 0, done.stderr

    call("emergency_stop")
    odometry.wait_for("r1/odom", lambda message: message.twist.twist.linear.x == 0.0, PATIENCE, anew=True)
    for again in (lambda: crash(project, "safety_monitor"), lambda: project("restart", "safety_monitor")):
        state.clear()
        odometry.clear()
        again()
        state.wait_for("r1/safety_state", lambda one: "emergency stop" in one.message, PATIENCE, anew=True)
        odometry.wait_for_count("r1/odom", len(odometry.messages("r1/odom")) + 50, PATIENCE)
        assert not any(message.twist.twist.linear.x for message in odometry.messages("r1/odom"))
    call("reset_emergency_stop")
    wait_until_it_drives(odometry)


def yaml_services() -> list[str]:
    """The services that belong to no profile."""
    tree = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
    return [name for name, service in tree["services"].items() if "profiles" not in service]


def test_an_operators_kill_is_obeyed_unless_there_is_a_keeper(project: Project) -> None:
    def runs(service: str) -> bool:
        running: bool = project.state(service)["State"]["Running"]
        return running

    project("up", "--wait", "--detach")
    project("kill", "position_tracker")
    with pytest.raises(AssertionError):
        eventually(lambda: runs("position_tracker"), "something starts it", timeout=3 * DELAY)

    project.profiles = "keeper"
    project("up", "--wait", "--detach")
    project("kill", "position_tracker")
    eventually(lambda: runs("position_tracker"), "the keeper starts it again")
    project("kill", "position_tracker")
    project("stop", "--timeout", "3", "safety_monitor")
    eventually(lambda: runs("position_tracker"), "the one that was killed is back")
    assert not runs("safety_monitor"), "what was stopped stays stopped"

    # Whoever kills the whole project means it.
    project("kill")
    with pytest.raises(AssertionError):
        eventually(lambda: project("ps", "--quiet") != "", "something comes back", timeout=2 * DELAY)


def test_a_second_robot_is_a_profile(project: Project, published: None) -> None:
    del published
    project("--profile", "second_robot", "up", "--wait", "--detach")
    listed = run_robo("node", "list", "--json", "--connect", project.endpoint)
    names = {json.loads(line)["node"] for line in listed.stdout.splitlines()}
    assert {"/r1/safety_monitor", "/r1_2/safety_monitor"} <= names
    assert len(names) == 12


@needs_cryptography
@pytest.mark.skipif(os.geteuid() != 0, reason="the keys have to be of the image's user")
def test_a_secured_robot_meets_by_a_socket_and_lets_in_who_has_a_name(image: str, tmp_path: Path) -> None:
    store = Keystore(tmp_path / "security")
    store.init("site")
    store.add("r1", "robot", (), 30)
    store.add("ann", "operator", (), 30)
    for name in ("r1", "ann"):
        for path in (store.name_folder(name), *store.name_folder(name).iterdir()):
            os.chown(path, compose.USER, compose.USER)
    profiles = profiles_of(ROOT / "launch" / "robot.yaml", {"demo": "arc"}, "r1")
    file = tmp_path / "docker-compose.yml"
    file.write_text(compose.export(
        profiles, folder=tmp_path, made_by="a test", image=image, build=False, keys=store.name_folder("r1"),
    ))  # fmt: skip
    port = free_port()
    words = ("compose", "--project-name", f"robo_test_{port}", "--file", str(file))
    try:
        docker(*words, "up", "--wait", "--detach", ROBO_PORT=str(port))
        network = f"--network=container:robo_test_{port}-router-1"
        outside = ("run", "--rm", network, f"--volume={store.name_folder('ann')}:/run/ann:ro", image)
        listed = docker(*outside, "node", "list", "--connect", "tls/127.0.0.1:7447", "--security", "/run/ann")
        assert "/r1/safety_monitor" in listed
        plain = docker(*outside, "node", "list", "--connect", "tcp/127.0.0.1:7447", "--timeout", "3", check=False)
        assert "/r1" not in plain
        said = docker(*words, "exec", "-T", "safety_monitor", "robo", "topic", "echo", "r1/odom", "--once")
        assert "pose" in said
    finally:
        docker(*words, "down", "--timeout", "3", "--volumes", check=False)


def test_the_dashboard_is_a_profile(project: Project, published: None) -> None:
    del published
    project.profiles = "dashboard"
    project("up", "--wait", "--detach", "dashboard")
    place = f"http://127.0.0.1:{project.dashboard}/"
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(place, timeout=PATIENCE)
    token = project("exec", "-T", "dashboard", "sh", "-c", "cat /var/lib/robo/*.tokens").split()[0]
    assert token not in project("logs", "dashboard")
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with opener.open(f"{place}?token={token}", timeout=PATIENCE) as page:
        assert "<title>robo" in page.read().decode()


def test_the_log_of_a_real_robot_is_a_profile(
    project: Project, published: None, intel_log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del published
    monkeypatch.setenv("ROBO_LOG", str(intel_log.resolve()))
    project("--profile", "replay", "up", "--wait", "--detach")
    session = open_session(Network(mode="client", connect=(project.endpoint,)))
    position = Heard(session, "r1_replay/current_position")
    position.wait_for_count("r1_replay/current_position", 5, PATIENCE)
    close_session(session)


def test_a_shell_script_is_a_node_in_a_container(project: Project, tmp_path: Path) -> None:
    file = tmp_path / "docker-compose.yml"
    assert run_robo("export", "compose", "examples/other_languages.yaml", "-o", str(file)).returncode == 0
    project("--file", str(file), "up", "--wait", "--detach", "lamp")
    assert "lamp of r1 on, robot at tcp/router:7447" in project("--file", str(file), "logs", "lamp")


def test_a_package_of_ones_own_runs_in_the_image_that_the_docs_describe(
    project: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "batt"
    for name, text in PACKAGE.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(folder / "src"))
    monkeypatch.chdir(folder)
    recipe = run_robo("export", "dockerfile").stdout
    (folder / "Dockerfile").write_text(recipe.replace("FROM robo\n", "FROM robo:test\n"))
    assert run_robo("export", "compose", "mine.yaml", "-o", "docker-compose.yml").returncode == 0
    project.image = "robo-test-batt"
    at = ("--project-directory", str(folder), "--file", str(folder / "docker-compose.yml"))
    try:
        project(*at, "up", "--build", "--wait", "--detach")
        assert "ready with msgpack" in project(*at, "logs", "battery")
        assert "charge is here" in project(*at, "exec", "-T", "battery", "charge")
        shown = project(*at, "exec", "-T", "battery", "robo", "interface", "show", "batt/Charge")
        assert "level" in shown
    finally:
        project(*at, "down", "--timeout", "3", "--rmi", "local", check=False)
        docker("image", "rm", "--force", project.image, check=False)


PACKAGE = {
    "pyproject.toml": """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"
[project]
name = "batt"
version = "1.0"
dependencies = ["msgpack"]
[project.scripts]
charge = "batt.battery:charge"
[project.entry-points."robo.messages"]
batt = "batt.messages"
[tool.hatch.build.targets.wheel]
packages = ["src/batt"]
""",
    "src/batt/__init__.py": "",
    "src/batt/messages.py": """
from robo_messages import Message, message

@message("batt/Charge")
class Charge(Message):
    level: float = 0.0
""",
    "src/batt/battery.py": """
from robo import Node, Publisher
from batt.messages import Charge

class Battery(Node):
    charge = Publisher(Charge, "charge")

    def on_start(self) -> None:
        import msgpack
        self.logger.info("ready with %s", msgpack.__name__)

def charge() -> None:
    print("charge is here")
""",
    "mine.yaml": """
groups:
  battery: {namespace: "${robot_name}", nodes: {battery: {service: batt.battery}}}
""",
}
"""A package as a user's: sources in src/, a dependency, a command, message types."""


def test_a_package_that_robo_create_makes_is_healthy_in_a_container(
    project: Project, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    made = run_robo("create", "my_robot", cwd=str(tmp_path))
    assert made.returncode == 0, made.stderr
    folder = tmp_path / "my_robot"
    (folder / "wheels").mkdir()
    shutil.copy(shared_wheel(tmp_path_factory), folder / "wheels")
    at = ("--project-directory", str(folder), "--file", str(folder / "docker-compose.yml"))
    try:
        project(*at, "up", "--build", "--wait", "--detach")
        assert project.state("robot")["State"]["Health"]["Status"] == "healthy"
        heard = project(*at, "exec", "-T", "robot", "robo", "topic", "echo", "r1/chatter", "--once", "--duration", "30")
        assert "chatter" in heard
    finally:
        project(*at, "down", "--timeout", "3", "--rmi", "local", check=False)


@pytest.mark.parametrize("name", sorted(path.name for path in (ROOT / "launch").glob("*.yaml")))
def test_compose_accepts_what_is_exported(image: str, name: str, tmp_path: Path) -> None:
    del image  # where it was built there is Compose
    file = tmp_path / "docker-compose.yml"
    run_robo("export", "compose", f"launch/{name}", "-o", str(file))
    docker("compose", "--file", str(file), "--profile", "*", "config", "--quiet")
