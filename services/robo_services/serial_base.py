"""Drives a base whose board is on a serial port and speaks as ros_arduino_bridge does."""

import re
import threading
from typing import ClassVar

import robo
from robo import Health, MessageInfo, Node, Publisher, QoS, check, subscribe
from robo.tf import Transform3, TransformBroadcaster
from robo_messages import BatteryState, Header, JointState, Odometry, Twist
from robo_services.arduino_base import ArduinoBase, BoardError, BoardSilent, NotABoard, Settings
from robo_services.arduino_protocol import BYTES_PER_PERIOD, END_OF_GARBAGE, STOP
from robo_services.arrivals import Arrivals, Newest
from robo_services.board_port import place_of_board
from robo_services.drives import STANDING, Wheels
from robo_services.kinematics import Twist2
from robo_services.safety import is_finite
from robo_services.serial_parameters import SerialBaseParameters
from robo_services.serial_port import PortGone, SerialPort, import_serial
from robo_services.tick_odometry import TickOdometry
from robo_services.waiting import Waiting, is_readable

RETRY = 0.2
"""How long it waits before it looks for its port again, s."""
REFUSED = 5.0
"""How long it leaves what is no such board in peace, s."""
GOODBYE = 0.2
"""How long the board may take to confirm that it stands, when the node ends, s."""
SETTLING = 1.0
"""For so long after the start it is no news that nobody commands, s."""
STANDS = re.compile(rb"Invalid Command\r?\n(?s:.*)OK\r?\n")
"""What a board says to an end without a command, and to `STOP`: other words were answers to others."""
MANY = 0.05
"""A share of lines that cannot be read from which on the wire is bad."""


class SerialBase(Node):
    """Drive a base with two wheels by the board on a serial port: speeds down, encoders up, odometry from ticks.

    A port that is not there is waited for, and one that was unplugged is taken again when it is back; the pose goes on.
    The board is told a speed in each period, so that its own watchdog stops the wheels when it is told none any more,
    and to stand when commands end. What does not answer as such a board is refused, and what it said is told.
    """

    REQUIRES: ClassVar = {"serial": "robo-zenoh[serial]"}

    Parameters = SerialBaseParameters
    parameters: SerialBaseParameters

    odometry = Publisher(Odometry, "odom")
    """Where the base is by its wheels and how fast it moves, whenever its board has said how far they turned."""
    frames = TransformBroadcaster()

    _waiting: Waiting | None = None

    def on_start(self) -> None:
        """No port is open yet."""
        import_serial()  # what cannot work is said at once
        p = self.parameters
        self._drive = p.drive()
        self._track = TickOdometry(self._drive, p.ticks_per_revolution, bits=p.counter_bits, noise=p.noise)
        self._base = ArduinoBase(
            Settings(
                period=1.0 / p.rate,
                loop_period=p.loop_period,
                trim=p.trim,
                gains=p.gains,
                battery_pin=p.battery_pin,
                start_limit=p.start_timeout,
                silence_limit=p.answer_timeout,
            ),
            self._track,
        )
        self._joints = self.create_publisher(JointState, "joint_states") if p.joint_states else None
        self._battery = self.create_publisher(BatteryState, "battery") if p.battery_pin >= 0 else None
        self._wall = self.clock.wall
        self._lock = threading.Lock()
        """Commands come on another thread than the one that drives."""
        self._arrivals = Arrivals(unstamped=p.unstamped)
        self._command: Newest[Twist] = Newest()
        self._refused = 0
        self._hindrance = ""
        self._trouble = "nobody has looked for it yet"
        """Why there is no board; empty if there is one."""
        self._kind = ""
        self._spoiled_before = self._readings_before = 0
        self._begin = self._wall.monotonic()
        self._waiting = Waiting()

    @subscribe("cmd_vel", qos=QoS.COMMAND, sole_source="command_source")
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        """Remember the newest command and when it was sent; with one that is not finite the wheels stand."""
        if not is_finite(twist):
            self._refused += 1
            text = "the wheels stand: a command holds NaN or an infinity, %d so far"
            self.logger.warning(text, self._refused, throttle=5.0)
            twist = Twist()
        now = self._wall.monotonic()  # the wheels are real, and roll on where simulated time stands still
        with self._lock:
            self._command.take(twist, self._arrivals.sent(info, now, now), now)

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node: wakes what waits for the port."""
        super().shutdown(exit_code)
        if self._waiting is not None:
            self._waiting.wake()

    def main(self) -> None:
        """Drive, whenever there is a board."""
        while not self.stopping:
            pause = RETRY
            try:
                p = self.parameters
                port = SerialPort(place_of_board(p.port, p.usb_id), p.baud)
            except PortGone as error:
                self._misses(f"no board: {error}; it is waited for")
                self._wait([], pause)
                continue
            try:
                self._drive_at(port)
            except NotABoard as error:
                pause = REFUSED
                self._misses(f"{port.path} has no such board: {error}", f"{port.path} {error.why}")
            except (BoardError, PortGone) as error:
                self._loses(error)
            finally:
                port.close()
            self._wait([], pause)

    @check("board")
    def board_answers(self) -> Health:
        """Whether there is a board that answers, and how well."""
        base, track = self._base, self._track
        counts = base.counts
        spoiled = counts.unread + counts.invalid
        unread, readings = spoiled - self._spoiled_before, counts.readings - self._readings_before
        self._spoiled_before, self._readings_before = spoiled, counts.readings
        if self._trouble:
            return Health.error(self._trouble)
        if base.fault:
            return Health.error(f"the wheels stand: {base.fault}")
        values = {
            "readings": counts.readings,
            "unread": counts.unread,
            "invalid": counts.invalid,
            "refused": track.refused,
            "resets": track.resets,
        }
        if unread > MANY * (unread + readings):
            text = f"{unread} of {unread + readings} lines cannot be read, or the board could not: look at the cable"
            return Health.warn(text, **values)
        return Health.ok(**values)

    def _drive_at(self, port: SerialPort) -> None:
        """Talk to whoever is at a port, until the node ends.

        A board that falls silent is asked anew on the same port: opening it anew would have many begin anew.

        Raises:
            BoardError: it is no such board, or stays silent.
            PortGone: it was unplugged.
        """
        base = self._base
        base.begin(self._wall.monotonic())
        try:
            while not self.stopping:
                now = self._wall.monotonic()
                try:
                    said = base.say(now, self._wanted(now))
                except BoardSilent as error:
                    self._loses(error)
                    self._stand(port)
                    base.begin(self._wall.monotonic(), again=True)
                    continue
                if said:
                    port.write(said, backlog=BYTES_PER_PERIOD)
                if port.fd in self._wait([port.fd], base.due - now):
                    moved = base.feed(port.read(), self._wall.monotonic())
                    self._tell_log(port)
                    if moved:
                        self._tell()
        finally:
            if base.is_known:
                self._stand(port)

    def _stand(self, port: SerialPort) -> None:
        """Have the wheels stand, if the board still listens."""
        try:
            port.discard()  # what has not left yet says how to drive
            port.write(END_OF_GARBAGE + STOP)
            end = self._wall.monotonic() + GOODBYE
            heard = b""
            while not STANDS.search(heard) and self._wall.monotonic() < end:
                if is_readable(port.fd, end - self._wall.monotonic()):
                    heard += port.read()
        except PortGone:
            return

    def _wanted(self, now: float) -> Wheels:
        """What the wheels have to do now, rad/s."""
        p = self.parameters
        with self._lock:
            self._arrivals.tick(now, 1.0 / p.rate)
            command, age = self._command.message, self._command.age(now)
        fresh = command is not None and age <= p.cmd_vel_timeout
        if self._base.is_known:
            self._say(self._base.fault if fresh else f"no command on {self.resolve('cmd_vel')}", now)
        twist = Twist2(command.linear.x, command.angular.z) if command is not None and fresh else STANDING
        return self._drive.wheels(twist)

    def _say(self, hindrance: str, now: float) -> None:
        if hindrance == self._hindrance or (hindrance and now - self._begin < SETTLING):
            return
        self._hindrance = hindrance
        if hindrance:
            self.logger.warning("the wheels stand: %s", hindrance)
        else:
            self.logger.info("the wheels follow %s", self.resolve("cmd_vel"))

    def _loses(self, error: OSError | BoardError) -> None:
        text = f"the board is gone: {error}; it is waited for, and stands by its own watchdog"
        self._misses(text, error.why if isinstance(error, BoardError) else text)

    def _misses(self, trouble: str, kind: str = "") -> None:
        """Tell of it once, however long it lasts; what it said last, in the same kind of trouble, is no news."""
        kind = kind or trouble
        is_news = kind != self._kind
        self._trouble, self._kind = trouble, kind
        if is_news:
            self.logger.warning("%s", trouble)

    def _tell_log(self, port: SerialPort) -> None:
        """What is to be said of what the board has said."""
        base = self._base
        if base.is_known and self._trouble:
            self._trouble = self._kind = ""
            self.logger.info("drives the board at %s", port.path)
        while base.unread:
            text = "cannot read %r of the board, %d such lines so far; it is asked again"
            self.logger.warning(text, base.unread.popleft(), base.counts.unread, throttle=5.0)
        while base.resets:
            text = (
                "the board has begun anew, it %s, or the wheels turn faster than max_wheel_velocity; the pose goes on"
            )
            self.logger.warning(text, base.resets.popleft(), throttle=5.0)

    def _tell(self) -> None:
        """Publish where the wheels have led."""
        p = self.parameters
        header = Header(self.now(), p.odom_frame_id)
        self._track.track.noise = p.noise
        odometry = self._track.message(header, p.base_frame_id)
        self.odometry.publish(odometry)
        if p.enable_odom_tf:
            stands = Transform3.from_message(odometry.pose.pose)
            self.frames.send(stands.to_stamped(header, odometry.child_frame_id))
        if self._joints is not None:
            turned, rates = self._track.turned[:2], self._track.rates[:2]
            names = [p.left_wheel_name, p.right_wheel_name]
            self._joints.publish(JointState(Header(header.stamp), names, [*turned], [*rates]))
        if self._battery is not None and self._base.battery is not None:
            volts, self._base.battery = self._base.battery / 1023.0 * p.battery_full_scale, None
            self._battery.publish(BatteryState(header=Header(header.stamp), voltage=volts, present=True))

    def _wait(self, fds: list[int], timeout: float) -> list[int]:
        """Wait until one can be read, or the node is told to stop."""
        assert self._waiting is not None
        return self._waiting.wait(fds, timeout)

    def on_stop(self) -> None:
        """Give back what woke it."""
        if self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            waiting.close()


if __name__ == "__main__":
    robo.run(SerialBase)
