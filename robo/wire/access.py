"""What others may do at a robot's router, as Zenoh's rules.

Who comes over a unix socket comes through a folder that is the owner's alone, and may do all. Who comes by another way
looks: he hears what is published and logged, sees who is there, and asks what only tells. Nothing that he publishes,
answers, announces, calls or sets goes past the router.

A rule of Zenoh's covers a key that it *includes*, so a question with wildcards needs a rule as wide. `**` covers no key
with a part that begins with `@`: these are said.

Rules hold for what passes the router. So that nobody leads anybody past it, others are in a region of their own:
without that the router's gossip tells the robot's nodes where a stranger listens, and they link to him (Zenoh 1.10.2).
"""

from collections.abc import Sequence
from typing import Literal, get_args

from robo.wire.keys import TELLS

WHOLE = ("access_control", "gateway")
"""The settings that are made here, each of which stands as a whole."""

LOOKS = "look"
"""What the owner's router says that others may do, in its metadata."""

_Message = Literal[
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
]
_ALL: tuple[_Message, ...] = get_args(_Message)

_EVERYWHERE = ("**", "@robo/**", "**/@adv/**", "@robo/**/@adv/**", "@ros2_lv/**")
"""What is published and announced, by robo, by Zenoh's latched publishers and by rmw_zenoh."""

_ADMIN = ("@/**", "@/**/@ros2/**", "@/**/@ros2_lv/**", "@/**/@adv/**")
"""What Zenoh and its plugins say of themselves."""

_TELLS = (
    *(f"@robo/**/supervisor/{verb}" for verb in TELLS),
    "@robo/**/status/*",
    "@robo/**/status/*/log",
    *(f"**/parameters/{verb}" for verb in ("list", "get", "describe", "explain")),
    *(f"**/get_{what}" for what in ("state", "available_states", "available_transitions", "transition_graph")),
    "**/@adv/**",
    "@/*/router",
)
"""What may be asked: what is answered there only tells."""


def settings(shared: Sequence[str] = ()) -> dict[str, object]:
    """Zenoh's settings, by path, for a router to which others come over a network link.

    Args:
        shared: the robots, by namespace, with which they may do all.
    """
    rules = [
        _rule("own", _ALL, (*_EVERYWHERE, *_ADMIN), ("ingress", "egress")),
        _rule("hear", ("declare_subscriber",), _EVERYWHERE, ("ingress",)),
        _rule("see", ("liveliness_query", "declare_liveliness_subscriber"), _EVERYWHERE, ("ingress",)),
        _rule("ask", ("query",), _TELLS, ("ingress",)),
        _rule("told", ("put", "delete", "liveliness_token", "declare_queryable"), _EVERYWHERE, ("egress",)),
        _rule("answered", ("reply",), (*_EVERYWHERE, *_ADMIN), ("egress",)),
    ]
    others = [str(rule["id"]) for rule in rules[1:]]
    if shared:
        theirs = [key for robot in shared for key in _of_robot(robot)]
        rules.append(_rule("shared", _ALL, theirs, ("ingress", "egress")))
        others.append("shared")
    return {
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": [
                {"id": "owner", "link_protocols": ["unixsock-stream"]},
                {"id": "others", "link_protocols": ["tcp", "udp", "tls", "quic", "ws"]},
            ],
            "policies": [{"subjects": ["owner"], "rules": ["own"]}, {"subjects": ["others"], "rules": others}],
        },
        "gateway": {
            "south": [
                # A unix socket has no interface, so all that it has, none, are of this list.
                {"filters": [{"modes": ["peer", "client"], "interfaces": [_NONE]}]},
                {"filters": [{"modes": ["peer", "client", "router"], "interfaces": [_NONE], "negated": True}]},
            ]
        },
        # Who has connected and says nothing takes a place of those that the owner's tools need as well: 100 of
        # them, for 10 s each, if nothing is said here.
        "transport/unicast/accept_pending": 2000,
        "transport/unicast/accept_timeout": 3000,
    }


_NONE = "-"
"""A name that no interface has."""


def told(owner: str, shared: Sequence[str] = ()) -> dict[str, object]:
    """What a router says of it where one asks who is there, beside its name."""
    return {"owner": owner, "others": LOOKS, "shared": [*shared]}


def refusal(owner: str, shared: Sequence[str], robot: str, *, mine: bool, joins: bool = False) -> str | None:
    """Why somebody who came as others do may do nothing but look; None where he may do all with the robot.

    Args:
        owner: whose the router is.
        shared: the robots with which others may do all.
        robot: which is meant; empty for any.
        mine: whether the owner himself has come by this way.
        joins: whether the robot is one that wants to be there, and not one that is.
    """
    if any(robot == one or robot.startswith(f"{one}/") for one in shared) or (shared and not robot):
        return None
    whose = f"the robot {robot} belongs" if robot and not joins else "what runs there belongs"
    if mine:
        return f"{whose} to you, and by this way it is read-only, as for others: leave out --connect and ROBO_CONNECT"
    return f"{whose} to user {owner}; it is read-only for others until {owner} starts it with --share"


def _of_robot(namespace: str) -> tuple[str, ...]:
    return f"{namespace}/**", f"{namespace}/**/@adv/**", f"@robo/{namespace}/**"


def _rule(name: str, messages: Sequence[_Message], keys: Sequence[str], flows: Sequence[str]) -> dict[str, object]:
    return {
        "id": name,
        "messages": [*messages],
        "key_exprs": [*keys],
        "flows": [*flows],
        "permission": "allow",
    }
