from robo.tools.strangers import lasting_surplus, refused, surplus
from robo.wire.keys import EndpointToken
from robo.wire.qos import QoS
from robo.wire.reports import NodeStatus, Refused


def status(node: str, uptime: float, published: int = 0, received: int = 0, refused: int = 0) -> NodeStatus:
    left_out = {"r1/cmd": [Refused("a plain Zenoh client", refused, 0.1)]} if refused else {}
    return NodeStatus(node, {"r1/cmd": published}, {"r1/cmd": received}, {}, {}, 0, refused=left_out, uptime=uptime)


PUBLISHER = EndpointToken("r1", "monitor", "pub", "geometry/Twist", QoS.DEFAULT, "r1/cmd")


def found(published: int, received: int, publishers: list[EndpointToken]) -> list[str]:
    before = {"/r1/monitor": status("/r1/monitor", 5.0), "/r1/base": status("/r1/base", 5.0)}
    after = {
        "/r1/monitor": status("/r1/monitor", 5.52, published=published),
        "/r1/base": status("/r1/base", 5.5, received=received),
    }
    return [str(one) for one in surplus(before, after, publishers)]


def test_counts_that_add_up_say_nothing() -> None:
    assert found(26, 25, [PUBLISHER]) == []
    assert found(26, 28, [PUBLISHER]) == []
    assert found(26, 3, [PUBLISHER]) == []


def test_who_has_not_said_that_he_publishes_shows_in_the_counts() -> None:
    for rate in (10, 50, 1000):
        assert len(found(26, 25 + rate // 2, [PUBLISHER])) == 1, rate
    assert (
        "somebody who is not announced publishes on r1/cmd: /r1/base receives 50 Hz more"
        in found(26, 50, [PUBLISHER])[0]
    )
    assert len(found(0, 25, [])) == 1


def test_what_had_waited_for_a_node_that_was_held_up_is_of_no_stranger() -> None:
    def look(number: int, received: int) -> dict[str, NodeStatus]:
        """After so many windows, in each of which 25 are published."""
        uptime = 5.0 + number / 2
        return {
            "/r1/monitor": status("/r1/monitor", uptime, published=25 * number),
            "/r1/base": status("/r1/base", uptime, received=received),
        }

    held_up = [look(0, 0), look(1, 35)]
    assert len(lasting_surplus(held_up, [PUBLISHER])) == 1
    assert lasting_surplus([*held_up, look(2, 60)], [PUBLISHER]) == []
    assert len(lasting_surplus([*held_up, look(2, 90)], [PUBLISHER])) == 1
    assert lasting_surplus([look(0, 0), look(1, 25), look(2, 60)], [PUBLISHER]) == [], "in the last one alone"


def test_a_publisher_that_tells_no_counters_is_left_out() -> None:
    tool = EndpointToken("r1", "topic_pub_12", "pub", "geometry/Twist", QoS.DEFAULT, "r1/cmd")
    assert found(26, 50, [PUBLISHER, tool]) == []


def test_whose_messages_are_left_out_is_told() -> None:
    [one] = refused({"/r1/base": status("/r1/base", 1.0, refused=7)})
    assert str(one).startswith("/r1/base leaves out messages of a plain Zenoh client on r1/cmd: 7 so far")
