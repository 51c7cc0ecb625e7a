"""What the page and its server say to each other: requests and news as JSON, messages of topics as they came. Pure.

A message of a topic is a binary frame: the number of its channel (uint16), when it was published and when it came (ms
since the epoch, float64, 0 where unknown), all little-endian, then its payload as it was on the network. Which key,
type and encoding a channel has is said once, as news.
"""

import struct
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

_HEAD = struct.Struct("<Hdd")


class _Request(msgspec.Struct, frozen=True, tag_field="do", tag=lambda name: name.lower(), forbid_unknown_fields=True):
    """What a page asks for."""


class Watch(_Request, frozen=True):
    """It shows these topics, and no others."""

    keys: list[str]
    frames: list[str] = []
    """Robots of which it is wanted where their frames stand."""


class Read(_Request, frozen=True):
    """It has dealt with so many frames more."""

    count: Annotated[int, Meta(ge=0)]


class Drive(_Request, frozen=True):
    """How the robot is to move."""

    robot: str
    linear: float
    """m/s, forwards."""
    angular: float
    """rad/s, to the left."""
    heard: int
    """The number of the newest beat that the page had from the server."""
    since: float
    """How long ago that was, by the page's own clock, s."""
    grip: int
    """The number for new grips that the page had been told when the hand took hold: see `driver`."""


class Release(_Request, frozen=True):
    """It drives no more."""


class Call(_Request, frozen=True):
    """A service is to be called; the answer has the same number."""

    id: int
    service: str
    type: str
    request: dict[str, Any] = {}


class Publish(_Request, frozen=True):
    """A message is to be published once, such as a goal."""

    id: int
    topic: str
    type: str
    message: dict[str, Any]


class Command(_Request, frozen=True):
    """A node is to be started, stopped or restarted, or it is asked why it is as it is."""

    id: int
    robot: str
    verb: Literal["start", "stop", "restart", "why"]
    node: str


class Parameters(_Request, frozen=True):
    """All parameters of a node are wanted, with what is known of them."""

    id: int
    node: str


class Set(_Request, frozen=True):
    """Parameters of a node are to be set, all or none."""

    id: int
    node: str
    values: dict[str, Any]


Request = Watch | Read | Drive | Release | Call | Publish | Command | Parameters | Set
DRIVERS = (Drive, Call, Publish, Set)
"""For those alone who may drive; and of the commands all but `why`."""

_requests: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)
_encoder = msgspec.json.Encoder()


def request(text: str | bytes) -> Request:
    """What a page asks for.

    Raises:
        msgspec.DecodeError: it is none of these.
    """
    return _requests.decode(text)


def needs_driver(asked: Request) -> bool:
    """Whether only who may drive may ask for this."""
    return isinstance(asked, DRIVERS) or (isinstance(asked, Command) and asked.verb != "why")


def news(kind: str, **what: object) -> str:
    """Something that the page is told."""
    return _encoder.encode({"kind": kind, **what}).decode()


def frame(channel: int, published: int | None, arrived: int, payload: bytes) -> bytes:
    """A message of a topic.

    Args:
        channel: its number.
        published: ns since the epoch; None where nobody has said it.
        arrived: ns since the epoch.
        payload: as it was on the network.
    """
    return _HEAD.pack(channel, published / 1e6 if published is not None else 0.0, arrived / 1e6) + payload
