"""What publishers of a topic offer, as recordings of ROS 2 have it, from version 9 on (Jazzy). Pure."""

import re
from collections.abc import Mapping
from typing import Final

from robo.wire.qos import KEEP_ALL, QoS, from_word

OFFERED: Final = "offered_qos_profiles"
"""The word of a channel's metadata that ROS reads."""
WORD: Final = "robo.qos"
"""The word that has robo's own, exact."""

_MOST = 100_000
_KEEPS_ALL = {"keep_all", "2"}
_FOR_EVER = "{sec: 9223372036, nsec: 854775807}"
_DURABILITY = re.compile(r"\bdurability: *(transient_local|1)\b")
_DEPTH = re.compile(r"\bdepth: *(\d{1,9})\b")
_HISTORY = re.compile(r"\bhistory: *(\w+)\b")


def words_of(qos: QoS) -> dict[str, str]:
    """The words of a channel's metadata."""
    return {OFFERED: _ros_text(qos), WORD: qos.word}


def qos_of(words: Mapping[str, str]) -> QoS:
    """What publishers of a channel offer, as far as its metadata say."""
    own = from_word(words.get(WORD, ""))
    if own is not None:
        return own
    text = words.get(OFFERED, "")[:_MOST]
    depths = [int(depth) for depth in _DEPTH.findall(text)]
    latched = _DURABILITY.search(text) is not None
    if not depths:
        return QoS.LATCHED if latched else QoS.DEFAULT
    if not latched:
        return QoS(depth=depths[0])
    if not _KEEPS_ALL.isdisjoint(_HISTORY.findall(text)):
        return QoS(depth=KEEP_ALL, latched=True)
    return QoS(depth=max(*depths, 1), latched=True)  # 0 where ROS was not told of it


def publishers_of(words: Mapping[str, str]) -> int:
    """How many publishers of a channel were announced, at least 1."""
    return max(len(_HISTORY.findall(words.get(OFFERED, "")[:_MOST])), 1)


def _ros_text(qos: QoS) -> str:
    keeps_all = qos.depth == KEEP_ALL
    lines = [
        f"history: {'keep_all' if keeps_all else 'keep_last'}",
        f"depth: {qos.depth}",
        "reliability: reliable",
        f"durability: {'transient_local' if qos.latched else 'volatile'}",
        f"deadline: {_duration(qos.deadline)}",
        f"lifespan: {_FOR_EVER}",
        "liveliness: automatic",
        f"liveliness_lease_duration: {_FOR_EVER}",
        "avoid_ros_namespace_conventions: false",
    ]
    return "- " + "\n  ".join(lines)


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return _FOR_EVER
    nanoseconds = round(seconds * 1e9)
    return f"{{sec: {nanoseconds // 10**9}, nsec: {nanoseconds % 10**9}}}"
