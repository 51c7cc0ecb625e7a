"""The graph of nodes, topics and services, and its drawings."""

import msgspec
import pytest

from robo.text.graph import FORMATS, Edge, Graph, GraphNode, GraphTopic, build, draw, without_system
from robo.tools.graph import of_robot

NODES = [GraphNode("/r1/a", "m:A"), GraphNode("/r1/b", "m:B"), GraphNode("/r2/c", None)]
EDGES = [
    Edge("/r1/a", "pub", "r1/odom", "nav/Odometry"),
    Edge("/r1/b", "sub", "r1/odom", "nav/Odometry"),
    Edge("/r1/a", "pub", "r1/lost", "std/Bool"),
    Edge("/r1/b", "sub", "r1/absent", "std/Bool"),
    Edge("/r1/a", "pub", "r1/both", "std/Bool"),
    Edge("/r2/c", "sub", "r1/both", "std/String"),
    Edge("/r1/a", "pub", "r1/log", "system/Log"),
    Edge("zenoh:1", "pub", "q/x", ""),
    Edge("/r1/a", "srv", "r1/reset", "std/Trigger"),
    Edge("/r1/b", "cli", "r1/reset", "std/Trigger"),
    Edge("/r1/b", "cli", "r1/gone", "std/Trigger"),
]


@pytest.fixture
def graph() -> Graph:
    return build(NODES, EDGES)


def test_dead_ends_and_clashes_are_marked(graph: Graph) -> None:
    assert {topic.key: topic.problems for topic in graph.topics} == {
        "q/x": ["nobody subscribes it"],
        "r1/absent": ["nobody publishes it"],
        "r1/both": ["type clash: std/Bool, std/String"],
        "r1/log": [],
        "r1/lost": ["nobody subscribes it"],
        "r1/odom": [],
    }
    assert {service.key: service.problems for service in graph.services} == {
        "r1/gone": ["nobody serves it"],
        "r1/reset": [],
    }


def test_the_order_of_what_is_found_does_not_matter(graph: Graph) -> None:
    assert build(NODES[::-1], EDGES[::-1]) == graph


def test_what_every_node_has_can_be_left_out(graph: Graph) -> None:
    assert {topic.key for topic in without_system(graph).topics} == {t.key for t in graph.topics} - {"r1/log"}


def test_one_robot_has_its_own_nodes_and_what_they_use(graph: Graph) -> None:
    r2 = of_robot(graph, "r2")
    assert [node.name for node in r2.nodes] == ["/r2/c"]
    assert [topic.key for topic in r2.topics] == ["r1/both"]


@pytest.mark.parametrize("form", FORMATS)
def test_every_drawing_names_everything(graph: Graph, form: str) -> None:
    drawing = draw(graph, form)
    for name in (
        "/r1/a",
        "/r1/b",
        "/r2/c",
        "r1/odom",
        "r1/reset",
        "nav/Odometry",
        "std/Trigger",
        "nobody publishes it",
    ):
        assert name in drawing


def test_mermaid_and_dot_have_an_arrow_for_each_end() -> None:
    small = build(NODES[:2], EDGES[:2])
    assert draw(small, "mermaid").splitlines() == [
        "flowchart LR",
        '  n0["/r1/a"]',
        '  n1["/r1/b"]',
        '  t0(["r1/odom<br/>nav/Odometry"])',
        "  n0 --> t0",
        "  t0 --> n1",
    ]
    dot = draw(small, "dot")
    assert dot.startswith("digraph robot {")
    assert '"/r1/a" -> "r1/odom";' in dot
    assert '"r1/odom" -> "/r1/b";' in dot


def test_json_is_the_graph_itself(graph: Graph) -> None:
    assert msgspec.json.decode(draw(graph, "json"), type=Graph) == graph
    assert graph.topics[4] == GraphTopic("r1/lost", ["std/Bool"], ["/r1/a"], [], ["nobody subscribes it"])


def test_that_nobody_reads_what_is_broadcast_is_no_problem() -> None:
    edges = [Edge("/r1/a", "pub", "r1/tf", "tf2/TFMessage"), Edge("/r1/a", "sub", "r2/tf", "tf2/TFMessage")]
    found = {topic.key: topic.problems for topic in build([GraphNode("/r1/a", None)], edges).topics}
    assert found == {"r1/tf": [], "r2/tf": ["nobody publishes it"]}
