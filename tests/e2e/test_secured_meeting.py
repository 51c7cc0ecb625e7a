"""A secured robot on its user's machine: own tools come by the socket, everybody else by the door of TLS."""

from pathlib import Path

import pytest

from robo.security.keystore import Keystore
from robo.wire.network import SECURED_RENDEZVOUS
from tests.extras import needs_cryptography
from tests.support import Desk, eventually

pytestmark = [needs_cryptography, pytest.mark.timeout(300)]


def test_own_tools_come_by_the_socket_and_others_by_the_door(desk: Desk, tmp_path: Path) -> None:
    store = Keystore(tmp_path / "security")
    store.init("test")
    for name, role in {"r1": "robot", "r2": "robot", "ann": "operator", "eve": "viewer"}.items():
        store.add(name, role, (), 30)  # type: ignore[arg-type]
    ann, eve = (f"--security {store.name_folder(name)}" for name in ("ann", "eve"))
    door = f"--connect {SECURED_RENDEZVOUS}"
    first = desk.start(f"robo up simulation.yaml --robot-name r1 --security {store.folder}")
    first.wait_for("r1 is ready")
    assert f"for your own tools, and for whom the policy names at {SECURED_RENDEZVOUS}" in first.output
    for who in ("", ann, eve):  # whatever name he takes, by the socket he is the owner
        code, said = desk.run(f"robo param set /r1/waypoint_follower speed 0.4 {who}")
        assert code == 0, said
    code, said = desk.run(f"robo param get /r1/waypoint_follower speed {ann} {door}")
    assert (code, said.strip()) == (0, "0.4")
    code, said = desk.run(f"robo stop safety_monitor --robot-name r1 {eve} {door}")
    assert (code, said.strip()) == (1, "error: refused: eve may not stop what runs of r1 (says router r1)")
    for endpoint in ("tcp/127.0.0.1:7447", SECURED_RENDEZVOUS):  # without a certificate
        code, said = desk.run(f"robo ps --connect {endpoint}")
        assert code == 1, said
        assert "/r1/" not in said

    second = desk.start(f"robo up simulation.yaml --robot-name r2 --security {store.folder}")
    second.wait_for("r2 is ready")
    assert "/r2/twist_mux" in desk.run("robo node list")[1], "they meet at the socket"
    eventually(lambda: "/r2/twist_mux" in desk.run(f"robo node list {ann} {door}")[1], "the first door leads to both")
    first.interrupt()
    first.wait(60.0)
    eventually(lambda: "/r2/twist_mux" in desk.run(f"robo node list {ann} {door}")[1], "the second takes the door over")
    assert "/r2/twist_mux" in desk.run("robo node list")[1]
