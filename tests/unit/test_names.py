import re

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import InvalidName
from robo.wire import names
from robo.wire.keys import EndpointToken, NodeToken, parse_token
from robo.wire.qos import QoS

chunk = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
namespace = st.lists(chunk, max_size=3).map("/".join)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("odom", "r1/odom"),
        ("sensors/scan", "r1/sensors/scan"),
        ("/odom", "odom"),
        ("~/state", "r1/tracker/state"),
        ("~", "r1/tracker"),
    ],
)
def test_names_resolve_as_in_ros(name: str, key: str) -> None:
    assert names.resolve(name, namespace="r1", node="tracker") == key


@pytest.mark.parametrize(
    ("remappings", "key"),
    [
        ({"odom": "robot/odom"}, "r1/robot/odom"),
        ({"odom": "/robot/odom"}, "robot/odom"),
        ({"/r1/odom": "base"}, "r1/base"),
        ({"odom": "~/odom"}, "r1/tracker/odom"),
        ({"scan": "lidar"}, "r1/odom"),
    ],
)
def test_remapping(remappings: dict[str, str], key: str) -> None:
    assert names.resolve("odom", namespace="r1", node="tracker", remappings=remappings) == key


@pytest.mark.parametrize("bad", ["", "/", "a//b", "a/", "1odom", "a b", "odom*", "~odom", "@x", "a/$b", "ünï"])
def test_bad_names_are_refused_with_the_rule(bad: str) -> None:
    with pytest.raises(InvalidName, match="letters, digits and _"):
        names.resolve(bad, namespace="r1", node="tracker")


def test_namespaces() -> None:
    assert names.normalize_namespace("/fleet/r1/") == "fleet/r1"
    assert names.normalize_namespace("/") == ""
    with pytest.raises(InvalidName, match="r-1"):
        names.normalize_namespace("r-1")
    with pytest.raises(InvalidName, match="node name"):
        names.check_node_name("a/b")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("", "robot name '' is empty"),
        ("//", "robot name '//' is empty"),
        ("r-1", "robot name 'r-1' is not valid; use letters, digits and _, .* did you mean r_1?"),
        ("turtle bot-3", "did you mean turtle_bot_3?"),
        ("rö1", "did you mean ro1?"),
        ("fleet/3d", "has part '3d'.* did you mean fleet/_3d?"),
        ("a//b", "has an empty part; use [^;]*$"),
    ],
)
def test_what_is_no_robots_name_is_told_with_one_that_is(name: str, said: str) -> None:
    with pytest.raises(InvalidName, match=said):
        names.robot_name(name)


def test_robots_names() -> None:
    assert [names.robot_name(name) for name in ("r1", "/r1", "r1/", "/r1/arm/")] == ["r1", "r1", "r1", "r1/arm"]


@given(namespace, chunk, chunk)
def test_a_relative_name_is_its_absolute_one(ns: str, node: str, topic: str) -> None:
    key = names.resolve(topic, namespace=ns, node=node)
    assert names.resolve("/" + key, namespace="elsewhere", node="other") == key


def test_keys_that_people_type() -> None:
    assert names.key_of("/r1/odom") == "r1/odom"
    assert names.key_of("/r1/odom/") == "r1/odom"
    assert names.key_of("r*/odom") == "r$*/odom"
    assert names.key_of("r$*/odom") == "r$*/odom"
    assert names.key_of("*/odom") == "*/odom"
    assert names.key_of("**/*") == "*/**"
    assert names.key_of("**/**/x/**") == "**/x/**"
    assert names.shown_key("r$*/odom") == "r*/odom"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("", "has an empty part"),
        ("/", "has an empty part"),
        ("a//b", "has an empty part"),
        ("a/**b", "has ** within the part '**b'"),
        ("a/***", "has ** within the part '***'"),
        ("#", "holds '#'"),
        ("a?", "holds '?'"),
        ("$", "holds '$'"),
        ("r$/x", "holds '$'"),
        ("~/x", "holds '~'"),
        ("a b", "holds ' '"),
        ("a\x1b]0;x\x07", "holds '\\x1b'"),
    ],
)
def test_what_is_no_key_is_told_in_a_sentence(name: str, said: str) -> None:
    with pytest.raises(InvalidName, match=re.escape(said)):
        names.key_of(name)


@given(st.text("ab*$/#?@ ~é", max_size=12))
def test_zenoh_takes_every_key_that_is_let_through(name: str) -> None:
    try:
        key = names.key_of(name)
    except InvalidName:
        return
    assert str(zenoh.KeyExpr(key)) == key


@given(namespace, chunk, st.sampled_from(["pub", "sub"]), namespace.filter(bool), st.integers(0, 10**6))
def test_tokens_say_again_what_was_put_into_them(ns: str, node: str, kind: str, topic: str, depth: int) -> None:
    endpoint = EndpointToken(ns, node, "pub" if kind == "pub" else "sub", "geometry/Twist", QoS(depth=depth), topic)
    assert parse_token(endpoint.key()) == endpoint
    token = NodeToken(ns, node, "package.module:Class", depth, "host-1.local")
    assert parse_token(token.key()) == token


@pytest.mark.parametrize("key", ["", "r1/odom", "@robo/x", "@robo/a/b/c/d/e", "@robo/r1/node/a/b/notapid/h"])
def test_other_keys_are_no_tokens(key: str) -> None:
    assert parse_token(key) is None


def test_names_within_a_namespace() -> None:
    assert names.label("r1", "/r1/tracker") == "tracker"
    assert names.label("r1", "/r1/arm/camera") == "arm/camera"
    assert names.label("r1", "/r10/tracker") == "r10/tracker"
