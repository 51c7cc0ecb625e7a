"""A manifest unfolded: conditions decided, loops unrolled, includes followed, every `${name}` filled in."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from robo.launch import draft as drafts
from robo.launch import unfold
from robo.launch.arguments import COMMAND_LINE, Given
from robo.launch.draft import Draft
from robo.launch.layers import Layer, layer_of
from robo.launch.manifest import NodeEntry
from robo.launch.plan import LogPlan, ProcessPlan, ReadyPlan, RestartPlan, StopPlan
from robo.launch.reader import read
from robo.launch.substitution import Broken, Scope, Shared, of_process
from robo.launch.unfold import Unfolding
from robo.text.tree import Map, Position, Problem, Scalar


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def unfolded(text: str, **arguments: object) -> Unfolding:
    Path("m.yaml").write_text(text)
    found = Unfolding(of_process)
    manifest = found.manifests.read(Path("m.yaml"))
    assert manifest is not None
    values = found.arguments(manifest, Given(arguments, Path.cwd(), COMMAND_LINE))
    found.unfold(manifest, values)
    return found


def fine(text: str, **arguments: object) -> dict[str, ProcessPlan]:
    found = unfolded(text, **arguments)
    assert found.problems == []
    return {draft.plan.full_name: draft.plan for draft in found.drafts}


def mistakes(text: str, **arguments: object) -> list[str]:
    return [str(problem) for problem in dict.fromkeys(unfolded(text, **arguments).problems)]


def one(text: str, **arguments: object) -> ProcessPlan:
    """The plan of a single node that says this."""
    (found,) = fine(f"args: {{on: true, n: 3}}\ngroups: {{g: {{nodes: {{a: {{{text}}}}}}}}}", **arguments).values()
    return found


# -- a single process --------------------------------------------------------------------------------------


def test_a_node_that_says_nothing_else_has_defaults() -> None:
    service, command = one("service: my.node"), one("run: x")
    assert (service.service, service.run, service.watchdog, service.ready.when) == ("my.node", (), 5.0, "node")
    assert (command.service, command.run, command.watchdog, command.ready.when) == (None, ("x",), 0.0, "started")
    for found in (service, command):
        assert (found.restart, found.stop, found.log) == (RestartPlan(), StopPlan(), LogPlan())
        assert (found.priority, found.cpus, found.cwd, found.required) == (None, (), None, False)
        assert found.source == Position("m.yaml", 2, 22)


def test_under_a_debugger_a_node_stands_still_on_purpose() -> None:
    assert one("service: my.node, prefix: gdb --args").watchdog == 0.0
    assert one("service: my.node, prefix: gdb --args, watchdog: 7").watchdog == 7.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x -p '/dev/tty 1' ${n}", ("x", "-p", "/dev/tty 1", "3")),
        ("[x, 1, '${n}', true, 'a b']", ("x", "1", "3", "true", "a b")),
        ("x $${n} '${n} ${on}'", ("x", "${n}", "3 true")),
        ("'${words}'", ("a b",)),
    ],
)
def test_a_line_is_split_before_anything_is_put_in(text: str, words: tuple[str, ...]) -> None:
    line = text if text.startswith(("[", "'$")) else f'"{text}"'
    (found,) = fine(f"args: {{on: true, n: 3, words: a b}}\ngroups: {{g: {{nodes: {{a: {{run: {line}}}}}}}}}").values()
    assert found.run == words


def test_what_tells_that_it_is_ready() -> None:
    ready = one(
        "service: s, remap: {odom: o}, namespace: r1, ready: {topics: [odom, /map], port: 80, probe: test -e x}"
    ).ready
    assert ready == ReadyPlan(topics=("r1/o", "map"), port="127.0.0.1:80", probe=("test", "-e", "x"))
    assert one("run: x, ready: node").ready.when == "node"
    assert one("run: x, ready: {log: up}").ready == ReadyPlan(when="started", log="up")
    assert one("run: x, ready: {port: 'host:8080', timeout: 0}").ready.port == "host:8080"


def test_how_it_runs() -> None:
    found = one(
        "run: x, restart: {policy: always, max: '${n}'}, stop: {signal: sigterm, timeout: 2}, log: {level: warn}, "
        "required: n > 2, priority: -5, cpus: '0-1,3', cwd: work, args: -v, env: {A: '${n}'}, "
        "publishes: {o: nav/Odometry}"
    )
    assert found.restart == RestartPlan(policy="always", max=3)
    assert found.stop == StopPlan(signal="TERM", timeout=2.0)
    assert found.log == LogPlan(level="warn")
    assert (found.required, found.priority, found.cpus) == (True, -5, (0, 1, 3))
    assert found.cwd == f"{Path.cwd()}/work"
    assert (found.args, found.env, found.publishes) == (("-v",), {"A": "3"}, {"o": "nav/Odometry"})
    assert found.sources["remap"] == {}
    assert found.sources["env"]["A"].line == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("run: x, name: a b", "node name 'a b': use letters"),
        ("service: ''", "service: name a node class"),
        ("run: ''", "run: the command is empty"),
        ('run: [x, "a\\0b"]', "run holds a zero character"),
        ('run: x, env: {A: "a\\0b"}', "env A holds a zero character"),
        ("run: x, remap: {a b: c}", "name 'a b' is not valid"),
        ("run: x, remap: {a: b c}", "name 'b c' is not valid"),
        ("run: x, publishes: {a b: c}", "name 'a b' is not valid"),
        ("run: x, ready: {topics: a b}", "name 'a b' is not valid"),
        ("run: x, ready: {port: 70000}", "ready: port: '70000' is no port"),
        ("run: x, cwd: 'a/${up}'", "${up} is '../x', which leads out"),
        ("run: x, namespace: a b", "namespace 'a b' is not valid"),
    ],
)
def test_a_mistake_is_one_message(text: str, message: str) -> None:
    (found,) = mistakes(f"args: {{up: ../x}}\ngroups: {{g: {{nodes: {{a: {{{text}}}}}}}}}")
    assert message in found


def test_every_mistake_of_a_process_is_told() -> None:
    found = mistakes("groups: {g: {nodes: {a: {run: x, name: 1a, cwd: '${x1}', priority: 99, env: {A: '${x2}'}}}}}")
    assert [text.split(": ", 1)[1].split(" ")[0] for text in found] == ["node", "${x1}", "priority:", "${x2}"]


# -- layers --------------------------------------------------------------------------------------------------


BEFORE, BEHIND = "groups: {g: {nodes: {a: {", "}}}}"


def place(text: str, piece: str) -> Position:
    """Where a piece of what a node says stands."""
    return Position("m.yaml", 1, len(BEFORE) + text.index(piece) + 1)


def layer(text: str, values: Mapping[str, object]) -> tuple[Layer, list[str]]:
    problems: list[Problem] = []
    manifest = read(f"{BEFORE}{text}{BEHIND}", Path("m.yaml"), problems)
    assert manifest is not None
    assert not problems
    node = manifest.groups[0].nodes[0]
    told: list[str] = []
    found = layer_of(node, Scope(Path("m.yaml"), values, Shared()), lambda where, text: told.append(f"{where}: {text}"))
    return found, told


def test_a_filled_layer_has_plain_values_at_the_places_where_they_were_written() -> None:
    text = "run: x, watchdog: '${n}', remap: {a: '${n}x'}, needs: '${n}', namespace: 'r${n}'"
    found, told = layer(text, {"n": 7})
    assert not told
    assert found.plain["watchdog"] == Scalar(7, place(text, "'${n}'"))
    assert found.remap[0].value == Scalar("7x", place(text, "'${n}x"))
    assert found.needs is not None
    assert (found.needs[0].node.value, found.namespace) == (7, Scalar("r7", place(text, "'r${n}")))
    assert not found.of_group


def test_a_value_that_cannot_be_filled_is_broken_and_nobody_complains_yet() -> None:
    found, told = layer("run: 'x ${q}', cwd: '${q}', restart: {delay: '${q}'}, params: {a: '${q}', b: ['${q}']}", {})
    assert not told
    restart, cwd = found.plain["restart"], found.plain["cwd"]
    assert isinstance(restart, Map)
    delay = restart.get("delay")
    values = found.params[0].values
    assert values is not None
    for scalar in (cwd, delay, values.get("a"), values.get("b")):
        assert isinstance(scalar, Scalar)
        assert isinstance(scalar.value, Broken)
        assert "${q} is not defined" in scalar.value.problems[0].text


def test_of_parameters_and_variables_those_stay_whose_condition_holds() -> None:
    text = (
        "run: x, params: [{if: on, a: 1}, {unless: on, a: 2}], env: {A: {value: 1, if: on}, B: {value: 2, unless: on}}"
    )
    found, told = layer(text, {"on": False})
    assert not told
    assert [source.values.entries[0].value for source in found.params if source.values] == [
        Scalar(2, place(text, "2}"))
    ]
    assert [variable.name for variable in found.env] == ["B"]
    _, told = layer("run: x, params: {if: of, a: 1}", {"on": False})
    assert [line.partition(": ")[2].partition(";")[0] for line in told] == ["'of': ${of} is not defined"]


def test_files_of_parameters_count_from_the_manifest() -> None:
    found, _ = layer("run: x, params: ['${n}.yaml', '${empty}']", {"n": "p", "empty": ""})
    assert [source.file.value for source in found.params if source.file] == [f"{Path.cwd()}/p.yaml", ""]


# -- from group to node ------------------------------------------------------------------------------------


def test_what_groups_say_is_for_all_in_them_and_the_inner_one_holds() -> None:
    found = fine(
        """\
groups:
  g:
    restart: {policy: always, delay: 1, max: 9}
    log: {level: warn}
    env: {A: g, B: g}
    remap: {x: gx, y: gy}
    namespace: r1
    hosts: base
    groups:
      h:
        restart: {delay: 2}
        log: file
        env: {B: h}
        hosts: [arm, hand]
        nodes:
          a: {run: x, restart: {max: 3}, remap: {y: ay}, namespace: n}
    nodes:
      b: {run: x, restart: never, env: {C: b}}
"""
    )
    a, b = found["/r1/n/a"], found["/r1/b"]
    assert a.restart == RestartPlan(policy="always", delay=2.0, max=3)
    assert a.log == LogPlan(level="warn", output="file")
    assert (a.env, a.remap) == ({"A": "g", "B": "h"}, {"x": "gx", "y": "ay"})
    assert (a.group, a.hosts, b.group, b.hosts) == ("g/h", ("arm", "hand"), "g", ("base",))
    assert b.restart == RestartPlan(policy="never", delay=1.0, max=9)
    assert b.env == {"A": "g", "B": "g", "C": "b"}


def test_ready_is_taken_whole() -> None:
    Path("inner.yaml").write_text("groups: {g: {nodes: {a: {run: x, ready: {log: up, timeout: 3}}}}}")
    (found,) = fine("include: {file: inner.yaml, override: {a: {ready: {port: 80}}}}").values()
    assert found.ready == ReadyPlan(when="started", port="127.0.0.1:80")


def test_what_an_override_replaces_need_not_make_sense() -> None:
    Path("inner.yaml").write_text(
        "groups: {g: {nodes: {a: {service: '${env:NO_SUCH_CLASS}', args: '${env:NO_SUCH_ARGS}', priority: 99}}}}"
    )
    (found,) = fine("include: {file: inner.yaml, override: {a: {run: y, args: [z], priority: 1}}}").values()
    assert (found.service, found.run, found.args, found.priority) == (None, ("y",), ("z",), 1)
    back = "{file: inner.yaml, override: {a: {service: my.node, args: [z], priority: 1}}}"
    (found,) = fine(f"include: {back}").values()
    assert (found.service, found.run) == ("my.node", ())


def test_the_outermost_override_has_the_last_word_and_names_of_its_own() -> None:
    Path("inner.yaml").write_text("groups: {g: {nodes: {a: {run: x, watchdog: 1, env: {A: i}}}}}")
    Path("middle.yaml").write_text(
        "args: {v: 2}\ninclude: {file: inner.yaml, override: {a: {watchdog: '${v}', env: {A: m, B: '${v}'}}}}"
    )
    (found,) = fine(
        "args: {v: 7}\ninclude: {file: middle.yaml, override: {a: {watchdog: '${v}', env: {C: '${v}'}}}}"
    ).values()
    assert found.watchdog == 7.0
    assert found.env == {"A": "m", "B": "2", "C": "7"}


# -- conditions and loops ----------------------------------------------------------------------------------


def test_what_a_condition_leaves_out_is_known_to_be_left_out() -> None:
    Path("inner.yaml").write_text("groups: {g: {nodes: {deep: {run: x}}}}")
    found = unfolded(
        """\
args: {on: false}
groups:
  g: {if: on, include: inner.yaml, nodes: {a: {run: x}}, groups: {h: {nodes: {b: {run: x}}}}}
  k: {nodes: {c: {run: x, unless: not on}, d: {run: x, replicas: 0}, e: {run: x}}}
  l: {replicas: 0, nodes: {f: {run: x}}}
include: {file: inner.yaml, if: on}
"""
    )
    assert found.problems == []
    assert [draft.key for draft in found.drafts] == ["e"]
    assert found.left_out == {"deep", "a", "b", "c", "d", "f"}
    assert found.groups == ["g", "k", "l"]


def test_loops_within_loops() -> None:
    found = unfolded(
        """\
groups:
  g:
    for_each: {robot: [{name: r1, arms: 1}, {name: r2, arms: 2}]}
    namespace: ${robot.name}
    nodes:
      arm: {run: "x ${index}", replicas: "${robot.arms}"}
      head: {run: "x ${index}"}
"""
    )
    assert found.problems == []
    assert [(draft.plan.full_name, draft.key, draft.plan.run[1]) for draft in found.drafts] == [
        ("/r1/arm_1", "arm", "1"), ("/r1/head", "head", "1"),
        ("/r2/arm_1", "arm", "1"), ("/r2/arm_2", "arm", "2"), ("/r2/head", "head", "2"),
    ]  # fmt: skip


def test_an_item_with_a_mistake_is_told_once() -> None:
    text = "groups: {g: {for_each: {r: [a, '${q}']}, nodes: {n: {run: 'x ${r}', name: 'n${index}'}}}}"
    assert [line.split(" ")[1] for line in mistakes(text)] == ["${q}"]


@pytest.mark.parametrize("loop", ["replicas: many", "replicas: 1.5", "replicas: '${q}'"])
def test_a_loop_with_a_mistake_is_taken_as_one(loop: str) -> None:
    found = unfolded(f"groups: {{g: {{nodes: {{a: {{run: x, {loop}}}}}}}}}")
    assert len(found.problems) == 1
    assert [draft.plan.name for draft in found.drafts] == ["a_1"]


def test_a_launch_has_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unfold, "MOST_STEPS", 10)
    (found,) = mistakes("groups: {g: {replicas: 5, groups: {h: {replicas: 5, nodes: {}}}}}")
    assert found.endswith("unfolds to more than 10 groups, includes and nodes")
    monkeypatch.setattr(unfold, "MOST_STEPS", 1_000)
    monkeypatch.setattr(unfold, "MOST_PROCESSES", 3)
    (found,) = mistakes("groups: {g: {nodes: {a: {run: x, replicas: 5}}}}")
    assert found == "m.yaml:1:22: more than 3 processes"


# -- includes ----------------------------------------------------------------------------------------------


def test_an_included_file_knows_what_it_is_given() -> None:
    Path("inner.yaml").write_text(
        "args: {speed: 1.0, name: x}\n"
        "groups: {g: {namespace: '${robot_name}', nodes: {a: {run: 'x ${speed} ${name}'}}}}\n"
    )
    found = fine(
        """\
args: {fast: 2.5}
groups:
  one: {namespace: a, args: {speed: "${fast}"}, include: inner.yaml}
  two: {include: {file: inner.yaml, namespace: b, args: {name: y, robot_name: r7}}}
""",
        robot_name="r1",
    )
    assert {name: plan.run for name, plan in found.items()} == {
        "/a/r1/a": ("x", "2.5", "x"), "/b/r7/a": ("x", "1.0", "y"),
    }  # fmt: skip


def test_what_an_include_leaves_out_or_changes_has_to_be_there() -> None:
    Path("inner.yaml").write_text("groups: {g: {nodes: {left: {run: x}, right: {run: x, if: false}}}}")
    assert fine("include: {file: inner.yaml, without: [left, right]}") == {}
    assert list(fine("include: {file: inner.yaml, override: {right: {watchdog: 1}}}")) == ["/left"]
    (found,) = mistakes("include: {file: inner.yaml, without: lft}")
    assert found.endswith("inner.yaml has no node 'lft'; did you mean left?")
    (found,) = mistakes("include: {file: inner.yaml, override: {lft: {watchdog: 1}}}")
    assert found.endswith("inner.yaml has no node 'lft'; did you mean left?")


def test_includes_in_a_circle_and_in_vain() -> None:
    Path("inner.yaml").write_text("include: m.yaml")
    assert mistakes("include: inner.yaml") == [
        "inner.yaml:1:10: include goes in a circle: m.yaml → inner.yaml → m.yaml"
    ]
    assert mistakes("include: {file: nowhere.yaml, if: false}") == [], "it may be there where it is needed"
    assert fine("args: {other: ''}\ninclude: ${other}") == {}, "an argument that names no file"
    Path("folder.yaml").mkdir()
    assert "there is no manifest 'folder.yaml'" in mistakes("include: folder.yaml")[0]


def test_a_manifest_is_read_once_and_its_mistakes_are_told_once() -> None:
    Path("inner.yaml").write_text("groups: {g: {nodes: {a: {runn: x}}}}")
    found = unfolded("include: [inner.yaml, inner.yaml, {file: inner.yaml, namespace: b}]")
    assert len(found.problems) == 1
    assert found.manifests.paths() == ["m.yaml", "inner.yaml"]


# -- topics ------------------------------------------------------------------------------------------------


def test_promises_stand_in_the_namespace_of_their_group() -> None:
    found = unfolded(
        """\
args: {fast: 50}
topics: {/clock: {rate: "<= 100"}}
groups:
  g:
    namespace: r1
    topics: {scan: {type: sensor/LaserScan, rate: "${fast}", max_age: 0.5, external: fast > 1}, odom: nav/Odometry}
"""
    )
    assert found.problems == []
    clock, scan, odom = found.topics
    assert (clock.key, clock.min_rate, clock.max_rate) == ("clock", None, 100.0)
    assert (scan.key, scan.type, scan.min_rate, scan.max_age, scan.external) == (
        "r1/scan", "sensor/LaserScan", 50.0, 0.5, True,
    )  # fmt: skip
    assert (odom.type, odom.source) == ("nav/Odometry", Position("m.yaml", 6, 97))
    assert mistakes("topics: {~/x: {}}") == ["m.yaml:1:10: topic ~/x: private names are a node's; write it whole"]


def test_a_draft_is_none_where_its_name_is_not_valid() -> None:
    found = unfolded("groups: {g: {nodes: {1a: {run: x}, b: {run: x, needs: 1a}}}}")
    assert [draft.key for draft in found.drafts] == ["b"]
    assert found.left_out == {"1a"}
    assert len(found.problems) == 1
    assert isinstance(found.drafts[0], Draft)
    assert drafts.within(None, "r1", found.complain) == "r1"


def test_a_node_knows_whether_there_may_be_several() -> None:
    assert not NodeEntry(key="a", tree=Map((), Position("m.yaml", 1, 1)), position=Position("m.yaml", 1, 1)).looped
