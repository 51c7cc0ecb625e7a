"""Types that do not fit: told once, with both hashes and, where ROS's node tells it, the field that differs."""

from collections.abc import Callable
from typing import Protocol

from robo.bridges.ros2.tally import Tally
from robo.bridges.ros2.tokens import NO_HASH, EndToken, ros_type

Ask = Callable[[EndToken, str, Callable[[str], None]], None]
"""Asks the node of an end for its type, which robo has by a name; the last one gets the field that differs."""


class Typed(Protocol):
    """A type on both sides, as a topic's form or a service's is."""

    @property
    def name(self) -> str:
        """In robo."""

    @property
    def hash(self) -> str:
        """Of robo's."""


class Misfits:
    """Tells of types that do not fit."""

    def __init__(self, tally: Tally, ask: Ask = lambda _token, _name, _tell: None) -> None:
        """
        Args:
            tally: where it is told.
            ask: asks a node of ROS's for its type.
        """
        self._tally, self._ask = tally, ask

    def unknown(self, what: str, key: str, type_: str, wanted: str | None) -> None:
        """A type that robo does not have, or not the one that a rule says.

        Args:
            what: the topic or service, in words.
            key: in robo.
            type_: ROS's, as DDS has it.
            wanted: the one that its rule says.
        """
        ros = ros_type(type_)
        if wanted is not None:
            text = f"{what} does not cross to /{key}: it is a {ros}, and the rule says {wanted}"
        else:
            text = (
                f"{what} does not cross to /{key}: robo has no type for {ros}; write one, or make it of ROS's file: "
                "robo interface import"
            )
        self._tally.fault(f"type {what}", text)

    def hash(self, what: str, typed: Typed, theirs: str, token: EndToken | None) -> None:
        """A type that both have, and that is not the same.

        Args:
            what: the topic or service, in words.
            typed: robo's type.
            theirs: the hash of ROS's.
            token: of ROS's end, where one is known.
        """
        subject = f"type {what} {theirs}"
        if theirs == NO_HASH:
            self._tally.fault(
                subject, f"{what} does not cross: its distribution of ROS has no hashes of types; Jazzy and later do"
            )
            return
        text = f"{what} does not cross: {typed.name} is {typed.hash} in robo and {theirs} in ROS"
        self._tally.fault(subject, text)
        if token is not None:
            self._ask(token, typed.name, lambda field: self._tally.fault(subject, f"{text}; {field}"))
