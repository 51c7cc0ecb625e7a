"""The node static_transform_publisher: where a frame stands, for latecomers too, and what it refuses."""

import math

import pytest

from robo import ParameterError
from robo.testing import RunNode
from robo.tf import Transform3
from robo_messages import TFMessage, TransformStamped
from robo_services.static_transform_publisher import StaticTransformPublisher


def test_a_frame_stands_where_it_is_said_to(run_node: RunNode) -> None:
    node = run_node(StaticTransformPublisher, namespace="r1", child_frame_id="camera", x=0.1, z=0.4, yaw=math.pi / 2)

    def last() -> TransformStamped:
        message = node.published("tf_static")[-1]
        assert isinstance(message, TFMessage)
        (stamped,) = message.transforms
        return stamped

    stamped = last()
    assert (stamped.header.frame_id, stamped.child_frame_id) == ("base_link", "camera")
    assert Transform3.from_message(stamped.transform).apply(1.0, 0.0, 0.0) == pytest.approx((0.1, 1.0, 0.4))
    node.set(x=0.2, yaw=0.0)
    assert Transform3.from_message(last().transform).apply(1.0, 0.0, 0.0) == pytest.approx((1.2, 0.0, 0.4))


def test_a_frame_does_not_stand_in_itself(run_node: RunNode) -> None:
    with pytest.raises(ParameterError, match="frame_id and child_frame_id are both base_link"):
        run_node(StaticTransformPublisher, child_frame_id="base_link")
