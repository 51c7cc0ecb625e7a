"""Stands between whoever commands the robot and its base."""

import math
import threading
from typing import Annotated, TypeVar

from msgspec import Meta

import robo
from robo import READ_ONLY, MessageInfo, Node, NotKept, Publisher, QoS, Unit, service, subscribe, timer
from robo_messages import DiagnosticStatus, KeyValue, LaserScan, Message, Odometry, Trigger, Twist
from robo_services.arrivals import Arrivals, Newest, Unstamped
from robo_services.safety import Action, Decision, Limits, Situation, decide

M = TypeVar("M", bound=Message)

PATIENCE = 3.0
"""Without any scan for so long after the start, it says what may be done, s."""

_LEVELS: dict[Action, int] = {
    "clear": DiagnosticStatus.OK,
    "slow": DiagnosticStatus.WARN,
    "stop": DiagnosticStatus.ERROR,
}


_EMERGENCY_STOP = "emergency_stop"

RIVAL_SHOWN = 1.0
"""How long after its last command somebody is named who commands the base too, s."""


class SafetyMonitor(Node):
    """Pass commands on while the way is free; slow down and stop for obstacles, and whenever in doubt.

    A timer decides, not the arrival of commands, so silence stops the robot too. Ages count from when
    a command or a scan was sent. An emergency stop holds until it is reset, also when this node ends and
    is started again; it waits for no other callback. Who else commands the base is named in the state.
    """

    class Parameters(robo.Parameters):
        """What is safe."""

        min_distance: Annotated[float, Meta(ge=0, description="stop for an obstacle this near"), Unit("m")] = 0.3
        warning_distance: Annotated[float, Meta(ge=0, description="slow down for one nearer than this"), Unit("m")] = (
            0.5
        )
        max_speed: Annotated[float, Meta(gt=0, description="faster commands are slowed down to it"), Unit("m/s")] = 1.0
        sector: Annotated[
            float,
            Meta(gt=0, le=2 * math.pi, description="angle around the motion in which obstacles count"),
            Unit("rad"),
        ] = 2.0
        scan_timeout: Annotated[float, Meta(ge=0.01, le=10, description="an older scan stops the robot"), Unit("s")] = (
            0.25
        )
        command_timeout: Annotated[
            float, Meta(ge=0.01, le=10, description="an older command stops the robot"), Unit("s")
        ] = 0.5
        unstamped: Unstamped = True
        rate: Annotated[float, Meta(ge=1, le=1000, description="decisions per second"), Unit("Hz")] = 50.0
        laser: Annotated[
            bool, Meta(description="false for a base without one: obstacles do not stop it, all else does"), READ_ONLY
        ] = True

    parameters: Parameters

    command = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    """What the base is to do: a command that is passed on or slowed down, m/s and rad/s; 0 to stand."""
    state = Publisher(DiagnosticStatus, "safety_state", latched=True)
    """What it has decided and why: on every change of the reason, and once a second."""

    def on_start(self) -> None:
        """Nothing is known yet, so nothing is safe; what was before a restart still holds."""
        self._arrivals = Arrivals(unstamped=self.parameters.unstamped)
        self._wall = self.clock.wall
        self._command: Newest[Twist] = Newest()
        self._scan: Newest[LaserScan] = Newest()
        self._speed: float | None = None
        self._emergency_stop = self.memory.lost or bool(self.memory.recall(_EMERGENCY_STOP))
        if self.memory.lost:
            text = "what was before this start is not known (%s): emergency stop, until reset_emergency_stop"
            self.logger.error(text, self.memory.problem)
        self._commanding = threading.Lock()
        """Who holds it commands the base, for no longer than a publish: the emergency stop has a turn of its own."""
        self._rival = self._last_rival = ""
        self._rival_time = -math.inf
        self._last: Decision | None = None
        self._last_state = -math.inf
        self._begin = self.clock.monotonic()
        self._advised = False

    @subscribe("cmd_vel_raw", qos=QoS.COMMAND)
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        """Remember the newest command and when it was sent."""
        self._take(self._command, twist, info)

    @subscribe("scan", depth=1)
    def on_scan(self, scan: LaserScan, info: MessageInfo) -> None:
        """Remember the newest scan and when it was sent."""
        self._take(self._scan, scan, info)

    @subscribe("cmd_vel", qos=QoS.COMMAND)
    def on_passed(self, _twist: Twist, info: MessageInfo) -> None:
        """Notice who else commands the base."""
        if info.source_id != self.command.id:
            sender = f"another {info.sender}" if info.source == self.full_name else info.sender
            self._rival, self._rival_time = sender, self._wall.monotonic()

    @subscribe("odom", depth=1)
    def on_odometry(self, odometry: Odometry) -> None:
        """Remember how fast the robot really is."""
        linear = odometry.twist.twist.linear
        self._speed = math.hypot(linear.x, linear.y)

    # Both in one turn: neither undoes half of the other. Beside the node's turn, which a decision, a large scan or
    # a line of the log may hold: all that they share with it is the flag, and who commands the base.
    @service("emergency_stop", turn="stop")
    def stop_at_once(self, _request: Trigger.Request) -> Trigger.Response:
        """Stop, and stay until `reset_emergency_stop`, whatever is commanded."""
        self._emergency_stop = True
        with self._commanding:
            self.command.publish(Twist())
        return Trigger.Response(message="stopped; call reset_emergency_stop to drive again" + self._keep(True))

    @service("reset_emergency_stop", turn="stop")
    def release(self, _request: Trigger.Request) -> Trigger.Response:
        """Let the robot drive again, once nothing else speaks against it."""
        remark = self._keep(False)
        was_stopped, self._emergency_stop = self._emergency_stop, False
        return Trigger.Response(message=("released" if was_stopped else "there was no emergency stop") + remark)

    def _keep(self, stopped: bool) -> str:
        """Keep over a restart whether there is an emergency stop. Returns what is to be said of it."""
        try:
            self.memory.keep(_EMERGENCY_STOP, stopped)
        except NotKept as error:
            self.logger.error("an emergency stop holds after a restart in any case: %s", error)
            return "; a restart of the safety monitor stops the robot, since this cannot be written down"
        return ""

    def _take(self, newest: Newest[M], message: M, info: MessageInfo) -> None:
        now = self.clock.monotonic()
        newest.take(message, self._arrivals.sent(info, now, self._wall.monotonic()), now)

    @timer(rate="rate")
    def guard(self) -> None:
        """Decide, and tell the base."""
        now = self.clock.monotonic()
        p = self.parameters
        if not p.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), 1.0 / p.rate)
        situation = Situation(
            command=self._command.message,
            command_age=self._command.age(now),
            scan=self._scan.message,
            scan_age=self._scan.age(now),
            speed=self._speed,
            emergency_stop=self._emergency_stop,
        )
        limits = Limits(
            min_distance=p.min_distance,
            warning_distance=p.warning_distance,
            max_speed=p.max_speed,
            sector=p.sector,
            scan_timeout=p.scan_timeout,
            command_timeout=p.command_timeout,
            laser=p.laser,
        )
        decision = decide(situation, limits)
        with self._commanding:
            if decision.action == "stop" or self._emergency_stop:  # which may have come since it was looked at
                self.command.publish(Twist())
            else:
                # Whoever receives it counts its age from when it was commanded: timeouts of a chain do not add up.
                self.command.publish(decision.twist, situation.command_age)
        self._report(decision, now)

    def _report(self, decision: Decision, now: float) -> None:
        """Publish the state on every change of cause and once a second; log the changes."""
        changed = self._last is None or decision.reason != self._last.reason
        if changed:
            log = self.logger.warning if decision.action == "stop" else self.logger.info
            log("%s: %s", decision.action, decision.text)
        rival = self._rival if self._wall.monotonic() - self._rival_time < RIVAL_SHOWN else ""
        if rival != self._last_rival:
            changed, self._last_rival = True, rival
            if rival:
                # Told once a minute of each, who may come and go; the state says it all the time.
                text = f"{rival} commands the base too, past this monitor, on %s"
                self.logger.warning(text, self.command.topic, throttle=60.0)
        if changed or not 0.0 <= now - self._last_state < 1.0:  # simulated time may step back
            self._last_state = now
            values = [KeyValue("action", decision.action), KeyValue("reason", decision.reason)]
            level, text = _LEVELS[decision.action], decision.text
            if rival:
                values.append(KeyValue("rival", rival))
                level, text = max(level, DiagnosticStatus.WARN), f"{text}; {rival} commands the base too"
            self.state.publish(DiagnosticStatus(level, self.full_name, text, values=values))
        self._last = decision
        if decision.reason == "no_scan" and not self._advised and now - self._begin > PATIENCE:
            self._advised = True
            self.logger.warning(
                "still no laser scan on %s, so the robot stands: start what publishes it or, where the base has no "
                "laser, set laser to false (docs/own_base.md)",
                self.resolve("scan"),
            )

    def on_stop(self) -> None:
        """Leave the robot standing."""
        self.command.publish(Twist())


if __name__ == "__main__":
    robo.run(SafetyMonitor)
