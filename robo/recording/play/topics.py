"""Which topics of a recording are played, and under which names. Pure."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import msgspec
import zenoh

from robo.bag.read.topics import Topic
from robo.errors import BagError, InvalidName, UsageError
from robo.text.brief import brief
from robo.text.suggestions import suggest
from robo.wire import codec, names
from robo.wire.qos import KEEP_ALL, QoS

CLOCK = "clock"
"""The topic that nodes with `use_sim_time` follow: it is one for all robots."""

_LONGEST_NAME = 500
"""Of a topic, characters."""
_LONGEST_ENCODING = 200
"""Characters. Zenoh 1.10.2 panics, and its session is of no use any more, where an encoding has more than 255 bytes."""
_MOST_LATCHED = 1_000
"""Messages that are kept of a latched topic which keeps all."""


class Choice(NamedTuple):
    """What somebody wants of a recording. Names may be those of the recording's robot, without its namespace."""

    topics: Sequence[str] = ()
    """Only these: names, `*` and `**` match; none for all."""
    exclude: Sequence[str] = ()
    """Not these."""
    remap: Sequence[str] = ()
    """`old:=new`, or `old/**:=new/**` for all within."""
    robot: str = ""
    """The namespace that takes the place of the recording's robot; empty: all stays as it was."""


class Played(msgspec.Struct, frozen=True, eq=False):
    """A topic that is played."""

    topic: Topic
    key: str
    """On which its messages are published."""
    type: str
    """Robo's name of its type; empty where nodes cannot read it."""
    encoding: str
    """Of messages that are published as the bytes they are: `application/cdr;pkg/msg/Type`; empty where they are made
    robo's."""
    qos: QoS


class Selection(NamedTuple):
    """What becomes of the topics of a recording."""

    played: list[Played]
    nameless: list[str]
    """Topics that were asked for, and whose names no topic can have."""
    robot: str
    """The robot that was recorded, as far as that can be told; empty where it cannot."""


def select(topics: Mapping[str, Topic], choice: Choice, path: str, robot: str | None = None) -> Selection:
    """Choose topics, and name them.

    Args:
        topics: those of the recording.
        choice: what is wanted.
        path: of the recording, for messages.
        robot: the robot that was recorded, where the recording says so.

    Raises:
        UsageError: a pattern or a remapping makes no sense, or matches nothing.
        BagError: nothing is left to be played, or it cannot be told which robot was recorded.
    """
    if not topics:
        raise BagError("it is empty: there is no topic in it", path)
    recorded = _recorded(topics.values(), robot)
    wanted = _wanted(topics, choice, recorded)
    if not any(topic.count for topic in wanted):
        what = "nothing is left to be played: all topics are excluded" if not wanted else "no message is in it"
        if wanted and any(topic.count for topic in topics.values()):
            what = f"there is no message of {', '.join(brief(topic.name, 100) for topic in wanted[:5])}"
        raise BagError(what, path)
    renames = [_Rename(text, recorded, choice.robot) for text in choice.remap]
    played, nameless = [], []
    for topic in filter(_has_messages, wanted):  # others are not even announced
        key = _key(topic, recorded, choice.robot, renames)
        if key is None:
            nameless.append(topic.name)
        else:
            played.append(_played(topic, key))
    for rename in renames:
        if not rename.used:
            raise UsageError(f"--remap {rename.text}: no topic matches; {suggest(rename.old, topics, 'it has')}")
    if not played:
        raise BagError(f"{brief(nameless[0], 100)} is no name of a topic: --remap OLD:=NEW gives another one", path)
    _check_apart(played)
    return Selection(played, nameless, recorded)


def _has_messages(topic: Topic) -> bool:
    return topic.count > 0


def own_name(topic: Topic) -> str:
    """A topic's name without its type, which stands beside it where there are several of one name."""
    return topic.name.removesuffix(f" ({topic.schema})")


def _recorded(topics: Iterable[Topic], robot: str | None) -> str:
    """The namespace that is the recorded robot's; empty where there is none.

    It is what the recording says, else what all names have in common: a recording of ROS with `/odom` has none.
    """
    all_names = [own_name(topic) for topic in topics]
    if robot and any(name.startswith(f"{robot}/") for name in all_names):
        return robot
    first = {name.partition("/")[0] if "/" in name else "" for name in all_names if name != CLOCK}
    return first.pop() if len(first) == 1 else ""


def _wanted(topics: Mapping[str, Topic], choice: Choice, recorded: str) -> list[Topic]:
    def matching(option: str, patterns: Sequence[str]) -> set[str]:
        found: set[str] = set()
        for pattern in patterns:
            these = {name for name, topic in topics.items() if _matches(option, pattern, own_name(topic), recorded)}
            if not these:
                raise UsageError(f"{option} {pattern}: no topic matches; {suggest(pattern, topics, 'it has')}")
            found |= these
        return found

    only = matching("--topics", choice.topics) if choice.topics else set(topics)
    left = only - matching("--exclude", choice.exclude)
    return [topic for name, topic in topics.items() if name in left]


def _matches(option: str, pattern: str, name: str, recorded: str) -> bool:
    try:
        wanted = names.key_of(pattern)
    except InvalidName as error:
        raise UsageError(f"{option} {pattern}: {error}") from None
    within = name.removeprefix(f"{recorded}/") if recorded else name
    return any(_includes(wanted, one) for one in dict.fromkeys((name, within)))


def _includes(pattern: str, name: str) -> bool:
    if "*" not in pattern:
        return pattern == name
    try:
        return zenoh.KeyExpr(pattern).includes(zenoh.KeyExpr(name))
    except zenoh.ZError:
        return False  # the name is none


def _check_apart(played: Iterable[Played]) -> None:
    """Refuse two topics that would become one of two types."""
    by_key: dict[str, Topic] = {}
    for one in played:
        other = by_key.setdefault(one.key, one.topic)
        if other.schema != one.topic.schema and own_name(other) != own_name(one.topic):
            both = f"{own_name(other)} ({other.type}) and {own_name(one.topic)} ({one.topic.type})"
            raise UsageError(f"{both} would both be published on {one.key}: --exclude one, or --remap it elsewhere")


class _Rename:
    """A remapping."""

    def __init__(self, text: str, recorded: str, robot: str) -> None:
        self.text = text
        self.used = False
        self.old, assign, new = text.partition(":=")
        self._all = self.old.endswith("/**") and new.endswith("/**")
        olds, news = (self.old[:-3], new[:-3]) if self._all else (self.old, new)
        if not assign or "*" in olds + news:
            raise UsageError(f"--remap {text}: write OLD:=NEW, or OLD/**:=NEW/** for all topics within")
        try:
            self._old, self._new = names.key_of(olds), names.key_of(news)
        except InvalidName as error:
            raise UsageError(f"--remap {text}: {error}") from None
        self._recorded = recorded
        self._home = "" if new.startswith("/") else robot or recorded

    def applied(self, name: str) -> str | None:
        """The key of a topic, by its recorded name; None where this is none of it."""
        for prefix in dict.fromkeys(("", f"{self._recorded}/" if self._recorded else "")):
            rest = self._rest(f"{prefix}{self._old}", name)
            if rest is None:
                continue
            self.used = True
            new = f"{self._new}{rest}"
            # A name within the recorded robot goes to one within the robot that is played.
            own = not prefix or not self._home or new.startswith(f"{self._home}/")
            return new if own else names.join(self._home, new)
        return None

    def _rest(self, old: str, name: str) -> str | None:
        if not self._all:
            return "" if name == old else None
        return name[len(old) :] if name.startswith(f"{old}/") else None


def _key(topic: Topic, recorded: str, robot: str, renames: Sequence[_Rename]) -> str | None:
    """On which key a topic is played; None where its name is no name."""
    name = own_name(topic)
    for rename in renames:
        if (key := rename.applied(name)) is not None:
            return key if not _is_inner(key) else None
    if robot and name != CLOCK:
        if recorded and name.startswith(f"{recorded}/"):
            name = names.join(robot, name.removeprefix(f"{recorded}/"))
        elif not recorded:
            name = names.join(robot, name)
    try:
        key = names.key_of(name)
        fits = "*" not in key and not _is_inner(key) and len(key) <= _LONGEST_NAME and bool(zenoh.KeyExpr(key))
    except (InvalidName, zenoh.ZError):
        return None
    return key if fits else None


def _is_inner(key: str) -> bool:
    """Whether a key is one by which robo's or Zenoh's own processes talk: a recording has no say there."""
    return "/@" in f"/{key}"


def _played(topic: Topic, key: str) -> Played:
    qos = topic.qos
    if qos.latched:
        qos = QoS(depth=min(qos.depth, _MOST_LATCHED) or _MOST_LATCHED, latched=True)
    else:
        # All of one priority: one that goes first would overtake what was recorded before it. And a deadline is no
        # promise of whoever may pause.
        qos = QoS(depth=KEEP_ALL)
    if topic.known is not None:
        return Played(topic, key, topic.type, "", qos)
    encoding = _encoding_of(topic)
    # What ROS cannot have was recorded as robo's own bytes: nodes read these.
    own = encoding == f"{codec.MSGPACK};{topic.schema}"
    return Played(topic, key, topic.schema if own else "", encoding, qos)


def _encoding_of(topic: Topic) -> str:
    """What is said of bytes that stay as they are, as far as it can be said.

    MCAP has words for some encodings, `cdr` and `msgpack`; others stand in a recording as Zenoh calls them.
    """
    kind = topic.encoding if "/" in topic.encoding else f"application/{topic.encoding}" if topic.encoding else _BYTES
    for encoding in (f"{kind};{topic.schema}" if topic.schema else kind, kind):
        if len(encoding) <= _LONGEST_ENCODING and encoding.isascii() and encoding.isprintable():
            return encoding
    return _BYTES


_BYTES = "application/octet-stream"
