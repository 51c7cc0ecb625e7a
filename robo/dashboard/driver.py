"""Driving from pages: one driver for each robot, commands on a topic of their own, and zeros when nobody commands.

The robot's own chain, its mux, smoother and safety monitor, has the last word: this topic is one of the mux's inputs.
"""

import threading
import time
from contextlib import suppress
from typing import NamedTuple

import msgspec
import zenoh

from robo.dashboard.lease import MOST_AGE, Lease
from robo.errors import RoboError
from robo.samples.publishing import Sender
from robo.wire import names
from robo.wire.qos import QoS
from robo_messages import Twist, Vector3, encode

TOPIC = "cmd_vel_dashboard"
NODE = "dashboard"
_PERIOD = 0.05
"""How often it is looked whether a robot is to be told to stand, s."""


_MOST_ROBOTS = 100
"""That are remembered: pages may make up names."""
_CLOSING = 2.0
"""How long the last zeros may take where the network is held up, s."""


class _Wanted(NamedTuple):
    """A command that is to be sent."""

    linear: float
    """m/s."""
    angular: float
    """rad/s."""
    since: float
    """When it came, s by the clock that never goes back."""


class _Robot(msgspec.Struct):
    lease: Lease
    wanted: _Wanted | None = None


class Driver:
    """Sends what pages command, by a thread of its own: a network that is held up holds up no page."""

    def __init__(self, session: zenoh.Session, topic: str = TOPIC) -> None:
        self._session = session
        self._topic = topic
        self._robots: dict[str, _Robot] = {}
        self._senders: dict[str, Sender] = {}
        self._changed = threading.Condition()
        self._over = False
        self._thread = threading.Thread(target=self._run, name="robo-dashboard-driver", daemon=True)
        self._thread.start()

    def take(self, robot: str, who: str) -> bool:
        """Somebody wants to drive, or goes on; whether it is the one who does."""
        with self._changed:
            found = self._robot(robot)
            return found is not None and found.lease.take(who, time.monotonic())

    def command(self, robot: str, who: str, linear: float, angular: float) -> bool:
        """How a robot is to move, m/s forwards, rad/s to the left; whether nobody else drives it."""
        with self._changed:
            found, now = self._robot(robot), time.monotonic()
            if found is None or not found.lease.command(who, now):
                return False
            found.wanted = _Wanted(linear, angular, now)
            self._changed.notify()
            return True

    def leave(self, who: str) -> None:
        """Somebody drives no more: has let go, or is gone."""
        with self._changed:
            for found in self._robots.values():
                if found.lease.driver == who:
                    found.wanted = None
                    found.lease.give(who)
            self._changed.notify()

    def drivers(self) -> dict[str, str]:
        """Who drives which robot."""
        with self._changed:
            return {robot: found.lease.driver for robot, found in self._robots.items() if found.lease.driver}

    def close(self) -> None:
        """Have all robots stand that were told to move, and say no more."""
        with self._changed:
            for found in self._robots.values():
                if found.lease.driver is not None:
                    found.wanted = None
                    found.lease.give(found.lease.driver)
            self._over = True
            self._changed.notify()
        self._thread.join(_CLOSING)
        if self._thread.is_alive():
            return  # the network takes nothing; the mux has stopped the robot
        for sender in self._senders.values():
            with suppress(zenoh.ZError):
                sender.close()

    def _robot(self, robot: str) -> _Robot | None:
        """A robot by name; None where there are too many."""
        if robot not in self._robots and len(self._robots) >= _MOST_ROBOTS:
            return None
        return self._robots.setdefault(robot, _Robot(Lease()))

    def _run(self) -> None:
        over = False
        while not over:
            with self._changed:
                self._changed.wait(_PERIOD)
                due = [(robot, said) for robot, found in self._robots.items() for said in self._due(found)]
                over = self._over and not due
            for robot, (linear, angular) in due:
                # The network has been left, and the mux stops the robot; whatever else: others are driven, too.
                with suppress(zenoh.ZError, RoboError):
                    self._sender(robot).send(encode(Twist(Vector3(x=linear), Vector3(z=angular))))

    def _due(self, robot: _Robot) -> list[tuple[float, float]]:
        """What is to be sent to a robot now."""
        now = time.monotonic()
        wanted, robot.wanted = robot.wanted, None
        if wanted is not None and now - wanted.since <= MOST_AGE:  # else the network has held up the one before
            return [(wanted.linear, wanted.angular)]
        return [(0.0, 0.0)] if robot.lease.is_to_stand(now) else []

    def _sender(self, robot: str) -> Sender:
        sender = self._senders.get(robot)
        if sender is None:
            key, node = names.join(robot, self._topic), "/" + names.join(robot, NODE)
            sender = self._senders[robot] = Sender(self._session, key, "geometry/Twist", QoS.COMMAND, node)
        return sender
