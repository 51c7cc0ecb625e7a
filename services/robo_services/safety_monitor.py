"""Stands between whoever commands the robot and its base."""

import math
import threading
from collections.abc import Set

import msgspec

import robo
from robo import Health, MessageInfo, Node, NotKept, Publisher, QoS, check, service, subscribe, timer
from robo_messages import (
    Bool,
    DiagnosticStatus,
    Joy,
    KeyValue,
    LaserScan,
    MarkerArray,
    Odometry,
    Trigger,
    Twist,
)
from robo_services.arrivals import Arrivals, Newest
from robo_services.safety import NO_LASER, Action, Decision, Limits, Situation, decide
from robo_services.safety_parameters import LASER, SafetyParameters, limits_of
from robo_services.safety_sources import Motion, Sources
from robo_services.zone_markers import markers_of

PATIENCE = 3.0
"""Without any scan for so long after the start, it says what may be done, s."""

_LEVELS: dict[Action, int] = {
    "clear": DiagnosticStatus.OK,
    "slow": DiagnosticStatus.WARN,
    "limit": DiagnosticStatus.WARN,
    "approach": DiagnosticStatus.WARN,
    "stop": DiagnosticStatus.ERROR,
}

_IDLE = ("no_command", "stale_command")
"""Why it stops a robot that is not to drive."""
_IN_THE_WAY = ("obstacle", "blind")
"""Why it stops one that is well."""

_EMERGENCY_STOP = "emergency_stop"
_LASER_HEARD = "laser_heard"

PRESSES = 100
"""Messages of what may be an emergency stop that wait: what comes after one must not take its place."""

FADING = 0.95
"""What is left of how late decisions came, with each one in time: within a second hardly anything."""

MOST_LATE = 1.0
"""Decisions that come later are counted as so late, s: time was set, or the process was stopped."""

RIVAL_SHOWN = 1.0
"""How long after its last command somebody is named who commands the base too, s."""


class SafetyMonitor(Node):
    """Pass commands on while the way is free; slow down and stop for obstacles, and whenever in doubt.

    A timer decides, not the arrival of commands, so silence stops the robot too. Ages count from when
    a command or a scan was sent. An emergency stop holds until it is reset, also when this node ends and
    is started again; it waits for no other callback. Who else commands the base is named in the state.
    """

    Parameters = SafetyParameters
    parameters: SafetyParameters

    command = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    """What the base is to do: a command that is passed on or slowed down, m/s and rad/s; 0 to stand."""
    state = Publisher(DiagnosticStatus, "safety_state", latched=True)
    """What it has decided and why: on every change of action, reason, zone or source, and once a second."""
    shown = Publisher(MarkerArray, "safety_zones", latched=True)
    """Footprint and zones, to be looked at: at the start, and when they are changed."""

    def on_start(self) -> None:
        """Nothing is known yet, so nothing is safe; what was before a restart still holds."""
        self._arrivals = Arrivals(unstamped=self.parameters.unstamped)
        self._wall = self.clock.wall
        self._command: Newest[Twist] = Newest()
        self._motion = Motion()
        self._sources = Sources(self, lambda: self.parameters, self._arrivals, self._motion)
        self._speed: float | None = None
        self._emergency_stop = self.memory.lost or bool(self.memory.recall(_EMERGENCY_STOP))
        if self.memory.lost:
            text = "what was before this start is not known (%s): emergency stop, until reset_emergency_stop"
            self.logger.error(text, self.memory.problem)
        self._laser_heard = self.memory.lost or bool(self.memory.recall(_LASER_HEARD))
        self._commanding = threading.Lock()
        """Who holds it commands the base, for no longer than a publish: the emergency stop has a turn of its own."""
        self._rival = self._last_rival = ""
        self._rival_time = -math.inf
        self._last: Decision | None = None
        self._last_state = -math.inf
        self._begin = self.clock.monotonic()
        self._advised = False
        self._decided, self._late, self._jumps = self._begin, 0.0, self.clock.jumps
        self._limit()
        # Not declared: a robot on which nobody publishes them lacks nothing.
        self.create_subscription(Bool, "emergency_stop", self._on_emergency_stop, depth=PRESSES, turn="stop")
        if self.parameters.emergency_button >= 0:
            self.create_subscription(Joy, "joy", self._on_joy, depth=PRESSES, turn="stop")

    def on_parameters_changed(self, _names: Set[str]) -> None:
        """Decide by the new ones from now on, and show the zones anew."""
        self._limit()

    def _limit(self) -> None:
        self._limits = limits_of(self.parameters, laser_heard=self._laser_heard)
        self.shown.publish(markers_of(self._limits, self.parameters.base_frame))

    @subscribe("cmd_vel_raw", qos=QoS.COMMAND)
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        """Remember the newest command and when it was sent."""
        now = self.clock.monotonic()
        self._command.take(twist, self._arrivals.sent(info, now, self._wall.monotonic()), now)

    @subscribe("scan", depth=1)
    def on_scan(self, scan: LaserScan, info: MessageInfo) -> None:
        """Remember the newest scan and when it was sent."""
        self._sources.take(LASER, scan, info)
        if not (self._laser_heard or self.parameters.wait_for_laser):
            self._laser_heard = True  # so there is one; without it the robot stands from now on
            self._keep(_LASER_HEARD, True)
            self._limit()

    @subscribe("cmd_vel", qos=QoS.COMMAND)
    def on_passed(self, _twist: Twist, info: MessageInfo) -> None:
        """Notice who else commands the base."""
        if info.source_id != self.command.id:
            sender = f"another {info.sender}" if info.source == self.full_name else info.sender
            self._rival, self._rival_time = sender, self._wall.monotonic()

    @subscribe("odom", depth=1)
    def on_odometry(self, odometry: Odometry, info: MessageInfo) -> None:
        """Remember how the robot really moves."""
        twist, now = odometry.twist.twist, self.clock.monotonic()
        self._notice_jump()
        self._speed = math.hypot(twist.linear.x, twist.linear.y)
        self._motion.measured(twist, self._arrivals.sent(info, now, self._wall.monotonic()))

    # Both in one turn: neither undoes half of the other. Beside the node's turn, which a decision, a large scan or
    # a line of the log may hold: all that they share with it is the flag, and who commands the base.
    @service("emergency_stop", turn="stop")
    def stop_at_once(self, _request: Trigger.Request) -> Trigger.Response:
        """Stop, and stay until `reset_emergency_stop`, whatever is commanded."""
        return Trigger.Response(message="stopped; call reset_emergency_stop to drive again" + self._latch())

    def _on_emergency_stop(self, pressed: Bool, info: MessageInfo) -> None:
        if pressed.data:  # false says nothing, and never releases it
            self._latch_once(f"by {info.sender}")

    def _on_joy(self, joy: Joy, info: MessageInfo) -> None:
        button = self.parameters.emergency_button
        if button < len(joy.buttons) and joy.buttons[button]:
            self._latch_once(f"by button {button} of {info.sender}")

    def _latch_once(self, by: str) -> None:
        if not self._emergency_stop:
            self._latch()
            self.logger.warning("emergency stop %s, until reset_emergency_stop is called", by)

    def _latch(self) -> str:
        """Stop at once and remember it. Returns what is to be said of it."""
        self._emergency_stop = True
        with self._commanding:
            self.command.publish(Twist())
        return self._keep(_EMERGENCY_STOP, True)

    @service("reset_emergency_stop", turn="stop")
    def release(self, _request: Trigger.Request) -> Trigger.Response:
        """Let the robot drive again, once nothing else speaks against it."""
        remark = self._keep(_EMERGENCY_STOP, False)
        was_stopped, self._emergency_stop = self._emergency_stop, False
        if was_stopped:
            self.logger.info("the emergency stop is released")
        return Trigger.Response(message=("released" if was_stopped else "there was no emergency stop") + remark)

    def _keep(self, what: str, holds: bool) -> str:
        """Keep something over a restart. Returns what is to be said of it."""
        try:
            self.memory.keep(what, holds)
        except NotKept as error:  # and so what was kept counts as lost then, which is an emergency stop
            self.logger.error("an emergency stop holds after a restart in any case: %s", error)
            return "; a restart of the safety monitor stops the robot, since this cannot be written down"
        return ""

    @timer(rate="rate")
    def guard(self) -> None:
        """Decide, and tell the base."""
        now = self.clock.monotonic()
        if not self.parameters.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), 1.0 / self.parameters.rate)
        self._notice_jump()
        rival = self._who_else()
        try:
            decision = decide(self._situation(now, rival), self._limits_now(now))
        except Exception as error:  # whatever it is, nobody knows then whether it is safe to drive
            self.logger.error("the decision failed", exception=error, throttle=5.0)
            decision = Decision("stop", "failed", f"the decision failed: {type(error).__name__}", Twist())
        with self._commanding:
            if decision.action == "stop" or self._emergency_stop:  # which may have come since it was looked at
                passed = Twist()
                self.command.publish(passed)
            else:
                passed = decision.twist
                # Whoever receives it counts its age from when it was commanded: timeouts of a chain do not add up.
                # By the time of now: a process that was stopped since it decided passes nothing old on as new.
                self.command.publish(passed, self._command.age(self.clock.monotonic()))
        self._motion.commanded(passed, now)
        self._report(decision, rival, now)

    def _situation(self, now: float, rival: str) -> Situation:
        """All that is known."""
        laser = self._sources.laser
        scan = laser.newest.message
        return Situation(
            command=self._command.message,
            command_age=self._command.age(now),
            scan=scan if isinstance(scan, LaserScan) else None,
            scan_age=laser.newest.age(now),
            scan_yaw=laser.yaw,
            speed=self._speed,
            velocity=self._motion.velocity,
            sightings=self._sources.sightings(now),
            emergency_stop=self._emergency_stop,
            rival=rival if self.parameters.on_rival == "stop" else "",
        )

    def _limits_now(self, now: float) -> Limits:
        """What is safe, with the longer reaction of decisions that come late: of a busy machine, or of much to see."""
        period = 1.0 / self.parameters.rate
        self._late = max(self._late * FADING, min(abs(now - self._decided) - period, MOST_LATE))
        self._decided = now
        limits = self._limits
        if limits.body is None or self._late < period:
            return limits
        body = msgspec.structs.replace(limits.body, reaction_time=limits.body.reaction_time + self._late)
        return msgspec.structs.replace(limits, body=body)

    def _notice_jump(self) -> None:
        """Simulated time was set: how the base has moved is known of another time."""
        if self.clock.jumps != self._jumps:
            self._jumps = self.clock.jumps
            self._motion.forget()

    def _who_else(self) -> str:
        """Who else commands the base of late."""
        return self._rival if self._wall.monotonic() - self._rival_time < RIVAL_SHOWN else ""

    def _report(self, decision: Decision, rival: str, now: float) -> None:
        """Publish the state on every change of cause, zone or source and once a second; log the changes of cause."""
        changed = self._last is None or _cause_of(decision) != _cause_of(self._last)
        if self._last is None or decision.reason != self._last.reason:
            is_grave = decision.action == "stop" or decision.reason == NO_LASER
            log = self.logger.warning if is_grave else self.logger.info
            log("%s: %s", decision.action, decision.text)
        if rival != self._last_rival:
            gone, changed, self._last_rival = self._last_rival, True, rival
            if not rival:
                self.logger.info("%s commands the base no more", gone)
            else:
                # Told once a minute of each, who may come and go; the state says it all the time.
                text = f"{rival} commands the base too, past this monitor, on %s"
                self.logger.warning(text, self.command.topic, throttle=60.0)
        if changed or not 0.0 <= now - self._last_state < 1.0:  # simulated time may step back
            self._last_state = now
            values = _values_of(decision)
            level, text = _LEVELS[decision.action], decision.text
            if rival:
                values.append(KeyValue("rival", rival))
                level = max(level, DiagnosticStatus.WARN)
                if decision.reason != "rival":
                    text = f"{text}; {rival} commands the base too"
            self.state.publish(DiagnosticStatus(level, self.full_name, text, values=values))
        self._last = decision
        if decision.reason == "no_scan" and not self._advised and now - self._begin > PATIENCE:
            self._advised = True
            self.logger.warning(
                "still no laser scan on %s, so the robot stands: start what publishes it or, where the base has no "
                "laser, set laser to false (docs/own_base.md)",
                self.resolve("scan"),
            )

    @check("safety")
    def nothing_speaks_against_driving(self) -> Health:
        """Whether the robot may drive; that nobody wants it to is no fault."""
        if self._last is None:
            return Health.ok()
        return health_of(self._last, self._who_else())

    def on_stop(self) -> None:
        """Leave the robot standing."""
        self.command.publish(Twist())


def health_of(decision: Decision, rival: str) -> Health:
    """What a decision says of the robot's health, and who commands the base too."""
    if rival and decision.reason != "rival":
        return Health.warn(f"{decision.text}; {rival} commands the base too", action=decision.action)
    if decision.action != "stop" or decision.reason in _IDLE:
        return Health.ok(decision.text, action=decision.action)
    level = Health.warn if decision.reason in _IN_THE_WAY else Health.error
    return level(decision.text, action=decision.action)


def _cause_of(decision: Decision) -> tuple[str, str, str, str]:
    return decision.action, decision.reason, decision.zone, decision.source


def _values_of(decision: Decision) -> list[KeyValue]:
    return [
        KeyValue("action", decision.action),
        KeyValue("reason", decision.reason),
        KeyValue("zone", decision.zone),
        KeyValue("source", decision.source),
        KeyValue("distance", _figure(decision.distance)),
        KeyValue("time_to_collision", _figure(decision.time_to_collision)),
    ]


def _figure(value: float) -> str:
    """In m or s; empty where nothing is in the way."""
    return f"{value:.3f}" if math.isfinite(value) else ""


if __name__ == "__main__":
    robo.run(SafetyMonitor)
