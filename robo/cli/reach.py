"""Which network, which robot, how long: what every verb that looks at running robots is told."""

from collections.abc import Sequence
from typing import NamedTuple

from robo.errors import UsageError
from robo.wire import names

ANSWER_TIMEOUT = 2.0
"""How long to wait for what is there, s: a machine may be busy."""
OPEN_TIMEOUT = 5.0
"""How long to wait for the network where somebody listens, s: packets may be lost, each for some time."""
REFUSED_TIMEOUT = 0.3
"""How long to wait where nobody listens, s: a robot that leaves hands the meeting point over within that."""

SILENT_TIMEOUT = 3.5
"""How long to wait for an address that says nothing, s: where packets get lost, it is asked again after 1 and 3 s."""


class Reach(NamedTuple):
    """Where and how far a verb looks."""

    connect: tuple[str, ...] = ()
    """Zenoh endpoints to dial; by default ROBO_CONNECT, else where robots on this machine meet."""
    robot: str | None = None
    """The namespace of the only robot that is meant; None for all."""
    given_timeout: float | None = None
    """How long to wait for the network and for an answer, s, if somebody said so."""

    @classmethod
    def of(
        cls, connect: Sequence[str] | None = None, robot_name: str | None = None, timeout: float | None = None
    ) -> "Reach":
        """What the options say.

        Raises:
            InvalidName: the robot's name is empty or breaks the rules.
        """
        robot = names.robot_name(robot_name) if robot_name is not None else None
        return cls(tuple(connect or ()), robot, timeout)

    @property
    def timeout(self) -> float:
        """How long to wait for an answer, s."""
        return ANSWER_TIMEOUT if self.given_timeout is None else self.given_timeout

    @property
    def open_timeout(self) -> float:
        """How long to wait for the network where somebody listens, s."""
        return OPEN_TIMEOUT if self.given_timeout is None else max(self.given_timeout, 0.1)

    @property
    def silent_timeout(self) -> float:
        """How long to wait for an address that says nothing, s."""
        return SILENT_TIMEOUT if self.given_timeout is None else self.given_timeout

    @property
    def refused_timeout(self) -> float:
        """How long to wait for somebody to listen, s."""
        return REFUSED_TIMEOUT if self.given_timeout is None else self.given_timeout

    @property
    def namespace(self) -> str:
        """The named robot's namespace; empty where all are meant."""
        return self.robot or ""

    def covers(self, key: str) -> bool:
        """Whether a full name or key belongs to the robot that is named."""
        return not self.namespace or key.strip("/").startswith(f"{self.namespace}/")

    def key(self, name: str) -> str:
        """The key expression of a topic's name: within the robot that is named, unless it says a robot itself.

        Raises:
            InvalidName: it is no name.
        """
        key = names.key_of(name)
        return key if name.startswith("/") or self.covers(key) else names.join(self.namespace, key)

    def one_key(self, name: str, verb: str) -> str:
        """The key of a topic that has to be a single one.

        Args:
            name: what somebody typed.
            verb: what is to be done with it, for the message: `plot`.

        Raises:
            InvalidName: it is no name.
            UsageError: it names many.
        """
        key = self.key(name)
        if "*" in key:
            raise UsageError(f"{names.shown_key(key)} names many topics: {verb} one")
        return key
