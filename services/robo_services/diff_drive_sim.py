"""A simulated base with a laser: the default robot, for a desk without one."""

from collections import deque
from collections.abc import Set
from functools import partial
from typing import Annotated, Literal

from msgspec import Meta, structs

import robo
from robo import READ_ONLY, Health, MessageInfo, Node, Publisher, QoS, Unit, check, service, subscribe, timer
from robo.node.clock import SimClock
from robo.tf import StaticTransformBroadcaster, Transform3, TransformBroadcaster
from robo_messages import (
    Clock,
    Header,
    Imu,
    JointState,
    LaserScan,
    Odometry,
    Time,
    TransformStamped,
    Trigger,
    Twist,
)
from robo_services import world
from robo_services.arrivals import Arrivals
from robo_services.drives import Ackermann, DiffDrive, SkidSteer
from robo_services.kinematics import Pose2, Twist2
from robo_services.safety import is_finite
from robo_services.simulated_base import SimulatedBase
from robo_services.simulated_errors import ErringWheels, SimulatedImu, WheelErrors
from robo_services.simulator import MOST_STEPS, REMEMBERED, Command, SimulatorParameters, in_force
from robo_services.uncertainty import NOISE, PoseCovariance
from robo_services.wheel_odometry import odometry_message, twist_variances

_JOINTS = {
    "diff": ("left_wheel_joint", "right_wheel_joint"),
    "skid": ("front_left_wheel_joint", "rear_left_wheel_joint", "front_right_wheel_joint", "rear_right_wheel_joint"),
    "ackermann": (
        "rear_left_wheel_joint",
        "rear_right_wheel_joint",
        "front_left_steering_joint",
        "front_right_steering_joint",
    ),
}


class DiffDriveSim(Node):
    """Simulate a base and its laser in a flat world: a differential drive, or a skid steer, or a car."""

    class Parameters(SimulatorParameters):
        """The base, its sensors and its world."""

        drive: Annotated[
            Literal["diff", "skid", "ackermann"],
            Meta(description="two wheels, rows of wheels that slide in turns, or a car, which cannot turn on the spot"),
            READ_ONLY,
        ] = "diff"
        wheelbase: Annotated[
            float, Meta(ge=0.001, le=100, description="between the axles of a car"), Unit("m"), READ_ONLY
        ] = 0.3
        max_steering_angle: Annotated[
            float, Meta(ge=0.01, le=1.5, description="how far a car steers to either side"), Unit("rad"), READ_ONLY
        ] = 0.6
        max_steering_velocity: Annotated[
            float, Meta(ge=0.01, le=100, description="how quickly it steers"), Unit("rad/s"), READ_ONLY
        ] = 2.0
        errors: WheelErrors = WheelErrors()

        def __post_init__(self) -> None:
            """Refuse what is not simulated."""
            super().__post_init__()
            if self.errors and self.drive == "ackermann":
                raise ValueError("errors are simulated of the drives diff and skid, not of ackermann")

    parameters: Parameters

    odometry = Publisher(Odometry, "odom")
    """Where the base is and how fast it moves, after every step of the simulation: true to the last digit, but for
    `errors`.

    Its covariance is that of wheels all the same, as of a real base.
    """
    scans = Publisher(LaserScan, "scan")
    """What the laser measures; nothing where `laser` is false."""
    frames = TransformBroadcaster()
    fixed_frames = StaticTransformBroadcaster()

    def on_start(self) -> None:
        """Build the world and put the base into it."""
        p = self.parameters
        surroundings = world.load(p.world) if p.world else world.ROOM
        self._drive = _drive_of(p)
        self._new_base = partial(SimulatedBase, surroundings, p.limits, Pose2(p.x, p.y, p.yaw), self._drive)
        self._base = self._new_base()
        self._covariance = PoseCovariance()
        self._turned: list[float] = []
        self._joints = self.create_publisher(JointState, "joint_states") if p.joint_states else None
        self._new_wheels = partial(ErringWheels, self._drive, p.errors, Pose2(p.x, p.y, p.yaw), p.seed)
        self._erring = self._new_wheels() if p.errors else None
        self._imu = SimulatedImu(p.imu_noise, p.seed)
        self._imu_readings = self.create_publisher(Imu, "imu") if p.imu else None
        self._truth = self.create_publisher(Odometry, "ground_truth") if p.ground_truth else None
        self._laser = world.Laser(
            surroundings,
            rays=p.rays,
            range_min=p.range_min,
            range_max=p.range_max,
            noise=p.range_noise,
            seed=p.seed,
        )
        self._commands: deque[Command] = deque(maxlen=REMEMBERED)
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
        self._say_where_sensors_are()

    def on_parameters_changed(self, names: Set[str]) -> None:
        """Say where a laser stands that is there now."""
        if "laser" in names:
            self._say_where_sensors_are()

    @subscribe("cmd_vel", qos=QoS.COMMAND, sole_source="command_source")
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        """Remember the newest command and when it was sent; one that is not finite counts as silence."""
        if is_finite(twist):
            sent = self._arrivals.sent(info, self.clock.monotonic(), self._wall.monotonic())
            self._commands.append(Command(twist, sent))
            if twist.linear.x == 0.0 and twist.angular.z != 0.0 and isinstance(self._drive, Ackermann):
                self.logger.warning("a car cannot turn on the spot: it stands", throttle=5.0)
        else:
            self.logger.warning("ignored a command that holds NaN or an infinity", throttle=5.0)

    @service("reset")
    def reset(self, _request: Trigger.Request) -> Trigger.Response:
        """Put the base back to where it started, standing still."""
        self._base = self._new_base()
        self._erring = self._new_wheels() if self.parameters.errors else None
        self._covariance = PoseCovariance()
        self._turned = []
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
        steps = range(max(self._steps, due - MOST_STEPS), due)
        turned = 0.0
        for step in steps:
            # What is made up for after a pause happened then: a command moves nothing before it was sent.
            command = in_force(self._commands, self._begin + (step + 1) / rate, timeout)
            yaw = self._base.pose.yaw
            self._base.step(command.linear.x, command.angular.z, 1.0 / rate)
            way, turn = self._base.linear / rate, self._base.angular / rate
            self._covariance = self._covariance.after(way, turn, yaw, NOISE)
            turned += turn
            if self._erring is not None:
                self._erring.step(way, turn, 1.0 / rate)
        self._steps = due
        if self._base.bumped:
            self.logger.warning("the base pushes against something", throttle=5.0)
        truth = self._odometry()
        odometry = truth if self._erring is None else self._erring.message(truth.header, truth.child_frame_id)
        self.odometry.publish(odometry)
        if self.parameters.enable_odom_tf:
            moved = Transform3.from_message(odometry.pose.pose)
            self.frames.send(moved.to_stamped(odometry.header, odometry.child_frame_id))
        if self._truth is not None:
            header = Header(truth.header.stamp, self.parameters.world_frame)
            self._truth.publish(structs.replace(truth, header=header))
        if self._imu_readings is not None and steps:
            header = Header(odometry.header.stamp, self.parameters.imu_frame)
            self._imu_readings.publish(self._imu.message(header, self._base.linear, turned, len(steps) / rate))
        if self._joints is not None:
            self._joints.publish(self._joint_state(odometry.header.stamp, max(len(steps), 1) / rate))

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

    @check("contact")
    def contact(self) -> Health:
        """Whether the base stands against something."""
        if self._base.bumped:
            return Health.warn("the base pushes against something")
        return Health.ok()

    def _say_where_sensors_are(self) -> None:
        p = self.parameters
        sensors = {p.laser_frame: p.laser and p.publish_laser_tf, p.imu_frame: p.imu}
        header = Header(self.now(), p.base_frame)  # all of them stand in the middle of the base
        said = [TransformStamped(header, frame) for frame, is_there in sensors.items() if is_there]
        if said:
            self.fixed_frames.send(*said)

    def _odometry(self) -> Odometry:
        base, p = self._base, self.parameters
        twist = Twist2(base.linear, base.angular)
        variances = twist_variances(twist, NOISE, 1.0 / p.odom_rate)
        return odometry_message(
            Header(self.now(), p.odom_frame), p.base_frame, base.pose, twist, self._covariance, variances
        )

    def _joint_state(self, stamp: Time, elapsed: float) -> JointState:
        left, right, steering = self._base.wheels if self._erring is None else self._erring.wheels
        turned = {
            "diff": [left, right],
            "skid": [left, left, right, right],
            "ackermann": [left, right],
        }[self.parameters.drive]
        if isinstance(self._drive, Ackermann):
            turned += self._drive.front_wheels(steering)
        before, self._turned = self._turned or turned, turned
        rates = [(new - old) / elapsed for new, old in zip(turned, before, strict=True)]
        return JointState(Header(stamp), list(_JOINTS[self.parameters.drive]), turned, rates)


def _drive_of(p: DiffDriveSim.Parameters) -> DiffDrive | Ackermann:
    if p.drive == "ackermann":
        return Ackermann(
            wheelbase=p.wheelbase,
            wheel_separation=p.wheel_separation,
            wheel_radius=p.wheel_radius,
            max_steering_angle=p.max_steering_angle,
            max_steering_velocity=p.max_steering_velocity,
        )
    kind = SkidSteer if p.drive == "skid" else DiffDrive
    return kind(wheel_separation=p.wheel_separation, wheel_radius=p.wheel_radius)


if __name__ == "__main__":
    robo.run(DiffDriveSim)
