"""What a session is told: Zenoh's settings."""

import json
from pathlib import Path

import pytest

from robo.cli.network import router_network
from robo.cli.router import print_config
from robo.errors import NetworkError, UsageError
from robo.session import Network, settings_by_path, settings_of, zenoh_config

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


def test_the_printed_configuration_is_a_routers(capsys: pytest.CaptureFixture[str]) -> None:
    print_config(name="site", listen=["tcp/0.0.0.0:7447"], connect=[], config=None)
    printed = capsys.readouterr().out
    assert printed == (ROOT / "config" / "zenohd.json5").read_text(), "the file that is given is what is printed"
    tree = json.loads(printed)
    assert tree["mode"] == "router"
    assert tree["listen"]["endpoints"] == ["tcp/0.0.0.0:7447"]
    assert tree["metadata"] == {"name": "site"}
    assert tree["connect"]["retry"] == settings_of(Network())["connect/retry"]


def test_shared_memory_can_be_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "transport/shared_memory/enabled" not in settings_of(Network())
    monkeypatch.setenv("ROBO_SHM", "off")
    assert settings_of(Network())["transport/shared_memory/enabled"] is False
