"""What the rules say of one use of the network, and which words of the policy say it. Pure, without a router."""

from collections.abc import Iterable

import msgspec
import zenoh

from robo.security import rights
from robo.security.policy import Policy, entry_of
from robo.security.rights import Grant, Right
from robo.text.tree import Position
from robo.wire.names import shown_key


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """Whether somebody may do something, and why."""

    name: str
    role: str
    right: Right
    key: str
    allowed: bool
    reason: str
    """A sentence."""
    rule: str = ""
    """The key that decides; empty where none does."""
    place: str = ""
    """Where in the policy it stands."""


def explain(policy: Policy, name: str, right: Right, key: str) -> Verdict:
    """What a router says where a name uses a right on a key.

    Raises:
        PolicyError: the policy does not know the name.
    """
    entry = entry_of(policy, name)

    def verdict(reason: str, rule: str = "", where: str = "", *, allowed: bool) -> Verdict:
        place = policy.places.get(where)
        return Verdict(
            name=name, role=entry.role, right=right, key=key, allowed=allowed, reason=reason, rule=rule,
            place=str(place) if isinstance(place, Position) else "",
        )  # fmt: skip

    if entry.role == "router":
        return verdict(f"{name} is a router, which passes on everything", allowed=True)
    asked = rights.asked_key(right, key)
    for kind, keys, where in policy.denied(name):
        for one in keys:
            if _covers(rights.denied(kind, (one,)), right, asked):
                return verdict(f"{_who(where)} may not {kind} {one}", one, where, allowed=False)
    found = [*policy.allowed(name)]
    for kind, keys, where in found:
        for one in keys:
            if _covers(rights.allowed(kind, (one,)), right, asked):
                said = f"may {kind} {one}" if where.count(".only.") == 0 else f"may {kind} {one}, by its contracts"
                return verdict(f"{_who(where)} {said}", one, where, allowed=True)
    partly = [
        one for kind, keys, _ in found if kind == right for one in keys if _meets(rights.asked_key(right, one), asked)
    ]
    if partly:
        narrower = f"{partly[0]} is narrower than {key}, and a rule holds only for what it includes as a whole"
        return verdict(
            f"nothing allows {name} to {right} all of {shown_key(key)}: {narrower}", partly[0], allowed=False
        )
    return verdict(f"nothing allows {name}, {_article(entry.role)}, to {right} {shown_key(key)}", allowed=False)


def _who(where: str) -> str:
    whose = where.partition(".")[0]
    return f"{_article(whose)}" if whose in rights.ROLES else whose


def _article(role: str) -> str:
    return f"{'an' if role[0] in 'aeiou' else 'a'} {role}"


def _covers(grants: Iterable[Grant], right: Right, key: str) -> bool:
    message = rights.MAIN[right]

    return any(
        zenoh.KeyExpr(one).includes(zenoh.KeyExpr(key))
        for grant in grants
        if grant.flow == "ingress" and message in grant.messages
        for one in grant.keys
    )


def _meets(one: str, other: str) -> bool:
    return zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other))
