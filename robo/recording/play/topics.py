"""Which topics of a recording are played, and under which names. Pure."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import msgspec
import zenoh

from robo.bag.of_robot import robots_among
from robo.bag.read.topics import Topic
from robo.errors import BagError, InvalidName, UsageError
from robo.text.brief import brief
from robo.text.patterns import chosen
from robo.text.suggestions import suggest
from robo.wire import codec, names
from robo.wire.keys import SNAPSHOTS_TOPIC, SYSTEM_TOPICS
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
    """Only these: names, `*` and `**` match; none for all but what nodes say of themselves."""
    exclude: Sequence[str] = ()
    """Not these."""
    remap: Sequence[str] = ()
    """`old:=new`, or `old/**:=new/**` for all within. The old name is one of the recording, whatever it is."""
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
    left: list[str]
    """Topics that nobody has asked for by name: what nodes say of themselves."""
    robot: str
    """The robot that was recorded, as far as that can be told; empty where it cannot, or there are several."""


def select(topics: Mapping[str, Topic], choice: Choice, path: str, robots: Sequence[str] | None = None) -> Selection:
    """Choose topics, and name them.

    Args:
        topics: those of the recording.
        choice: what is wanted.
        path: of the recording, for messages.
        robots: those that were recorded, where the recording says so; see `robots_among`.

    Raises:
        UsageError: a pattern or a remapping makes no sense, or matches nothing; or two robots would become one.
        BagError: nothing is left to be played.
    """
    if not topics:
        raise BagError("it is empty: there is no topic in it", path)
    every = [own_name(topic) for topic in topics.values()]
    there = robots_among(every, robots)
    recorded = there[0] if len(there) == 1 else ""
    meant = chosen(every, choice.topics, choice.exclude, path, robot=recorded, options=("--topics", "--exclude"))
    wanted = [topic for topic in topics.values() if meant(own_name(topic))]
    if not any(map(_has_messages, wanted)):
        some = any(map(_has_messages, topics.values()))
        names_of = ", ".join(brief(topic.name, 100) for topic in wanted[:5])
        raise BagError(f"there is no message of {names_of}" if some else "no message is in it", path)
    wanted = list(filter(_has_messages, wanted))  # others are not even announced
    left = [] if choice.topics else [topic.name for topic in wanted if _is_of_nodes(topic)]
    wanted = [topic for topic in wanted if topic.name not in left]
    if not wanted:
        raise BagError(f"nothing is left to be played; --topics {left[0]} plays what nodes said of themselves", path)
    if choice.robot and len(there) > 1:
        recorded = _one_of(there, wanted, choice.robot)
    played, nameless = _named(wanted, recorded, choice)
    if not played:
        raise BagError(f"{brief(nameless[0], 100)} is no name of a topic: --remap OLD:=NEW gives another one", path)
    return Selection(played, nameless, left, recorded)


def own_name(topic: Topic) -> str:
    """A topic's name without its type, which stands beside it where there are several of one name."""
    return topic.own_name


def _has_messages(topic: Topic) -> bool:
    return topic.count > 0


def _is_of_nodes(topic: Topic) -> bool:
    """Whether it is what every node says by itself: those that run now say it of themselves."""
    return own_name(topic).rpartition("/")[2] in {*SYSTEM_TOPICS, SNAPSHOTS_TOPIC}


def _one_of(robots: Sequence[str], wanted: Sequence[Topic], robot: str) -> str:
    """The one of several recorded robots whose topics are wanted, to be played as another one."""
    there = [one for one in robots if any(own_name(topic).startswith(f"{one}/") for topic in wanted)]
    if len(there) > 1:
        raise UsageError(
            f"it has {' and '.join(there)}, which cannot all be {robot}: --topics '{there[0]}/**' plays one of them; "
            f"without --robot-name, --remap '{there[0]}/**:=/{robot}/**' names each"
        )
    return there[0] if there else ""


def _named(topics: Sequence[Topic], recorded: str, choice: Choice) -> tuple[list[Played], list[str]]:
    """Topics as they are played, and those whose names are none."""
    renames = [_Rename(text, recorded, choice.robot) for text in choice.remap]
    played, nameless, by_words = [], [], set()
    for topic in topics:
        name = own_name(topic)
        found = [(rename, key) for rename in renames if (key := rename.applied(name)) is not None]
        if found:
            found[0][0].used = True
        key = _checked(found[0][1] if found else _of_robot(name, recorded, choice.robot))
        if key is None:
            nameless.append(topic.name)
            continue
        played.append(_played(topic, key))
        if found:
            by_words.add(topic.name)
    for rename in renames:
        if not rename.used:
            raise rename.unused([own_name(topic) for topic in topics])
    _check_apart(played, by_words)
    return played, nameless


def _check_apart(played: Iterable[Played], by_words: Collection[str]) -> None:
    """Refuse two topics that would become one, unless somebody has written so of both, and they are of one type."""
    by_key: dict[str, Topic] = {}
    for one in played:
        other = by_key.setdefault(one.key, one.topic)
        apart = own_name(other) != own_name(one.topic)
        if apart and (other.schema != one.topic.schema or not {other.name, one.topic.name} <= set(by_words)):
            both = f"{own_name(other)} ({other.type}) and {own_name(one.topic)} ({one.topic.type})"
            raise UsageError(f"{both} would both be published on {one.key}: --exclude one, or --remap it elsewhere")


class _Rename:
    """A remapping."""

    def __init__(self, text: str, recorded: str, robot: str) -> None:
        self.text = text
        self.used = False
        self._old, assign, new = text.partition(":=")
        self._all = self._old.endswith("/**") and new.endswith("/**")
        if self._all:
            self._old, new = self._old[:-3], new[:-3]
        if not assign or "*" in new:
            raise self._unclear()
        try:
            self._new = names.key_of(new)
        except InvalidName as error:
            raise UsageError(f"--remap {text}: {error}") from None
        # A name as it was recorded may be anything, or --remap could give no other one to what is no name.
        own = f"{recorded}/" if recorded and self._old.strip("/") and not self._old.startswith("/") else ""
        self._prefixes = dict.fromkeys(("", own))
        self._recorded = recorded
        self._home = "" if new.startswith("/") else robot or recorded

    def applied(self, name: str) -> str | None:
        """The name of a topic, by its recorded name; None where this is none of it."""
        for prefix in self._prefixes:
            rest = self._rest(prefix + self._old.strip("/"), name)
            if rest is None:
                continue
            new = f"{self._new}{rest}"
            # A name within the recorded robot goes to one within the robot that is played.
            whole = bool(self._recorded) and not prefix
            return new if whole or not self._home or new.startswith(f"{self._home}/") else f"{self._home}/{new}"
        return None

    def unused(self, there: Sequence[str]) -> UsageError:
        """Why it holds for no topic."""
        if any(self.applied(name) is not None for name in there):
            return UsageError(f"--remap {self.text}: one that stands before it holds for all that it means")
        if "*" in self._old:
            return self._unclear()
        return UsageError(f"--remap {self.text}: no topic matches; {suggest(self._old, there, 'it has')}")

    def _unclear(self) -> UsageError:
        return UsageError(f"--remap {self.text}: write OLD:=NEW, or OLD/**:=NEW/** for all topics within")

    def _rest(self, old: str, name: str) -> str | None:
        if not self._all:
            return "" if name.strip("/") == old else None
        return name[len(old) :] if name.startswith(f"{old}/") else None


def _of_robot(name: str, recorded: str, robot: str) -> str:
    """What a topic is called where another robot takes the place of the one that was recorded."""
    if not robot or name == CLOCK:
        return name
    if not recorded:
        return names.join(robot, name)
    own = f"{recorded}/"
    return names.join(robot, name.removeprefix(own)) if name.startswith(own) else name


def _checked(name: str) -> str | None:
    """The key of a name; None where no topic can have it."""
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
