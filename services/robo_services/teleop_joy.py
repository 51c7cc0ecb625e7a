"""Drives a robot by a game pad."""

import math
from typing import Annotated

import msgspec
from msgspec import Meta

import robo
from robo import MessageInfo, Node, Publisher, QoS, Unit, subscribe
from robo_messages import Joy, Time, Twist
from robo_services.arrivals import Arrivals, Newest, Unstamped
from robo_services.joy_driving import DeadMan, Mapping, Scales, missing, mode_of, twist_of

_MOST = 255
"""Linux numbers axes and buttons by a byte."""

LOOKED_AT = 0.05
"""How often it looks whether the pad is silent, s."""


class LinearAxes(msgspec.Struct, frozen=True):
    """Which axis drives; -1 for none."""

    x: Annotated[int, Meta(ge=-1, le=_MOST, description="the axis that drives forward")] = 1
    y: Annotated[int, Meta(ge=-1, le=_MOST, description="the axis that drives to the left")] = -1


class AngularAxes(msgspec.Struct, frozen=True):
    """Which axis turns; -1 for none."""

    yaw: Annotated[int, Meta(ge=-1, le=_MOST, description="the axis that turns to the left")] = 0


class LinearScales(msgspec.Struct, frozen=True):
    """How fast an axis at its end drives."""

    x: Annotated[float, Meta(ge=-100, le=100, description="forward, the axis at its end"), Unit("m/s")] = 0.5
    y: Annotated[float, Meta(ge=-100, le=100, description="to the left, the axis at its end"), Unit("m/s")] = 0.0


class AngularScales(msgspec.Struct, frozen=True):
    """How fast an axis at its end turns."""

    yaw: Annotated[float, Meta(ge=-100, le=100, description="to the left, the axis at its end"), Unit("rad/s")] = 1.0


class TeleopJoy(Node):
    """Drive while a button of a game pad is held: the dead man's, or the one for turbo.

    When it is let go, or the pad is silent, it says 0 once and nothing after it, so that others may drive. A pad that
    comes with its button held down drives nobody until the button was let go.
    """

    class Parameters(robo.Parameters):
        """What buttons and axes are for; names are those of ROS's teleop_twist_joy."""

        require_enable_button: Annotated[
            bool, Meta(description="false: it drives whenever an axis says so, and nobody need hold anything")
        ] = True
        enable_button: Annotated[
            int, Meta(ge=-1, le=_MOST, description="the button that is held to drive; -1 for none")
        ] = 4
        enable_turbo_button: Annotated[
            int, Meta(ge=-1, le=_MOST, description="the button that is held to drive fast; -1 for none")
        ] = 5
        axis_linear: LinearAxes = LinearAxes()
        axis_angular: AngularAxes = AngularAxes()
        scale_linear: LinearScales = LinearScales()
        scale_linear_turbo: LinearScales = LinearScales(x=1.0)
        scale_angular: AngularScales = AngularScales()
        scale_angular_turbo: AngularScales = AngularScales(yaw=1.5)
        inverted_reverse: Annotated[bool, Meta(description="turn the other way while it drives backward")] = False
        joy_timeout: Annotated[
            float, Meta(ge=0.02, le=10, description="a pad that is silent for so long is let go"), Unit("s")
        ] = 0.3
        still_timeout: Annotated[
            float,
            Meta(ge=0, le=3600, description="a pad of which nothing has moved for so long is let go; 0: never"),
            Unit("s"),
        ] = 0.0
        unstamped: Unstamped = True

    parameters: Parameters

    command = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    """How to drive, m/s and rad/s, while the button is held; one 0 after it, then nothing."""

    def on_start(self) -> None:
        """No pad is there yet."""
        self._arrivals = Arrivals(unstamped=self.parameters.unstamped)
        self._wall = self.clock.wall
        self._newest: Newest[Joy] = Newest()
        self._dead_man = DeadMan()
        self._unclear = 0
        self._moved: Time | None = None
        self._still_since = -math.inf
        self.create_timer(LOOKED_AT, self.look, self._wall)

    @subscribe("joy", qos=QoS.COMMAND)
    def on_joy(self, joy: Joy, info: MessageInfo) -> None:
        """Pass on what the pad says, as old as it is."""
        # Whoever holds a button lives by the wall clock, however fast a simulation goes.
        p, now = self.parameters, self._wall.monotonic()
        sent = self._arrivals.sent(info, now, now)
        age = now - sent
        if age > p.joy_timeout:
            self.logger.warning("left out what a pad said %.2g s ago", age, throttle=5.0)
            return
        self._newest.take(joy, sent, now)
        if joy.header.stamp != self._moved:
            self._moved, self._still_since = joy.header.stamp, now
        mapping = _mapping_of(p)
        lacks = missing(joy, mapping)
        if lacks:
            self.logger.warning("the pad on %s: %s", self.resolve("joy"), "; ".join(lacks), throttle=30.0)
        mode = mode_of(joy, mapping)
        try:
            twist = twist_of(joy, mapping, mode)
        except ValueError as error:
            self._unclear += 1
            text = "the pad says what is no number, %s: %d times so far; let the button go to drive on"
            self.logger.warning(text, error, self._unclear, throttle=5.0)
            self._dead_man.lose()
            self._stand()
            return
        if self._dead_man.hear(mode, needs_button=mapping.require_enable_button):
            self._dead_man.driving = True
            self.command.publish(twist, age)
        else:
            if mode != "off":
                self.logger.warning("its button is held down from the start: let it go to drive", throttle=5.0)
            self._stand()

    def look(self) -> None:
        """Let the robot stand when the pad is silent."""
        now = self._wall.monotonic()
        self._arrivals.tick(now, LOOKED_AT)
        p = self.parameters
        if self._newest.message is not None and self._newest.age(now) > p.joy_timeout:
            self._newest = Newest()
            self._lose(f"nothing on {self.resolve('joy')} for {p.joy_timeout:g} s")
        elif p.still_timeout and self._dead_man.driving and now - self._still_since > p.still_timeout:
            self._lose(f"nothing of the pad has moved for {p.still_timeout:g} s")

    def _lose(self, why: str) -> None:
        """Take the button as let go, and as one that has to be before it counts again."""
        self._dead_man.lose()
        if self._dead_man.driving:
            self.logger.warning("%s: the robot stands; let the button go to drive on", why)
        self._stand()

    def _stand(self) -> None:
        """Say 0, once, where this node has driven."""
        if self._dead_man.driving:
            self._dead_man.driving = False
            self.command.publish(Twist())

    def on_stop(self) -> None:
        """Leave the robot standing, if it was this node that drove it."""
        self._stand()


def _mapping_of(p: TeleopJoy.Parameters) -> Mapping:
    return Mapping(
        require_enable_button=p.require_enable_button,
        enable_button=p.enable_button,
        enable_turbo_button=p.enable_turbo_button,
        axis_x=p.axis_linear.x,
        axis_y=p.axis_linear.y,
        axis_yaw=p.axis_angular.yaw,
        normal=Scales(p.scale_linear.x, p.scale_linear.y, p.scale_angular.yaw),
        turbo=Scales(p.scale_linear_turbo.x, p.scale_linear_turbo.y, p.scale_angular_turbo.yaw),
        inverted_reverse=p.inverted_reverse,
    )


if __name__ == "__main__":
    robo.run(TeleopJoy)
