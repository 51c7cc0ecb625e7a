"""Keys and liveliness tokens of rmw_zenoh: how ROS 2 finds nodes and the ends of topics and services. Pure.

`@ros2_lv/<domain>/<session>/<node>/<end>/<kind>/<enclave>/<namespace>/<name>`, and for an end
`…/<topic>/<type>/<hash>/<qos>`. `/` within a chunk is written `%`. Anybody may declare any key: what does not spell a
token is none.
"""

import re
from typing import Literal, NamedTuple, get_args

import msgspec

from robo.bridges.ros2 import quality
from robo.bridges.ros2.quality import RosQoS
from robo.text.choices import choice_of
from robo.wire import names

PREFIX = "@ros2_lv"
NO_HASH = "TypeHashNotSupported"
"""What distributions before Jazzy say in the place of a hash."""
MOST_DOMAIN = 232
"""The largest domain id that ROS takes."""

Kind = Literal["MP", "MS", "SS", "SC"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""A publisher, a subscription, a service, a client of one."""

_LONGEST = 2_000
"""Characters of a token: none of ROS's own is as long."""
_SESSION = re.compile(r"[0-9a-f]{1,32}")
_NUMBER = re.compile(r"\d{1,9}", re.ASCII)
_HASH = re.compile(r"RIHS01_[0-9a-f]{64}|TypeHashNotSupported")
_TYPE = re.compile(r"([A-Za-z]\w*)::(msg|srv|action)::dds_::([A-Za-z]\w*)_", re.ASCII)


class NodeToken(msgspec.Struct, frozen=True):
    """A node of ROS's graph."""

    domain: int
    session: str
    """Zenoh's id of the session that has declared it."""
    number: int
    """Of the node within its session."""
    namespace: str
    """Without outer slashes."""
    name: str

    @property
    def full_name(self) -> str:
        """For example `/r1/listener`."""
        return "/" + names.join(self.namespace, self.name)

    def key(self) -> str:
        """The token's key expression."""
        whose = f"{PREFIX}/{self.domain}/{self.session}/{self.number}/{self.number}/NN"
        return f"{whose}/%/{mangled(self.namespace)}/{self.name}"


class EndToken(msgspec.Struct, frozen=True):
    """A publisher, a subscription, a service or a client of one."""

    node: NodeToken
    number: int
    """Of the end within its session."""
    kind: Kind
    topic: str
    """The topic's or the service's full name, without its leading slash."""
    type: str
    """As DDS has it: `std_msgs::msg::dds_::String_`."""
    hash: str
    quality: RosQoS
    said: str = ""
    """The key as its session has declared it, by which ROS knows it: others may spell the same otherwise."""

    def key(self) -> str:
        """The token's key expression."""
        n = self.node
        whose = (
            f"{PREFIX}/{n.domain}/{n.session}/{n.number}/{self.number}/{self.kind}/%/{mangled(n.namespace)}/{n.name}"
        )
        return f"{whose}/{mangled(self.topic)}/{self.type}/{self.hash}/{self.quality.word}"

    @property
    def data_key(self) -> str:
        """The key of what it sends and hears."""
        return data_key(self.node.domain, self.topic, self.type, self.hash)


def parse(key: str) -> NodeToken | EndToken | None:
    """The token that a key spells; None for a key that spells none."""
    chunks = key.split("/")
    if len(key) > _LONGEST or len(chunks) not in (9, 13, 14) or chunks[0] != PREFIX:
        return None  # newer releases say one chunk more of ends
    domain, session, node, end, kind, _, namespace, name = chunks[1:9]
    if not (_SESSION.fullmatch(session) and names.is_word(name) and _is_number(domain, node, end)):
        return None
    inner = unmangled(namespace)
    if inner is None or int(domain) > MOST_DOMAIN:
        return None
    owner = NodeToken(int(domain), session, int(node), inner, name)
    if kind == "NN":
        return owner if len(chunks) == 9 and node == end else None
    which = choice_of(kind, KINDS)
    if which is None or len(chunks) == 9:
        return None
    topic, type_, hash_, word = unmangled(chunks[9]), *chunks[10:13]
    found = quality.from_word(word)
    if not topic or found is None or not (_TYPE.fullmatch(type_) and _HASH.fullmatch(hash_)):
        return None
    return EndToken(owner, int(end), which, topic, type_, hash_, found, key)


class DataKey(NamedTuple):
    """What the key of a message says."""

    topic: str
    """The full name, without its leading slash."""
    type: str
    """As DDS has it."""
    hash: str


def data_key(domain: int, topic: str, type_: str, hash_: str) -> str:
    """The key of a topic's messages, or of a service."""
    return f"{domain}/{topic}/{type_}/{hash_}"


def parse_data_key(key: str, domain: int) -> DataKey | None:
    """What the key of a message says; None for one that is none of this domain's."""
    chunks = key.split("/")
    if len(key) > _LONGEST or len(chunks) < 4 or chunks[0] != str(domain):
        return None
    type_, hash_ = chunks[-2:]
    if not (all(map(names.is_word, chunks[1:-2])) and _TYPE.fullmatch(type_) and _HASH.fullmatch(hash_)):
        return None
    return DataKey("/".join(chunks[1:-2]), type_, hash_)


def dds_type(name: str) -> str:
    """A type as DDS has it: `geometry_msgs/msg/Twist` is `geometry_msgs::msg::dds_::Twist_`."""
    package, folder, own = name.split("/")
    return f"{package}::{folder}::dds_::{own}_"


def ros_type(type_: str) -> str:
    """A type as ROS has it, of one as DDS has it; as it is where it is none."""
    match = _TYPE.fullmatch(type_)
    return "/".join(match.groups()) if match is not None else type_


def mangled(name: str) -> str:
    """A name without its leading slash as one chunk: `r1/odom` is `%r1%odom`, the root `%`."""
    return "%" + name.replace("/", "%")


def unmangled(chunk: str) -> str | None:
    """The name, without its leading slash, that a chunk spells; None for one that spells none."""
    if not chunk.startswith("%"):
        return None
    name = chunk[1:].replace("%", "/")
    return name if not name or all(map(names.is_word, name.split("/"))) else None


def _is_number(*words: str) -> bool:
    return all(_NUMBER.fullmatch(word) for word in words)
