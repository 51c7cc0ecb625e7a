from typing import Any

import msgspec
import pytest

from robo.node.message_check import LARGE, MessageCheck
from robo_messages import Imu, LaserScan, Point, String, Twist, Vector3

encode = msgspec.msgpack.encode


def test_a_field_of_another_type_is_named() -> None:
    wrong: Any = "fast"
    with pytest.raises(TypeError, match=r"^r1/cmd_vel: linear\.x of geometry/Twist: expected float, got str$"):
        MessageCheck(Twist, "r1/cmd_vel")(encode(Twist(Vector3(x=wrong))))
    with pytest.raises(TypeError, match=r"^r1/text: data of std/String: expected str, got int$"):
        MessageCheck(String, "r1/text")(encode(String(data=5)))  # type: ignore[arg-type]


@pytest.mark.parametrize("message", [Twist(Vector3(x=1)), Imu(), Point(x=float("nan")), LaserScan(ranges=[1, 2.5])])
def test_what_a_receiver_takes_passes(message: Any) -> None:
    payload = encode(message)
    assert MessageCheck(type(message), "x")(payload) == len(payload)


def test_large_messages_are_looked_at_now_and_then() -> None:
    check = MessageCheck(String, "x")
    wrong: Any = [1] * LARGE
    assert check(encode(String("x" * LARGE))) > LARGE
    assert check(encode(String(wrong))) > LARGE  # so soon after the one before it is not looked at
    with pytest.raises(TypeError, match="expected str, got array"):
        MessageCheck(String, "x")(encode(String(wrong)))
