import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo import names
from robo.discovery import EndpointToken, NodeToken, parse_token
from robo.errors import InvalidName

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


@given(namespace, chunk, chunk)
def test_a_relative_name_is_its_absolute_one(ns: str, node: str, topic: str) -> None:
    key = names.resolve(topic, namespace=ns, node=node)
    assert names.resolve("/" + key, namespace="elsewhere", node="other") == key


def test_keys_that_people_type() -> None:
    assert names.key_of("/r1/odom") == "r1/odom"
    assert names.key_of("r*/odom") == "r*/odom"
    for bad in ("", "a//b", "~/x", "a b"):
        with pytest.raises(InvalidName):
            names.key_of(bad)


@given(namespace, chunk, st.sampled_from(["pub", "sub"]), namespace.filter(bool), st.integers(0, 10**6))
def test_tokens_say_again_what_was_put_into_them(ns: str, node: str, kind: str, topic: str, depth: int) -> None:
    endpoint = EndpointToken(ns, node, "pub" if kind == "pub" else "sub", "geometry/Twist", depth, topic)
    assert parse_token(endpoint.key()) == endpoint
    token = NodeToken(ns, node, "package.module:Class", depth, "host-1.local")
    assert parse_token(token.key()) == token


@pytest.mark.parametrize("key", ["", "r1/odom", "@robo/x", "@robo/a/b/c/d/e", "@robo/r1/node/a/b/notapid/h"])
def test_other_keys_are_no_tokens(key: str) -> None:
    assert parse_token(key) is None


def test_names_within_a_namespace() -> None:
    assert names.within("r1", "/r1/tracker") == "tracker"
    assert names.within("r1", "/r1/arm/camera") == "arm/camera"
    assert names.within("r1", "/r10/tracker") == "r10/tracker"
