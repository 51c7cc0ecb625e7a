"""`robo bridge ros2`: a robot and ROS 2 connected until Ctrl-C."""

import os
import threading
from typing import NamedTuple

import msgspec

from robo.bridges.ros2.bridge import Bridge, Status
from robo.bridges.ros2.claim import claim
from robo.bridges.ros2.gids import hasher
from robo.bridges.ros2.networks import join_ros
from robo.bridges.ros2.rules import crossings_of
from robo.bridges.ros2.scope import NODE
from robo.bridges.ros2.words import crossings
from robo.cli.connection import connect_to_robot
from robo.cli.endpoints import check_endpoints
from robo.cli.link import watched
from robo.cli.printing import amount, note, print_json, print_line
from robo.cli.reach import Reach
from robo.errors import UsageError
from robo.launch.plan import Ros2Plan
from robo.process import signals
from robo.text.readable import readable
from robo.text.terminal import visible
from robo.wire import names
from robo.wire.discovery import hostname
from robo.wire.keys import NodeToken
from robo.wire.session import close_session

_PERIOD = 1.0
"""How often it is told how it goes, with --json, s."""


class Wanted(NamedTuple):
    """What a command line says of a bridge."""

    domain: int
    connect: str
    topics: list[str] | None
    services: list[str] | None
    actions: list[str] | None
    parameters: str
    rosout: bool

    def plan(self) -> Ros2Plan:
        """The same as a manifest would say it.

        Raises:
            UsageError: it makes no sense.
        """
        said = {
            "domain": self.domain,
            "connect": self.connect,
            "topics": crossings(self.topics),
            "services": crossings(self.services),
            "actions": crossings(self.actions),
            "parameters": self.parameters,
            "rosout": self.rosout,
        }
        check_endpoints([self.connect])
        try:
            return msgspec.convert(said, readable(Ros2Plan))
        except msgspec.ValidationError as error:
            raise UsageError(f"--parameters {self.parameters}: use none, read or write ({error})") from None


def connect(reach: Reach, wanted: Wanted, *, json: bool) -> None:
    """Connect until Ctrl-C.

    Args:
        reach: the robot's network.
        wanted: what crosses.
        json: print how it goes as JSON Lines, once a second.

    Raises:
        UsageError: options make no sense.
        RunError: a library is missing, or another bridge has the robot.
        NetworkError: no robot runs there, or ROS's router does not answer.
    """
    plan = wanted.plan()
    crossings_of(plan, reach.namespace)  # what is wrong with names is told before anything is dialled
    hasher()
    full_name = "/" + names.join(reach.namespace, NODE)
    over = threading.Event()
    signals.on_end(over.set)
    with connect_to_robot(reach) as session, watched(session, reach):
        held = claim(session, full_name)
        ros = join_ros(plan.connect, timeout=reach.open_timeout)
        try:
            bridge = Bridge(session, ros, plan, reach.namespace, lambda text: note(visible(text)))
            own = NodeToken(*names.split(full_name), "robo.bridges.ros2", os.getpid(), hostname())
            token = session.liveliness().declare_token(own.key())
            try:
                _tell(bridge.status(), plan, json=json)
                while not over.wait(_PERIOD):
                    if json:
                        print_json(bridge.status())
            finally:
                token.undeclare()
                bridge.close()
        finally:
            close_session(ros)
        for one in held:
            one.undeclare()
    if not json:
        _tell_end(bridge.status())


def _tell(status: Status, plan: Ros2Plan, *, json: bool) -> None:
    if json:
        print_json(status)
        return
    print_line(f"connected with ROS 2 at {plan.connect}, domain {plan.domain}")
    print_line("  Ctrl-C ends it")


def _tell_end(status: Status) -> None:
    crossed = sum(one.crossed for one in status.topics)
    lost = sum(one.dropped for one in status.topics)
    print_line(f"{amount(crossed, 'message')} crossed, {lost} lost")
