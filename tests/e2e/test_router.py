"""A router beside clients that take nothing any more: the others do not notice."""

import json
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import pytest
import zenoh

from tests.conftest import free_port
from tests.support import eventually, robo

STOPPED = 5
WATCHED = 4.0
"""s. Without what is tested here all stands still for 5 s and more, soon after the clients have stopped."""
LONGEST = 2.0
"""How long an answer may take on a machine under load, s."""

_SUBSCRIBERS = """
import json, sys, threading, zenoh
sessions = []
for _ in range(int(sys.argv[2])):
    config = zenoh.Config()
    for key, value in json.loads(sys.argv[1]).items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    sessions.append((session, session.declare_subscriber("**", zenoh.handlers.RingChannel(1))))
print("ready", flush=True)
threading.Event().wait()
"""


def settings(endpoint: str, lease: int = 10_000) -> dict[str, object]:
    """A plain client without shared memory: all that it gets goes through its socket.

    Args:
        endpoint: of the router.
        lease: after how long the router gives it up where it is silent, ms.
    """
    return {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 15_000,  # a router says that it runs before it listens
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": lease,
    }


def client(stack: ExitStack, endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in settings(endpoint).items():
        config.insert_json5(key, json.dumps(value))
    return stack.enter_context(zenoh.open(config))


@pytest.mark.parametrize("control", [zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK])
def test_stopped_clients_hold_up_nobody_else(control: zenoh.CongestionControl) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        stack.enter_context(robo("router", "--listen", endpoint)).wait_for("Ctrl-C stops")
        service, caller, source = (client(stack, endpoint) for _ in range(3))
        service.declare_queryable("service", lambda query: query.reply("service", b"done"))
        eventually(lambda: answered(caller), "the service is known")

        subscribers = subprocess.Popen(
            [
                sys.executable,
                "-c",
                _SUBSCRIBERS,
                json.dumps(settings(f"{endpoint}#so_rcvbuf=65536", lease=1000)),
                str(STOPPED),
            ],
            stdout=subprocess.PIPE,
        )
        stack.callback(subscribers.communicate)
        stack.callback(subscribers.kill)
        assert subscribers.stdout is not None
        assert subscribers.stdout.readline() == b"ready\n"

        over = threading.Event()

        def publish() -> None:
            publisher = source.declare_publisher("camera", congestion_control=control)
            while not over.wait(0.02):
                publisher.put(bytes(200_000))

        publishing = threading.Thread(target=publish)
        publishing.start()
        stack.callback(publishing.join)
        stack.callback(over.set)

        subscribers.send_signal(signal.SIGSTOP)
        end = time.monotonic() + WATCHED
        longest = 0.0
        while (asked := time.monotonic()) < end:
            assert answered(caller), f"no answer after {time.monotonic() - asked:.1f} s"
            longest = max(longest, time.monotonic() - asked)
            time.sleep(0.02)
        assert longest < LONGEST


def test_tools_tell_that_the_connection_is_lost_and_back() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        up = stack.enter_context(robo("up", "robot.yaml", "--robot-name", "r1", "--listen", endpoint))
        up.wait_for("r1 is ready")
        echo = stack.enter_context(robo("topic", "echo", "r1/safety_state", "--connect", endpoint))
        echo.wait_for("# r1/safety_state")
        ps = stack.enter_context(robo("ps", "--watch", "--interval", "0.2", "--connect", endpoint))
        ps.wait_for("safety_monitor")

        router = up.child("robo.process.router")
        router.suspend()
        for tool in (echo, ps):
            tool.wait_for(f"the link to {endpoint} is lost")
        router.resume()
        for tool in (echo, ps):
            tool.wait_for(f"the link to {endpoint} is back")
        before = ps.output.count("safety_monitor")
        eventually(lambda: ps.output.count("safety_monitor") > before, "the table is printed again")
        for tool in (echo, ps):
            tool.interrupt()
            tool.wait()
        tables = ps.output.split("ROBOT ")
        assert all("safety_monitor" in table for table in tables[1:-1]), f"an empty one in:\n{ps.output}"


def test_a_router_that_hangs_is_started_again() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        up = stack.enter_context(robo("up", "robot.yaml", "--robot-name", "r1", "--listen", endpoint))
        up.wait_for("r1 is ready")
        echo = stack.enter_context(robo("topic", "echo", "r1/odom", "--connect", endpoint))
        echo.wait_for("# r1/odom")
        up.child("robo.process.router").suspend()
        up.wait_for("the router runs, but answers nobody; starting it again")
        echo.wait_for(f"the link to {endpoint} is back")
        before = echo.output.count("# r1/odom")
        eventually(lambda: echo.output.count("# r1/odom") > before, "messages come again")


def test_a_router_that_hangs_as_it_starts_keeps_no_robot_from_starting() -> None:
    with ExitStack() as stack:
        place = f"tcp/127.0.0.1:{free_port()}"
        up = stack.enter_context(robo("up", "robot.yaml", "--robot-name", "r1", "--listen", place))
        up.child("robo.process.router").suspend()
        up.wait_for("the router runs, but answers nobody; starting it again")
        up.wait_for("r1 is ready")
        assert "ERROR" not in up.output


def answered(session: zenoh.Session) -> bool:
    return any(reply.ok is not None for reply in session.get("service", timeout=WATCHED))
