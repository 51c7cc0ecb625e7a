"""What others may do at a robot's router: the rules, judged as Zenoh judges them."""

from collections.abc import Sequence
from typing import Any, cast

import pytest
import zenoh

from robo.errors import ReadOnly
from robo.node import services
from robo.wire import access, codec, doors, keys
from robo.wire.access import refusal, settings
from robo.wire.network import Network, settings_of
from robo.wire.session import close_session, open_session

LOOKS: list[tuple[str, str, str]] = [
    ("ingress", "declare_subscriber", "r1/odom"),
    ("ingress", "declare_subscriber", "**"),
    ("ingress", "declare_subscriber", keys.log_key("r1")),
    ("egress", "put", "r1/odom"),
    ("egress", "put", keys.event_key("r1")),
    ("ingress", "liveliness_query", keys.ALL_TOKENS),
    ("ingress", "declare_liveliness_subscriber", keys.ALL_TOKENS),
    ("egress", "liveliness_token", "@robo/r1/node/base/a:B/1/host"),
    *(("ingress", "query", keys.control_key(robot, verb)) for robot in ("r1", "**") for verb in keys.TELLS),
    *(("ingress", "query", keys.status_key("r1", node)) for node in ("base", "*")),
    ("ingress", "query", keys.status_key("**", "*")),
    ("ingress", "query", keys.lines_key("r1", "base")),
    *(("ingress", "query", keys.parameters_key("r1", "base", verb)) for verb in ("list", "get", "describe", "explain")),
    ("ingress", "query", keys.parameters_key("", "**", "get")),
    ("ingress", "query", "r1/gripper/get_state"),
    ("ingress", "query", keys.latched_key("r1/map", 0)),
    ("ingress", "query", "@/*/router"),
    ("egress", "reply", "r1/base/parameters/get"),
]
ACTS: list[tuple[str, str, str]] = [
    *(("ingress", "put", key) for key in ("r1/cmd_vel", "*/cmd_vel", "**", "@robo/r1/events", "@/1/router/config/a")),
    ("ingress", "delete", "r1/map"),
    *(("ingress", "query", keys.control_key("r1", verb)) for verb in (*keys.ACTS, "*")),
    ("ingress", "query", "@robo/**"),
    *(("ingress", "query", keys.parameters_key("r1", "base", verb)) for verb in ("set", "*", "**")),
    *(("ingress", "query", key) for key in ("r1/reset", "r1/*", "**", "*/**", "r1/gripper/change_state")),
    ("ingress", "query", keys.action_key("r1/go", "send_goal")),
    ("ingress", "query", keys.action_key("r1/go", "cancel_goal")),
    *(("ingress", "query", key) for key in ("@/**", "@/*/router/config/**", "@/*/router/publisher/**")),
    *(("ingress", "declare_queryable", key) for key in ("r1/reset", "@robo/r1/supervisor/*", "**")),
    ("ingress", "reply", "r1/reset"),
    ("ingress", "liveliness_token", "@robo/r1/node/evil/a:B/1/host"),
    ("egress", "query", "r1/reset"),
    ("egress", "declare_subscriber", "r1/cmd_vel"),
]


def allows(made: dict[str, Any], who: str, flow: str, message: str, key: str) -> bool:
    """Zenoh's verdict: somebody may do what one of his rules includes; by default nothing."""
    rules = made["access_control"]
    assert (rules["enabled"], rules["default_permission"]) == (True, "deny")
    his = next(one["rules"] for one in rules["policies"] if one["subjects"] == [who])
    return any(
        rule["id"] in his
        and rule["permission"] == "allow"
        and flow in rule["flows"]
        and message in rule["messages"]
        and any(
            zenoh.KeyExpr(one).includes(zenoh.KeyExpr.autocanonize(key.partition("?")[0])) for one in rule["key_exprs"]
        )
        for rule in rules["rules"]
    )


@pytest.mark.parametrize(("flow", "message", "key"), LOOKS)
def test_others_may_look(flow: str, message: str, key: str) -> None:
    assert allows(settings(), "others", flow, message, key)


@pytest.mark.parametrize(("flow", "message", "key"), ACTS)
def test_others_may_do_nothing(flow: str, message: str, key: str) -> None:
    assert not allows(settings(), "others", flow, message, key)


@pytest.mark.parametrize(("flow", "message", "key"), [*LOOKS, *ACTS])
def test_the_owner_may_do_all(flow: str, message: str, key: str) -> None:
    assert allows(settings(), "owner", flow, message, key)


def test_who_shares_a_robot_shares_that_one_alone() -> None:
    made = settings(["r1"])
    for flow, message, key in ACTS:
        if key.startswith(("r1/", "@robo/r1/")):
            assert allows(made, "others", flow, message, key), (flow, message, key)
            other = key.replace("r1/", "r2/")
            assert not allows(made, "others", flow, message, other), (flow, message, other)
        else:
            assert not allows(made, "others", flow, message, key), (flow, message, key)


def test_whoever_comes_by_a_network_link_is_one_of_the_others() -> None:
    subjects = {one["id"]: one["link_protocols"] for one in cast(Any, settings())["access_control"]["subjects"]}
    assert subjects["owner"] == ["unixsock-stream"]
    assert {"tcp", "tls", "quic", "udp", "ws"} <= set(subjects["others"])


def test_a_router_with_these_rules_starts(endpoint: str) -> None:
    session = open_session(Network(mode="router", listen=(endpoint,), guarded=True, shared=("r1", "r2")))
    close_session(session)


def test_who_comes_by_the_door_is_told_before_and_after(endpoint: str) -> None:
    router = open_session(Network(mode="router", name="r1", listen=(endpoint,), guarded=True, shared=("r2",)))
    tool = open_session(Network(mode="client", connect=(endpoint,)))
    refused = "the robot r1 belongs to you, and by this way it is read-only"
    with pytest.raises(ReadOnly, match=refused):
        doors.check(tool, "r1", 10.0)
    doors.check(tool, "r2", 10.0)
    doors.check(router, "r1", 10.0)
    with pytest.raises(ReadOnly, match=refused):
        services.ask(tool, "r1/reset", (b"\x80", b""), codec.MSGPACK, 10.0, 10.0)
    close_session(tool)
    close_session(router)


def test_the_owners_own_rules_stand_alone() -> None:
    theirs = {"access_control": {"enabled": False}}
    made = settings_of(Network(guarded=True, more=dict(theirs)))
    assert "access_control" not in made
    assert made["access_control/enabled"] is False
    assert "gateway" in made
    assert not {"access_control", "gateway"} & settings_of(Network(listen=("tcp/0.0.0.0:7447",))).keys()


@pytest.mark.parametrize(
    ("shared", "robot", "mine", "joins", "said"),
    [
        (
            [],
            "r1",
            False,
            False,
            "the robot r1 belongs to user alice; it is read-only for others until alice starts it",
        ),
        ([], "", False, False, "what runs there belongs to user alice; it is read-only for others until alice starts"),
        ([], "r9", False, True, "what runs there belongs to user alice; it is read-only for others until alice starts"),
        (
            [],
            "r1",
            True,
            False,
            "the robot r1 belongs to you, and by this way it is read-only, as for others: leave out",
        ),
        (["r2"], "r1", False, False, "the robot r1 belongs to user alice"),
        (["r1"], "r1", False, False, None),
        (["fleet"], "fleet/r1", False, False, None),
        (["r1"], "", False, False, None),
    ],
)
def test_a_refusal_says_whose_it_is(
    shared: Sequence[str], robot: str, mine: bool, joins: bool, said: str | None
) -> None:
    found = refusal("alice", shared, robot, mine=mine, joins=joins)
    assert (found is None) == (said is None)
    assert (found or "").startswith(said or "")


def test_others_are_told_apart_where_one_asks_who_is_there() -> None:
    told = settings_of(Network(name="r1", guarded=True, shared=("r1",)))["metadata"]
    assert isinstance(told, dict)
    assert (told["name"], told["others"], told["shared"]) == ("r1", access.LOOKS, ["r1"])
    assert settings_of(Network(name="r1"))["metadata"] == {"name": "r1"}
