"""The key `bridges` of a manifest: the node that it stands for, and its mistakes."""

from pathlib import Path

import msgspec
import pytest

from robo.launch import resolve
from robo.launch.plan import CrossingPlan, Ros2Plan


def resolved(text: str, folder: Path, **arguments: object) -> resolve.Resolution:
    file = folder / "m.yaml"
    file.write_text(text)
    return resolve.resolve(file, arguments)


def test_it_stands_for_a_node_of_the_robot_that_is_told_all_of_it(tmp_path: Path) -> None:
    text = """
args: {robot_name: r1, domain: 3}
bridges:
  ros2:
    domain: ${domain}
    topics:
      odom: /odom
      scan:
      "cam/*": {ros: "/cams/*", direction: both, depth: 2, durability: transient_local}
    services: {}
"""
    found = resolved(text, tmp_path, robot_name="r7")
    assert not found.problems
    (node,) = found.plan.processes
    assert (node.full_name, node.service) == ("/r7/ros2_bridge", "robo_services.ros2_bridge")
    said = msgspec.json.decode(str(node.parameters["settings"]), type=Ros2Plan)
    assert said == Ros2Plan(
        domain=3,
        topics={
            "odom": CrossingPlan(ros="/odom"),
            "scan": CrossingPlan(),
            "cam/*": CrossingPlan(ros="/cams/*", direction="both", depth=2, durability="transient_local"),
        },
        services={},
    )


def test_in_a_group_it_is_in_the_namespace_of_that(tmp_path: Path) -> None:
    found = resolved("groups: {arm: {namespace: r1/arm, bridges: {ros2: 5}}}", tmp_path)
    assert not found.problems
    (node,) = found.plan.processes
    assert node.full_name == "/r1/arm/ros2_bridge"
    assert msgspec.json.decode(str(node.parameters["settings"]), type=Ros2Plan) == Ros2Plan(domain=5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ros2: {domain: 300}", "domain: expected a whole number from 0 to 232, not 300"),
        ("ros2: {topic: {}}", "unknown key 'topic' in ros2; did you mean topics?"),
        ("ros2: {topics: {'a b': /x}}", "topics: name 'a b' holds ' '"),
        ("ros2: {topics: {x: {direction: up}}}", "direction: 'up' is not known"),
        ("ros2: {topics: [x]}", "topics: expected a map"),
        ("ros3: 1", "unknown key 'ros3' in bridges; did you mean ros2?"),
        ("ros2: {topics: {x: {depth: -1}}}", "depth: expected a whole number of at least 0, not -1"),
    ],
)
def test_mistakes_are_told_with_their_places(text: str, said: str, tmp_path: Path) -> None:
    found = resolved(f"bridges: {{{text}}}", tmp_path)
    assert [said in problem.text for problem in found.problems] == [True]
    assert found.problems[0].position.line == 1
