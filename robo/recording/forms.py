"""How messages of a topic are written down: as CDR where robo has their type and ROS can, else as the bytes they are.

Pure but for types of users, whose modules are imported when one of them is met first.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import NamedTuple

import robo_messages
from robo.bag.options import CDR, TopicInFile
from robo.bag.types import topic_of
from robo.errors import ContractError, MessageError
from robo.interfaces import catalogue, cdr
from robo.text.brief import brief
from robo.text.unreadable import UNREADABLE
from robo.wire import codec
from robo.wire.codec import Malformed
from robo.wire.qos import QoS
from robo_messages import Message, UnknownType

_IN_FILES = {codec.MSGPACK: "msgpack", codec.JSON: "json"}
"""What MCAP calls encodings; all others are called as Zenoh calls them."""
_IN_ZENOH = {name: encoding for encoding, name in _IN_FILES.items()}
_UNSAID = ("", "zenoh/bytes")
"""What Zenoh says of messages of which nobody has said what they are: nodes read these too."""

_MOST_NAME = 200
"""Of an encoding and a type that somebody says, characters."""

Write = Callable[[bytes], bytes]
"""The payload of a message as a recording has it.

Raises Malformed for one that is no message of its type, or that ROS cannot have: a finite number beyond float32, …
"""


class Form(NamedTuple):
    """How messages of one topic and encoding are written down."""

    topic: TopicInFile
    write: Write
    unknown: str
    """Why they stay the bytes that they are; empty where they become CDR."""


def form_of(key: str, encoding: str, qos: QoS = QoS.DEFAULT, announced: str = "") -> Form:
    """How messages are written down.

    Args:
        key: their topic.
        encoding: Zenoh's, as they say it: `application/msgpack;geometry/Twist`.
        qos: what the publishers of the topic offer.
        announced: the type that nodes say of it; it counts where the messages say none.
    """
    kind, _, name = encoding.partition(";")
    if kind not in _IN_FILES and kind not in _UNSAID:
        return _bytes(key, encoding, qos, f"its messages are in {brief(kind, _MOST_NAME)!r}, which robo does not read")
    name = name or announced
    if not name:
        return _bytes(key, encoding, qos, "nobody says what type its messages are of")
    try:
        type_ = catalogue.find_here(name)
        if type_ is None:
            return _bytes(key, encoding, qos, f"type {brief(name, _MOST_NAME)} is not known here")
        topic = topic_of(key, type_, qos)
        return Form(topic, _to_cdr(type_, encoding), "")
    except (ContractError, UnknownType) as error:
        return _bytes(key, encoding, qos, f"ROS cannot have its type: {error}")
    except Exception as error:  # of a user's module, or of a disk on which it is looked for
        why = brief(f"{type(error).__name__}: {error}", _MOST_NAME)
        return _bytes(key, encoding, qos, f"its type {brief(name, _MOST_NAME)} cannot be used: {why}")


def zenoh_encoding(encoding: str, schema: str) -> str:
    """Zenoh's encoding of messages that were written down as the bytes they are.

    Args:
        encoding, schema: of their topic, as the file has them.
    """
    kind = _IN_ZENOH.get(encoding, encoding)
    return f"{kind};{schema}" if schema else kind


def _bytes(key: str, encoding: str, qos: QoS, why: str) -> Form:
    kind, _, name = encoding.partition(";")
    written = _IN_FILES.get(kind, brief(kind, _MOST_NAME))
    # A file that called its own bytes CDR would be read as ROS's.
    written = f"zenoh/{written}" if written == CDR else written
    return Form(TopicInFile(key, brief(name, _MOST_NAME), "", "", qos, written, ""), _as_it_is, why)


def _as_it_is(payload: bytes) -> bytes:
    return payload


def _to_cdr(type_: type[Message], encoding: str) -> Write:
    """MessagePack or JSON of a type to CDR.

    Raises:
        ContractError, UnknownType: ROS cannot have this type.
    """
    encode = cdr.encoder(type_)
    decoder = codec.Decoder(type_)
    fast = decoder.fast

    def write(payload: bytes) -> bytes:
        try:
            try:
                message = fast(payload)
            except UNREADABLE:
                message = decoder.decode_other(payload, encoding)
            return encode(message)
        except Malformed:
            raise
        except MessageError as error:
            raise Malformed(f"ROS cannot have it: {error}") from None
        except Exception as error:  # a user's class of messages may raise anything
            raise Malformed(brief(f"{type(error).__name__}: {error}", _MOST_NAME)) from None

    return _scans(write) if robo_messages.type_name(type_) == _SCAN else write


def _scans(write: Write) -> Write:
    """Scans of many rays, where there is numpy, without a number of Python's for each ray: in a fifth of the time."""
    swift: Write | None = None
    has_numpy = find_spec("numpy") is not None

    def write_scan(payload: bytes) -> bytes:
        nonlocal swift
        if len(payload) < _LONG_SCAN or not has_numpy:
            return write(payload)
        if swift is None:
            swift = _swift_scans()
        try:
            return swift(payload)
        except (ValueError, MessageError, *UNREADABLE):
            return write(payload)  # JSON, or it is told what is wrong

    return write_scan


def _swift_scans() -> Write:
    from robo_messages.scans import LaserScanArray  # whoever has no such scans does without numpy

    decode, encode = robo_messages.decoder_of(LaserScanArray).decode, cdr.encoder(LaserScanArray)
    return lambda payload: encode(decode(payload))


_SCAN = "sensor/LaserScan"
_LONG_SCAN = 4_000
"""Bytes: 400 rays. For fewer numpy is not worth its memory."""
