"""The viewers' protocol: what a client says, what it is told, and the frames of bytes. Pure.

Words are JSON, each an object with its `op`; messages, times and calls of services are bytes that begin with a number.
Two names are said of it, `foxglove.websocket.v1` and `foxglove.sdk.v1`; the second one knows playback, too.
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

SDK, PLAIN = "foxglove.sdk.v1", "foxglove.websocket.v1"
SUBPROTOCOLS = (SDK, PLAIN)
"""Names of the protocol that are spoken."""

INFO, WARNING, ERROR = 0, 1, 2
"""How bad it is what a client is told."""

MOST_NUMBER = 2**32 - 1
"""Ids are whole numbers of 32 bits."""


class Unreadable(Exception):
    """A client has said what makes no sense; the text is the reason."""


class Channel(msgspec.Struct, frozen=True, rename="camel"):
    """A topic that a client may subscribe."""

    id: int
    topic: str
    """With a slash before it."""
    encoding: str
    """Of its messages."""
    schema_name: str
    schema: str
    """The definition of their type, whole."""
    schema_encoding: str


class Half(msgspec.Struct, frozen=True, rename="camel"):
    """The request or the response of a service."""

    encoding: str
    schema_name: str
    schema_encoding: str
    schema: str


class Service(msgspec.Struct, frozen=True, rename="camel"):
    """A service that a client may call."""

    id: int
    name: str
    """With a slash before it."""
    type: str
    request: Half
    response: Half


class Parameter(msgspec.Struct, frozen=True):
    """A parameter: `/r1/safety_monitor.max_speed`. Without a value it is not there."""

    name: str
    value: Any = msgspec.UNSET
    type: str | msgspec.UnsetType | None = msgspec.UNSET
    """`float64`, `float64_array`, `byte_array`: where JSON does not tell; a client that knows none may say null."""


class Wanted(msgspec.Struct, frozen=True, rename="camel"):
    """A subscription, by the number that the client gives it."""

    id: int
    channel_id: int


class Offered(msgspec.Struct, frozen=True, rename="camel"):
    """A topic on which a client will publish."""

    id: int
    topic: str
    encoding: str
    schema_name: str


class _Said(msgspec.Struct, frozen=True, tag_field="op", rename="camel"):
    pass


class Subscribe(_Said, frozen=True, tag="subscribe"):
    """Messages of these topics are wanted."""

    subscriptions: list[Wanted]


class Unsubscribe(_Said, frozen=True, tag="unsubscribe"):
    """And no longer of these."""

    subscription_ids: list[int]


class Advertise(_Said, frozen=True, tag="advertise"):
    """The client is going to publish."""

    channels: list[Offered]


class Unadvertise(_Said, frozen=True, tag="unadvertise"):
    """And no longer there."""

    channel_ids: list[int]


class GetParameters(_Said, frozen=True, tag="getParameters"):
    """Values are asked for; of all parameters where none is named."""

    parameter_names: list[str] = []
    id: str | None = None


class SetParameters(_Said, frozen=True, tag="setParameters"):
    """Parameters are to be set."""

    parameters: list[Parameter]
    id: str | None = None


class WatchParameters(_Said, frozen=True, tag="subscribeParameterUpdates"):
    """Each change of these is wanted; of all where none is named."""

    parameter_names: list[str] = []


class UnwatchParameters(_Said, frozen=True, tag="unsubscribeParameterUpdates"):
    """And no longer of these."""

    parameter_names: list[str] = []


class WatchGraph(_Said, frozen=True, tag="subscribeConnectionGraph"):
    """Who publishes, subscribes and serves what is wanted."""


class UnwatchGraph(_Said, frozen=True, tag="unsubscribeConnectionGraph"):
    """And no longer."""


class Publish(NamedTuple):
    """A message of a client."""

    channel: int
    data: bytes


class Call(NamedTuple):
    """A call of a service."""

    service: int
    call: int
    encoding: str
    data: bytes


class Control(NamedTuple):
    """What a viewer wants of who plays a recording."""

    plays: bool
    """Whether it is to go on, or to stand."""
    rate: float
    seek: int | None
    """To this time first, ns since the epoch."""
    request: str
    """By which the answer is known."""


Said = (
    Subscribe
    | Unsubscribe
    | Advertise
    | Unadvertise
    | GetParameters
    | SetParameters
    | WatchParameters
    | UnwatchParameters
    | WatchGraph
    | UnwatchGraph
)
Request = Said | Publish | Call | Control

_words: msgspec.json.Decoder[Said] = msgspec.json.Decoder(Said)
_U32, _CALL = struct.Struct("<I"), struct.Struct("<III")
_CONTROL = struct.Struct("<BfBQI")
_MESSAGE, _TIME, _ANSWER, _STATE = (struct.Struct(form) for form in ("<BIQ", "<BQ", "<BIII", "<BBQfBI"))


def read(said: str | bytes) -> Request:
    """What a client says.

    Raises:
        Unreadable: it makes no sense.
    """
    try:
        return _words.decode(said) if isinstance(said, str) else _read_bytes(said)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, struct.error) as error:
        raise Unreadable(str(error)) from None


def _read_bytes(frame: bytes) -> Request:
    kind = frame[:1]
    if kind == b"\x01":
        return Publish(_U32.unpack_from(frame, 1)[0], frame[1 + _U32.size :])
    if kind == b"\x02":
        service, call, length = _CALL.unpack_from(frame, 1)
        encoding, data = _text(frame, 1 + _CALL.size, length)
        return Call(service, call, encoding, data)
    if kind == b"\x03":
        command, rate, seeks, at, length = _CONTROL.unpack_from(frame, 1)
        if command not in (0, 1):
            raise Unreadable(f"command {command} of playback is not known")
        return Control(command == 0, rate, at if seeks else None, _text(frame, 1 + _CONTROL.size, length)[0])
    raise Unreadable(f"bytes that begin with {frame[0]} are not known" if frame else "there are no bytes")


def _text(frame: bytes, begin: int, length: int) -> tuple[str, bytes]:
    if len(frame) < begin + length:
        raise Unreadable("it ends too early")
    return frame[begin : begin + length].decode(), frame[begin + length :]


def message(subscription: int, time: int, payload: bytes) -> bytes:
    """A message of a topic; its time is in ns since the epoch."""
    return _MESSAGE.pack(1, subscription, max(0, time)) + payload


def time_of(now: int) -> bytes:
    """What time it is, ns since the epoch."""
    return _TIME.pack(2, max(0, now))


def answer(call: Call, payload: bytes) -> bytes:
    """What a service has answered, in the encoding in which it was asked."""
    encoding = call.encoding.encode()
    return _ANSWER.pack(3, call.service, call.call, len(encoding)) + encoding + payload


PLAYING, PAUSED, ENDED = 0, 1, 3


def playback(status: int, position: int, rate: float, request: str = "", *, jumped: bool = False) -> bytes:
    """How far a recording is played.

    Args:
        status: PLAYING, PAUSED or ENDED.
        position: ns since the epoch.
        rate: times as fast as recorded.
        request: the `Control` that it answers; empty for none.
        jumped: whether it does not follow what was told before.
    """
    asked = request.encode()
    return _STATE.pack(5, status, max(0, position), rate, jumped, len(asked)) + asked


def word(op: str, **what: object) -> str:
    """A word to a client."""
    return msgspec.json.encode({"op": op, **what}).decode()


def status(level: int, text: str, id_: str = "") -> str:
    """Something that a person should see; of one id the last one holds."""
    named = {"id": id_} if id_ else {}
    return word("status", level=level, message=text, **named)


def no_status(*ids: str) -> str:
    """What a person should see no longer."""
    return word("removeStatus", statusIds=ids)


def server_info(name: str, capabilities: Sequence[str], session: str, play_range: tuple[int, int] | None = None) -> str:
    """The first word to a client: what can be done here.

    Args:
        name: of the server.
        capabilities: by the protocol's words.
        session: another one makes the client forget what it has seen.
        play_range: from when to when a recording goes, ns since the epoch.
    """
    ends: Mapping[str, object] = {}
    if play_range is not None:
        ends = {
            name: {"sec": at // 10**9, "nsec": at % 10**9}
            for name, at in zip(("dataStartTime", "dataEndTime"), play_range, strict=True)
        }
    # By the name of a ROS 2 viewers choose its definitions for what they publish; these have not changed since.
    more = {"metadata": {"ROS_DISTRO": "humble"}, "sessionId": session, "supportedEncodings": ENCODINGS}
    return word("serverInfo", name=name, capabilities=list(capabilities), **more, **ends)


ENCODINGS = ("cdr", "json")
"""Of what clients publish and ask; viewers take the first one that they know."""
