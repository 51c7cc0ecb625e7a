"""Where a robot is met: a port that another program holds, and a site that is not there."""

import socket
from collections.abc import Iterator

import pytest

from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port
from tests.support import eventually, lines_of_its_own, robo, run_robo

pytestmark = pytest.mark.timeout(120)


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
