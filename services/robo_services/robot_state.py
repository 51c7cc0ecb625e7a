"""Which transforms follow from what is heard of joints, and which are still missing. Pure; times in ns."""

from collections.abc import Collection, Mapping

from robo.tf.transform import Transform3
from robo_messages import JointState
from robo_services.urdf_model import Model, is_position
from robo_services.urdf_xml import Joint

SET_BACK = 1_000_000_000
"""A stamp that is older than the last one by more begins anew, as when a log is played again, ns."""

MOST_STRANGERS = 100
"""So many names are remembered that the robot does not have."""


class Pace:
    """Lets so much through of what comes often, for each joint.

    Stamps that come at the very rate, but not quite evenly, are all let through.
    """

    def __init__(self) -> None:
        self._last: dict[str, int] = {}
        self._due: dict[str, int] = {}

    def lets_through(self, joints: Collection[str], stamp: int, interval: int) -> bool:
        """Whether one of the joints is due; then all of them are taken.

        Args:
            joints: of one message.
            stamp: of that message, ns.
            interval: between what is let through, ns.
        """
        for joint in joints:
            if stamp < self._last.get(joint, stamp) - SET_BACK:
                del self._due[joint]
        if not any(stamp >= self._due.get(joint, stamp) for joint in joints):
            return False
        for joint in joints:
            self._last[joint] = stamp
            self._due[joint] = max(self._due.get(joint, stamp) + interval, stamp)
        return True


class RobotState:
    """A robot's joints, as far as they have been heard of."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._pace = Pace()
        self._placed: set[str] = set()
        self.strangers: set[str] = set()
        """Names of joints that came, and that the robot does not have."""

    @property
    def missing(self) -> list[Joint]:
        """The joints that move and of which no position has come."""
        return [joint for name, joint in self._model.moving.items() if name not in self._placed]

    def take(self, told: Mapping[str, float], stamp: int, interval: int = 0) -> dict[str, Transform3]:
        """Where links stand, by the names of the joints that hold them; nothing, where that was said just before.

        Args:
            told: positions of joints, rad or m.
            stamp: when they were measured, ns.
            interval: between what is said of one joint, ns; 0 for all that comes.
        """
        for name in told:
            if name not in self._model.moving and len(self.strangers) < MOST_STRANGERS:
                self.strangers.add(name)
        transforms = self._model.transforms(told)
        if not transforms or (interval and not self._pace.lets_through(transforms, stamp, interval)):
            return {}
        self._placed.update(transforms)
        return transforms


def positions_of(state: JointState) -> dict[str, float]:
    """The positions of a message, rad or m, by joints; of a joint that stands there twice, the first one.

    Raises:
        ValueError: there are not as many positions as names.
    """
    if len(state.position) != len(state.name):
        raise ValueError(f"{len(state.position)} positions of {len(state.name)} joints")
    told: dict[str, float] = {}
    for name, position in zip(state.name, state.position, strict=True):
        told.setdefault(name, position)
    return told


def no_positions(told: Mapping[str, float]) -> list[str]:
    """The joints whose positions are none: not finite, or absurd."""
    return [name for name, position in told.items() if not is_position(position)]
