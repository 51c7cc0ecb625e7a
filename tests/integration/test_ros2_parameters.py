"""Parameters of robo's nodes as ROS's tools see and set them, and what nodes say beside their topics."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Annotated, Any

import pytest
from msgspec import Meta, field

import robo
from robo import READ_ONLY, Node, Unit
from robo.interfaces.type_hash import type_hash
from robo_messages import Log, ParameterEvent
from robo_messages.system import Parameter
from tests.support import eventually

pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from robo.bridges.ros2.parameter_types import (
    Answers,
    Changes,
    FloatingPointRange,
    IntegerRange,
    Names,
    SetParametersResult,
)
from robo.bridges.ros2.parameters import listed
from tests.ros2 import Both, RosNode

pytestmark = pytest.mark.timeout(120)


class Gains(robo.Parameters):
    p: float = 1.0
    i: float = 0.0


class Base(Node):
    """Has parameters of many types."""

    class Parameters(robo.Parameters):
        speed: Annotated[float, Meta(ge=0, le=5, description="at most"), Unit("m/s")] = 1.5
        count: Annotated[int, Meta(ge=1, le=9)] = 3
        name: Annotated[str, READ_ONLY] = "base"
        limits: list[float] = field(default_factory=lambda: [1.0, 2.0])
        gains: Gains = field(default_factory=Gains)
        lit: bool = True

    parameters: Parameters

    def on_start(self) -> None:
        self.logger.warning("hello")


@pytest.fixture
def both() -> Iterator[Both]:
    with ExitStack() as stack:
        yield Both(stack)


def call(ros: RosNode, service: str, end: str, request: Any, response: Any) -> Any:
    return ros.call(f"system/{service}", f"/r1/base/{end}", request, response)


def seen(ros: RosNode) -> bool:
    return any("/SS/" in one and "%set_parameters_atomically/" in one for one in ros.tokens())


def test_ros_lists_reads_describes_and_sets_parameters(both: Both) -> None:
    both.bridge()
    ros = both.ros("param")
    events = ros.hear(ParameterEvent, "/parameter_events")
    with Base(name="base", namespace="r1", session=both.robo) as base:
        eventually(lambda: seen(ros), "they are announced")
        names = ["count", "gains.i", "gains.p", "limits", "lit", "name", "speed", "use_sim_time"]
        found = call(ros, "ListParameters", "list_parameters", Names.List(), Answers.List)
        assert sorted(set(found.result.names) & {*names}) == [one for one in names if one in found.result.names]
        assert found.result.prefixes == ["gains"]
        wanted = ["speed", "count", "name", "limits", "gains.p", "lit", "nothing"]
        got = call(ros, "GetParameters", "get_parameters", Names.Get(wanted), Answers.Get)
        assert got.values == [1.5, 3, "base", [1.0, 2.0], 1.0, True, None]
        types = call(ros, "GetParameterTypes", "get_parameter_types", Names.Types(wanted), Answers.Types)
        assert types.types == [3, 2, 4, 8, 3, 1, 0]
        about = call(ros, "DescribeParameters", "describe_parameters", Names.Describe(wanted), Answers.Describe)
        speed, count, name, *_ = about.descriptors
        assert (speed.type, speed.description) == (3, "at most [m/s]")
        assert speed.floating_point_range == FloatingPointRange(0.0, 5.0)
        assert count.integer_range == IntegerRange(1, 9)
        assert name.read_only
        each = Changes.Each([Parameter("speed", 2.0), Parameter("speed", 9.0), Parameter("name", "x")])
        results = call(ros, "SetParameters", "set_parameters", each, Answers.Each).results
        assert [one.successful for one in results] == [True, False, False]
        assert "speed" in results[1].reason
        assert base.parameters.speed == 2.0
        both_or_none = Changes.All([Parameter("count", 5), Parameter("speed", -1.0)])
        result = call(ros, "SetParametersAtomically", "set_parameters_atomically", both_or_none, Answers.All).result
        assert not result.successful
        assert base.parameters.count == 3
        event = events.wait()[0]
        assert (event.node, event.changed_parameters) == ("/r1/base", [Parameter("speed", 2.0)])
    eventually(lambda: not seen(ros), "they are gone with their node")


def test_who_may_only_read_sets_nothing_and_who_may_do_nothing_sees_nothing(both: Both) -> None:
    bridge = both.bridge(parameters="read")
    ros = both.ros("param")
    with Base(name="base", namespace="r1", session=both.robo) as base:
        eventually(lambda: seen(ros), "they are announced")
        change = Changes.Each([Parameter("speed", 2.0)])
        results = call(ros, "SetParameters", "set_parameters", change, Answers.Each).results
        assert results == [SetParametersResult(False, "the bridge to ROS 2 lets nobody set parameters")]
        assert base.parameters.speed == 1.5
        bridge.close()
        eventually(lambda: not seen(ros), "the first bridge is gone")
        both.bridge(parameters="none")
        eventually(lambda: any(one.endswith("/NN/%/%r1/base") for one in ros.tokens()), "the node is there")
        assert not seen(ros)


def test_the_log_is_on_rosout(both: Both) -> None:
    both.bridge(topics={})
    console = both.ros("console")
    rosout = console.hear(Log, "/rosout")
    with Base(name="base", namespace="r1", session=both.robo) as base:
        eventually(lambda: any("%rosout" in one for one in console.tokens()), "it is announced")
        base.logger.error("out")
        eventually(lambda: "out" in [one.msg for one in rosout.messages], "its line")
    assert rosout.messages[-1].name == "/r1/base"


def test_names_are_listed_as_ros_lists_them() -> None:
    there = ["a", "b.c", "b.d.e", "bc.f"]
    assert listed(there, [], 0).names == there
    assert listed(there, [], 1).names == ["a"]
    assert listed(there, ["b"], 0).names == ["b.c", "b.d.e"]
    assert listed(there, ["b"], 1).names == ["b.c"]
    assert listed(there, [], 0).prefixes == ["b", "b.d", "bc"]


@pytest.mark.parametrize(
    ("service", "hash_"),
    [
        ("DescribeParameters", "845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff"),
        ("GetParameters", "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"),
        ("GetParameterTypes", "da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca"),
        ("ListParameters", "3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d"),
        ("SetParameters", "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0"),
        ("SetParametersAtomically", "0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd"),
    ],
)
def test_the_six_services_have_the_hashes_that_nodes_of_ros_announce(service: str, hash_: str) -> None:
    assert type_hash(f"system/{service}") == f"RIHS01_{hash_}"
