"""Drives a base whose driver speaks wheels: velocities to wheels, and wheels to odometry."""

from typing import Annotated

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, Health, MessageInfo, Node, Publisher, QoS, Unit, check, subscribe, timer
from robo.tf import Transform3, TransformBroadcaster
from robo_messages import Header, JointState, Odometry, Time, Twist
from robo_services.arrivals import Arrivals, Newest
from robo_services.base_parameters import WheeledParameters
from robo_services.drives import STANDING
from robo_services.kinematics import Twist2
from robo_services.safety import is_finite
from robo_services.wheel_odometry import WheelOdometry

Names = Annotated[list[str], Meta(min_length=1, max_length=100), READ_ONLY]


SETTLING = 1.0
"""For so long after the start it is no news that nothing has come yet, s."""


class DiffDriveController(Node):
    """Turn velocity commands into those of wheels, and what the wheels did into odometry.

    For two wheels, or for several on each side, which then slide in turns. A timer sends, not the arrival of commands:
    wheels are told to stand when commands end, and when nobody says any more what the wheels do. Ages count from when
    a command was sent, and what is passed on has the age of the command that it comes from.
    """

    class Parameters(WheeledParameters):
        """The base."""

        left_wheel_names: Annotated[Names, Meta(description="the joints of the left side")] = msgspec.field(
            default_factory=lambda: ["left_wheel_joint"]
        )
        right_wheel_names: Annotated[Names, Meta(description="the joints of the right side")] = msgspec.field(
            default_factory=lambda: ["right_wheel_joint"]
        )
        encoder_wrap: Annotated[
            float,
            Meta(ge=0, le=1e9, description="after so much positions begin anew; 0: never"),
            Unit("rad"),
            READ_ONLY,
        ] = 0.0
        position_feedback: Annotated[
            bool, Meta(description="whether odometry counts positions of joints, or else velocities"), READ_ONLY
        ] = True
        open_loop: Annotated[
            bool, Meta(description="there is no feedback: odometry is what was commanded"), READ_ONLY
        ] = False
        publish_rate: Annotated[
            float, Meta(ge=1, le=1000, description="commands and odometry messages per second"), Unit("Hz")
        ] = 50.0
        joint_states_timeout: Annotated[
            float, Meta(ge=0.01, le=10, description="stand still without feedback for this long"), Unit("s")
        ] = 0.5

        def __post_init__(self) -> None:
            """Refuse a wheel on both sides."""
            if both := {*self.left_wheel_names} & {*self.right_wheel_names}:
                raise ValueError(f"a joint is on one side, not on both: {', '.join(sorted(both))}")

    parameters: Parameters

    wheels = Publisher(JointState, "wheel_commands", qos=QoS.COMMAND)
    """What the wheels are to do, as velocities of joints, rad/s."""
    odometry = Publisher(Odometry, "odom")
    """Where the base is by its wheels and how fast it moves, as of the last feedback."""
    frames = TransformBroadcaster()

    def on_start(self) -> None:
        """Nothing is commanded yet, and nothing known of the wheels."""
        p = self.parameters
        self._drive = p.drive()
        self._track = WheelOdometry(self._drive, wrap=p.encoder_wrap)
        self._arrivals = Arrivals(unstamped=p.unstamped)
        self._wall = self.clock.wall
        self._command: Newest[Twist] = Newest()
        self._feedback: Newest[JointState] = Newest()
        self._measured: Time | None = None
        self._driver = ""
        self._refused = 0
        self._hindrance = ""
        self._begin = self._wall.monotonic()

    @subscribe("cmd_vel", qos=QoS.COMMAND, sole_source="command_source")
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        """Remember the newest command and when it was sent; one that is not finite counts as silence."""
        if is_finite(twist):
            now = self.clock.monotonic()
            self._command.take(twist, self._arrivals.sent(info, now, self._wall.monotonic()), now)
        else:
            self._refused += 1
            text = "ignored a command that holds NaN or an infinity, %d so far"
            self.logger.warning(text, self._refused, throttle=5.0)

    @subscribe("joint_states")
    def on_joint_states(self, state: JointState, info: MessageInfo) -> None:
        """Follow the wheels; what makes no sense of them moves nothing, and is no feedback."""
        p = self.parameters
        values = dict(zip(state.name, state.position if p.position_feedback else state.velocity, strict=False))
        missing = [name for name in (*p.left_wheel_names, *p.right_wheel_names) if name not in values]
        if missing:
            if len(missing) < len(p.left_wheel_names) + len(p.right_wheel_names) or {*missing} & {*state.name}:
                kind = "position" if p.position_feedback else "velocity"
                self.logger.warning("%s says no %s of %s", info.sender, kind, ", ".join(missing), throttle=5.0)
            return  # joints of somebody else
        if not self._is_driver(info):
            return
        take = self._track.take_positions if p.position_feedback else self._track.take_velocities
        self._track.noise = p.noise
        stamp = state.header.stamp if state.header.stamp != Time() else self.now()
        left, right = ([values[name] for name in names] for names in (p.left_wheel_names, p.right_wheel_names))
        if take(left, right, stamp.to_seconds()):
            now = self.clock.monotonic()
            self._feedback.take(state, self._arrivals.sent(info, now, self._wall.monotonic()), now)
            self._measured = stamp
        else:
            text = "left out what %s says of the wheels, which they cannot have done; %d times so far"
            self.logger.warning(text, info.sender, self._track.left_out, throttle=5.0)

    def _is_driver(self, info: MessageInfo) -> bool:
        """Whether this is who says what the wheels do: one at a time, and another one counts from somewhere else."""
        if info.source_id != self._driver:
            if self._feedback.age(self.clock.monotonic()) <= self.parameters.joint_states_timeout:
                self.logger.warning("%s says too what the wheels do: left out", info.sender, throttle=5.0)
                return False
            self._driver = info.source_id
            self._track.begin_anew()
        return True

    @timer(rate="publish_rate")
    def drive(self) -> None:
        """Tell the wheels what to do, and everybody where they have led."""
        now, p = self.clock.monotonic(), self.parameters
        if not p.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), 1.0 / p.publish_rate)
        command, age = self._command.message, self._command.age(now)
        hindrance = self._why_not(age, now)
        wanted = STANDING if hindrance or command is None else Twist2(command.linear.x, command.angular.z)
        # Whoever receives it counts its age from when it was commanded: timeouts of a chain do not add up.
        left, right, _ = self._drive.wheels(wanted)
        self._send(left, right, 0.0 if hindrance else self._command.age(self.clock.monotonic()))
        self._say(hindrance)
        if p.open_loop:
            self._measured = self.now()
            self._track.take_velocities([left], [right], self._measured.to_seconds())
        if self._measured is not None:
            self._tell(Header(self._measured, p.odom_frame_id))
            self._measured = None

    def _why_not(self, age: float, now: float) -> str:
        """Why the wheels have to stand; empty if they do not."""
        p = self.parameters
        if not p.open_loop and not self._feedback.age(now) <= p.joint_states_timeout:
            return self._silence()
        return "" if age <= p.cmd_vel_timeout else f"no command on {self.resolve('cmd_vel')}"

    @check("wheels")
    def wheels_are_heard(self) -> Health:
        """Whether the wheels say what they do; that nobody commands them is no fault."""
        p, silent = self.parameters, self._feedback.age(self.clock.monotonic())
        if not p.open_loop and not silent <= p.joint_states_timeout:
            return Health.error(f"the wheels stand: {self._silence()}")
        return Health.ok(left_out=self._track.left_out, refused=self._refused)

    def _silence(self) -> str:
        names = ", ".join((*self.parameters.left_wheel_names, *self.parameters.right_wheel_names))
        return f"nothing new on {self.resolve('joint_states')} of {names}"

    def _say(self, hindrance: str) -> None:
        if hindrance == self._hindrance or (hindrance and self._wall.monotonic() - self._begin < SETTLING):
            return
        self._hindrance = hindrance
        if hindrance:
            self.logger.warning("the wheels stand: %s", hindrance)
        else:
            self.logger.info("the wheels follow %s", self.resolve("cmd_vel"))

    def _send(self, left: float, right: float, age: float) -> None:
        on_left, on_right = self.parameters.left_wheel_names, self.parameters.right_wheel_names
        velocities = [left] * len(on_left) + [right] * len(on_right)
        self.wheels.publish(JointState(Header(self.now()), [*on_left, *on_right], velocity=velocities), age)

    def _tell(self, header: Header) -> None:
        odometry = self._track.message(header, self.parameters.base_frame_id)
        self.odometry.publish(odometry)
        if self.parameters.enable_odom_tf:
            stands = Transform3.from_message(odometry.pose.pose)
            self.frames.send(stands.to_stamped(header, odometry.child_frame_id))

    def on_stop(self) -> None:
        """Leave the wheels standing."""
        self._send(0.0, 0.0, 0.0)


if __name__ == "__main__":
    robo.run(DiffDriveController)
