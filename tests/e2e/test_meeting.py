"""Where a robot is met: a port that another program holds, and a site that is not there."""

import os
import pwd
import socket
import sys
from collections.abc import Iterator

import psutil
import pytest

from robo.wire.network import PORT, RENDEZVOUS, Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port
from tests.support import Desk, Running, eventually, lines_of_its_own, robo, run_robo

pytestmark = pytest.mark.timeout(120)

DEAF = " and no Zenoh answers there"


@pytest.fixture
def held() -> Iterator[str]:
    """A port that a program holds which is no Zenoh router."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp/127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize(
    "words",
    [
        ("up", "--robot-name", "r1"),
        ("up", "--robot-name", "r1", "-d", "--wait"),
        ("run", "robo_services.position_tracker"),
        ("router",),
    ],
)
def test_a_port_of_another_program_is_told_and_nothing_starts(words: tuple[str, ...], held: str) -> None:
    result = run_robo(*words, "--listen", held)
    said = result.stdout + result.stderr
    assert result.returncode == 1
    assert f"port {held.rpartition(':')[2]} on 127.0.0.1 is taken by process " in said
    assert "and no Zenoh answers there" in said
    assert "choose another port: --listen tcp/127.0.0.1:7448" in said
    assert "ready" not in said
    assert "Traceback" not in said


def test_the_doctor_names_the_program_that_holds_the_port(held: str) -> None:
    assert "is taken by process" in run_robo("doctor", "--connect", held).stdout


@pytest.fixture
def web(desk: Desk) -> Running:
    """A web server of the same user at a desk, at the port where others look at robots."""
    server = desk.start(f"exec {sys.executable} -u -m http.server {PORT} --bind 127.0.0.1")
    server.wait_for("Serving")
    return server


def in_the_way(web: Running) -> str:
    name = psutil.Process(web.process.pid).name()
    user = pwd.getpwuid(os.geteuid()).pw_name
    return f"port {PORT} on 127.0.0.1 is held by process {web.process.pid} ({name}) of user {user}" + DEAF


@pytest.mark.skipif(sys.platform != "linux", reason="who holds a port is read from Linux's table")
def test_a_program_of_ones_own_at_the_door_for_others_is_told_by_all_who_speak_of_it(desk: Desk, web: Running) -> None:
    told = f"{in_the_way(web)}: r1 does not dial it, and others cannot look at r1"
    up = desk.start("robo up --robot-name r1")
    ready = up.wait_for("r1 is ready")
    assert told in up.output
    assert "for your own tools" in ready
    assert RENDEZVOUS not in up.output
    of_all = f"{in_the_way(web)}: your robots do not dial it, and others do not see them there"
    code, said = desk.run("robo doctor")
    assert of_all in said, said
    assert f"and {RENDEZVOUS}" not in said, "the router answers at the socket alone"
    code, said = desk.run("robo net")
    assert (code, of_all in said) == (1, True), said
    assert desk.run("robo down")[0] == 0
    code, said = desk.run("robo up --robot-name r1 -d --wait")
    assert (code, told in said, "r1 is ready" in said) == (0, True, True), said


@pytest.mark.skipif(sys.platform != "linux", reason="who holds a port is read from Linux's table")
@pytest.mark.parametrize(
    ("words", "said", "told"),
    [
        ("router", "router for your own tools; Ctrl-C stops", "this router does not dial it"),
        ("run robo_services.position_tracker", ", for your own tools; Ctrl-C stops", "this node does not dial it"),
    ],
)
def test_so_it_is_by_a_router_and_a_node_alone(desk: Desk, web: Running, words: str, said: str, told: str) -> None:
    running = desk.start(f"robo {words}")
    eventually(lambda: said in running.output and told in running.output, "it has told both")
    assert in_the_way(web) in running.output
    assert RENDEZVOUS not in running.output


def test_a_router_waits_for_the_port_of_another(endpoint: str) -> None:
    with robo("router", "--listen", endpoint) as first:
        first.wait_for(f"router at {endpoint}")
        with robo("router", "--listen", endpoint, "--name", "second") as second:
            second.wait_for(f"{endpoint} is another router's just now; this router takes it over when it is free")
            assert len(lines_of_its_own(second.output)) == 1


def test_a_site_that_is_not_reached_is_told_and_so_is_its_coming_and_going(endpoint: str) -> None:
    site = f"tcp/127.0.0.1:{free_port()}"
    with robo("up", "--robot-name", "r1", "--listen", endpoint, "--connect", site) as up:
        up.wait_for(f"{site} is not reached: nobody listens there; the robot runs without it")
        up.wait_for("r1 is ready")
        lost = f"r1 does not reach {site}: nobody listens there"
        for words in ("why", "net", "doctor"):
            assert lost in run_robo(words, "--connect", endpoint).stdout, words
        router = open_session(Network(mode="router", listen=(site,)))
        up.wait_for(f"{site} is reached")
        for words in ("why", "net", "doctor"):
            assert "r1 does not reach" not in run_robo(words, "--connect", endpoint).stdout, words
        close_session(router)
        up.wait_for(f"{site} is lost: nobody listens there")
        eventually(lambda: lost in run_robo("why", "--connect", endpoint).stdout, "why knows")
        assert up.output.count("is not reached") == 1


def test_a_site_whose_name_is_not_known_is_told(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint, "--connect", "tcp/site.invalid:7447") as up:
        up.wait_for("tcp/site.invalid:7447 is not reached: ")
        up.wait_for("r1 is ready")
