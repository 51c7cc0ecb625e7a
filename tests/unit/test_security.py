"""The policy, the rules that follow from it, what they say, and what a router's log tells of them."""

import json
import time
from typing import Any

import pytest
import zenoh

from robo.errors import PolicyError
from robo.security import policy, rights, rules, verdicts
from robo.security.policy import DEFAULT_ROLES, Entry, Grants, Policy
from robo.security.refusals import Reader, Refusal, Tally
from robo.security.rights import RIGHTS, Right, Role
from robo.wire.keys import TELLS

ROLES: dict[str, Role] = {"site": "router", "r1": "robot", "r2": "robot", "ann": "operator", "eve": "viewer"}
PEOPLE = Policy(names={name: Entry(role=role) for name, role in ROLES.items()}, roles=DEFAULT_ROLES)


def router_says(known: Policy, name: str, message: str, key: str, flow: str = "ingress") -> bool:
    """What a router makes of a message: as Zenoh goes through its rules."""
    made: Any = rules.access_control(known)
    of_subject = [rule for one in made["policies"] if one["subjects"] == [name] for rule in one["rules"]]
    found = {rule["id"]: rule for rule in made["rules"]}
    said = {
        found[one]["permission"]
        for one in of_subject
        if flow in found[one]["flows"] and message in found[one]["messages"]
        for rule_key in found[one]["key_exprs"]
        if zenoh.KeyExpr(rule_key).includes(zenoh.KeyExpr(key))
    }
    return "allow" in said and "deny" not in said


# -- the file ----------------------------------------------------------------------------------------------------------


def test_a_policy_is_the_same_when_it_is_written_and_read() -> None:
    grants = Grants(allow={"publish": ("fleet/r1",)}, deny={"serve": ("r1/x",)})
    more = Entry(role="robot", more=grants, only={"publish": ("r1/odom",)})
    known = Policy(names={**PEOPLE.names, "r1": more}, roles=DEFAULT_ROLES)
    again = policy.read(policy.text_of(known), "policy.yaml")
    assert (again.names, again.roles) == (known.names, known.roles)
    assert policy.text_of(again) == policy.text_of(known)


def test_the_short_form_of_a_name() -> None:
    assert policy.read("names: {r1: robot}", "policy.yaml").names == {"r1": Entry(role="robot")}


def test_all_mistakes_come_at_once_with_their_places() -> None:
    text = """\
roles:
  robbot: {publish: ['**']}
  viewer:
    publish: [/r1/odom, 'r1//odom', 3]
    subscribes: ['**']
  router: {}
names:
  r1: {role: robott}
  r2: {}
  a/b: {role: viewer}
  eve: {role: viewer, list: ['r1/odom'], deny: {publish: ['@robo/**']}, only: []}
more: 1
"""
    with pytest.raises(PolicyError) as raised:
        policy.read(text, "policy.yaml")
    lines = str(raised.value).splitlines()
    assert [line.split(": ")[0] for line in lines] == [
        "policy.yaml:2:3", "policy.yaml:4:15", "policy.yaml:4:25", "policy.yaml:4:37", "policy.yaml:5:5",
        "policy.yaml:6:3", "policy.yaml:8:14", "policy.yaml:9:7", "policy.yaml:10:3", "policy.yaml:11:30",
        "policy.yaml:11:59", "policy.yaml:11:79", "policy.yaml:12:1",
    ]  # fmt: skip
    assert "did you mean robot?" in lines[0]
    assert "leave the first / out" in lines[1]
    assert "did you mean subscribe?" in lines[4]


@pytest.mark.parametrize("name", ["robot", "NAME", "a b", "", "x" * 65, "a/b", "@x"])
def test_names_that_nobody_may_have(name: str) -> None:
    with pytest.raises(PolicyError):
        policy.checked_name(name)


# -- changes -----------------------------------------------------------------------------------------------------------


def test_what_is_allowed_can_be_taken_back() -> None:
    more = policy.changed(PEOPLE, "r1", "publish", "fleet/r1", allow=True)
    assert more.names["r1"].more == Grants(allow={"publish": ("fleet/r1",)})
    assert policy.changed(more, "r1", "publish", "fleet/r1", allow=False) == PEOPLE


def test_what_a_wider_key_allows_is_denied() -> None:
    less = policy.changed(PEOPLE, "viewer", "subscribe", "*/camera/**", allow=False)
    assert less.roles["viewer"].deny == {"subscribe": ("*/camera/**",)}
    assert not router_says(less, "eve", "declare_subscriber", "r1/camera/image")
    assert not router_says(less, "eve", "put", "r1/camera/image", "egress"), "who subscribes to all does not get it"
    assert router_says(less, "eve", "declare_subscriber", "r1/odom")
    assert policy.changed(less, "viewer", "subscribe", "*/camera/**", allow=True).roles["viewer"].deny == {}


def test_denying_what_is_allowed_literally_and_by_a_wider_key() -> None:
    both = policy.changed(PEOPLE, "operator", "publish", "r1/x", allow=True)
    less = policy.changed(both, "operator", "publish", "r1/x", allow=False)
    assert not router_says(less, "ann", "put", "r1/x")
    assert router_says(less, "ann", "put", "r1/y")


@pytest.mark.parametrize(
    ("whom", "key"), [("nobody", "r1/x"), ("router", "r1/x"), ("site", "r1/x"), ("r1", "@robo/**")]
)
def test_what_cannot_be_said(whom: str, key: str) -> None:
    with pytest.raises(PolicyError):
        policy.changed(PEOPLE, whom, "publish", key, allow=True)


# -- rules -------------------------------------------------------------------------------------------------------------


ALLOWED: list[tuple[str, Right, str, bool]] = [
    ("r1", "publish", "r1/odom", True),
    ("r1", "publish", "r1/arm/joint_states", True),
    ("r1", "publish", "r2/odom", False),
    ("r1", "publish", "*/odom", False),
    ("r1", "subscribe", "r1/cmd_vel", True),
    ("r1", "subscribe", "**", False),
    ("r1", "serve", "r1/reset", True),
    ("r1", "serve", "r2/reset", False),
    ("r1", "call", "r2/reset", False),
    ("r1", "command", "r2", False),
    ("ann", "publish", "r1/cmd_vel", True),
    ("ann", "call", "r1/base/parameters/set", True),
    ("ann", "serve", "r1/reset", False),
    ("ann", "command", "r1", True),
    ("ann", "list", "**", True),
    ("eve", "subscribe", "**", True),
    ("eve", "publish", "r1/cmd_vel", False),
    ("eve", "call", "r1/base/parameters/get", True),
    ("eve", "call", "r1/base/parameters/set", False),
    ("eve", "call", "r1/base/parameters/*", False),
    ("eve", "list", "r1", True),
    ("eve", "command", "r1", False),
    ("site", "publish", "r1/cmd_vel", True),
]


@pytest.mark.parametrize(("name", "right", "key", "allowed"), ALLOWED)
def test_rules_and_explanations_say_the_same(name: str, right: Right, key: str, allowed: bool) -> None:
    known = policy.read(policy.text_of(PEOPLE), "policy.yaml")
    verdict = verdicts.explain(known, name, right, key)
    assert verdict.allowed is allowed, verdict
    assert router_says(known, name, rights.MAIN[right], rights.asked_key(right, key)) is allowed
    assert allowed is False or name == "site" or verdict.place.startswith("policy.yaml:")


def test_wide_questions_of_tools_reach_robots_and_come_back() -> None:
    asked = [f"@robo/{robot}/supervisor/{verb}" for robot in ("**", "r1") for verb in TELLS]
    for key in (*asked, "@robo/**/status/*"):
        assert router_says(PEOPLE, "eve", "query", key)
        assert router_says(PEOPLE, "r1", "query", key, "egress")
    assert router_says(PEOPLE, "r1", "reply", "@robo/r1/supervisor/ps")
    assert not router_says(PEOPLE, "r1", "reply", "@robo/r2/supervisor/ps")
    assert router_says(PEOPLE, "eve", "reply", "@robo/r1/supervisor/ps", "egress")
    assert router_says(PEOPLE, "eve", "liveliness_query", "@robo/**")
    assert router_says(PEOPLE, "r1", "liveliness_token", "@robo/r1/node/base/a:B/1/host")
    assert not router_says(PEOPLE, "r2", "liveliness_token", "@robo/r1/node/base/a:B/1/host")


def test_latched_topics_are_asked_and_answered() -> None:
    assert router_says(PEOPLE, "eve", "query", "r1/map/@adv/**")
    assert router_says(PEOPLE, "r1", "declare_queryable", "r1/map/@adv/pub/1/2/_")
    assert router_says(PEOPLE, "r1", "reply", "r1/map")
    assert router_says(PEOPLE, "eve", "reply", "r1/map", "egress")


def test_only_what_contracts_say() -> None:
    entry = Entry(role="robot", only={"publish": ("r1/odom",), "serve": ("r1/reset",)})
    known = Policy(names={"r1": entry}, roles=DEFAULT_ROLES)
    assert router_says(known, "r1", "put", "r1/odom")
    assert not router_says(known, "r1", "put", "r1/secret")
    assert router_says(known, "r1", "declare_queryable", "@robo/r1/supervisor/*"), "it still tells what runs"
    assert not verdicts.explain(known, "r1", "publish", "r1/secret").allowed
    assert "by its contracts" in verdicts.explain(known, "r1", "publish", "r1/odom").reason


def test_a_machine_with_several_robots() -> None:
    known = policy.changed(PEOPLE, "r1", "serve", "r7/**", allow=True)
    assert rules.robots_of(known, "r1") == ["r1", "r7"]
    assert router_says(known, "r1", "liveliness_token", "@robo/r7/node/base/a:B/1/host")
    assert rules.robots_of(policy.changed(PEOPLE, "r1", "serve", "r7/reset", allow=True), "r1") == ["r1"]


def test_rules_are_the_same_for_the_same_policy_and_name_everybody() -> None:
    shuffled = Policy(names=dict(reversed(PEOPLE.names.items())), roles=DEFAULT_ROLES)
    assert json.dumps(rules.access_control(shuffled)) == json.dumps(rules.access_control(PEOPLE))
    made: Any = rules.access_control(PEOPLE)
    assert (made["enabled"], made["default_permission"]) == (True, "deny")
    *named, own = made["subjects"]
    assert all(subject["cert_common_names"] == [subject["id"]] for subject in named)
    assert own == {"id": "own nodes", "link_protocols": ["unixsock-stream"]}, "a folder of the router's user"
    assert {rule["permission"] for rule in made["rules"]} == {"allow"}


def test_everybody_s_rules_are_shared() -> None:
    made: Any = rules.access_control(
        Policy(names={f"v{n}": Entry(role="viewer") for n in range(50)}, roles=DEFAULT_ROLES)
    )
    one: Any = rules.access_control(Policy(names={"v0": Entry(role="viewer")}, roles=DEFAULT_ROLES))
    assert len(made["rules"]) == len(one["rules"])


def test_zenoh_takes_the_rules_of_many_robots() -> None:
    for count in (200, 2000):
        begin = time.monotonic()
        known = Policy(names={f"r{n}": Entry(role="robot") for n in range(count)}, roles=DEFAULT_ROLES)
        config = zenoh.Config()
        config.insert_json5("access_control", json.dumps(rules.access_control(known)))
        assert time.monotonic() - begin < 20.0, f"{count} robots"


def test_all_rights_have_a_main_message_that_they_allow() -> None:
    for right in RIGHTS:
        key = "r1" if right in rights.OF_ROBOTS else "r1/x"
        assert any(
            rights.MAIN[right] in grant.messages and grant.flow == "ingress" for grant in rights.allowed(right, [key])
        )
        assert any(rights.MAIN[right] in grant.messages for grant in rights.denied(right, [key]))


# -- what a router's log tells -----------------------------------------------------------------------------------------

ZID = "fbddd27a19f62514905db941da202ae7"
ACL = "zenoh::net::routing::interceptor::access_control"


def line(text: str, target: str = ACL, level: str = "TRACE", thread: str = "rx-1 ThreadId(12)") -> str:
    return f"2026-11-24T15:45:35.645954Z {level:>5} {thread} {target}: {text}"


def denied(what: str, key: str, *, who: str = "r2", flow: str = "ingress") -> str:
    return line(
        f"{ZID} on Interface(lo)+CertCommonName({who})+Transport(Tls)+{ZID} is unauthorized to {what} ({flow}) on {key}"
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("peer sent no certificates. Hint: …", "somebody without a certificate was refused"),
        ("invalid peer certificate: UnknownIssuer. Hint: …", "somebody whose certificate is of another CA was refused"),
        ("invalid peer certificate: certificate expired: …", "somebody whose certificate has expired was refused"),
        ("received corrupt message of type InvalidContentType. …", "somebody who does not speak TLS was refused"),
    ],
)
def test_certificates(text: str, sentence: str) -> None:
    refusal = Reader().read(line(text, "zenoh_link_tls::unicast", "WARN", "acc-0 ThreadId(05)"))
    assert refusal is not None
    assert refusal.sentence == sentence


@pytest.mark.parametrize(
    ("what", "key", "sentence"),
    [
        ("Put", "r1/cmd_vel", "r2 may not publish r1/cmd_vel"),
        ("Delete", "r1/map", "r2 may not delete what is said on r1/map"),
        ("Query", "r1/reset", "r2 may not call r1/reset"),
        ("Query", "@robo/r1/supervisor/down", "r2 may not down what runs of r1"),
        ("Query", "@/*/router", "r2 may not ask what routers say of themselves"),
        ("Declare Subscriber", "**", "r2 may not subscribe to **"),
    ],
)
def test_what_rules_refuse(what: str, key: str, sentence: str) -> None:
    assert Reader().read(denied(what, key)) == Refusal("rights", "r2", sentence)


def test_what_nobody_tried_is_not_told() -> None:
    reader = Reader()
    assert reader.read(line("ACL (ingress): caching permissions for `r1/x` ...")) is None
    for what in ("Query", "Put", "Declare/Undeclare Subscriber", "Declare Liveliness Subscriber"):
        assert reader.read(denied(what, "r1/x")) is None, "it only would be refused"
    assert reader.read(line("ACL (egress): caching permissions for `r1/x` ...")) is None
    for what in ("Query", "Put", "Declare/Undeclare Subscriber", "Declare Liveliness Subscriber"):
        assert reader.read(denied(what, "r1/x", flow="egress")) is None
    found = reader.read(line(f"Using cached result: {ZID} is unauthorized to Put (ingress) on r1/x"))
    assert found == Refusal("rights", "r2", "r2 may not publish r1/x")
    assert reader.read(denied("Put", "r1/x")) is not None, "without a declared key each message has its line"
    assert reader.read(denied("Put", "r1/x", flow="egress")) is None, "nobody tries not to hear"
    assert reader.read(denied("Declare Subscriber", f"@/{ZID}/router/config/**")) is None


def test_who_is_not_in_the_rules() -> None:
    reader = Reader()
    reader.known = frozenset({"ann"})
    for name in ("gone", "ann"):
        text = f"Accepted TLS connection on x. Common Name: {name}."
        assert reader.read(line(text, "zenoh_link_tls::unicast", "DEBUG")) is None
    text = f"{ZID} did not match any configured ACL subject. Default permission `Deny` will be applied on all messages"
    found = reader.read(line(text, level="INFO"))
    assert found is not None
    assert found.sentence == "gone, who is not in the policy, is linked and may do nothing"


@pytest.mark.parametrize("text", ["", "\x1b[0m", "garbage", line("is unauthorized to"), line("caching permissions")])
def test_other_lines_say_nothing(text: str) -> None:
    assert Reader().read(text) is None


def test_a_refusal_is_told_once_and_then_now_and_again() -> None:
    tally, refusal = Tally(), Refusal("rights", "r2", "r2 may not publish r1/x")
    told = [tally.add(refusal, now, 0) for now in (0.0, 1.0, 2.0, 61.0, 62.0)]
    assert told == [refusal.sentence, None, None, f"{refusal.sentence} (2 times more since)", None]
    assert [(one.sentence, one.count) for one in tally.listed()] == [(refusal.sentence, 5)]


def test_who_makes_up_keys_fills_neither_memory_nor_screen() -> None:
    tally = Tally()
    told = [tally.add(Refusal("rights", "r2", f"r2 may not publish r1/{n}"), 0.0, 0) for n in range(5000)]
    assert sum(one is not None for one in told) == Tally.BURST
    assert len(tally.listed()) == Tally.MOST + 1
    assert sum(one.count for one in tally.listed()) == 5000
