"""The policy: which names there are, of which role, and what each role and name may do.

Pure: from the text of `policy.yaml` to a `Policy`, or to all of its mistakes with their places.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import cast

import msgspec
import zenoh

from robo.errors import InvalidName, PolicyError
from robo.security.rights import OF_ROBOTS, RIGHTS, ROLES, Right, Role
from robo.text.brief import shown
from robo.text.choices import choice_of
from robo.text.suggestions import suggest
from robo.text.tree import Items, Map, Position, Problem, Scalar, Tree, kind
from robo.text.yaml_tree import as_yaml, parse
from robo.wire import names

OWN = "NAME"
"""What stands in a role's keys for the name that has the role: `NAME/**` is `r1/**` for robot r1."""

MOST_OF_A_NAME = 64
"""Characters; a certificate takes no longer one."""

Rights = dict[Right, tuple[str, ...]]
"""The keys of each right."""

_HEAD = """\
# Who may do what on this network; docs/security.md explains it. `robo security add, allow, deny, revoke` write here.
# In a role's keys NAME is the name that has the role: of robot r1, NAME/** is r1/**.
# publish, subscribe, call and serve are followed by topics and services, list and command by robots.
"""


class Grants(msgspec.Struct, frozen=True, kw_only=True):
    """What is allowed, and what is taken away of it."""

    allow: Rights = {}
    deny: Rights = {}


class Entry(msgspec.Struct, frozen=True, kw_only=True):
    """One machine or person."""

    role: Role
    more: Grants = Grants()
    """Beside what its role may."""
    only: Rights | None = None
    """In place of what its role may; None where the role holds."""


class Policy(msgspec.Struct, frozen=True, kw_only=True):
    """Who may do what."""

    names: dict[str, Entry] = {}
    roles: dict[Role, Grants] = {}
    places: dict[str, Position] = {}
    """Where in its file each list of keys stands, by `role.allow.publish`, for explanations."""

    def allowed(self, name: str) -> Iterator[tuple[Right, tuple[str, ...], str]]:
        """Every right of a name: its keys, and where that is said."""
        entry = self.names[name]
        role = self.roles.get(entry.role, Grants())
        if entry.only is not None:
            for right, keys in entry.only.items():
                yield right, keys, f"{name}.only.{right}"
        else:
            for right, keys in role.allow.items():
                yield right, filled(keys, name), f"{entry.role}.allow.{right}"
        for right, keys in entry.more.allow.items():
            yield right, keys, f"{name}.allow.{right}"

    def denied(self, name: str) -> Iterator[tuple[Right, tuple[str, ...], str]]:
        """Every right that is taken from a name: its keys, and where that is said."""
        entry = self.names[name]
        for right, keys in self.roles.get(entry.role, Grants()).deny.items():
            yield right, filled(keys, name), f"{entry.role}.deny.{right}"
        for right, keys in entry.more.deny.items():
            yield right, keys, f"{name}.deny.{right}"


def filled(keys: tuple[str, ...], name: str) -> tuple[str, ...]:
    """Keys of a role, for a name that has it."""
    return tuple("/".join(name if chunk == OWN else chunk for chunk in key.split("/")) for key in keys)


_OF_NODES = tuple(f"**/parameters/{verb}" for verb in ("list", "get", "describe", "explain"))

DEFAULT_ROLES: dict[Role, Grants] = {
    "robot": Grants(allow={"publish": ("NAME/**",), "subscribe": ("NAME/**",), "serve": ("NAME/**",)}),
    "operator": Grants(
        allow={"publish": ("**",), "subscribe": ("**",), "call": ("**",), "list": ("**",), "command": ("**",)}
    ),
    "viewer": Grants(allow={"subscribe": ("**",), "call": _OF_NODES, "list": ("**",)}),
}
"""What a new policy says of roles. A router passes on everything; that is what it is for."""


def checked_name(name: str) -> str:
    """A name that a machine or a person may have.

    Raises:
        PolicyError: it breaks the rules of names.
    """
    try:
        word = names.robot_name(name)
    except InvalidName as error:
        raise PolicyError(str(error)) from None
    if "/" in word or len(word) > MOST_OF_A_NAME or word == OWN or word in ROLES:
        raise PolicyError(
            f"{shown(name)} is no name for a machine or a person: one word of at most {MOST_OF_A_NAME} characters,"
            f" and none of {', '.join((OWN, *ROLES))}"
        )
    return word


def fault_of_key(right: Right, key: str) -> str:
    """What is wrong with a key as people say it; empty where nothing is."""
    if key.startswith("/"):
        return f"{shown(key)}: leave the first / out"
    try:
        canonical = str(zenoh.KeyExpr.autocanonize(key))
    except zenoh.ZError:
        return f"{shown(key)} is no key; write r1/cmd_vel, r1/** or **"
    if canonical != key:
        return f"{shown(key)} is written {canonical}"
    if "@" in key:
        return f"{shown(key)}: keys with @ are robo's own; the rights list and command say who may use them"
    if right in OF_ROBOTS and ("/" in key or ("*" in key and key not in ("*", "**"))):
        return f"{shown(key)}: {right} is followed by the name of a robot, or by ** for all"
    return ""


# -- the file ----------------------------------------------------------------------------------------------------------


def text_of(policy: Policy) -> str:
    """The file of a policy."""
    return _HEAD + as_yaml(_plain(policy))


def _plain(policy: Policy) -> dict[str, object]:
    return {
        "roles": {role: _grants(grants) for role, grants in policy.roles.items()},
        "names": {name: _entry(entry) for name, entry in sorted(policy.names.items())},
    }


def _grants(grants: Grants) -> dict[str, object]:
    said: dict[str, object] = {right: list(grants.allow[right]) for right in RIGHTS if right in grants.allow}
    if grants.deny:
        said["deny"] = {right: list(grants.deny[right]) for right in RIGHTS if right in grants.deny}
    return said


def _entry(entry: Entry) -> dict[str, object]:
    only = {} if entry.only is None else {"only": {r: list(entry.only[r]) for r in RIGHTS if r in entry.only}}
    return {"role": entry.role, **_grants(entry.more), **only}


def read(text: str, file: object) -> Policy:
    """The policy that a text says.

    Raises:
        PolicyError: all of its mistakes, a line for each.
    """
    problems: list[Problem] = []
    tree = parse(text, file, problems)
    policy = _Reader(problems).policy(tree) if tree is not None else Policy()
    if problems:
        raise PolicyError("\n".join(map(str, sorted(problems, key=lambda one: one.position[1:]))))
    return policy


class _Reader:
    def __init__(self, problems: list[Problem]) -> None:
        self._problems = problems
        self._places: dict[str, Position] = {}

    def policy(self, tree: Tree) -> Policy:
        entries: dict[str, Entry] = {}
        roles: dict[Role, Grants] = {}
        parts: dict[str, Callable[[Tree], None]] = {
            "roles": lambda found: self._roles(found, roles),
            "names": lambda found: self._names(found, entries),
        }
        self._take(tree, "a policy", parts)
        return Policy(names=entries, roles=roles, places=self._places)

    def _roles(self, tree: Tree, roles: dict[Role, Grants]) -> None:
        for entry in self._map(tree, "roles"):
            role = choice_of(entry.key, ROLES)
            if role is None:
                self._wrong(entry.position, f"there is no role {shown(entry.key)}; {suggest(entry.key, ROLES)}")
            elif role == "router":
                self._wrong(entry.position, "a router passes on everything; there is nothing to say of its role")
            else:
                roles[role], _, _ = self._said(entry.value, role, with_role=False)

    def _names(self, tree: Tree, entries: dict[str, Entry]) -> None:
        for entry in self._map(tree, "names"):
            try:
                name = checked_name(entry.key)
            except PolicyError as error:
                self._wrong(entry.position, str(error))
                continue
            if isinstance(entry.value, Scalar) and entry.value.value is not None:  # the short form
                role = self._role(entry.value)
                more, only = Grants(), None
            else:
                more, role, only = self._said(entry.value, name, with_role=True)
            if role is not None:
                entries[name] = Entry(role=role, more=more, only=only)

    def _said(self, tree: Tree, whose: str, *, with_role: bool) -> tuple[Grants, Role | None, Rights | None]:
        allow: Rights = {}
        deny: Rights = {}
        only: Rights = {}
        found: dict[str, object] = {}

        def take_role(value: Tree) -> None:
            found["role"] = self._role(value)

        def take_only(value: Tree) -> None:
            found["only"] = only
            self._rights(value, only, f"{whose}.only")

        parts: dict[str, Callable[[Tree], None]] = {
            right: partial(self._keys, right=right, into=allow, where=f"{whose}.allow") for right in RIGHTS
        }
        parts["deny"] = lambda value: self._rights(value, deny, f"{whose}.deny")
        if with_role:
            parts |= {"role": take_role, "only": take_only}
        self._take(tree, whose, parts)
        if with_role and "role" not in found:
            self._wrong(tree.position, f"{whose} has no role; say role: {', '.join(ROLES[:-1])} or {ROLES[-1]}")
        return Grants(allow=allow, deny=deny), cast("Role | None", found.get("role")), only if "only" in found else None

    def _rights(self, tree: Tree, into: Rights, where: str) -> None:
        parts: dict[str, Callable[[Tree], None]] = {
            right: partial(self._keys, right=right, into=into, where=where) for right in RIGHTS
        }
        self._take(tree, where.replace(".", ": "), parts)

    def _keys(self, tree: Tree, right: Right, into: Rights, where: str) -> None:
        items = tree.items if isinstance(tree, Items) else (tree,)
        keys: list[str] = []
        for item in items:
            if not (isinstance(item, Scalar) and isinstance(item.value, str)):
                self._wrong(item.position, f"{right}: expected keys such as r1/cmd_vel, not {kind(item)}")
            elif fault := fault_of_key(right, item.value):
                self._wrong(item.position, f"{right}: {fault}")
            else:
                keys.append(item.value)
        into[right] = tuple(keys)
        self._places[f"{where}.{right}"] = tree.position

    def _role(self, tree: Tree) -> Role | None:
        word = str(tree.value) if isinstance(tree, Scalar) else ""
        role = choice_of(word, ROLES)
        if role is None:
            self._wrong(
                tree.position, f"role: there is no {shown(word) if word else kind(tree)}; {suggest(word, ROLES)}"
            )
        return role

    def _take(self, tree: Tree, what: str, parts: Mapping[str, Callable[[Tree], None]]) -> None:
        for entry in self._map(tree, what):
            take = parts.get(entry.key)
            if take is None:
                self._wrong(entry.position, f"{what} has no {shown(entry.key)}; {suggest(entry.key, parts)}")
            else:
                take(entry.value)

    def _map(self, tree: Tree, what: str) -> Map:
        if isinstance(tree, Map):
            return tree
        if not (isinstance(tree, Scalar) and tree.value is None):
            self._wrong(tree.position, f"{what}: expected a map, not {kind(tree)}")
        return Map((), tree.position)

    def _wrong(self, position: Position, text: str) -> None:
        self._problems.append(Problem(position, text))


# -- changes -----------------------------------------------------------------------------------------------------------


def changed(policy: Policy, whom: str, right: Right, key: str, *, allow: bool) -> Policy:
    """A policy in which a role or a name may do something more, or may not do it any more.

    What the other list says of the same key goes. A right of a role that was said literally is just taken back; what is
    still allowed by a wider key is denied.

    Raises:
        PolicyError: there is no such role or name, or the key is none.
    """
    if fault := fault_of_key(right, key):
        raise PolicyError(f"{right}: {fault}")
    role = choice_of(whom, ROLES)
    if role == "router":
        raise PolicyError("a router passes on everything: what it may is not to be said")
    if role is not None:
        before = policy.roles.get(role, Grants())
        return msgspec.structs.replace(policy, roles={**policy.roles, role: _with(before, right, key, allow=allow)})
    entry = entry_of(policy, whom)
    if entry.role == "router":
        raise PolicyError(f"{whom} is a router, which passes on everything: what it may is not to be said")
    only = entry.only
    if only is not None and not allow and key in only.get(right, ()):
        only = {**only, right: tuple(one for one in only[right] if one != key)}
    after = msgspec.structs.replace(entry, more=_with(entry.more, right, key, allow=allow), only=only)
    return msgspec.structs.replace(policy, names={**policy.names, whom: after})


def _with(grants: Grants, right: Right, key: str, *, allow: bool) -> Grants:
    allowed, denied = dict(grants.allow), dict(grants.deny)
    add, drop = (allowed, denied) if allow else (denied, allowed)
    was = drop.get(right, ())
    drop[right] = tuple(one for one in was if one != key)
    if not drop[right]:
        del drop[right]
    covered = any(zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(key)) for one in drop.get(right, ()))
    if allow or key not in was or covered:
        add[right] = tuple(dict.fromkeys((*add.get(right, ()), key)))
    return Grants(allow=allowed, deny=denied)


def entry_of(policy: Policy, name: str) -> Entry:
    """What a policy says of a name.

    Raises:
        PolicyError: it does not know the name.
    """
    entry = policy.names.get(name)
    if entry is None:
        raise PolicyError(f"the policy has no name {shown(name)}; {suggest(name, policy.names)}")
    return entry
