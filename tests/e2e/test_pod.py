"""The pod that `robo export kubernetes` makes, on a Docker engine: what a kubelet would start."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import yaml

from robo.export.kubernetes import folder as kubernetes
from robo.export.kubernetes.folder import Wishes
from robo.export.profiles import profiles_of
from tests.conftest import free_port
from tests.docker_engine import built_image
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
