"""A base with a laser, an inertial measurement unit and a camera in MuJoCo: wheels that grip or slip, and weight."""

import math
import random
from collections import deque
from collections.abc import Sequence, Set
from typing import Any, ClassVar, NamedTuple

import robo
from robo import Health, MessageInfo, Node, Publisher, QoS, check, service, subscribe, timer
from robo.node.clock import SimClock
from robo.tf import StaticTransformBroadcaster, Transform3, TransformBroadcaster
from robo_messages import CameraInfo, Clock, Header, JointState, LaserScan, Odometry, Time, Trigger, Twist, sensor
from robo_services import mjcf, mujoco_physics, mujoco_pictures
from robo_services.arrivals import Arrivals
from robo_services.drives import DiffDrive
from robo_services.kinematics import Pose2
from robo_services.mujoco_laser import MujocoLaser
from robo_services.mujoco_messages import imu_message, joint_state, scan_message, truth_message
from robo_services.mujoco_parameters import MujocoParameters
from robo_services.mujoco_physics import Diverged, MujocoBase
from robo_services.mujoco_pictures import Camera, CannotDraw, Window
from robo_services.mujoco_sensors import Imu, ModelError, mean
from robo_services.safety import is_finite
from robo_services.simulator import MOST_STEPS, REMEMBERED, Command, in_force
from robo_services.wheel_odometry import WheelOdometry

FRAMES_SHOWN = 30.0
"""Pictures per second in the window, of real time."""
TIPPED = math.pi / 3
"""Who leans further does not stand on its wheels, rad."""


class _Seen(NamedTuple):
    """A state of the world, at which each sensor looks once."""

    stamp: Time
    positions: Any
    """MuJoCo's `qpos`."""


class MujocoSim(Node):
    """Simulate a differential drive with its sensors in MuJoCo, in place of `diff_drive_sim`: the same topics.

    Odometry is that of the wheels: where they slip, it errs, and `ground_truth` says by how much. The same seed and the
    same commands at the same steps are the same drive, bit for bit.
    """

    REQUIRES: ClassVar = mujoco_physics.REQUIRES

    class Parameters(MujocoParameters):
        """The base, its sensors and its world."""

    parameters: Parameters

    odometry = Publisher(Odometry, "odom")
    """Where the base is by its wheels, after every step of the simulation."""
    truth = Publisher(Odometry, "ground_truth")
    """Where it truly is, and how fast it truly moves, also sideways; nothing where `ground_truth` is false."""
    scans = Publisher(LaserScan, "scan")
    """What the laser measures; nothing where `laser` is false."""
    imu = Publisher(sensor.Imu, "imu")
    """What the base feels, after every step: the mean over it. Its orientation is true. Nothing without `imu`."""
    pictures = Publisher(sensor.Image, "image_raw", qos=QoS.SENSOR_DATA)
    """What the camera sees; nothing where `camera` is false."""
    infos = Publisher(CameraInfo, "camera_info", latched=True)
    """How it sees; likewise."""
    frames = TransformBroadcaster()
    fixed_frames = StaticTransformBroadcaster()

    _window: Window | None = None
    _camera: Camera | None = None
    _seen: _Seen
    _scanned: _Seen | None = None
    _pictured: _Seen | None = None

    def on_start(self) -> None:
        """Build the world and put the robot into it."""
        p = self.parameters
        if p.window and not mujoco_pictures.has_screen():
            raise CannotDraw(mujoco_pictures.NO_SCREEN)
        self._drive = DiffDrive(wheel_separation=p.wheel_separation, wheel_radius=p.wheel_radius)
        self._base = MujocoBase(*p.models(), p.limits, self._drive, Pose2(p.x, p.y, p.yaw), timestep=p.timestep)
        if self._base.starts_inside:
            self.logger.warning("the robot starts in the middle of something: say another x, y or yaw")
        self._laser = _laser_of(p, self._base) if p.laser else None
        self._blind = ""
        """Why there are no pictures."""
        self._joints = self.create_publisher(JointState, "joint_states") if p.joint_states else None
        self._commands: deque[Command] = deque(maxlen=REMEMBERED)
        self._arrivals = Arrivals(unstamped=True)  # of whom `command_source` lets in
        self._wall = wall = self.clock.wall
        self._steps = 0
        self._begin_anew()
        if p.publish_clock:
            # Each tick of the wall clock is one step of the time that everybody follows, as in diff_drive_sim.
            self.clock = self._simulated = SimClock()
            self._clock_topic = self.create_publisher(Clock, "/clock")
            self.create_timer(1.0 / (p.odom_rate * p.real_time_factor), self.step_time, wall)
        else:
            self.clock = wall
            self.create_timer(1.0 / p.odom_rate, self.advance)
        self._begin = self.clock.monotonic()
        if p.camera:
            self._camera = Camera(self._base, p.camera_width, p.camera_height)
            self.infos.publish(self._camera.info(Header(self.now(), p.camera_frame)))
        if p.window:
            self._window = Window(self._base)
            self.create_timer(1.0 / FRAMES_SHOWN, self.show, wall)
        self._say_where_sensors_are()

    @classmethod
    def lacking(cls, parameters: Any) -> Sequence[str]:
        """MuJoCo, and a screen for its window."""
        screens = [mujoco_pictures.NO_SCREEN] if parameters.window and not mujoco_pictures.has_screen() else []
        return [*super().lacking(parameters), *screens]

    def on_stop(self) -> None:
        """Close the window, and give back what draws pictures."""
        if self._window is not None:
            self._window.close()
        if self._camera is not None:
            self._camera.close()

    def on_parameters_changing(self, new: Any) -> None:
        """Refuse a laser that the robot has no place for."""
        if new.laser and self._laser is None:
            try:
                self._laser = _laser_of(new, self._base)
            except ModelError as error:
                raise ValueError(str(error)) from None

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
        else:
            self.logger.warning("ignored a command that holds NaN or an infinity", throttle=5.0)

    @service("reset")
    def reset(self, _request: Trigger.Request) -> Trigger.Response:
        """Put the robot back to where it started, standing still; all noise begins anew."""
        self._base.reset()
        if self._laser is not None:
            self._laser.reset()
        self._begin_anew()
        self._commands.clear()
        if self.parameters.paused:
            self._tell_where(self.now())
        return Trigger.Response(message="back at the start")

    @service("step")
    def step(self, _request: Trigger.Request) -> Trigger.Response:
        """Make one step, of the length of 1 / odom_rate, while `paused`."""
        if not self.parameters.paused:
            return Trigger.Response(success=False, message="it is not paused: set the parameter paused first")
        if self.parameters.publish_clock:
            self._tick()
        else:
            self._run([self.clock.monotonic()])
        if self.stopping:
            return Trigger.Response(success=False, message="it ends; its log says why")
        return Trigger.Response(message=f"at {self._base.time:.3f} s")

    def step_time(self) -> None:
        """Make one step of simulated time, tell it, and publish where it leads."""
        if not self.parameters.paused:
            self._tick()

    def advance(self) -> None:
        """Make the steps that are due, each of the same length, and publish where that leads."""
        rate = self.parameters.odom_rate
        self._arrivals.tick(self._wall.monotonic(), 1.0 / rate)
        due = int((self.clock.monotonic() - self._begin) * rate + 1e-6)
        steps, self._steps = range(max(self._steps, due - MOST_STEPS), due), due
        if not self.parameters.paused:
            # What is made up for after a pause happened then: a command moves nothing before it was sent.
            self._run([self._begin + (step + 1) / rate for step in steps])

    @timer(rate="scan_rate")
    def scan(self) -> None:
        """Publish what the laser sees, if anything may have moved since it looked."""
        p, seen = self.parameters, self._seen
        if self._laser is None or not p.laser or seen is self._scanned:
            return
        self._scanned = seen
        self.scans.publish(scan_message(Header(seen.stamp, p.laser_frame), self._laser, 1.0 / p.scan_rate))

    @timer(rate="camera_rate", turn="camera")
    def take_picture(self) -> None:
        """Publish what the camera sees, as `scan` does; beside the physics, which does not wait for it."""
        seen, frame = self._seen, self.parameters.camera_frame
        if self._camera is None or seen is self._pictured:
            return
        self._pictured = seen
        try:
            picture = self._camera.take(seen.positions)
        except CannotDraw as error:
            self._blind = str(error)
            self.logger.warning("no pictures: %s", self._blind, throttle=60.0)
            return
        self._blind = ""
        self.pictures.publish(sensor.Image.from_array(picture, "rgb8", Header(seen.stamp, frame)))

    def show(self) -> None:
        """Show in the window where everything is; who resets it there resets all of it."""
        if self._window is None or not self._window.is_open:
            return
        time = self._base.time
        self._window.show()
        if self._base.time != time:
            self.reset(Trigger.Request())

    @check("contact")
    def contact(self) -> Health:
        """Whether the robot stands against something."""
        return Health.warn("the base pushes against something") if self._base.bumped else Health.ok()

    @check("upright")
    def stands(self) -> Health:
        """Whether the robot stands on its wheels."""
        return Health.error("the base has tipped over") if self._base.tilt > TIPPED else Health.ok()

    @check("camera")
    def camera_draws(self) -> Health:
        """Whether there are pictures, where there is a camera."""
        return Health.error(f"no pictures: {self._blind}") if self._blind else Health.ok()

    def _begin_anew(self) -> None:
        p = self.parameters
        self._odometry = WheelOdometry(self._drive, pose=Pose2(p.x, p.y, p.yaw))
        self._odometry.take_positions(self._base.wheels[:1], self._base.wheels[1:2], 0.0)
        self._random = random.Random(p.seed)
        self._seen = _Seen(self.now(), self._base.data.qpos.copy())

    def _tick(self) -> None:
        self._steps += 1
        nanoseconds = round(self._steps * 1e9 / self.parameters.odom_rate)
        self._simulated.advance(nanoseconds)
        self._run([self._begin + self._steps / self.parameters.odom_rate])
        self._clock_topic.publish(Clock(Time.from_nanoseconds(nanoseconds)))

    def _run(self, moments: list[float]) -> None:
        """Make the steps that end at some moments, and publish where that leads."""
        base, p = self._base, self.parameters
        felt: list[Imu] = []
        for moment in moments:
            command = in_force(self._commands, moment, p.cmd_vel_timeout)
            try:
                base.step(command.linear.x, command.angular.z, 1.0 / p.odom_rate)
            except Diverged as error:
                self.logger.error("%s: the robot's masses, sizes and torques do not go together", error)
                self.shutdown(1)
                return
            felt.append(base.imu)
            left, right, _ = base.wheels
            self._odometry.take_positions([left], [right], base.time)
        if base.bumped:
            self.logger.warning("the base pushes against something", throttle=5.0)
        stamp = self.now()
        self._tell_where(stamp)
        if p.imu and felt:
            self.imu.publish(imu_message(Header(stamp, p.imu_frame), mean(felt), p.imu_noise, self._random))

    def _tell_where(self, stamp: Time) -> None:
        p, base = self.parameters, self._base
        odometry = self._odometry.message(Header(stamp, p.odom_frame), p.base_frame)
        self.odometry.publish(odometry)
        if p.enable_odom_tf:
            moved = Transform3.from_message(odometry.pose.pose)
            self.frames.send(moved.to_stamped(odometry.header, odometry.child_frame_id))
        if p.ground_truth:
            self.truth.publish(truth_message(Header(stamp, p.world_frame), p.base_frame, base))
        if self._joints is not None:
            self._joints.publish(joint_state(Header(stamp), base))
        self._seen = _Seen(stamp, base.data.qpos.copy())

    def _say_where_sensors_are(self) -> None:
        header, places = Header(self.now(), self.parameters.base_frame), _places(self.parameters, self._base)
        if places:
            self.fixed_frames.send(*(place.to_stamped(header, frame) for frame, place in places.items()))


def _places(p: MujocoSim.Parameters, base: MujocoBase) -> dict[str, Transform3]:
    """Where in the base the sensors stand of which this node says it, by their frames."""
    places = {
        p.laser_frame: base.site(mjcf.LASER) if p.laser and p.publish_laser_tf else None,
        p.imu_frame: base.site(mjcf.IMU) if p.imu else None,
        p.camera_frame: base.camera(mjcf.CAMERA) if p.camera else None,
    }
    return {frame: place for frame, place in places.items() if place is not None}


def _laser_of(p: MujocoSim.Parameters, base: MujocoBase) -> MujocoLaser:
    return MujocoLaser(
        base, rays=p.rays, range_min=p.range_min, range_max=p.range_max, noise=p.range_noise, seed=p.seed
    )


if __name__ == "__main__":
    robo.run(MujocoSim)
