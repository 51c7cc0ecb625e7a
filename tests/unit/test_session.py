"""What a session is told: Zenoh's settings."""

import json
import os
import socket
import threading
from pathlib import Path
from typing import cast

import pytest

from robo.cli.launch.network import router_network
from robo.cli.launch.router import print_config
from robo.errors import NetworkError, UsageError
from robo.wire import meeting, zenoh_threads
from robo.wire.network import Mode, Network, settings_by_path, settings_of, zenoh_config
from robo.wire.session import close_session, open_session
from tests.conftest import wait_until_listened_at

ROOT = Path(__file__).parents[2]


def test_maps_within_maps_are_settings_by_their_paths() -> None:
    tree = {"transport": {"link": {"tx": {"lease": 1}}}, "a": [{"b": 1}], "listen": {"endpoints": {"router": []}}}
    assert settings_by_path(tree) == {"transport/link/tx/lease": 1, "a": [{"b": 1}], "listen/endpoints": {"router": []}}


def test_the_uplink_that_ships_is_accepted() -> None:
    network = router_network([], ["tcp/127.0.0.1:1"], ROOT / "config" / "uplink.yaml")
    config = zenoh_config(network)
    assert json.loads(config.get_json("downsampling"))[0]["rules"][1] == {"key_expr": "*/scan", "freq": 1.0}


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("nonsense: 1", NetworkError, "nonsense: 1 is not accepted"),
        ("downsampling: [{flows: [sideways]}]", NetworkError, "downsampling: "),
        ("[1]", UsageError, "expected a map"),
        ("{", UsageError, "not valid YAML"),
    ],
)
def test_settings_that_zenoh_does_not_know_are_told(
    tmp_path: Path, text: str, error: type[Exception], message: str
) -> None:
    file = tmp_path / "network.yaml"
    file.write_text(text)
    with pytest.raises(error, match=message):
        router_network([], [], file)


def test_rules_of_a_users_come_after_those_that_keep_a_router_from_waiting(tmp_path: Path) -> None:
    rule = {"messages": ["put"], "key_exprs": ["r1/map"], "overwrite": {"congestion_control": "block"}}
    file = tmp_path / "network.yaml"
    file.write_text(json.dumps({"qos": {"network": [rule]}}))
    network = router_network([], [], file)
    zenoh_config(network)  # Zenoh accepts them
    rules = cast("list[dict[str, object]]", settings_of(network)["qos/network"])
    assert rules[-1] == rule
    dropping = next(rule for rule in rules if rule["overwrite"] == {"congestion_control": "drop"})
    assert dropping["flows"] == ["egress"]
    assert "unixsock-stream" not in cast("list[str]", dropping["link_protocols"]), "a robot's own nodes may wait"
    assert "qos/network" not in settings_of(Network(mode="client"))


def test_a_router_has_more_threads_than_a_node(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(zenoh_threads.VARIABLE, zenoh_threads.OF_A_NODE)
    zenoh_threads.use_those_of_a_router()
    assert os.environ[zenoh_threads.VARIABLE] == zenoh_threads.OF_A_ROUTER
    monkeypatch.setenv(zenoh_threads.VARIABLE, "(rx:(worker_threads:7))")
    zenoh_threads.use_those_of_a_router()
    assert os.environ[zenoh_threads.VARIABLE] == "(rx:(worker_threads:7))", "what a user has set"


def test_the_printed_configuration_is_a_routers(capsys: pytest.CaptureFixture[str]) -> None:
    print_config(name="site", listen=["tcp/0.0.0.0:7447"], connect=[], config=None)
    printed = capsys.readouterr().out
    assert printed == (ROOT / "config" / "zenohd.json5").read_text(), "the file that is given is what is printed"
    tree = json.loads(printed)
    assert tree["mode"] == "router"
    assert tree["listen"]["endpoints"] == ["tcp/0.0.0.0:7447"]
    assert tree["metadata"] == {"name": "site"}
    assert tree["connect"]["retry"] == settings_of(Network())["connect/retry"]


def test_a_router_has_limits_and_a_file_may_say_others(tmp_path: Path) -> None:
    largest = "transport/link/rx/max_message_size"
    assert settings_of(Network())[largest] == 128 << 20
    assert largest not in settings_of(Network(mode="peer")), "nodes of one robot are no strangers"
    zenoh_config(Network())  # Zenoh accepts them
    (tmp_path / "network.yaml").write_text(json.dumps({"transport": {"link": {"rx": {"max_message_size": 1_000_000}}}}))
    assert settings_of(router_network([], [], tmp_path / "network.yaml"))[largest] == 1_000_000


def test_connections_that_say_nothing_keep_nobody_out(endpoint: str) -> None:
    router = open_session(Network(listen=(endpoint,)))
    wait_until_listened_at(endpoint)
    address = ("127.0.0.1", int(endpoint.rpartition(":")[2]))
    idle = [socket.create_connection(address) for _ in range(150)]
    try:
        close_session(open_session(Network(mode="client", connect=(endpoint,), timeout=8.0)))
    finally:
        for one in idle:
            one.close()
        close_session(router)


def test_shared_memory_can_be_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "transport/shared_memory/enabled" not in settings_of(Network())
    monkeypatch.setenv("ROBO_SHM", "off")
    assert settings_of(Network())["transport/shared_memory/enabled"] is False


def test_a_session_is_closed_where_no_thread_can_be_begun_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    session = open_session(Network(mode="peer"))

    def start(_: threading.Thread) -> None:
        raise RuntimeError("can't create new thread at interpreter shutdown")

    monkeypatch.setattr(threading.Thread, "start", start)
    assert close_session(session)
    assert session.is_closed()


def test_a_node_that_is_told_where_to_dial_joins_that_network_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBO_CONNECT", raising=False)
    monkeypatch.delenv("ROBO_LISTEN", raising=False)
    elsewhere, here, door = "tcp/192.0.2.1:7447", meeting.endpoint(), "tcp/127.0.0.1:7447"

    def network(mode: Mode, connect: tuple[str, ...] = (), *, meeting_point: bool = False) -> tuple[object, object]:
        found = Network.from_environment(mode, connect, meeting_point=meeting_point)
        return found.connect, found.listen

    assert network("router") == ((here,), (here, door)), "the door is not dialled: anybody may have it"
    assert network("router", (elsewhere,)) == ((elsewhere,), ())
    assert network("router", (elsewhere,), meeting_point=True) == ((elsewhere, here), (here,)), "a robot is found here"
    assert network("client") == ((here,), ())
    monkeypatch.setenv("ROBO_CONNECT", elsewhere)
    assert network("router") == ((elsewhere,), ())
    monkeypatch.setenv("ROBO_LISTEN", "tcp/127.0.0.1:7777")
    assert network("router") == ((elsewhere, "tcp/127.0.0.1:7777"), ("tcp/127.0.0.1:7777",))
    assert network("client") == ((elsewhere,), ()), "tools listen nowhere"
