"""Zenoh's access rules, made from a policy. Pure, and the same policy always gives the same rules.

Each name is a subject of its own, known by the common name of its certificate. Of the rules of one subject a denial is
the stronger; across subjects anything that is allowed anywhere is allowed. So no subject is without a name, and nobody
is shut out by a denial: who is not in the policy has no subject, and nothing is allowed him.
"""

from collections.abc import Iterator

from robo.security import rights
from robo.security.policy import OWN, Grants, Policy, filled
from robo.security.rights import Grant

Rule = dict[str, object]


def access_control(policy: Policy, *, robot: str = "") -> dict[str, object]:
    """Zenoh's `access_control` for a router.

    Args:
        policy: who may do what.
        robot: where it is the router of a robot's machine, that machine's name: all of its own may pass.

    What comes by a unix socket may pass in any case: it is in a folder of the router's user.
    """
    rules: dict[str, Rule] = {}
    subjects: list[dict[str, object]] = []
    policies: list[dict[str, object]] = []
    for name in sorted(policy.names):
        ids = []
        for rule in _rules_of(policy, name):
            rules.setdefault(str(rule["id"]), rule)
            ids.append(rule["id"])
        subjects.append({"id": name, "cert_common_names": [name], "link_protocols": ["tls"]})
        if ids:
            policies.append({"rules": ids, "subjects": [name]})
    found = [_rule(f"{_EVERYTHING}.{index}", grant, "allow") for index, grant in enumerate(rights.everything())]
    rules.update({str(rule["id"]): rule for rule in found})
    own = ["own nodes"]
    subjects.append({"id": own[0], "link_protocols": ["unixsock-stream"]})
    if robot:
        own.append("own routers")
        subjects.append({"id": own[1], "cert_common_names": [robot], "link_protocols": ["tls"]})
    policies.append({"rules": [rule["id"] for rule in found], "subjects": own})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": list(rules.values()),
        "subjects": subjects,
        "policies": policies,
    }


_EVERYTHING = "everything"


def _rules_of(policy: Policy, name: str) -> Iterator[Rule]:
    entry = policy.names[name]
    if entry.role == "router":
        for index, grant in enumerate(rights.everything()):
            yield _rule(f"{_EVERYTHING}.{index}", grant, "allow")
        return
    yield _rule("attempts", rights.attempts(), "allow")
    for right, keys, where in policy.allowed(name):
        for index, grant in enumerate(rights.allowed(right, keys)):
            yield _rule(f"{_of_whom(policy, name, where)}.{index}", grant, "allow")
    for right, keys, where in policy.denied(name):
        for index, grant in enumerate(rights.denied(right, keys)):
            yield _rule(f"{_of_whom(policy, name, where)}.{index}", grant, "deny")
    if entry.role == "robot":
        for index, grant in enumerate(rights.presence(robots_of(policy, name))):
            yield _rule(f"{name}.presence.{index}", grant, "allow")
    elif entry.role == "operator":
        yield _rule("operator.announce", rights.announcing(), "allow")


def robots_of(policy: Policy, name: str) -> list[str]:
    """The robots that a machine runs: that of its own name, and each R of which it may serve all, `R/**`."""
    served = [key.removesuffix("/**") for right, keys, _ in policy.allowed(name) if right == "serve" for key in keys
              if key.endswith("/**")]  # fmt: skip
    return list(dict.fromkeys([name, *(robot for robot in served if "/" not in robot and "*" not in robot)]))


def _of_whom(policy: Policy, name: str, where: str) -> str:
    """The id of a rule: the role's, which all who have it share, unless it is about the name itself."""
    role = policy.names[name].role
    whose, _, what = where.partition(".")
    grants = policy.roles.get(role, Grants())
    kind, _, right = what.partition(".")
    keys = (grants.allow if kind == "allow" else grants.deny).get(right, ()) if whose == role else ()  # type: ignore[call-overload]
    return where if whose == role and filled(keys, OWN + OWN) == keys else f"{name}.{what}"


def _rule(name: str, grant: Grant, permission: str) -> Rule:
    return {
        "id": name,
        "key_exprs": list(dict.fromkeys(grant.keys)),
        "messages": list(grant.messages),
        "flows": [grant.flow],
        "permission": permission,
    }
