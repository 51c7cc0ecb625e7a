"""Lets one of several commanders drive: a joystick before the autonomy, and nobody while a lock is closed."""

from functools import partial
from typing import Annotated

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, ContractError, Health, MessageInfo, Node, Publisher, QoS, Subscribes, Unit, check, timer
from robo_messages import Bool, DiagnosticStatus, KeyValue, Twist
from robo_services.arrivals import Arrivals, Newest, Unstamped
from robo_services.mux import Choice, Input, Lock, choose
from robo_services.safety import is_finite

Priority = Annotated[int, Meta(ge=0, le=255, description="the highest one drives")]


class InputParameters(msgspec.Struct, frozen=True):
    """Who may drive."""

    topic: Annotated[str, Meta(description="where its commands come from"), Subscribes(Twist), READ_ONLY]
    priority: Priority
    timeout: Annotated[float, Meta(ge=0.01, le=10, description="an older command is none"), Unit("s")] = 0.5
    sole: Annotated[
        bool, Meta(description="one sender at a time: the next one half a second after the last has ended"), READ_ONLY
    ] = False


class LockParameters(msgspec.Struct, frozen=True):
    """What may keep others out."""

    topic: Annotated[str, Meta(description="says true to close it, false to open it"), Subscribes(Bool), READ_ONLY]
    priority: Annotated[int, Meta(ge=0, le=255, description="inputs of a lower one are kept out")]
    timeout: Annotated[
        float,
        Meta(ge=0, le=3600, description="not heard for so long it is closed; 0: it is closed only where it says so"),
        Unit("s"),
    ] = 0.5


class TwistMux(Node):
    """Pass on the commands of whoever has the highest priority and has commanded lately; one 0 when he ends.

    Each command goes on as it comes, with its age. Where the one who drove ends or is locked out, the base is told once
    to stand, and then nothing until somebody else commands: whoever is behind sees that nobody drives.
    """

    class Parameters(robo.Parameters):
        """Who may drive, and what may forbid it."""

        topics: dict[str, InputParameters] = msgspec.field(default_factory=dict)
        locks: dict[str, LockParameters] = msgspec.field(default_factory=dict)
        unstamped: Unstamped = True
        rate: Annotated[
            float, Meta(ge=1, le=1000, description="how often it looks whether somebody has ended"), Unit("Hz")
        ] = 50.0

    parameters: Parameters

    command = Publisher(Twist, "cmd_vel_out", qos=QoS.COMMAND)
    """The command of who drives, m/s and rad/s; one 0 when nobody does any more."""
    state = Publisher(DiagnosticStatus, "mux_state", latched=True)
    """Who drives, why, and since when: on every change, and once a second."""

    def on_start(self) -> None:
        """Nobody has commanded yet, and no lock has been heard."""
        p = self.parameters
        self._arrivals = Arrivals(unstamped=p.unstamped)
        self._wall = self.clock.wall
        self._commands: dict[str, Newest[Twist]] = {name: Newest() for name in p.topics}
        self._closed: dict[str, Newest[Bool]] = {name: Newest() for name in p.locks}
        self._refused: dict[str, int] = dict.fromkeys(p.topics, 0)
        self._choice: Choice | None = None
        self._is_driving = False
        self._since = self.now()
        self._last_state = self.clock.monotonic()
        self._refuse_mixed_up_topics()
        for name, said in p.topics.items():
            sole = _whoever if said.sole else None
            self.create_subscription(
                Twist, said.topic, partial(self.on_command, name), qos=QoS.COMMAND, sole_source=sole
            )
        for name, lock in p.locks.items():
            self.create_subscription(Bool, lock.topic, partial(self.on_lock, name), depth=1)
        if not p.topics:
            self.logger.warning("nobody may drive: name inputs in the parameter topics (docs/driving.md)")

    def _refuse_mixed_up_topics(self) -> None:
        """Each input has a topic of its own, and none is what the mux says itself: it would hear itself for ever."""
        taken = {self.resolve("cmd_vel_out"): "the output of the mux"}
        for name, said in self.parameters.topics.items():
            key = self.resolve(said.topic)
            if key in taken:
                raise ContractError(f"{self.full_name}: topics.{name}.topic is {key}, and so is {taken[key]}")
            taken[key] = f"topics.{name}.topic"

    def on_command(self, name: str, twist: Twist, info: MessageInfo) -> None:
        """Pass a command on if its sender drives; one that is not finite counts as silence."""
        if not is_finite(twist):
            self._refused[name] += 1
            text = "ignored a command of %s that holds NaN or an infinity, %d so far"
            self.logger.warning(text, name, self._refused[name], throttle=5.0)
            return
        now = self.clock.monotonic()
        sent = self._arrivals.sent(info, now, self._wall.monotonic())
        newest = self._commands[name]
        newest.take(twist, sent, now)
        self._decide(now)
        if newest.message is twist and self._choice is not None and self._choice.driver == name:
            self._is_driving = True
            self.command.publish(twist, newest.age(self.clock.monotonic()))

    def on_lock(self, name: str, closed: Bool, info: MessageInfo) -> None:
        """Take note of a lock, and act on it at once."""
        now = self.clock.monotonic()
        self._closed[name].take(closed, self._arrivals.sent(info, now, self._wall.monotonic()), now)
        self._decide(now)

    @timer(rate="rate")
    def watch(self) -> None:
        """See who has ended, and say who drives."""
        now = self.clock.monotonic()
        if not self.parameters.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), 1.0 / self.parameters.rate)
        self._decide(now)
        if not 0.0 <= now - self._last_state < 1.0:  # simulated time may step back
            self._report(now)

    def _decide(self, now: float) -> None:
        """See who drives now; who does no longer leaves the base standing."""
        p = self.parameters
        inputs = {
            name: Input(said.priority, said.timeout, self._commands[name].age(now)) for name, said in p.topics.items()
        }
        locks = {name: self._lock(name, said, now) for name, said in p.locks.items()}
        last, choice = self._choice, choose(inputs, locks)
        self._choice = choice
        if last is None or (last.driver, last.reason, last.lock) != (choice.driver, choice.reason, choice.lock):
            if last is None or last.driver != choice.driver:
                self._since = self.now()
            log = self.logger.info if choice.reason != "locked" else self.logger.warning
            log("%s", choice.text)
            self._report(now)
        if last is not None and last.driver not in ("", choice.driver):
            self._leave(inputs[last.driver], inputs.get(choice.driver))

    def _leave(self, left: Input, follower: Input | None) -> None:
        """Leave the base standing, but where somebody takes over whose commands come first."""
        if self._is_driving and (follower is None or follower.priority <= left.priority):
            self._is_driving = False
            self.command.publish(Twist())

    def _lock(self, name: str, said: LockParameters, now: float) -> Lock:
        heard = self._closed[name]
        closed = heard.message is not None and heard.message.data
        return Lock(said.priority, said.timeout, closed, heard.age(now))

    def _report(self, now: float) -> None:
        """Publish who drives."""
        assert self._choice is not None
        self._last_state = now
        choice = self._choice
        values = [
            KeyValue("driver", choice.driver),
            KeyValue("reason", choice.reason),
            KeyValue("since", f"{self._since.to_seconds():.3f}"),
            KeyValue("lock", choice.lock),
        ]
        values += [KeyValue(f"age.{name}", f"{one.age(now):.3f}") for name, one in self._commands.items()]
        level = DiagnosticStatus.WARN if choice.reason == "locked" else DiagnosticStatus.OK
        self.state.publish(DiagnosticStatus(level, self.full_name, choice.text, values=values))

    @check("driver")
    def somebody_may_drive(self) -> Health:
        """Whether a lock keeps anybody out; that nobody wants to drive is no fault."""
        if self._choice is None:
            return Health.ok()
        level = Health.warn if self._choice.reason == "locked" else Health.ok
        return level(self._choice.text, driver=self._choice.driver, refused=sum(self._refused.values()))

    def on_stop(self) -> None:
        """Leave the robot standing, if it was this node that had it drive."""
        if self._is_driving:
            self.command.publish(Twist())


def _whoever() -> str:
    """Of an input for one sender at a time: the first one that comes, whatever it is called."""
    return ""


if __name__ == "__main__":
    robo.run(TwistMux)
