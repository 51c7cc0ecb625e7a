"""Driving from pages: one driver for each robot, commands on a topic of their own, and zeros when nobody commands.

The robot's own chain, its mux, smoother and safety monitor, has the last word: this topic is one of the mux's inputs.
"""

import threading
import time
from contextlib import suppress

import msgspec
import zenoh

from robo.dashboard.lease import Lease
from robo.samples.publishing import Sender
from robo.wire import names
from robo.wire.qos import QoS
from robo_messages import Twist, Vector3, encode

TOPIC = "cmd_vel_dashboard"
NODE = "dashboard"
_PERIOD = 0.05
"""How often it is looked whether a robot is to be told to stand, s."""


class _Robot(msgspec.Struct):
    lease: Lease
    wanted: tuple[float, float] | None = None
    """A command that is to be sent: m/s, rad/s."""


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
            return self._robot(robot).lease.take(who, time.monotonic())

    def command(self, robot: str, who: str, linear: float, angular: float) -> bool:
        """How a robot is to move, m/s forwards, rad/s to the left; whether nobody else drives it."""
        with self._changed:
            found = self._robot(robot)
            if not found.lease.command(who, time.monotonic()):
                return False
            found.wanted = (linear, angular)
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
        self._thread.join()
        for sender in self._senders.values():
            with suppress(zenoh.ZError):
                sender.close()

    def _robot(self, robot: str) -> _Robot:
        return self._robots.setdefault(robot, _Robot(Lease()))

    def _run(self) -> None:
        over = False
        while not over:
            with self._changed:
                self._changed.wait(_PERIOD)
                due = [(robot, said) for robot, found in self._robots.items() for said in self._due(found)]
                over = self._over and not due
            for robot, (linear, angular) in due:
                with suppress(zenoh.ZError):  # the network has been left; the mux stops the robot
                    self._sender(robot).send(encode(Twist(Vector3(x=linear), Vector3(z=angular))))

    def _due(self, robot: _Robot) -> list[tuple[float, float]]:
        """What is to be sent to a robot now."""
        if robot.wanted is not None:
            wanted, robot.wanted = robot.wanted, None
            return [wanted]
        return [(0.0, 0.0)] if robot.lease.is_to_stand(time.monotonic()) else []

    def _sender(self, robot: str) -> Sender:
        sender = self._senders.get(robot)
        if sender is None:
            key, node = names.join(robot, self._topic), "/" + names.join(robot, NODE)
            sender = self._senders[robot] = Sender(self._session, key, "geometry/Twist", QoS.COMMAND, node)
        return sender
