"""What live views show: charts, the state of topics, tables that fit."""

import math

import msgspec
import pytest
from rich.console import Console

from robo.cli.views.top import render, shares
from robo.samples.stream import Arrival
from robo.text.chart import Chart
from robo.tools.top import NodeFigures, Snapshot, TopicFigures, Traffic
from robo.tools.topics import Topic
from robo.wire.codec import Attachment
from robo.wire.explained import explained
from robo.wire.reports import Explanation, HealthLevel, Input, ProcessStatus
from robo_messages import DiagnosticStatus

TOPIC = Topic("r1/odom", "nav/Odometry", ["nav/Odometry"], ["/r1/a"], [])


def arrival(number: int, size: int = 100) -> Arrival:
    return Arrival("r1/odom", number * 10**8, size, Attachment(number, number * 10**8), None)  # type: ignore[arg-type]


def test_a_flow_has_rate_bandwidth_age_and_loss() -> None:
    flow = Traffic("r1/odom")
    for number in (1, 2, 3, 6, 7, 8, 9, 10):
        flow.add(arrival(number), number * 0.1)
    figures = flow.figures(TOPIC, 1.0, 1.05)
    assert (figures.rate, figures.bandwidth, figures.lost, figures.count) == (10.0, 800.0, 2, 8)
    assert figures.age == pytest.approx(0.05)
    assert not figures.stale
    later = flow.figures(TOPIC, 1.0, 2.5)
    assert (later.rate, later.lost, later.stale) == (0.0, 2, True)


def test_what_never_came_or_has_no_pace_is_not_stale() -> None:
    flow = Traffic("r1/odom")
    assert flow.figures(TOPIC, 1.0, 100.0).age is None
    flow.add(arrival(1), 100.0)
    assert not flow.figures(TOPIC, 1.0, 1000.0).stale
    slow = Traffic("r1/odom")
    for number in range(1, 5):
        slow.add(arrival(number), number * 10.0)
    assert not slow.figures(TOPIC, 1.0, 80.0).stale, "ten seconds are its pace"
    assert slow.figures(TOPIC, 1.0, 100.0).stale


@pytest.mark.parametrize(
    ("lines", "first", "second", "expected"),
    [(20, 4, 8, (4, 8)), (10, 4, 20, (4, 6)), (10, 20, 2, (8, 2)), (10, 20, 20, (5, 5)), (0, 3, 3, (1, 1))],
)
def test_two_tables_share_the_lines(lines: int, first: int, second: int, expected: tuple[int, int]) -> None:
    assert shares(lines, first, second) == expected


def snapshot(nodes: int, topics: int) -> Snapshot:
    return Snapshot(
        10**18,
        1.0,
        [NodeFigures(f"/r1/node_{i}", "ready", "", i, "host", 1.5, 30_000_000, i, 3.0) for i in range(nodes)],
        [
            TopicFigures(f"r1/{'long_' * 20}{i}", ["nav/Odometry"], 1, 2, 50.0, 1e6, 0.01, i == 0, i, 9)
            for i in range(topics)
        ],
    )


@pytest.mark.parametrize("width", [80, 200])
@pytest.mark.parametrize("height", [10, 24, 60])
@pytest.mark.parametrize(("nodes", "topics"), [(0, 0), (3, 5), (40, 2), (40, 40)])
def test_a_picture_fits_the_terminal(width: int, height: int, nodes: int, topics: int) -> None:
    console = Console(width=width, height=height, color_system=None)
    with console.capture() as capture:
        console.print(render(snapshot(nodes, topics), width, height))
    lines = capture.get().splitlines()
    assert len(lines) <= height
    assert all(len(line) <= width for line in lines)
    assert "CPU" in lines[1]
    assert ("HOST" in lines[1]) == (width == 200)
    if nodes == topics == 40:
        assert sum("more" in line for line in lines) == 2
    if (nodes, topics, height) == (3, 5, 24):
        assert "50.0 Hz" in capture.get()
        assert "more" not in capture.get()


def test_what_is_wrong_is_seen_where_not_all_have_room() -> None:
    seen = snapshot(40, 40)
    nodes = [*seen.nodes[:-1], msgspec.structs.replace(seen.nodes[-1], state="failed")]
    topics = [msgspec.structs.replace(topic, stale=topic is seen.topics[-1]) for topic in seen.topics]
    console = Console(width=200, height=24, color_system=None)
    with console.capture() as capture:
        console.print(render(msgspec.structs.replace(seen, nodes=nodes, topics=topics), 200, 24))
    lines = capture.get().splitlines()
    assert "/r1/node_39" in lines[3]
    assert next(line for line in lines if line.startswith("r1/")).split()[-1] == "39", "by how many it has lost"


def troubled(nodes: int, **troubles: tuple[HealthLevel, str]) -> Snapshot:
    """A look at nodes of which some are not well; `_3` is the fourth."""
    seen = snapshot(nodes, 40)
    found = {f"_{i}": node for i, node in enumerate(seen.nodes)}
    found = {
        name: msgspec.structs.replace(
            node, health=troubles.get(name, ("ok", ""))[0], trouble=troubles.get(name, ("", ""))[1]
        )
        for name, node in found.items()
    }
    return msgspec.structs.replace(seen, nodes=list(found.values()))


@pytest.mark.parametrize("width", [60, 80, 200])
@pytest.mark.parametrize("height", [10, 24, 60])
@pytest.mark.parametrize("nodes", [4, 40])
def test_what_ails_nodes_fits_the_terminal(width: int, height: int, nodes: int) -> None:
    seen = troubled(
        nodes, _0=("warn", "battery: low"), _2=("error", "motor: " + 30 * "hot "), _3=("stale", "\x1b[2Jgone")
    )
    console = Console(width=width, height=height, color_system=None)
    with console.capture() as capture:
        console.print(render(seen, width, height))
    lines = capture.get().splitlines()
    assert len(lines) <= height
    assert all(len(line) <= width for line in lines)
    assert "HEALTH" in lines[1]
    told = [line.split()[:2] for line in lines if line.split()[0] in ("WARN", "ERROR", "STALE")]
    assert told == [["STALE", "/r1/node_3"], ["ERROR", "/r1/node_2"], ["WARN", "/r1/node_0"]][: max(height // 5, 1)]
    if height == 60:
        assert any(line.startswith("WARN /r1/node_0  battery: low") for line in lines)
        assert next(line for line in lines if line.startswith("/r1/node_1 ")).split()[2] == "OK"
    assert "\x1b" not in capture.get()


def test_a_chart_draws_lines_with_their_range() -> None:
    ramp = [(i / 10, i / 10) for i in range(101)]
    chart = Chart({"ramp": ramp}, begin=0.0, end=10.0, width=40, height=10)
    rows = str(chart).splitlines()
    assert len(rows) == 10
    assert all(len(row) <= 40 for row in rows)
    assert rows[0].startswith("10.5│")
    assert rows[-1].startswith("-0.5│")
    first, last = (next(i for i, row in enumerate(chart.rows) if row[column][1] == 0) for column in (-1, 5))
    assert first < last, "it rises"


def test_a_chart_of_nothing_and_of_gaps_is_drawn() -> None:
    assert "│" in str(Chart({}, begin=0.0, end=1.0, width=20, height=4))
    gaps = [(0.0, 1.0), (0.5, math.nan), (1.0, 1.0), (-5.0, 9.0)]
    chart = Chart({"a": gaps}, begin=0.0, end=1.0, width=30, height=5)
    drawn = [column for row in chart.rows for column, cell in enumerate(row) if cell[1] == 0]
    assert len(drawn) == 2, "a point on each side of the gap"
    assert (chart.low, chart.high) == (0.5, 1.5)


def test_who_stands_by_is_told_with_what_can_be_asked_of_it() -> None:
    process = ProcessStatus(
        robot="r1", group="vision", node="/r1/camera", state="standby", reason="inactive", pid=1, restarts=0,
        uptime=8.0, cpu=None, memory=None, published={}, received={}, run="a", host="here",
    )  # fmt: skip
    why = Explanation(process=process, exits=[], unmet_needs=[], inputs=[], callback_errors=0, next_start=None)
    assert explained(why) == [
        "/r1/camera is standby: inactive",
        "  running for 8.0s, process 1",
        "  robo lifecycle list /r1/camera: what can be asked of it now",
    ]


def test_an_input_on_which_nothing_comes_is_told_with_where_to_look() -> None:
    process = ProcessStatus(
        robot="r1", group="control", node="/r1/safety_monitor", state="ready", reason="", pid=1, restarts=0, uptime=8.0,
        cpu=None, memory=None, published={}, received={}, run="a", host="here",
    )  # fmt: skip
    scan = Input(topic="r1/scan", received=0, age=7.9, malformed=0, dropped=0)
    odom = Input(topic="r1/odom", received=0, age=1.2, malformed=0, dropped=0)  # it may not have been told yet
    key = Input(topic="r1/cmd_vel_key", received=0, age=60.0, malformed=0, dropped=0, external=True)
    frames = Input(topic="r1/tf_static", received=1, age=60.0, malformed=0, dropped=0)
    inputs = [scan, odom, key, frames]
    why = Explanation(process=process, exits=[], unmet_needs=[], inputs=inputs, callback_errors=0, next_start=None)
    assert explained(why)[2:] == [
        "  has received nothing on r1/scan for 7.9s",
        "    robo topic info r1/scan: who publishes it; robo logs /r1/safety_monitor: what it says of it",
    ]


def test_what_a_node_says_that_is_not_well_is_told_the_worst_first() -> None:
    process = ProcessStatus(
        robot="r1", group="base", node="/r1/base", state="ready", reason="", pid=1, restarts=0, uptime=8.0, cpu=None,
        memory=None, published={}, received={}, run="a", host="here", health="error", trouble="motor: hot",
    )  # fmt: skip
    checks = [
        DiagnosticStatus(DiagnosticStatus.OK, "/r1/base: topics", "50 Hz"),
        DiagnosticStatus(DiagnosticStatus.WARN, "/r1/base: callbacks", "plan has been running for 3.0 s"),
        DiagnosticStatus(DiagnosticStatus.WARN, "/r1/base: battery", "low"),
        DiagnosticStatus(DiagnosticStatus.ERROR, "/r1/base: motor", "hot"),
    ]
    why = Explanation(
        process=process, exits=[], unmet_needs=[], inputs=[], callback_errors=0, next_start=None, checks=checks
    )
    assert explained(why)[2:] == [
        "  ERROR motor: hot",
        "  WARN callbacks: plan has been running for 3.0 s",
        "  WARN battery: low",
    ]
    runs = msgspec.structs.replace(process, running="plan", running_for=3.2)
    assert explained(msgspec.structs.replace(why, process=runs))[2:] == [
        "  its callback plan has been running for 3.2s; all others of its turn wait",
        "  ERROR motor: hot",
        "  WARN battery: low",
    ]
    silent = msgspec.structs.replace(process, health="stale", trouble="has said nothing for 4.0 s")
    assert explained(msgspec.structs.replace(why, process=silent))[2:] == ["  has said nothing for 4.0 s"]
