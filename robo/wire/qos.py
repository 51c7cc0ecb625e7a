"""How a topic's messages are kept and carried: a few named facts, and profiles under ROS's names.

`depth` says how many messages are kept while a receiver is busy. `depth=n` keeps the newest n and drops the
oldest, and a sender never waits. `depth=KEEP_ALL` loses nothing on one machine: a full receiver makes the
sender wait. To other hosts a router waits for nobody.
"""

from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal, get_args

import msgspec
from msgspec import Meta

from robo.errors import ContractError
from robo.text.readable import readable

if TYPE_CHECKING:
    import zenoh

KEEP_ALL: Final = 0
"""Lose nothing: a receiver that falls behind slows the sender down, on the same machine."""

DEFAULT_DEPTH: Final = 10

DEFAULT_TIMEOUT: Final = 2.0
"""How long a call of a service waits for its answer, s."""

Priority = Literal["real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"]
"""Zenoh's, the most urgent first."""
PRIORITIES: tuple[Priority, ...] = get_args(Priority)

LONGEST_TIME: Final = 1e9
"""Of a deadline and a lifespan, s: 30 years are for ever."""

_MOST_DIGITS = 9
"""Of a depth in a token: none makes sense beyond."""


def check_priority(priority: str) -> Priority:
    """`priority` if it is one.

    Raises:
        ContractError: it is none.
    """
    if priority not in PRIORITIES:
        raise ContractError(f"priority {priority!r} is not known; use {', '.join(PRIORITIES)}")
    return priority


class QoS(msgspec.Struct, frozen=True, kw_only=True):
    """The quality of service of one end of a topic.

    An end takes of it what concerns it: a priority is the publisher's, a lifespan the subscription's.
    """

    depth: int = DEFAULT_DEPTH
    """Messages that are kept while a receiver is busy, the newest; KEEP_ALL (0): all, and the sender waits.
    Of a latched publisher: how many it keeps for whoever comes later."""
    latched: bool = False
    """Whether who comes later gets the last `depth` messages of each publisher that is there: transient local."""
    priority: Priority = "data"
    """What goes first where a link has more to carry than it can."""
    deadline: float | None = None
    """A message comes at least so often, s: what a publisher promises, and what a subscription needs."""
    lifespan: float | None = None
    """Messages that are older than this when the callback could have them are dropped, s."""

    if TYPE_CHECKING:  # else each node would carry Python's compiler, for a name in an annotation
        DEFAULT: ClassVar["QoS"]
        """What holds where nothing is said: the newest 10."""
        SENSOR_DATA: ClassVar["QoS"]
        """Of scans and the like: the newest 5."""
        COMMAND: ClassVar["QoS"]
        """Of what moves or stops a robot: the newest alone, before all data."""
        LATCHED: ClassVar["QoS"]
        """Of a state that is told when it changes: the last one, for whoever comes later too."""
        BULK: ClassVar["QoS"]
        """Of images, point clouds, maps on their way to a file: the newest alone, after all others."""

    def __post_init__(self) -> None:
        if self.depth < 0:
            raise ContractError(f"depth {self.depth}: use a positive number, or KEEP_ALL to lose nothing")
        check_priority(self.priority)
        for name, seconds in (("deadline", self.deadline), ("lifespan", self.lifespan)):
            if seconds is not None and not 0 < seconds <= LONGEST_TIME:
                raise ContractError(f"{name} {seconds}: use a number of seconds above 0")

    @property
    def reliable(self) -> bool:
        """Whether a publisher waits for a full receiver rather than drop a message.

        What is latched is said once: the last word would be lost for good.
        """
        return self.depth == KEEP_ALL or self.latched

    def of_publisher(self) -> "QoS":
        """What of it concerns a publisher.

        Raises:
            ContractError: it would keep each of its messages for ever.
        """
        if self.latched and self.depth == KEEP_ALL:
            raise ContractError(
                "a latched publisher keeps its last `depth` messages, and KEEP_ALL would be all for ever; say how many"
            )
        return msgspec.structs.replace(self, lifespan=None)

    def of_subscription(self) -> "QoS":
        """What of it concerns a subscription."""
        return msgspec.structs.replace(self, priority="data")

    @property
    def word(self) -> str:
        """As a chunk of a key has it: the depth, and what differs from the default: `1,latched,data_high`."""
        words = [str(self.depth)]
        words += ["latched"] if self.latched else []
        words += [self.priority] if self.priority != "data" else []
        words += [f"deadline={self.deadline:g}"] if self.deadline is not None else []
        words += [f"lifespan={self.lifespan:g}"] if self.lifespan is not None else []
        return ",".join(words)

    def __str__(self) -> str:
        """In words: `depth 1, latched, data_high`."""
        words = ["keeps all" if self.depth == KEEP_ALL else f"depth {self.depth}"]
        words += ["latched"] if self.latched else []
        words += [self.priority] if self.priority != "data" else []
        words += [f"deadline {self.deadline:g} s"] if self.deadline is not None else []
        words += [f"lifespan {self.lifespan:g} s"] if self.lifespan is not None else []
        return ", ".join(words)


QoS.DEFAULT = QoS()
QoS.SENSOR_DATA = QoS(depth=5)
QoS.COMMAND = QoS(depth=1, priority="interactive_high")
QoS.LATCHED = QoS(depth=1, latched=True, priority="data_high")
QoS.BULK = QoS(depth=1, priority="background")


Profile = Literal["default", "sensor_data", "command", "latched", "bulk"]
PROFILES: dict[Profile, QoS] = {
    "default": QoS.DEFAULT,
    "sensor_data": QoS.SENSOR_DATA,
    "command": QoS.COMMAND,
    "latched": QoS.LATCHED,
    "bulk": QoS.BULK,
}


def said(
    qos: QoS | None = None,
    *,
    depth: int | None = None,
    latched: bool | None = None,
    priority: Priority | None = None,
    deadline: float | None = None,
    lifespan: float | None = None,
) -> QoS:
    """What holds where a profile, or none, and some facts beside it are said.

    Without a profile `latched=True` alone is `QoS.LATCHED`: the last message.

    Raises:
        ContractError: a value makes no sense.
    """
    facts = {"depth": depth, "latched": latched, "priority": priority, "deadline": deadline, "lifespan": lifespan}
    base = qos if qos is not None else QoS.LATCHED if latched else QoS.DEFAULT
    return msgspec.structs.replace(base, **{name: value for name, value in facts.items() if value is not None})


def zenoh_priority(priority: Priority) -> "zenoh.Priority":
    """A priority as Zenoh has it."""
    import zenoh  # a launch, which reads of priorities too, needs none

    found: zenoh.Priority = getattr(zenoh.Priority, priority.upper())
    return found


class Quality(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a launch says of a topic's ends, over what they say themselves."""

    SHORT: ClassVar = ("profile",)

    profile: Annotated[
        Profile | None,
        Meta(description="default, sensor_data, command, latched or bulk; the rest comes over it."),
    ] = None
    depth: Annotated[int, Meta(ge=0, description="Messages that are kept, the newest; 0 keeps all.")] | None = None
    latched: Annotated[bool, Meta(description="Whether who comes later gets the last messages.")] | None = None
    priority: Annotated[Priority, Meta(description="What goes first where a link is full.")] | None = None
    deadline: Annotated[float, Meta(ge=0, description="One comes at least so often, s; 0: never mind.")] | None = None
    lifespan: Annotated[float, Meta(ge=0, description="Older ones are dropped, s; 0: none is.")] | None = None

    def over(self, qos: QoS) -> QoS:
        """What holds at an end that says `qos` itself.

        Raises:
            ContractError: a value makes no sense.
        """
        base = qos if self.profile is None else PROFILES[self.profile]
        facts = {name: value for name in QoS.__struct_fields__ if (value := getattr(self, name)) is not None}
        for name in ("deadline", "lifespan"):
            if facts.get(name) == 0:
                facts[name] = None
        return msgspec.structs.replace(base, **facts)


def misfit(topic: str, publisher: tuple[str, QoS], subscription: tuple[str, QoS]) -> str:
    """Why a subscription does not get of a publisher what it wants, in words; empty where both fit.

    Args:
        topic: of both.
        publisher, subscription: the full names of their nodes, and what holds there.
    """
    (source, offered), (reader, wanted) = publisher, subscription
    if wanted.latched and not offered.latched:
        return f"{source} does not latch {topic}, and {reader} wants what it said before: say latched=True there"
    if offered.deadline is not None and wanted.deadline is not None and offered.deadline > wanted.deadline:
        return (
            f"{source} promises a message on {topic} every {offered.deadline:g} s,"
            f" and {reader} needs one every {wanted.deadline:g} s"
        )
    return ""


def from_word(word: str) -> QoS | None:
    """The QoS that a word spells; None for anything else."""
    depth, *facts = word.split(",")
    if not (len(depth) <= _MOST_DIGITS and depth.isascii() and depth.isdigit()):
        return None
    found: dict[str, object] = {"depth": int(depth)}
    for fact in facts:
        name, _, value = fact.partition("=")
        if fact == "latched":
            found["latched"] = True
        elif name in ("deadline", "lifespan"):
            found[name] = value
        else:
            found["priority"] = fact
    try:
        qos = msgspec.convert(found, readable(QoS), strict=False)
    except (ContractError, msgspec.ValidationError):
        return None
    return qos if qos.word == word else None
