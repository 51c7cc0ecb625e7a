"""What two nodes have to do with each other, from the ends that nodes have."""

from robo.tools.net import between, nearly
from robo.wire.keys import EndpointToken, parse_token


def ends(*said: str) -> dict[str, list[EndpointToken]]:
    """`controller pub cmd_vel_raw geometry/Twist`, and so on."""
    found: dict[str, list[EndpointToken]] = {}
    for one in said:
        node, kind, topic, type_name = one.split()
        token = parse_token(f"@robo/r1/{kind}/{node}/{type_name.replace('/', '%')}/1/r1%{topic}")
        assert isinstance(token, EndpointToken)
        found.setdefault(f"/r1/{node}", []).append(token)
    return found


CHAIN = ends(
    "controller pub raw geometry/Twist",
    "controller pub log system/Log",
    "monitor sub raw geometry/Twist",
    "monitor pub cmd_vel geometry/Twist",
    "base sub cmd_vel geometry/Twist",
    "base pub odom nav/Odometry",
    "logger sub log system/Log",
    "logger pub cmd_vel geometry/Twist",
)


def test_a_node_between_two_is_named_whichever_is_named_first() -> None:
    for pair in (("/r1/controller", "/r1/base"), ("/r1/base", "/r1/controller")):
        assert [(reason.fine, reason.text) for reason in between(*pair, CHAIN)] == [
            (True, "/r1/controller publishes r1/raw, /r1/monitor subscribes it and publishes r1/cmd_vel, "
                   "/r1/base subscribes that: /r1/monitor stands between them"),
        ]  # fmt: skip


def test_a_chain_of_nodes_that_pass_on_one_type_is_named() -> None:
    chain = ends(
        "controller pub nav geometry/Twist",
        "mux sub nav geometry/Twist",
        "mux pub muxed geometry/Twist",
        "smoother sub muxed geometry/Twist",
        "smoother pub raw geometry/Twist",
        "smoother pub muxed geometry/Twist",
        "monitor sub raw geometry/Twist",
        "monitor pub cmd_vel geometry/Twist",
        "base sub cmd_vel geometry/Twist",
        "base pub odom nav/Odometry",
        "tracker sub odom nav/Odometry",
        "tracker pub place geometry/Point",
    )
    for pair in (("/r1/controller", "/r1/base"), ("/r1/base", "/r1/controller")):
        (reason,) = between(*pair, chain)
        assert reason.text.startswith("/r1/controller publishes r1/nav, /r1/mux publishes r1/muxed, ")
        assert reason.text.endswith("/r1/base subscribes that: /r1/mux, /r1/smoother, /r1/monitor stand between them")
    assert between("/r1/controller", "/r1/tracker", chain) == []


def test_what_every_node_publishes_connects_nobody() -> None:
    without = {name: found for name, found in CHAIN.items() if name != "/r1/monitor"}
    assert between("/r1/controller", "/r1/base", without) == []


def test_topics_of_one_type_may_have_been_meant_to_be_one() -> None:
    reasons = nearly("/r1/controller", "/r1/base", CHAIN)
    assert [reason.fine for reason in reasons] == [False]
    assert "both geometry/Twist: remap one of them" in reasons[0].text
    (nothing,) = nearly("/r1/base", "/r1/idle", {**CHAIN, "/r1/idle": []})
    assert nothing.text.startswith("they have no topic and no service in common")
