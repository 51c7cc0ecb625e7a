"""What a node is called, and what it means by names."""

import os

import pytest

from robo import InvalidName, Node
from robo.environment import NAMESPACE_VARIABLE, RUN_VARIABLE
from robo.node.hooks import Hooks, overrides
from robo.node.identity import Identity
from robo.wire.keys import parse_token


def test_a_namespace_comes_from_the_environment_where_none_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(NAMESPACE_VARIABLE, "/fleet/r1/")
    assert Identity.of("base").full_name == "/fleet/r1/base"
    assert Identity.of("base", "").full_name == "/base", "the root is a namespace too"
    assert Identity.of("base", "/r2").full_name == "/r2/base"


@pytest.mark.parametrize(
    ("name", "namespace"), [("", "r1"), ("a/b", "r1"), ("1st", ""), ("base", "r 1"), ("base", "a//b")]
)
def test_a_name_that_breaks_the_rules_is_refused(name: str, namespace: str) -> None:
    with pytest.raises(InvalidName):
        Identity.of(name, namespace)


def test_names_are_meant_within_the_namespace_and_remapped() -> None:
    given = {"odom": "wheel_odom", "/r1/scan": "/lab/scan"}
    node = Identity.of("base", "r1", given)
    assert [node.resolve(name) for name in ("odom", "scan", "/odom", "~/state", "imu")] == [
        "r1/wheel_odom",
        "lab/scan",
        "odom",
        "r1/base/state",
        "r1/imu",
    ]
    assert [node.absolute(name) for name in ("monitor", "/monitor")] == ["/r1/monitor", "/monitor"]
    given["imu"] = "other"
    assert node.resolve("imu") == "r1/imu", "what it was told once holds"


def test_the_token_of_a_node_says_who_runs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RUN_VARIABLE, "20260101-000000-abcd")
    token = Identity.of("base", "r1").token(Node)
    assert (token.full_name, token.class_name, token.pid) == ("/r1/base", "robo.node.node:Node", os.getpid())
    assert token.run == "20260101-000000-abcd"
    assert parse_token(token.key()) == token
    monkeypatch.delenv(RUN_VARIABLE)
    assert Identity.of("base", "r1").token(Node).run == ""


def test_a_hook_counts_where_a_class_or_one_of_its_bases_has_its_own() -> None:
    class Plain(Node):
        """Has none."""

    class Warming(Node):
        def ready(self) -> bool:
            return False

    class Camera(Warming):
        """Takes that of its base."""

    assert [overrides(cls(), Hooks.ready) for cls in (Plain, Warming, Camera)] == [False, True, True]
    assert not overrides(Camera(), Hooks.main)
