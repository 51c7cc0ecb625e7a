"""`metadata.yaml`, which ROS 2 wants beside the files of a recording that has several. Pure."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec


class TopicKey(NamedTuple):
    """What tells topics of a recording apart."""

    name: str
    """As the file calls it."""
    type: str
    """ROS's name of it."""
    encoding: str
    """Of its messages: `cdr`, `msgpack`, …"""


class FileOf(msgspec.Struct, frozen=True):
    """A file of a recording that is whole."""

    name: str
    begin: int
    """The first arrival, ns since the epoch."""
    end: int
    counts: Mapping[TopicKey, int]
    """Messages by topic."""


class TopicOf(msgspec.Struct, frozen=True):
    """A topic of a recording."""

    key: TopicKey
    type_hash: str
    offered: str
    """What its publishers offer, as YAML."""


def metadata_yaml(files: Sequence[FileOf], topics: Sequence[TopicOf]) -> str:
    """The text of the file, in version 9 (Jazzy and later)."""
    full = [file for file in files if sum(file.counts.values())]
    begin = min((file.begin for file in full), default=0)
    end = max((file.end for file in full), default=0)
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 9",
        "  storage_identifier: mcap",
        f"  duration: {{nanoseconds: {end - begin}}}",
        f"  starting_time: {{nanoseconds_since_epoch: {begin}}}",
        f"  message_count: {sum(sum(file.counts.values()) for file in files)}",
        "  topics_with_message_count:" if topics else "  topics_with_message_count: []",
    ]
    for topic in topics:
        lines += [
            f"    - message_count: {sum(file.counts.get(topic.key, 0) for file in files)}",
            "      topic_metadata:",
            f"        name: {_quoted(topic.key.name)}",
            f"        type: {_quoted(topic.key.type)}",
            f"        serialization_format: {_quoted(topic.key.encoding)}",
            f"        type_description_hash: {_quoted(topic.type_hash)}",
            "        offered_qos_profiles:" if topic.offered else "        offered_qos_profiles: []",
            *(f"          {line}" for line in topic.offered.splitlines()),
        ]
    lines += ["  compression_format: ''", "  compression_mode: ''", "  relative_file_paths:"]
    lines += [f"    - {_quoted(file.name)}" for file in files]
    lines.append("  files:")
    for file in files:
        lines += [
            f"    - path: {_quoted(file.name)}",
            f"      starting_time: {{nanoseconds_since_epoch: {file.begin}}}",
            f"      duration: {{nanoseconds: {file.end - file.begin}}}",
            f"      message_count: {sum(file.counts.values())}",
        ]
    return "\n".join([*lines, "  custom_data: {}", "  ros_distro: robo", ""])


def _quoted(text: str) -> str:
    """A text as YAML has it, whatever is in it. (JSON writes what lies beyond 16 bits as two characters.)"""
    plain = (one if one.isprintable() and one not in '"\\' else f"\\U{ord(one):08x}" for one in text)
    return f'"{"".join(plain)}"'
