"""A simulated base with a laser: the default robot, for a desk without one."""

from collections import deque
from collections.abc import Iterable
from functools import partial
from typing import Annotated, NamedTuple

from msgspec import Meta

import robo
from robo import READ_ONLY, MessageInfo, Node, Publisher, QoS, Unit, service, subscribe, timer
from robo.node.clock import SimClock
from robo.tf import StaticTransformBroadcaster, Transform3, TransformBroadcaster
from robo_messages import (
    Clock,
    Header,
    LaserScan,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Time,
    TransformStamped,
    Trigger,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from robo_services import world
from robo_services.arrivals import Arrivals
from robo_services.diff_drive import BaseLimits, DiffDrive
from robo_services.kinematics import Pose2
from robo_services.planar import quaternion_from_yaw
from robo_services.safety import is_finite


def _diagonal(*values: float) -> tuple[float, ...]:
    return tuple(values[i] if i == j else 0.0 for i in range(6) for j in range(6))


# Not measured is a large variance: a planar base knows nothing of z, roll and pitch.
POSE_COVARIANCE = _diagonal(1e-3, 1e-3, 1e6, 1e6, 1e6, 1e-2)
TWIST_COVARIANCE = _diagonal(1e-3, 1e-3, 1e6, 1e6, 1e6, 1e-2)

MOST_STEPS = 50
"""Steps made up for at once after the process was held up; beyond them simulated time falls behind."""


_REMEMBERED = 64
"""Commands, for the steps that are made up for."""


class Command(NamedTuple):
    """A velocity command."""

    twist: Twist
    sent: float
    """By the base's clock, s; -inf where that is not known."""


def in_force(commands: Iterable[Command], moment: float, timeout: float) -> Twist:
    """The velocity that holds at a moment: that of the last command before it, if it is no older than `timeout` s."""
    twist = Twist()
    for command in commands:
        if command.sent <= moment + 1e-6:
            twist = command.twist if moment - command.sent <= timeout else Twist()
    return twist


class DiffDriveSim(Node):
    """Simulate a differential-drive base and its laser in a flat world."""

    class Parameters(robo.Parameters):
        """The base, its laser and its world."""

        world: Annotated[
            str, Meta(description="YAML file of walls, boxes and circles; empty: a 10 m room"), READ_ONLY
        ] = ""
        x: Annotated[float, Meta(description="where it starts, along x of the world"), Unit("m"), READ_ONLY] = 0.0
        y: Annotated[float, Meta(description="where it starts, along y"), Unit("m"), READ_ONLY] = 0.0
        yaw: Annotated[float, Meta(description="where it looks at the start"), Unit("rad"), READ_ONLY] = 0.0
        seed: Annotated[
            int, Meta(description="what the laser's noise begins from: the same seed, the same noise"), READ_ONLY
        ] = 0
        radius: Annotated[float, Meta(gt=0, description="radius of the round base"), Unit("m"), READ_ONLY] = 0.2
        max_linear_velocity: Annotated[float, Meta(gt=0, description="it drives no faster"), Unit("m/s"), READ_ONLY] = (
            1.5
        )
        max_angular_velocity: Annotated[
            float, Meta(gt=0, description="it turns no faster"), Unit("rad/s"), READ_ONLY
        ] = 3.0
        linear_acceleration: Annotated[float, Meta(gt=0, description="how it gains speed"), Unit("m/s²"), READ_ONLY] = (
            2.0
        )
        linear_deceleration: Annotated[float, Meta(gt=0, description="how it brakes"), Unit("m/s²"), READ_ONLY] = 5.0
        angular_acceleration: Annotated[
            float, Meta(gt=0, description="how its turning changes"), Unit("rad/s²"), READ_ONLY
        ] = 6.0
        cmd_vel_timeout: Annotated[
            float, Meta(ge=0.01, le=10, description="stand still without a command for this long"), Unit("s")
        ] = 0.5
        command_source: Annotated[
            str,
            Meta(description="whose commands alone move it: a node, plain (Zenoh clients), or empty: the first node"),
            READ_ONLY,  # else whoever may set a parameter may drive
        ] = ""
        odom_rate: Annotated[
            float, Meta(ge=1, le=1000, description="steps and odometry messages per second"), Unit("Hz"), READ_ONLY
        ] = 50.0
        laser: Annotated[bool, Meta(description="whether there is a laser")] = True
        scan_rate: Annotated[float, Meta(ge=0.1, le=100, description="scans per second"), Unit("Hz")] = 10.0
        rays: Annotated[int, Meta(ge=1, le=10_000, description="rays of a scan, over the full turn"), READ_ONLY] = 360
        range_min: Annotated[
            float, Meta(ge=0, description="the laser measures nothing nearer"), Unit("m"), READ_ONLY
        ] = 0.05
        range_max: Annotated[
            float, Meta(gt=0, description="the laser measures nothing further"), Unit("m"), READ_ONLY
        ] = 12.0
        range_noise: Annotated[float, Meta(ge=0, description="standard deviation of a range"), Unit("m"), READ_ONLY] = (
            0.005
        )
        publish_clock: Annotated[
            bool, Meta(description="publish /clock: time is what is simulated, for nodes with use_sim_time"), READ_ONLY
        ] = False
        real_time_factor: Annotated[
            float, Meta(ge=0.01, le=100, description="how fast the published time runs, 1 is real time"), READ_ONLY
        ] = 1.0
        odom_frame: Annotated[str, Meta(description="the frame of odometry's poses")] = "odom"
        base_frame: Annotated[str, Meta(description="the frame of odometry's velocities")] = "base_link"
        laser_frame: Annotated[str, Meta(description="the frame of scans")] = "base_laser"

    parameters: Parameters

    odometry = Publisher(Odometry, "odom")
    """Where the base is and how fast it moves, after every step of the simulation."""
    scans = Publisher(LaserScan, "scan")
    """What the laser measures; nothing where `laser` is false."""
    frames = TransformBroadcaster()
    fixed_frames = StaticTransformBroadcaster()

    def on_start(self) -> None:
        """Build the world and put the base into it."""
        p = self.parameters
        surroundings = world.load(p.world) if p.world else world.ROOM
        limits = BaseLimits(
            radius=p.radius,
            max_linear_velocity=p.max_linear_velocity,
            max_angular_velocity=p.max_angular_velocity,
            linear_acceleration=p.linear_acceleration,
            linear_deceleration=p.linear_deceleration,
            angular_acceleration=p.angular_acceleration,
        )
        self._new_base = partial(DiffDrive, surroundings, limits, Pose2(p.x, p.y, p.yaw))
        self._base = self._new_base()
        self._laser = world.Laser(
            surroundings,
            rays=p.rays,
            range_min=p.range_min,
            range_max=p.range_max,
            noise=p.range_noise,
            seed=p.seed,
        )
        self._commands: deque[Command] = deque(maxlen=_REMEMBERED)
        self._arrivals = Arrivals(unstamped=True)  # of whom `command_source` lets in
        self._wall = wall = self.clock.wall
        self._steps = 0
        if p.publish_clock:
            # Each tick of the wall clock is one step of the time that everybody follows, this node's
            # own laser and timeouts included: however busy the machine is, nobody misses a step.
            self.clock = self._simulated = SimClock()
            self._clock_topic = self.create_publisher(Clock, "/clock")
            self.create_timer(1.0 / (p.odom_rate * p.real_time_factor), self.step_time, wall)
        else:
            self.clock = wall
            self.create_timer(1.0 / p.odom_rate, self.advance)
        self._begin = self.clock.monotonic()
        if p.laser:  # it stands in the middle of the base
            self.fixed_frames.send(TransformStamped(Header(self.now(), p.base_frame), p.laser_frame))

    @subscribe("cmd_vel", qos=QoS.COMMAND, sole_source="command_source")
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        """Remember the newest command and when it was sent; one that is not finite counts as silence."""
        if is_finite(twist):
            sent = self._arrivals.sent(info, self.clock.monotonic(), self._wall.monotonic())
            self._commands.append(Command(twist, sent))
        else:
            self.logger.warning("ignored a command that holds NaN or an infinity", throttle=5.0)

    @service("reset")
    def reset(self, _request: Trigger.Request) -> Trigger.Response:
        """Put the base back to where it started, standing still."""
        self._base = self._new_base()
        self._commands.clear()
        return Trigger.Response(message="back at the start")

    def step_time(self) -> None:
        """Make one step of simulated time, tell it, and publish where it leads."""
        nanoseconds = round((self._steps + 1) * 1e9 / self.parameters.odom_rate)
        self._simulated.advance(nanoseconds)
        self.advance()
        self._clock_topic.publish(Clock(Time.from_nanoseconds(nanoseconds)))

    def advance(self) -> None:
        """Make the steps that are due, each of the same length, and publish where that leads."""
        now = self.clock.monotonic()
        rate, timeout = self.parameters.odom_rate, self.parameters.cmd_vel_timeout
        if not self.parameters.publish_clock:
            self._arrivals.tick(self._wall.monotonic(), 1.0 / rate)
        due = int((now - self._begin) * rate + 1e-6)
        for step in range(max(self._steps, due - MOST_STEPS), due):
            # What is made up for after a pause happened then: a command moves nothing before it was sent.
            command = in_force(self._commands, self._begin + (step + 1) / rate, timeout)
            self._base.step(command.linear.x, command.angular.z, 1.0 / rate)
        self._steps = due
        if self._base.bumped:
            self.logger.warning("the base pushes against something", throttle=5.0)
        odometry = self._odometry()
        self.odometry.publish(odometry)
        moved = Transform3.from_message(odometry.pose.pose)
        self.frames.send(moved.to_stamped(odometry.header, odometry.child_frame_id))

    @timer(rate="scan_rate")
    def scan(self) -> None:
        """Publish what the laser sees."""
        if not self.parameters.laser:
            return
        laser = self._laser
        self.scans.publish(
            LaserScan(
                header=Header(self.now(), self.parameters.laser_frame),
                angle_min=laser.angle_min,
                angle_max=laser.angle_min + (laser.rays - 1) * laser.angle_increment,
                angle_increment=laser.angle_increment,
                scan_time=1.0 / self.parameters.scan_rate,
                range_min=laser.range_min,
                range_max=laser.range_max,
                ranges=laser.scan(self._base.pose),
            )
        )

    def _odometry(self) -> Odometry:
        base, p = self._base, self.parameters
        pose = Pose(Point(base.pose.x, base.pose.y), quaternion_from_yaw(base.pose.yaw))
        twist = Twist(Vector3(x=base.linear), Vector3(z=base.angular))
        return Odometry(
            Header(self.now(), p.odom_frame),
            p.base_frame,
            PoseWithCovariance(pose, POSE_COVARIANCE),
            TwistWithCovariance(twist, TWIST_COVARIANCE),
        )


if __name__ == "__main__":
    robo.run(DiffDriveSim)
