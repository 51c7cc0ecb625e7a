"""What a right is made of in Zenoh's terms: which messages, in which direction, on which keys. Pure.

The directions are the router's: `ingress` is what it hears of whoever has the right, `egress` what it tells him. A
rule holds for a key that its own key *includes*, so a question with wildcards needs a rule that is as wide, and `**`
includes no key with a chunk that begins with `@`. What is told to somebody is kept wide where no more can come of it
than what he has asked for, and that he may only ask within his rights.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple, get_args

from robo.wire.keys import ACTS, PREFIX, TELLS

Right = Literal["publish", "subscribe", "call", "serve", "list", "command"]
RIGHTS: tuple[Right, ...] = get_args(Right)
"""`list` is to see robots and nodes and to ask how they are, `command` to stop, start and end them."""

Role = Literal["robot", "router", "operator", "viewer"]
ROLES: tuple[Role, ...] = get_args(Role)

Flow = Literal["ingress", "egress"]

OF_ROBOTS: tuple[Right, ...] = ("list", "command")
"""The rights whose keys are names of robots; those of the others are names of topics and services."""

EVERYTHING = ("**", "**/@adv/**", f"{PREFIX}/**", "@/**")
"""All keys there are: topics, what latched publishers say of themselves, robo's own, and Zenoh's own."""

ALL_MESSAGES = (
    "put", "delete", "query", "reply", "declare_subscriber", "declare_queryable",
    "liveliness_token", "liveliness_query", "declare_liveliness_subscriber",
)  # fmt: skip


class Grant(NamedTuple):
    """Some messages on some keys, in one direction."""

    flow: Flow
    messages: tuple[str, ...]
    keys: tuple[str, ...]


MAIN: dict[Right, str] = {
    "publish": "put",
    "subscribe": "declare_subscriber",
    "call": "query",
    "serve": "declare_queryable",
    "list": "liveliness_query",
    "command": "query",
}
"""The message by which each right is used, and which is refused to whoever does not have it."""


def asked_key(right: Right, key: str) -> str:
    """The key on which the main message of a right goes, for a key as people say it."""
    match right:
        case "list":
            return _of_robots(key, "")
        case "command":
            return _of_robots(key, "supervisor/down")
        case _:
            return key


def allowed(right: Right, keys: Sequence[str]) -> Iterator[Grant]:
    """What a right to some keys takes."""
    own = tuple(keys)
    latched = tuple(f"{key}/@adv/**" for key in keys)
    match right:
        case "publish":
            yield Grant("ingress", ("put", "delete"), own)
            # A latched publisher answers for what it has said last, beside its topic, and has a token there.
            yield Grant("ingress", ("declare_queryable", "liveliness_token"), latched)
            yield Grant("ingress", ("reply",), (*own, *latched))
            yield Grant("egress", ("query",), latched)
        case "subscribe":
            yield Grant("ingress", ("declare_subscriber",), own)
            yield Grant("ingress", ("query", "liveliness_query", "declare_liveliness_subscriber"), latched)
            yield Grant("egress", ("put", "delete", "reply"), (*own, *latched))
            yield Grant("egress", ("liveliness_token",), latched)
        case "call":
            yield Grant("ingress", ("query",), own)
            yield Grant("egress", ("reply",), own)
        case "serve":
            yield Grant("ingress", ("declare_queryable", "reply"), own)
            yield Grant("egress", ("query",), EVERYTHING)
        case "list":
            yield from _listed(keys)
        case "command":
            asked = tuple(_of_robots(key, f"supervisor/{verb}") for key in keys for verb in ACTS)
            network = ("@/**",) if "**" in keys else ()
            yield Grant("ingress", ("query",), (*asked, *network))
            yield Grant("egress", ("reply",), (*asked, *network))


def _listed(keys: Sequence[str]) -> Iterator[Grant]:
    tokens = tuple(_of_robots(key, "") for key in keys)
    asked = tuple(_of_robots(key, f"supervisor/{verb}") for key in keys for verb in TELLS)
    asked += tuple(_of_robots(key, part) for key in keys for part in ("status/**", "router/**"))
    heard = tuple(_of_robots(key, part) for key in keys for part in ("output", "events"))
    yield Grant("ingress", ("liveliness_query", "declare_liveliness_subscriber"), tokens)
    yield Grant("egress", ("liveliness_token",), tokens)
    yield Grant("ingress", ("query",), asked)
    yield Grant("egress", ("reply",), asked)
    yield Grant("ingress", ("declare_subscriber",), heard)
    yield Grant("egress", ("put", "delete"), heard)


def denied(right: Right, keys: Sequence[str]) -> Iterator[Grant]:
    """What is taken away with a right to some keys, whatever else allows it."""
    own = tuple(keys)
    match right:
        case "publish":
            yield Grant("ingress", ("put", "delete"), own)
        case "subscribe":
            yield Grant("ingress", ("declare_subscriber",), own)
            # Whoever subscribes to more than that would still get it.
            yield Grant("egress", ("put", "delete"), own)
        case "call":
            yield Grant("ingress", ("query",), own)
        case "serve":
            yield Grant("ingress", ("declare_queryable", "reply"), own)
        case "list":
            tokens = tuple(_of_robots(key, "") for key in keys)
            yield Grant("ingress", ("liveliness_query", "declare_liveliness_subscriber", "query"), tokens)
            yield Grant("egress", ("liveliness_token",), tokens)
        case "command":
            yield Grant("ingress", ("query",), tuple(_of_robots(k, f"supervisor/{v}") for k in keys for v in ACTS))


def presence(robots: Sequence[str]) -> Iterator[Grant]:
    """What a robot's machine says of its robots beside topics: that they are there, what runs, what is printed."""
    own = tuple(f"{PREFIX}/{robot}/**" for robot in robots)
    names_in_use = (f"{PREFIX}/**/claim/*/*/*/*", f"{PREFIX}/**/node/*/*/*/*", *own)
    yield Grant("ingress", ("put", "delete", "declare_queryable", "reply", "liveliness_token", "query"), own)
    yield Grant("egress", ("query",), EVERYTHING)
    yield Grant("egress", ("reply",), own)
    # No two nodes have one name: who starts nodes looks who has theirs.
    yield Grant("ingress", ("liveliness_query", "declare_liveliness_subscriber"), names_in_use)
    yield Grant("egress", ("liveliness_token",), names_in_use)


def attempts() -> Grant:
    """Who listens and serves is told to everybody: else nothing would be sent that is not allowed, and nobody told."""
    return Grant("egress", ("declare_subscriber", "declare_queryable"), EVERYTHING)


def announcing() -> Grant:
    """Tools that publish say so by a token."""
    return Grant("ingress", ("liveliness_token",), (f"{PREFIX}/**",))


def everything() -> Iterator[Grant]:
    """All there is: what routers pass on to each other, and what a robot's own nodes do."""
    yield Grant("ingress", ALL_MESSAGES, EVERYTHING)
    yield Grant("egress", ALL_MESSAGES, EVERYTHING)


def _of_robots(robot: str, part: str) -> str:
    inner = "" if robot == "**" else f"{robot}/"
    return f"{PREFIX}/{inner}**{f'/{part}' if part else ''}"
