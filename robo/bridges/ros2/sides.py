"""What services and actions cross with."""

from typing import NamedTuple

import zenoh

from robo.bridges.ros2.announced import Announced
from robo.bridges.ros2.calls import Workers
from robo.bridges.ros2.misfits import Misfits
from robo.bridges.ros2.tally import Tally


class Sides(NamedTuple):
    """Both networks, and who keeps the books between them."""

    robo: zenoh.Session
    ros: zenoh.Session
    announced: Announced
    """What is announced in ROS."""
    tally: Tally
    """Where calls are counted."""
    misfits: Misfits
    """Is told of types that do not fit."""
    workers: Workers
    """Hand answers back."""
    node: str
    """The full name of who speaks in ROS."""
