"""The pod that `robo export kubernetes` makes, on a Docker engine: what a kubelet would start."""

import os
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import yaml

from robo.export.kubernetes import folder as kubernetes
from robo.export.kubernetes.folder import Wishes
from robo.export.profiles import profiles_of
from robo.security.keystore import Keystore
from tests.conftest import free_port
from tests.docker_engine import built_image, docker
from tests.extras import needs_cryptography
from tests.played_pod import PlayedPod
from tests.support import eventually

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.timeout(420)


@pytest.fixture
def pod(tmp_path: Path) -> Iterator[PlayedPod]:
    image = built_image()
    profiles = profiles_of(ROOT / "launch" / "robot.yaml", {"demo": "arc"}, None)
    found = kubernetes.export(profiles, Wishes("robo:latest"), folder=ROOT, made_by="a test")
    objects = [one for text in found.objects for one in yaml.safe_load_all(text)]
    made = PlayedPod(f"robo-test-pod-{free_port()}", image, objects, {"ROBOT_NAME": "r1"}, tmp_path)
    try:
        made.start()
        yield made
    finally:
        made.remove()


@pytest.fixture
def secured(tmp_path: Path) -> Iterator[tuple[PlayedPod, Keystore]]:
    """A pod that is r1 on a secured network, and its keystore."""
    image = built_image()
    store = Keystore(tmp_path / "security")
    store.init("site")
    store.add("r1", "robot", (), 30)
    store.add("ann", "operator", (), 30)
    secret = tmp_path / "secret"  # as a kubelet has it: root's, and a pod's group may read it
    secret.mkdir()
    for file in store.name_folder("r1").iterdir():
        shutil.copy(file, secret)
        os.chown(secret / file.name, 0, 1000)
        (secret / file.name).chmod(0o440)
    profiles = profiles_of(ROOT / "launch" / "robot.yaml", {"demo": "arc"}, "r1")
    found = kubernetes.export(profiles, Wishes("robo:latest", security="r1-keys"), folder=ROOT, made_by="a test")
    objects = [one for text in found.objects for one in yaml.safe_load_all(text)]
    made = PlayedPod(f"robo-test-pod-{free_port()}", image, objects, {}, tmp_path)
    try:
        made.start()
        yield made, store
    finally:
        made.remove()


def speed(pod: PlayedPod) -> float:
    words = ("topic", "echo", "r1/odom", "--once", "--field", "twist.twist.linear.x")
    said = pod.run("router", "robo", *words, check=False)
    return float(said.split()[-1]) if said.strip() else 0.0


def restarted(pod: PlayedPod, name: str) -> bool:
    state, count = pod.state(name).split()
    return state == "running" and int(count) >= 1


def test_a_robot_drives_in_its_pod_and_survives_what_dies(pod: PlayedPod) -> None:
    eventually(lambda: speed(pod) > 0.05, "it drives")
    sockets = pod.run("router", "ls", "/run/robo").split()
    assert set(sockets) >= {"router.sock", "diff-drive-sim.sock", "safety-monitor.sock"}, "nodes link directly"
    assert "/r1/safety_monitor" in pod.run("router", "robo", "node", "list")
    for name in ("router", "diff-drive-sim"):
        pod.run(name, "python", "-c", "import os, signal; os.kill(-1, signal.SIGKILL)", check=False)
        eventually(partial(restarted, pod, name), f"{name} is started again")
        eventually(lambda: speed(pod) > 0.05, "it drives again")
    codes = pod.stop()
    assert set(codes.values()) == {0}, codes


@needs_cryptography
@pytest.mark.skipif(os.geteuid() != 0, reason="a Secret's files are root's")
def test_a_secured_pod_drives_and_lets_in_who_has_a_name(secured: tuple[PlayedPod, Keystore], tmp_path: Path) -> None:
    pod, store = secured
    words = ("robo", "topic", "echo", "r1/odom", "--once", "--field", "twist.twist.linear.x")
    eventually(lambda: bool(pod.run("safety-monitor", *words, check=False).strip()), "its nodes meet by their socket")
    modes = pod.run("router", "stat", "-c", "%a %u", "/run/keys/name", "/run/keys/name/key.pem").split()
    assert modes[1] == modes[3] == "1000"
    assert int(modes[0], 8) & 0o077 == int(modes[2], 8) & 0o077 == 0
    ann = tmp_path / "ann"
    shutil.copytree(store.name_folder("ann"), ann)
    for file in (ann, *ann.iterdir()):
        os.chown(file, 1000, 1000)
    outside = ("run", "--rm", f"--network=container:{pod.name}-pause", f"--volume={ann}:/run/ann:ro", "robo:test")
    listed = docker(*outside, "node", "list", "--connect", "tls/127.0.0.1:7447", "--security", "/run/ann")
    assert "/r1/safety_monitor" in listed
    plain = docker(*outside, "node", "list", "--connect", "tcp/127.0.0.1:7447", "--timeout", "3", check=False)
    assert "/r1" not in plain
    assert "PRIVATE KEY" not in docker("inspect", *(f"{pod.name}-{name}" for name in pod.containers))
