"""Plays the board of a base on a pseudo-terminal, for a desk without one; and what may go wrong with it."""

import threading
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

import robo
from robo import READ_ONLY, Health, Node, Publisher, Unit, check, service, timer
from robo.errors import RunError
from robo_messages import Header, JointState, Odometry, Trigger
from robo_services.board import Board, BoardSpec, Wire
from robo_services.drives import DiffDrive
from robo_services.pseudo_terminal import PseudoTerminal
from robo_services.uncertainty import PoseCovariance
from robo_services.waiting import Waiting
from robo_services.wheel_odometry import LEAST_VARIANCE, odometry_message

IDLE = 0.005
"""The board's time goes on at least so often, s."""
PULLING = 1.0
"""Its cable is out within this time, s, or there is nobody who plays it."""
LONGEST_STEP = 0.5
"""A process that was held up makes up for no more than this, s."""


class EmulatedBoard(Node):
    """Be the board that `serial_base` talks to: motors with inertia, encoders, the firmware's loop and its watchdog.

    Its port is a pseudo-terminal with a link to it, such as /tmp/robo_board. Its wire may garble lines or cut them off;
    services reset it, unplug it and plug it in again. Where it truly is, it tells too.
    """

    class Parameters(robo.Parameters):
        """The board, its motors, and what is wrong with its wire."""

        link: Annotated[
            str,
            Meta(min_length=1, description="where its port is to be found; a link to the pseudo-terminal"),
            READ_ONLY,
        ] = "/tmp/robo_board"
        seed: Annotated[
            int, Meta(description="what its chances begin from: the same seed, the same chances"), READ_ONLY
        ] = 0
        ticks_per_revolution: Annotated[
            float, Meta(ge=1, le=1e7, description="what an encoder counts in a revolution of its wheel"), READ_ONLY
        ] = 1440.0
        counter_bits: Annotated[
            Literal[16, 32], Meta(description="of a counter, which then begins anew"), READ_ONLY
        ] = 32
        wheel_separation: Annotated[
            float, Meta(ge=0.001, le=100, description="between the wheels, truly"), Unit("m"), READ_ONLY
        ] = 0.3
        wheel_radius: Annotated[
            float, Meta(ge=0.001, le=100, description="of the wheels, truly"), Unit("m"), READ_ONLY
        ] = 0.05
        max_wheel_velocity: Annotated[
            float,
            Meta(ge=0.01, le=10_000, description="of a wheel with all that its motor gets"),
            Unit("rad/s"),
            READ_ONLY,
        ] = 20.0
        inertia: Annotated[
            float,
            Meta(ge=0.001, le=10, description="a motor has 63 % of its speed after this time"),
            Unit("s"),
            READ_ONLY,
        ] = 0.1
        noise: Annotated[
            float,
            Meta(ge=0, le=0.5, description="standard deviation of a wheel's load, as a share of its speed"),
            READ_ONLY,
        ] = 0.02
        loop_period: Annotated[
            float,
            Meta(ge=0.001, le=1, description="of the firmware's loop: 1000 / 30 in whole ms"),
            Unit("s"),
            READ_ONLY,
        ] = 0.033
        watchdog: Annotated[
            float,
            Meta(ge=0.01, le=60, description="without a command for this long it stops; the firmware comes with 2 s"),
            Unit("s"),
            READ_ONLY,
        ] = 0.2
        starting: Annotated[
            float, Meta(ge=0, le=10, description="it says nothing for this long after a reset"), Unit("s"), READ_ONLY
        ] = 0.0
        power_by_usb: Annotated[
            bool, Meta(description="unplugged it has no power: its motors too stop, and it counts from 0 afterwards")
        ] = True
        dead_encoder: Annotated[
            Literal["none", "left", "right"], Meta(description="the encoder of this side counts no more")
        ] = "none"
        garbled: Annotated[
            float, Meta(ge=0, le=0.5, description="share of lines, both ways, in which a letter is another one")
        ] = 0.0
        cut: Annotated[float, Meta(ge=0, le=0.5, description="share of lines, both ways, whose end is missing")] = 0.0
        rate: Annotated[float, Meta(ge=1, le=200, description="messages per second"), Unit("Hz")] = 30.0
        world_frame: Annotated[str, Meta(min_length=1, description="the frame of its true pose"), READ_ONLY] = "world"
        base_frame: Annotated[str, Meta(min_length=1, description="the frame of its true velocities"), READ_ONLY] = (
            "base_link"
        )

    parameters: Parameters

    truth = Publisher(Odometry, "ground_truth")
    """Where it truly is and how fast it truly moves."""
    wheels = Publisher(JointState, "true_wheels")
    """How far its wheels have truly turned, rad, and how fast they turn, rad/s."""

    _waiting: Waiting | None = None

    def on_start(self) -> None:
        """Plug it in."""
        p = self.parameters
        self._board = Board(
            BoardSpec(
                drive=DiffDrive(
                    wheel_separation=p.wheel_separation,
                    wheel_radius=p.wheel_radius,
                    max_wheel_velocity=p.max_wheel_velocity,
                ),
                per_revolution=p.ticks_per_revolution,
                bits=p.counter_bits,
                loop_period=p.loop_period,
                watchdog=p.watchdog,
                inertia=p.inertia,
                noise=p.noise,
                starting=p.starting,
            ),
            p.seed,
        )
        self._wire = Wire(seed=p.seed + 1)
        self._lock = threading.Condition()
        """The board belongs to the thread that plays it; callbacks look and touch in between. Who waits for it waits
        until the cable is out.
        """
        self._wall = self.clock.wall
        self._played = self._wall.monotonic()
        self._link = Path(p.link)
        self._terminal: PseudoTerminal | None = None
        self._is_pulled = False
        self._plug_in()
        self._waiting = Waiting()

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node: wakes what waits for words."""
        super().shutdown(exit_code)
        if self._waiting is not None:
            self._waiting.wake()

    def main(self) -> None:
        """Let the board's time pass, and have it hear and answer."""
        while not self.stopping:
            assert self._waiting is not None
            with self._lock:
                terminal = self._terminal
            ready = self._waiting.wait([] if terminal is None else [terminal.fd], IDLE)
            with self._lock:
                self._pass_time()
                if terminal is not None and ready:
                    self._converse(terminal)
                if self._is_pulled:  # here, where nobody waits for what is closed
                    self._pull_out()
                    self._lock.notify_all()

    @timer(rate="rate")
    def tell(self) -> None:
        """Publish the truth."""
        p = self.parameters
        with self._lock:
            self._pass_time()
            pose, twist, turned, rates = self._board.pose, self._board.twist, self._board.wheels, self._board.rates
        header = Header(self.now(), p.world_frame)
        certain = LEAST_VARIANCE, LEAST_VARIANCE
        self.truth.publish(odometry_message(header, p.base_frame, pose, twist, PoseCovariance(), certain))
        names = ["left_wheel_joint", "right_wheel_joint"]
        self.wheels.publish(JointState(Header(header.stamp), names, [*turned[:2]], [*rates[:2]]))

    @service("reset_board")
    def reset_board(self, _request: Trigger.Request) -> Trigger.Response:
        """Press its button: it counts from 0, and has forgotten everything; it stays where it is."""
        with self._lock:
            self._pass_time()
            self._board.reset()
        return Trigger.Response(message="it begins anew")

    @service("unplug")
    def unplug(self, _request: Trigger.Request) -> Trigger.Response:
        """Pull its cable; without power by USB it goes on by its battery."""
        with self._lock:
            self._pass_time()
            if self.parameters.power_by_usb:
                self._board.reset()  # nobody turns its motors any more
            self._is_pulled = True
            is_out = self._lock.wait_for(lambda: self._terminal is None, PULLING)
        return Trigger.Response(success=is_out, message=f"{self._link} is {'gone' if is_out else 'still there'}")

    @service("replug")
    def replug(self, _request: Trigger.Request) -> Trigger.Response:
        """Plug it in again; it begins anew where it has its power by USB."""
        with self._lock:
            self._is_pulled = False
            if self._terminal is None:
                self._pass_time()
                if self.parameters.power_by_usb:
                    self._board.reset()
                self._plug_in()
        return Trigger.Response(message=f"{self._link} is there")

    @check("cable")
    def cable(self) -> Health:
        """Whether it is plugged in."""
        with self._lock:
            encoders, spoiled = self._board.encoders, self._wire.spoiled
            values = {"left": encoders.left, "right": encoders.right, "spoiled": spoiled}
            return Health.warn("unplugged", **values) if self._terminal is None else Health.ok(**values)

    def _pass_time(self) -> None:
        now = self._wall.monotonic()
        self._board.fail_encoder(self.parameters.dead_encoder)
        self._board.advance(min(now - self._played, LONGEST_STEP))
        self._played = now

    def _converse(self, terminal: PseudoTerminal) -> None:
        self._wire.garbled, self._wire.cut = self.parameters.garbled, self.parameters.cut
        self._board.receive(self._wire.passes(terminal.read()))
        said = self._wire.passes(self._board.said())
        if terminal.write(said) < len(said):
            self.logger.warning("nobody reads what it says", throttle=5.0)

    def _plug_in(self) -> None:
        """Make its port.

        Raises:
            RunError: there is something else at the link's place, or no link can be made.
        """
        try:
            self._terminal = PseudoTerminal(self._link)
        except OSError as error:
            raise RunError(f"no link {self._link} can be made: {error.strerror}") from None
        self.logger.info("%s is its port", self._link)

    def _pull_out(self) -> None:
        terminal, self._terminal = self._terminal, None
        if terminal is not None:
            terminal.unplug()

    def on_stop(self) -> None:
        """Take it away."""
        self._pull_out()
        if self._waiting is not None:
            waiting, self._waiting = self._waiting, None
            waiting.close()


if __name__ == "__main__":
    robo.run(EmulatedBoard)
