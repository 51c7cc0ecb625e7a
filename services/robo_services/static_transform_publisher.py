"""Says where a frame stands in another one, for good: a laser on its base."""

from collections.abc import Set
from typing import Annotated

from msgspec import Meta

import robo
from robo import READ_ONLY, Node, Unit
from robo.tf import StaticTransformBroadcaster, Transform3
from robo_messages import Header

Length = Annotated[float, Meta(ge=-1e6, le=1e6), Unit("m")]
Angle = Annotated[float, Meta(ge=-7, le=7), Unit("rad")]
Frame = Annotated[str, Meta(min_length=1), READ_ONLY]


class StaticTransformPublisher(Node):
    """Publish one transform that never moves on `tf_static`, as ROS's tool of that name does."""

    class Parameters(robo.Parameters):
        """Which frame stands where; one that is measured anew may be set anew."""

        frame_id: Annotated[Frame, Meta(description="the frame in which the other one stands")] = "base_link"
        child_frame_id: Annotated[Frame, Meta(description="the frame that stands in it")] = "base_laser"
        x: Annotated[Length, Meta(description="forward")] = 0.0
        y: Annotated[Length, Meta(description="to the left")] = 0.0
        z: Annotated[Length, Meta(description="up")] = 0.0
        roll: Annotated[Angle, Meta(description="about the outer frame's x, the first of the three")] = 0.0
        pitch: Annotated[Angle, Meta(description="about its y")] = 0.0
        yaw: Annotated[Angle, Meta(description="about its z")] = 0.0

        def __post_init__(self) -> None:
            """Refuse a frame that stands in itself."""
            if self.frame_id == self.child_frame_id:
                raise ValueError(f"frame_id and child_frame_id are both {self.frame_id}")

    parameters: Parameters

    frames = StaticTransformBroadcaster()

    def on_start(self) -> None:
        """Say it."""
        self._send()

    def on_parameters_changed(self, _names: Set[str]) -> None:
        """Say it anew."""
        self._send()

    def _send(self) -> None:
        p = self.parameters
        where = Transform3.from_rpy(p.x, p.y, p.z, p.roll, p.pitch, p.yaw)
        self.frames.send(where.to_stamped(Header(self.now(), p.frame_id), p.child_frame_id))


if __name__ == "__main__":
    robo.run(StaticTransformPublisher)
