"""Drives a robot by the keys of a terminal."""

import atexit
import logging
import math
import sys
from collections import deque
from typing import Annotated, TypeVar

from msgspec import Meta

import robo
from robo import READ_ONLY, MessageInfo, Node, ParameterError, Publisher, QoS, Unit, subscribe
from robo.errors import RunError
from robo.node import log
from robo.text import colours
from robo.text.keyboard import KeyboardTerminal, NoTerminal
from robo_messages import DiagnosticStatus, LaserScan, Message, Odometry, Twist
from robo_services.arrivals import Arrivals, Newest
from robo_services.teleop import SPEEDS, Decoder, Kind, Operator, Speeds, Timing, adjusted, kind_of
from robo_services.teleop_screen import View, drawn, lines_of, nearest_of

M = TypeVar("M", bound=Message)

DRAWN_EVERY = 0.1
"""How often the screen is drawn, s; the loop never waits longer."""

HELD_UP = 0.15
"""A loop that is later than this was held up, s: what was typed meanwhile is old."""

ESCAPE_TIMEOUT = 0.05
"""How soon the rest of an escape sequence has to follow, s."""

SUSPENDED_AFTER = 0.3
"""How long it waits at most until others have heard that the robot is to stand, before Ctrl-Z stops it, s."""

MOST_NOTES = 100


class Notes(logging.Handler):
    """Keeps the lines of the log that would destroy the screen, and prints what matters of them once it is gone."""

    def __init__(self, logger: logging.Logger) -> None:
        super().__init__()
        self._logger = logger
        self._propagated = logger.propagate
        self._records: deque[logging.LogRecord] = deque(maxlen=MOST_NOTES)
        self.setFormatter(log.ConsoleFormatter(supervised=False, colour=False))
        logger.addHandler(self)
        logger.propagate = False

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it."""
        self._records.append(record)

    def newest(self, count: int) -> list[str]:
        """The newest lines."""
        self.acquire()
        try:
            records = list(self._records)[-count:]
        finally:
            self.release()
        return [self.format(record).partition("\n")[0] for record in records]

    def give_back(self) -> None:
        """Let the log go where it went, and print what it has warned of meanwhile."""
        self._logger.removeHandler(self)
        self._logger.propagate = self._propagated
        if self._propagated and self._logger.parent is not None:
            for record in self._records:
                if record.levelno >= logging.WARNING:
                    self._logger.parent.handle(record)
        self._records.clear()


class TeleopKeyboard(Node):
    """Drive while a key is held: w a s d, the arrows, or the keys around k; see the screen for all of them.

    A key counts as held for `first_key_timeout` after it has gone down, and for `key_timeout` after each repetition; a
    terminal tells no more. Then it says 0 once, and nothing after it, so that others may drive. Any key that has no
    meaning stops the robot. It needs a terminal: `robo run robo_services teleop_keyboard --robot-name r1`.
    """

    class Parameters(robo.Parameters):
        """How fast, and for how long a key counts."""

        speed: Annotated[float, Meta(ge=0, le=100, description="driving; keys change it"), Unit("m/s")] = 0.5
        turn: Annotated[float, Meta(ge=0, le=100, description="turning; keys change it"), Unit("rad/s")] = 1.0
        speed_limit: Annotated[float, Meta(ge=0, le=100, description="it drives no faster"), Unit("m/s")] = 1.0
        turn_limit: Annotated[float, Meta(ge=0, le=100, description="it turns no faster"), Unit("rad/s")] = 2.0
        key_timeout: Annotated[
            float, Meta(ge=0.02, le=2, description="a key that repeats counts as held for so long"), Unit("s")
        ] = 0.25
        first_key_timeout: Annotated[
            float,
            Meta(ge=0.02, le=2, description="likewise one that has gone down: longer than until its first repetition"),
            Unit("s"),
        ] = 0.7
        repeat_rate: Annotated[
            float, Meta(ge=1, le=100, description="commands per second while a key is held"), Unit("Hz")
        ] = 20.0
        terminal: Annotated[
            str, Meta(description="the device of the terminal; empty: the one that it is started in"), READ_ONLY
        ] = ""

    parameters: Parameters

    command = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    """How to drive, m/s and rad/s, while a key is held; one 0 after it, then nothing."""

    _terminal: KeyboardTerminal | None = None

    def on_start(self) -> None:
        """Find the terminal; its screen stays as it is until all else works."""
        if log.is_supervised():
            raise RunError(f"{self.full_name} needs a terminal, and what is launched has none; {_advice(self)}")
        try:
            self._terminal = KeyboardTerminal(self.parameters.terminal)
        except NoTerminal as error:
            raise RunError(f"{self.full_name} needs a terminal: {error}; {_advice(self)}") from None
        self._terminal.watch_signals()
        atexit.register(self._terminal.close)
        # Whoever holds a key lives by the wall clock, however fast a simulation goes.
        self._wall = self.clock.wall
        self._arrivals = Arrivals(unstamped=True)
        self._odometry: Newest[Odometry] = Newest()
        self._scan: Newest[LaserScan] = Newest()
        self._safety: Newest[DiagnosticStatus] = Newest()
        self._operator = Operator()
        self._keys = Decoder()
        self._typed = -math.inf
        self._said = Twist()
        self._colour = colours.shown_on(sys.stdout)

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node: wakes what waits for keys."""
        super().shutdown(exit_code)
        if self._terminal is not None:
            self._terminal.wake()

    @subscribe("odom", depth=1)
    def on_odometry(self, odometry: Odometry, info: MessageInfo) -> None:
        """Remember how fast the robot is, to show it."""
        self._take(self._odometry, odometry, info)

    @subscribe("scan", depth=1)
    def on_scan(self, scan: LaserScan, info: MessageInfo) -> None:
        """Remember what the laser sees, to show what is nearest."""
        self._take(self._scan, scan, info)

    @subscribe("safety_state", latched=True)
    def on_safety_state(self, state: DiagnosticStatus, info: MessageInfo) -> None:
        """Remember what the safety monitor says, to show it."""
        self._take(self._safety, state, info)

    def _take(self, newest: Newest[M], message: M, info: MessageInfo) -> None:
        now = self._wall.monotonic()
        newest.take(message, self._arrivals.sent(info, now, now), now)

    def main(self) -> None:
        """Read keys, command and draw, until it ends."""
        terminal, notes = self._terminal, Notes(self.logger.logger)
        assert terminal is not None
        try:
            terminal.enter()
            self._attend(terminal, notes)
        finally:
            terminal.leave()
            notes.give_back()

    def _attend(self, terminal: KeyboardTerminal, notes: Notes) -> None:
        now = self._wall.monotonic()
        command_due = draw_due = now
        while not self.stopping:
            until = draw_due if self._operator.silent else min(draw_due, command_due)
            if self._operator.held is not None:
                until = min(until, self._operator.held.until(self._timing()))
            begun = now
            heard = terminal.wait(min(until - now, ESCAPE_TIMEOUT if self._keys.pending else DRAWN_EVERY))
            now = self._wall.monotonic()
            if heard.closed:
                self.logger.warning("the terminal has gone")
                self.shutdown(self.exit_code)
                return
            if heard.suspend:
                self._suspend(terminal)
                now = self._wall.monotonic()
            elif heard.continued or now - begun > DRAWN_EVERY + HELD_UP:
                # This process stood still: nobody knows how old what was typed is, nor whether the key is held still.
                self._forget_keys(terminal, heard.data)
            elif self._hear(heard.data, now):
                command_due = now
            if now >= command_due or not self._is_held(now):
                self._say(now)
                command_due = max(command_due + 1.0 / self.parameters.repeat_rate, now)
            if now >= draw_due:
                self._draw(terminal, notes, now)
                draw_due = now + DRAWN_EVERY

    def _hear(self, data: bytes, now: float) -> bool:
        """Take what was typed. Returns whether it says something new, which is to be passed on at once."""
        before = self._operator.held
        if data:
            self._typed = now
        keys = self._keys.feed(data)
        if self._keys.pending and now - self._typed >= ESCAPE_TIMEOUT:
            keys += self._keys.flush()
        for key in keys:
            self._take_key(key, now)
        held = self._operator.held
        return bool(keys) and (held is None or before is None or held.key != before.key)

    def _take_key(self, key: str, now: float) -> None:
        kind = kind_of(key)
        if kind is Kind.END:
            self.shutdown(self.exit_code)
        elif kind is Kind.SPEED:
            self._change_speeds(*SPEEDS[key])
        self._operator.take(key, now, self._timing())

    def _say(self, now: float) -> None:
        """Publish what is to be said now, if anything."""
        said = self._operator.say(now, self._timing(), self._speeds())
        if said is not None:
            self._said = said.twist
            self.command.publish(said.twist, said.age)

    def _forget_keys(self, terminal: KeyboardTerminal, typed: bytes = b"") -> None:
        """Take all keys as let go, and drop what was typed; only what stops or ends holds however old it is."""
        terminal.flush()
        self._operator.let_go()
        for key in self._keys.feed(typed):
            if kind_of(key) in (Kind.STOP, Kind.END):
                self._take_key(key, self._wall.monotonic())
        self._keys = Decoder()

    def _suspend(self, terminal: KeyboardTerminal) -> None:
        """Leave the robot standing, and stop until somebody lets this process go on."""
        self._forget_keys(terminal)
        self._say(self._wall.monotonic())
        self.flush(SUSPENDED_AFTER)  # what is not on its way when the process stops stays here
        terminal.suspend()

    def _change_speeds(self, linear: float, angular: float) -> None:
        p = self.parameters
        try:
            self.set_parameters(
                speed=adjusted(p.speed, linear, p.speed_limit), turn=adjusted(p.turn, angular, p.turn_limit)
            )
        except ParameterError as error:  # a class that is derived from this one may refuse
            self.logger.warning("%s", error)

    def _speeds(self) -> Speeds:
        p = self.parameters
        return Speeds(min(p.speed, p.speed_limit), min(p.turn, p.turn_limit))

    def _timing(self) -> Timing:
        return Timing(self.parameters.first_key_timeout, self.parameters.key_timeout)

    def _is_held(self, now: float) -> bool:
        held = self._operator.held
        return held is not None and held.lasts(now, self._timing())

    def _draw(self, terminal: KeyboardTerminal, notes: Notes, now: float) -> None:
        odometry, scan = self._odometry.message, self._scan.message
        size = terminal.size
        view = View(
            name=self.full_name,
            topic=self.command.topic,
            command=self._said,
            held=self._is_held(now),
            speeds=self._speeds(),
            robot=None if odometry is None else odometry.twist.twist,
            robot_age=self._odometry.age(now),
            safety=self._safety.message,
            safety_age=self._safety.age(now),
            nearest=None if scan is None else nearest_of(scan),
            scan_age=math.inf if scan is None else self._scan.age(now),
            notes=notes.newest(size.lines),
        )
        terminal.write(drawn(lines_of(view, size.columns, size.lines), colour=self._colour))

    def on_stop(self) -> None:
        """Leave the robot standing, if it was this node that drove it, and the terminal as it was."""
        self._operator.let_go()
        self._say(self._wall.monotonic())
        if self._terminal is not None:
            self._terminal.close()
            atexit.unregister(self._terminal.close)


def _advice(node: Node) -> str:
    robot = f" --robot-name {node.namespace.strip('/')}" if node.namespace.strip("/") else ""
    return f"run it in one: robo run robo_services teleop_keyboard{robot}"


if __name__ == "__main__":
    robo.run(TeleopKeyboard)
