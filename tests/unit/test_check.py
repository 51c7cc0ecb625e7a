"""Wiring faults, each with both of its ends."""

from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

import robo_messages
from robo.launch import resolve
from robo.launch.check import Findings, check, ends_of
from robo.launch.graph import graph_of
from robo.launch.language import keys_of
from robo.launch.manifest import Manifest
from robo.launch.schema import manifest_schema, parts
from robo.text.graph import GraphTopic
from robo.text.tree import plain
from robo.text.yaml_tree import parse
from robo.wire.qos import Quality

ROOT = Path(__file__).parents[2]
SCHEMA = jsonschema.Draft202012Validator(manifest_schema())
SHIPPED = sorted(path.name for path in (ROOT / "launch").glob("*.yaml"))


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def findings(text: str) -> Findings:
    Path("m.yaml").write_text(text)
    return check(resolve.resolve(Path("m.yaml"), {}))


def faults(text: str) -> list[str]:
    return [str(problem) for problem in findings(text).faults]


SOURCE = "source: {run: x, publishes: {odom: nav/Odometry}}"
TRACKER = "tracker: {service: robo_services.position_tracker}"


def group(*nodes: str, more: str = "") -> str:
    lines = "".join(f"\n      {node}" for node in nodes)
    return f"groups:\n  g:\n    namespace: r1{more}\n    nodes:{lines}\n"


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_manifests_are_fine(name: str) -> None:
    found = check(resolve.resolve(ROOT / "launch" / name, {}, stand_ins=True))
    assert found.faults == ()


def test_a_sound_manifest_has_notes_at_most() -> None:
    found = findings(group(SOURCE, TRACKER))
    assert found.faults == ()
    assert [str(note) for note in found.notes] == [
        "m.yaml:6:7: nobody reads r1/current_position, which /r1/tracker publishes geometry/Point"
    ]


MAPPER = """
from robo import KEEP_ALL, Node, Publisher, subscribe
from robo_messages import String


class Mapper(Node):
    map = Publisher(String, "map")
    notes = Publisher(String, "notes", depth=KEEP_ALL)


class Planner(Node):
    @subscribe("map", latched=True)
    def on_map(self, text: String) -> None: ...

    @subscribe("notes", deadline=1.0)
    def on_note(self, text: String) -> None: ...
"""


def test_ends_that_do_not_fit_are_told_and_the_manifest_may_say_what_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mapping_nodes.py").write_text(MAPPER)
    monkeypatch.syspath_prepend(tmp_path)
    mapper, planner = (f"{name.lower()}: {{service: 'mapping_nodes:{name}'}}" for name in ("Mapper", "Planner"))
    nodes = group(mapper, planner)
    told = "/r1/mapper does not latch r1/map, and /r1/planner wants what it said before: say latched=True there"
    assert faults(nodes) == [f"m.yaml:6:7: {told}"]
    for qos in ("latched", "{latched: true}", "{profile: default, latched: true}", "{latched: false}"):
        assert faults(f"{nodes}    topics: {{map: {{qos: {qos}}}}}\n") == []
    slow = group(mapper, planner) + "    topics: {map: {qos: latched}, notes: {qos: {latched: true}}}\n"
    assert faults(slow) == [
        "m.yaml:5:7: /r1/mapper on r1/notes: a latched publisher keeps its last `depth` messages, and KEEP_ALL would be"
        " all for ever; say how many"
    ]
    plan = resolve.resolve(Path("m.yaml"), {}).plan
    assert plan.processes[0].qos == {"r1/map": Quality(profile="latched"), "r1/notes": Quality(latched=True)}


@pytest.mark.parametrize(
    ("qos", "told"),
    [
        ("fast", "is not known; use default, sensor_data, command, latched or bulk"),
        ("{depht: 1}", "unknown key 'depht' in qos"),
        ("{depth: -1}", "depth: expected a whole number of at least 0, not -1"),
        ("{priority: urgent}", "priority: 'urgent' is not known; use real_time"),
        ("{latched: true, depth: 0}", "topic odom: a latched publisher keeps its last `depth` messages"),
    ],
)
def test_a_quality_that_makes_no_sense_is_told(qos: str, told: str) -> None:
    (fault,) = faults(f"{group(SOURCE, TRACKER)}    topics: {{odom: {{qos: {qos}}}}}\n")
    assert told in fault


def test_two_types_on_one_key() -> None:
    assert faults(group("source: {run: x, publishes: {odom: geometry/Twist}}", TRACKER)) == [
        "m.yaml:6:7: two types on r1/odom: /r1/tracker subscribes nav/Odometry, "
        "but /r1/source publishes geometry/Twist (in m.yaml:5:7)"
    ]


def test_whose_messages_alone_count_has_to_publish_them() -> None:
    sim = "sim: {{service: robo_services.diff_drive_sim, params: {{command_source: {}}}}}"
    driver = "safety_monitor: {run: x, publishes: {cmd_vel: geometry/Twist}}"
    for fine in ("safety_monitor", "/r1/safety_monitor", "''", "plain"):
        assert faults(group(sim.format(fine), driver)) == []
    (fault,) = faults(group(sim.format("safty_monitor"), driver))
    assert fault == (
        "m.yaml:5:61: /r1/sim takes r1/cmd_vel of safty_monitor alone (command_source), which does not publish it; "
        "did you mean safety_monitor?"
    )


def test_a_topic_that_a_parameter_names_and_nothing_feeds_is_shown_there() -> None:
    mux = "mux: {service: robo_services.twist_mux, params: {topics: {phone: {topic: cmd_vel_fone, priority: 1}}}}"
    (fault,) = faults(group(mux, "phone: {run: x, publishes: {cmd_vel_phone: geometry/Twist}}"))
    assert fault.startswith("m.yaml:5:")
    assert fault.index("cmd_vel_fone") > 0
    assert int(fault.split(":")[2]) > len("      mux: {service: robo_services.twist_mux"), "at the parameter"
    assert "/r1/phone publishes this type on r1/cmd_vel_phone: name that, if it is meant; if it comes" in fault
    (fault,) = faults(group(mux))
    assert "cmd_vel_out" not in fault, "it is not to read itself"


def test_a_subscription_that_nothing_feeds() -> None:
    assert faults(group("source: {run: x, publishes: {odometry: nav/Odometry}}", TRACKER)) == [
        "m.yaml:6:7: nothing publishes r1/odom, which /r1/tracker subscribes nav/Odometry; "
        "/r1/source publishes this type on r1/odometry: remap one of them; "
        "if it comes from outside, promise it: topics: {odom: {external: true}}"
    ]
    assert faults(group(TRACKER)) == [
        "m.yaml:5:7: nothing publishes r1/odom, which /r1/tracker subscribes nav/Odometry; "
        "start a node that does, or promise it: topics: {odom: {external: true}}"
    ]
    assert faults(group(TRACKER, more="\n    topics: {odom: {external: true}}")) == []


def test_a_command_that_does_not_say_what_it_publishes_may_feed_anything() -> None:
    found = findings(group("source: {run: x}", TRACKER))
    assert found.faults == ()
    assert "unless /r1/source does: say it with publishes: {topic: type}" in str(found.notes[1])


def test_a_remapping_of_a_name_that_the_node_does_not_have() -> None:
    remapped = "tracker: {service: robo_services.position_tracker, remap: {odm: odom}}"
    assert faults(group(SOURCE, remapped)) == [
        "m.yaml:6:66: remap odm to odom: /r1/tracker (robo_services.position_tracker) has no topic or service 'odm'; "
        "did you mean odom?"
    ]


def test_a_remapping_of_a_group_is_for_those_that_have_the_name() -> None:
    other = "controller: {service: robo_services.velocity_controller}"
    assert faults(group(SOURCE, TRACKER, other, more="\n    remap: {/r1/cmd_vel: raw}")) == []
    (found,) = faults(group(SOURCE, TRACKER, more="\n    remap: {cmd_vel: raw}"))
    none = "none of /r1/source, /r1/tracker has a topic or service 'cmd_vel'"
    assert found.startswith(f"m.yaml:4:13: remap cmd_vel to raw: {none}")
    assert "there is odom, current_position" in found


def test_a_service_may_have_another_name_too() -> None:
    remapped = "tracker: {service: robo_services.position_tracker, remap: {reset_distance: reset, odom: wheel}}"
    assert faults(group("source: {run: x, publishes: {wheel: nav/Odometry}}", remapped)) == []


def test_a_remapped_topic_is_named_as_the_node_calls_it() -> None:
    text = group(
        "source: {run: x, publishes: {wheel: geometry/Twist}}",
        "tracker: {service: robo_services.position_tracker, remap: {odom: wheel}}",
    )
    (found,) = faults(text)
    assert "/r1/tracker subscribes nav/Odometry (its odom), but /r1/source publishes geometry/Twist" in found


def test_parameters_that_reach_nobody() -> None:
    Path("p.yaml").write_text("/**: {log_rte: 1}\n/r9/**: {log_rate: 1}\nbase: {x: 1}\ntrackr: {y: 1}\n")
    found = findings(
        group(SOURCE, TRACKER.replace("tracker}", "tracker, params: p.yaml}"), more="\n    params: {speeed: 1}")
    )
    assert [str(fault) for fault in found.faults if "source" not in str(fault)] == [
        "p.yaml:1:7: no node has a parameter 'log_rte'; did you mean log_rate?",
        "p.yaml:2:1: /r9/** matches no node of this launch",
        "p.yaml:4:1: trackr matches no node of this launch; did you mean tracker?",
    ]
    assert "p.yaml:3:1: base matches no node of this launch" in map(str, found.notes)


def test_a_parameter_file_that_contradicts_itself_is_noted() -> None:
    Path("p.yaml").write_text("/**: {log_rate: 1.0}\n/**: {log_rate: 2.0}\n")
    found = findings(group(SOURCE, TRACKER.replace("tracker}", "tracker, params: p.yaml}")))
    assert "p.yaml:2:7: /**: log_rate is 2.0 here and 1.0 in line 1; the last one holds" in map(str, found.notes)
    assert found.faults == ()


def test_a_parameter_file_of_another_group_is_noted() -> None:
    Path("p.yaml").write_text("tracker: {log_rate: 1.0}\nsource: {x: 1}\n")
    found = findings(
        f"groups:\n  g: {{namespace: r1, nodes: {{{TRACKER}}}}}\n"
        f"  h: {{namespace: r1, params: p.yaml, nodes: {{{SOURCE}}}}}\n"
    )
    assert found.faults == ()
    assert (
        "p.yaml:1:1: tracker means /r1/tracker, which is not given this file; name it in params: of that node too"
        in map(str, found.notes)
    )


def test_promises_about_topics() -> None:
    promise = (
        "\n    topics: {odom: {type: geometry/Twist}, scan: {rate: 5}, map: {type: nav/OccupancyGird, external: true}}"
    )
    assert faults(group(SOURCE, TRACKER, more=promise)) == [
        "m.yaml:4:14: r1/odom is promised as geometry/Twist, but /r1/source publishes nav/Odometry",
        "m.yaml:4:14: r1/odom is promised as geometry/Twist, but /r1/tracker subscribes nav/Odometry",
        "m.yaml:4:44: nobody publishes r1/scan, which is promised here; if it comes from outside, say external: true",
        "m.yaml:4:61: r1/map: there is no type 'nav/OccupancyGird'; did you mean nav/OccupancyGrid?",
    ]


def test_other_mistakes_come_with_the_wiring() -> None:
    found = faults(group("source: {run: x, publishes: {odom: geometry/Twist}}", TRACKER, "x: {runn: x}"))
    assert [line.split(" ")[0] for line in found] == ["m.yaml:6:7:", "m.yaml:7:11:"]


# -- drawings and schema -------------------------------------------------------------------------------


def test_the_graph_of_a_plan() -> None:
    Path("m.yaml").write_text(group(SOURCE, TRACKER))
    resolution = resolve.resolve(Path("m.yaml"), {})
    graph = graph_of(resolution, ends_of(resolution))
    assert [node.name for node in graph.nodes] == ["/r1/source", "/r1/tracker"]
    topics = {topic.key: topic for topic in graph.topics}
    assert topics["r1/odom"] == GraphTopic("r1/odom", ["nav/Odometry"], ["/r1/source"], ["/r1/tracker"], [])
    assert topics["r1/log"].publishers == ["/r1/tracker"], "a command is no node of robo's"
    assert [service.key for service in graph.services] == ["r1/reset_distance"]


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_manifests_fit_the_published_schema(name: str) -> None:
    tree = parse((ROOT / "launch" / name).read_text(), name, [], placeholders=True)
    assert tree is not None
    schema = manifest_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(plain(tree), schema)


@pytest.mark.parametrize(
    "tree",
    [
        {"groups": {"g": {"nodes": {"a": {"service": "s", "needz": {}}}}}},
        {"groups": {"g": {"nodes": {"a": {"service": "s", "needs": {"b": "redy"}}}}}},
        {"args": {"a": {"type": "number"}}},
        {"group": {}},
    ],
)
def test_the_schema_refuses_what_the_reader_refuses(tree: object) -> None:
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tree, manifest_schema())


NUMBERS = [
    (part, key.name, form)
    for part, struct in parts().items()
    for key in keys_of(struct).values()
    for form in key.form.schema.get("anyOf", ())
    if "minimum" in form and part != "override"
]
"""Every key that takes a number, with its limits as the schema has them."""


def test_the_ranges_of_the_language_are_looked_at() -> None:
    assert {("restart", "jitter"), ("ready", "port"), ("node", "cpus"), ("group", "replicas")} <= {
        (part, key) for part, key, _ in NUMBERS
    }


def with_number(part: str, key: str, value: object) -> dict[str, Any]:
    """A manifest in which one number of one part is this."""
    node: dict[str, Any] = {"run": "x", "name": "a${index}"} if key == "replicas" else {"run": "x"}
    group: dict[str, Any] = {"nodes": {"a": node}}
    if part == "group":
        group |= {"nodes": {}, "groups": {}, key: value}
    elif part == "node":
        node[key] = value
    elif part == "topic":
        group["topics"] = {"odom": {key: value}}
    elif part == "quality":
        group["topics"] = {"odom": {"qos": {key: value}}}
    elif part == "ros2":
        group["bridges"] = {"ros2": {key: value}}
    elif part == "crossing":
        group["bridges"] = {"ros2": {"topics": {"odom": {key: value}}}}
    else:
        node[part] = {key: value}
    return {"groups": {"g": group}}


@pytest.mark.parametrize(("part", "key", "form"), NUMBERS)
def test_the_schema_and_the_reader_have_the_same_limits(part: str, key: str, form: dict[str, Any]) -> None:
    low, high = form["minimum"], form["maximum"]
    refused: list[object] = [low - 1, high + 1, -1e300, 1e300]
    refused += [low + 0.5] if form["type"] == "integer" else [low - 0.001, high * 1.001]
    accepted = [low, min(low + 1, high), high]
    for value in [*accepted, *refused]:
        tree = with_number(part, key, value)
        Path("m.yaml").write_text(yaml.safe_dump(tree))
        mistakes = [str(problem) for problem in resolve.resolve(Path("m.yaml"), {}).problems]
        errors = [error.message for error in SCHEMA.iter_errors(tree)]
        assert bool(mistakes) == bool(errors) == (value in refused), (value, mistakes, errors)


@pytest.mark.parametrize(("rate", "fits"), [(0.001, True), (999_999_999, True), (0, False), (-1, False), (1e9, False)])
def test_the_schema_and_the_reader_agree_on_rates(rate: float, fits: bool) -> None:
    tree = with_number("topic", "rate", rate)
    Path("m.yaml").write_text(yaml.safe_dump(tree))
    assert (not resolve.resolve(Path("m.yaml"), {}).problems, SCHEMA.is_valid(tree)) == (fits, fits)


def test_every_key_is_described() -> None:
    for part in (Manifest, *parts().values()):
        assert all(key.about.endswith(".") or ": " in key.about for key in keys_of(part).values())


def test_the_guide_names_every_key() -> None:
    guide = (ROOT / "docs" / "launch.md").read_text()
    keys = {key for part in (Manifest, *parts().values()) for key in keys_of(part)}
    assert [key for key in sorted(keys) if f"`{key}`" not in guide and f"{key}:" not in guide] == []


def test_message_types_have_schemas_too() -> None:
    assert "$defs" in robo_messages.json_schema("geometry/Twist")


ACTIONS = """
from robo import ActionClient, Node, action
from robo_messages import Fibonacci


class Counter(Node):
    @action("count")
    def count(self, goal: Fibonacci.Goal) -> Fibonacci.Result:
        return Fibonacci.Result()


class Asker(Node):
    count = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "fibonacci")
"""


def test_who_executes_the_action_of_a_client(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    Path("counting_nodes.py").write_text(ACTIONS)
    nodes = "counter: {service: counting_nodes:Counter}", "asker: {service: counting_nodes:Asker}"
    found = findings(group(*nodes))
    assert found.faults == ()
    (note,) = [str(note) for note in found.notes if "nobody executes" in str(note)]
    assert "nobody executes r1/fibonacci, to which /r1/asker sends goals (example/Fibonacci)" in note
    remapped = nodes[1].replace("Asker}", "Asker, remap: {fibonacci: count}}")
    assert [str(note) for note in findings(group(nodes[0], remapped)).notes if "executes" in str(note)] == []
