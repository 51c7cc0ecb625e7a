"""Drives at a set velocity."""

from collections.abc import Set
from typing import Annotated

from msgspec import Meta

import robo
from robo import Node, Publisher, QoS, Unit, timer
from robo_messages import Twist, Vector3
from robo_services.limits import clamp, ramp

_LIMITED = {"linear_velocity", "angular_velocity", "max_linear_velocity", "max_angular_velocity"}


class VelocityController(Node):
    """Publish a steady velocity command, reached within acceleration limits."""

    class Parameters(robo.Parameters):
        """How fast, and how gently."""

        linear_velocity: Annotated[float, Meta(ge=-5, le=5, description="forward velocity"), Unit("m/s")] = 0.5
        angular_velocity: Annotated[float, Meta(ge=-10, le=10, description="yaw rate"), Unit("rad/s")] = 0.2
        publish_rate: Annotated[float, Meta(ge=0.1, le=1000, description="commands per second"), Unit("Hz")] = 10.0
        max_linear_velocity: Annotated[
            float, Meta(ge=0, description="it commands no more, forward or backward"), Unit("m/s")
        ] = 1.0
        max_angular_velocity: Annotated[
            float, Meta(ge=0, description="it commands no more, to either side"), Unit("rad/s")
        ] = 2.0
        max_linear_acceleration: Annotated[
            float, Meta(gt=0, description="how the forward velocity changes at most"), Unit("m/s²")
        ] = 1.0
        max_angular_acceleration: Annotated[
            float, Meta(gt=0, description="how the yaw rate changes at most"), Unit("rad/s²")
        ] = 2.0

    parameters: Parameters

    command = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    """How fast to drive, m/s and rad/s."""

    def on_start(self) -> None:
        """Start from standstill."""
        self._linear = 0.0
        self._angular = 0.0
        self._warn_of_limits()

    def on_parameters_changed(self, names: Set[str]) -> None:
        """Say what the limits make of new velocities."""
        if not names.isdisjoint(_LIMITED):
            self._warn_of_limits()

    def _warn_of_limits(self) -> None:
        p = self.parameters
        for name, value, limit in (
            ("linear_velocity", p.linear_velocity, p.max_linear_velocity),
            ("angular_velocity", p.angular_velocity, p.max_angular_velocity),
        ):
            if abs(value) > limit:
                self.logger.warning("%s = %g is limited to max_%s = %g", name, value, name, limit)

    @timer(rate="publish_rate")
    def publish_command(self) -> None:
        """Take one step towards the wanted velocity."""
        p = self.parameters
        dt = 1.0 / p.publish_rate
        linear = clamp(p.linear_velocity, p.max_linear_velocity)
        angular = clamp(p.angular_velocity, p.max_angular_velocity)
        self._linear = ramp(self._linear, linear, dt, p.max_linear_acceleration, p.max_linear_acceleration)
        self._angular = ramp(self._angular, angular, dt, p.max_angular_acceleration, p.max_angular_acceleration)
        self.command.publish(Twist(Vector3(x=self._linear), Vector3(z=self._angular)))

    def on_stop(self) -> None:
        """Leave the robot standing."""
        self.command.publish(Twist())


if __name__ == "__main__":
    robo.run(VelocityController)
