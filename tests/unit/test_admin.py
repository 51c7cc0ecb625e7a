"""What routers are asked of the ends of clients that are not robo's, and when."""

import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from robo.wire.admin import declared_by_others
from robo.wire.ids import is_robos, new_id

OWN, NODE, STRANGER = new_id(), new_id(), "c1a0"
ROUTER, SITE = new_id(), "51fe"


class Network:
    """Routers, each with the ids of those that are connected to it, and what they say is declared."""

    def __init__(self, connected: dict[str, dict[str, str]], declared: dict[str, list[str]]) -> None:
        self.connected = connected
        self.declared = declared
        self.asked: list[str] = []

    def zid(self) -> str:
        return OWN

    def get(self, key: str, timeout: float) -> Iterator[Any]:
        assert timeout == 0.5
        self.asked.append(key)
        if key == "@/*/router":
            for zid, there in self.connected.items():
                sessions = [{"peer": one, "whatami": kind, "links": []} for one, kind in there.items()]
                yield reply(f"@/{zid}/router", {"zid": zid, "sessions": sessions})
        for name, clients in self.declared.items():
            if name == key or (key.endswith("/**") and name.startswith(key[:-2])):
                yield reply(name, {"clients": clients})


def reply(key: str, content: object) -> Any:
    payload = SimpleNamespace(to_bytes=lambda: json.dumps(content).encode())
    return SimpleNamespace(ok=SimpleNamespace(key_expr=key, payload=payload))


def test_a_session_of_robos_is_known_by_its_id() -> None:
    assert is_robos(new_id())
    assert new_id() != new_id()
    assert len(new_id()) == 32
    assert not is_robos(STRANGER)


def test_a_router_whose_clients_are_all_robos_is_asked_nothing_that_may_stop_it() -> None:
    network: Any = Network({ROUTER: {OWN: "client", NODE: "peer", SITE: "router"}}, {})
    assert not list(declared_by_others(network, ["**"], 0.5))
    assert network.asked == ["@/*/router"]


def test_only_the_router_of_a_stranger_is_asked_and_only_of_the_keys_that_are_wanted() -> None:
    network: Any = Network(
        {ROUTER: {OWN: "client", NODE: "peer"}, SITE: {STRANGER: "client", NODE: "client"}},
        {f"@/{SITE}/router/publisher/q/x": [STRANGER, NODE], f"@/{SITE}/router/subscriber/q/y": [STRANGER]},
    )
    assert list(declared_by_others(network, ["q/x"], 0.5)) == [("pub", "q/x", STRANGER)]
    assert network.asked == ["@/*/router", f"@/{SITE}/router/publisher/q/x", f"@/{SITE}/router/subscriber/q/x"]
    assert list(declared_by_others(network, ["**"], 0.5)) == [("pub", "q/x", STRANGER), ("sub", "q/y", STRANGER)]


@pytest.mark.parametrize("key", ["*/x", "@robo/node/r1", ""])
def test_who_listens_to_a_pattern_makes_no_topic(key: str) -> None:
    network: Any = Network({SITE: {STRANGER: "peer"}}, {f"@/{SITE}/router/subscriber/{key}": [STRANGER]})
    assert not list(declared_by_others(network, ["**"], 0.5))


def test_of_no_key_nobody_is_asked() -> None:
    network: Any = Network({SITE: {STRANGER: "peer"}}, {})
    assert not list(declared_by_others(network, [], 0.5))
    assert not network.asked
