"""The quality of service of ROS's ends, as their tokens spell it, and what it is in robo. Pure."""

import re
from typing import Literal

import msgspec

from robo.wire.qos import KEEP_ALL, LONGEST_TIME, QoS

DEFAULT_DEPTH = 42
"""Of rmw_zenoh, where a token says none."""
_MOST_DEPTH = 1_000_000
_FORM = re.compile(
    r"(\d?):(\d?):(\d?),(\d{0,10}):(\d{0,20}),(\d{0,20}):(\d{0,20}),(\d{0,20}):(\d?),(\d{0,20}),(\d{0,20})",
    re.ASCII,
)
_BEST_EFFORT, _TRANSIENT_LOCAL, _VOLATILE, _KEEP_ALL = "2", "1", "2", "2"

Reliability = Literal["reliable", "best_effort"]
Durability = Literal["volatile", "transient_local"]


class RosQoS(msgspec.Struct, frozen=True, kw_only=True):
    """What an end of a topic or service promises, or wants."""

    reliable: bool = True
    transient_local: bool = False
    """Whether who comes later gets the last messages."""
    keep_all: bool = False
    depth: int = DEFAULT_DEPTH
    deadline: float | None = None
    """s; None for none."""
    lifespan: float | None = None
    """s; None for ever."""

    @property
    def word(self) -> str:
        """As a chunk of a token has it; blank where it is the default."""
        reliability = "" if self.reliable else _BEST_EFFORT
        durability = _TRANSIENT_LOCAL if self.transient_local else ""
        history = f"{_KEEP_ALL if self.keep_all else ''},{self.depth}"
        return f"{reliability}:{durability}:{history}:{_time(self.deadline)}:{_time(self.lifespan)}:,,"


def from_word(word: str) -> RosQoS | None:
    """What a chunk of a token spells; None for one that spells nothing."""
    match = _FORM.fullmatch(word)
    if match is None:
        return None
    reliability, durability, history, depth, *times = match.groups()
    return RosQoS(
        reliable=reliability != _BEST_EFFORT,
        transient_local=durability == _TRANSIENT_LOCAL,
        keep_all=history == _KEEP_ALL,
        depth=min(int(depth), _MOST_DEPTH) if depth else DEFAULT_DEPTH,
        deadline=_seconds(times[0], times[1]),
        lifespan=_seconds(times[2], times[3]),
    )


def to_robo(quality: RosQoS) -> QoS:
    """What robo has for it: a publisher that keeps all it has ever said is bounded."""
    if quality.transient_local:
        return QoS(depth=max(1, min(quality.depth, _MOST_LATCHED)), latched=True, priority="data_high")
    depth = KEEP_ALL if quality.keep_all else max(1, quality.depth)
    return QoS(depth=depth, deadline=quality.deadline, lifespan=quality.lifespan)


def to_ros(
    qos: QoS,
    reliability: Reliability | None = None,
    durability: Durability | None = None,
    depth: int | None = None,
) -> RosQoS:
    """What ROS has for it.

    Args:
        qos: of the end in robo.
        reliability, durability, depth: what is said of it for ROS.
    """
    latched = qos.latched if durability is None else durability == "transient_local"
    kept = qos.depth if depth is None else depth
    return RosQoS(
        reliable=reliability != "best_effort",
        transient_local=latched,
        keep_all=kept == KEEP_ALL and not latched,
        depth=max(1, kept),
        deadline=qos.deadline,
        lifespan=qos.lifespan,
    )


_MOST_LATCHED = 1_000


def _seconds(whole: str, parts: str) -> float | None:
    """s; None for ROS's infinity, and for more than makes sense."""
    found = int(whole or 0) + int(parts or 0) * 1e-9
    return found if 0 < found < LONGEST_TIME else None


def _time(seconds: float | None) -> str:
    if seconds is None:
        return ","
    nanoseconds = round(seconds * 1e9)
    return f"{nanoseconds // 10**9},{nanoseconds % 10**9}"
