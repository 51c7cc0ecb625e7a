"""Several hosts: network namespaces of one machine, linked by cables that can be cut."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.support import eventually, plain_environment

pytestmark = pytest.mark.timeout(180)

PREFIX = f"robo{os.getpid() % 10000}"


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, timeout=40)


class Host:
    """A network namespace."""

    def __init__(self, name: str, logs: Path) -> None:
        self.name = f"{PREFIX}{name}"
        # Each host has files of its own, and so a place of its own where robots meet; a socket's path has to be short.
        self._meeting = tempfile.TemporaryDirectory(prefix=f"{self.name}-")
        self._environment = plain_environment() | {
            "XDG_STATE_HOME": str(logs / name),
            "ROBO_MEETING": self._meeting.name,
        }
        ip("netns", "add", self.name)
        ip("netns", "exec", self.name, "ip", "link", "set", "lo", "up")

    def close(self) -> None:
        """Take it away."""
        subprocess.run(["ip", "netns", "delete", self.name], capture_output=True, timeout=40, check=False)
        self._meeting.cleanup()

    def robo(self, *words: str, timeout: float = 60.0) -> "subprocess.CompletedProcess[str]":
        """Run a command to its end."""
        return subprocess.run(self._command(words), capture_output=True, text=True, timeout=timeout, check=False,
                              env=self._environment)  # fmt: skip

    def start(self, stack: ExitStack, *words: str) -> "subprocess.Popen[bytes]":
        """Start a command that ends with the test."""
        process = subprocess.Popen(
            self._command(words), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=self._environment
        )

        def end() -> None:
            process.terminate()
            try:
                process.wait(40)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(40)

        stack.callback(end)
        return process

    def _command(self, words: tuple[str, ...]) -> list[str]:
        return ["ip", "netns", "exec", self.name, sys.executable, "-m", "robo", *words]


class Cable:
    """A link between two hosts; the first one has .1, the second one .2 of its network."""

    def __init__(self, number: int, one: Host, other: Host) -> None:
        self._ends = [(one, f"{PREFIX}a{number}"), (other, f"{PREFIX}b{number}")]
        ip("link", "add", self._ends[0][1], "type", "veth", "peer", "name", self._ends[1][1])
        for last, (host, end) in enumerate(self._ends, start=1):
            ip("link", "set", end, "netns", host.name)
            ip("netns", "exec", host.name, "ip", "addr", "add", f"10.99.{number}.{last}/24", "dev", end)
        self.mend()

    def cut(self) -> None:
        self._set("down")

    def mend(self) -> None:
        self._set("up")

    def _set(self, state: str) -> None:
        for host, end in self._ends:
            ip("netns", "exec", host.name, "ip", "link", "set", end, state)


@contextmanager
def hosts(tmp_path: Path, *names: str) -> Iterator[list[Host]]:
    if os.geteuid() != 0 or shutil.which("ip") is None:
        pytest.skip("network namespaces need root and iproute2")
    made: list[Host] = []
    try:
        for name in names:
            try:
                made.append(Host(name, tmp_path))
            except subprocess.CalledProcessError as error:
                pytest.skip(f"network namespaces cannot be made here: {error.stderr.decode().strip()}")
        yield made
    finally:
        for host in made:
            host.close()


def nodes_seen(host: Host, where: str) -> set[str]:
    found = host.robo("node", "list", "--json", "--connect", where)
    return {json.loads(line)["node"] for line in found.stdout.splitlines()}


def rate(host: Host, where: str, topic: str) -> float:
    """Messages a second that come here, as far as any come within a second."""
    found = host.robo("topic", "hz", topic, "--duration", "1", "--json", "--connect", where)
    lines = found.stdout.splitlines()
    return float(json.loads(lines[-1])["rate"]) if lines else 0.0


def test_a_robot_a_site_and_an_operator(tmp_path: Path) -> None:
    with hosts(tmp_path, "robot", "site", "operator") as (robot, site, operator), ExitStack() as stack:
        cable = Cable(1, robot, site)
        Cable(2, operator, site)
        from_robot, from_operator = "tcp/10.99.1.2:7447", "tcp/10.99.2.2:7447"
        site.start(stack, "router", "--name", "site", "--listen", "tcp/0.0.0.0:7447")
        up = robot.start(stack, "up", "demo:=arc", "--robot-name", "r1", "--connect", from_robot)
        eventually(lambda: len(nodes_seen(operator, from_operator)) == 6, "the operator sees the robot's nodes")

        eventually(lambda: 40 < rate(operator, from_operator, "r1/odom") < 60, "50 Hz of odometry")
        told = operator.robo(
            "param", "set", "velocity_controller", "linear_velocity", "0.3", "--connect", from_operator
        )
        assert told.returncode == 0, told.stderr
        listed = operator.robo("ps", "--json", "--connect", from_operator)
        before = {json.loads(line)["node"]: json.loads(line)["pid"] for line in listed.stdout.splitlines()}
        assert len(before) == 6
        logs = operator.robo("logs", "position_tracker", "-n", "3", "--json", "--connect", from_operator)
        assert {json.loads(line)["node"] for line in logs.stdout.splitlines()} == {"position_tracker"}

        cable.cut()
        eventually(lambda: nodes_seen(operator, from_operator) == set(), "the robot is gone from the site")
        time.sleep(7)  # with what went before, longer than ten seconds
        assert up.poll() is None
        cable.mend()
        eventually(lambda: rate(operator, from_operator, "r1/odom") > 40, "the link heals")
        listed = operator.robo("ps", "--json", "--connect", from_operator)
        after = {json.loads(line)["node"]: json.loads(line)["pid"] for line in listed.stdout.splitlines()}
        assert after == before, "nothing was started again"
        value = operator.robo("param", "get", "velocity_controller", "linear_velocity", "--connect", from_operator)
        assert value.stdout.strip() == "0.3"

        robot.start(stack, "up", "--robot-name", "r2", "--connect", from_robot)
        eventually(lambda: len(nodes_seen(operator, from_operator)) == 12, "the one that joins late is seen")


def test_an_uplink_is_sampled_down(tmp_path: Path) -> None:
    with hosts(tmp_path, "robot", "site") as (robot, site), ExitStack() as stack:
        Cable(1, robot, site)
        here, there = "tcp/127.0.0.1:7447", "tcp/10.99.1.2:7447"
        site.start(stack, "router", "--listen", "tcp/0.0.0.0:7447")
        config = Path(__file__).parents[2] / "config" / "uplink.yaml"
        robot.start(stack, "up", "--robot-name", "r1", "--connect", there, "--network-config", str(config))
        eventually(lambda: len(nodes_seen(site, here)) == 6, "the site sees the robot")
        came = site.robo("topic", "bw", "r1/odom", "--duration", "3", "--json", "--connect", here).stdout.splitlines()
        assert 2 < json.loads(came[-1])["rate"] < 8, "five a second"
        moves = site.robo("topic", "hz", "r1/current_position", "--duration", "1", "--json", "--connect", here)
        assert json.loads(moves.stdout.splitlines()[-1])["rate"] > 40


def test_one_robot_on_two_hosts(tmp_path: Path) -> None:
    manifest = tmp_path / "two.yaml"
    manifest.write_text(
        """
groups:
  base: {hosts: base, include: robot.yaml}
  arm:
    hosts: [arm]
    namespace: ${robot_name}
    nodes:
      far_tracker:
        service: robo_services.position_tracker
        needs: {diff_drive_sim: ready}
        remap: {current_position: far_position, reset_distance: reset_far}
"""
    )
    with hosts(tmp_path, "base", "arm") as (base, arm), ExitStack() as stack:
        Cable(1, base, arm)
        here = "tcp/127.0.0.1:7447"
        words = ("up", str(manifest), "--robot-name", "r1")
        arm.start(stack, *words, "--host", "arm", "--connect", "tcp/10.99.1.1:7447")

        def states(host: Host) -> dict[str, tuple[str, str]]:
            found = [json.loads(line) for line in host.robo("ps", "--json").stdout.splitlines()]
            return {one["node"]: (one["state"], one["host"]) for one in found}

        eventually(lambda: states(arm) == {"/r1/far_tracker": ("starting", "arm")}, "it waits for the other host")
        base.start(stack, *words, "--host", "base", "--listen", "tcp/0.0.0.0:7447")
        eventually(lambda: states(arm).get("/r1/far_tracker") == ("ready", "arm"), "what it needs is there")
        assert states(base) == states(arm)
        assert len(states(base)) == 7
        assert rate(base, here, "r1/far_position") > 10
        stopped = base.robo("stop", "far_tracker", "position_tracker")
        assert set(stopped.stdout.split()) - {"stopped"} == {"/r1/far_tracker", "/r1/position_tracker"}
        assert states(arm)["/r1/far_tracker"][0] == "stopped"
        unknown = base.robo("stop", "for_tracker")
        assert "no node or group for_tracker; did you mean /r1/far_tracker?" in unknown.stderr
        logs = base.robo("logs", "far_tracker", "--json", "--connect", here).stdout
        assert {json.loads(line)["node"] for line in logs.splitlines()} == {"far_tracker"}
        again = base.robo(*words, "--host", "arm", "--connect", here)
        assert again.returncode == 1
        assert "r1 runs already" in again.stdout + again.stderr
        down = base.robo("down")
        assert down.stdout.strip() == "r1 is down"
