"""What nodes without a supervisor keep of their log, and how their processes are shown."""

import logging
import time

import pytest

from robo.node.last_lines import MOST, LastLines
from robo.tools.unsupervised import of_robot, row_of
from robo.wire.keys import NodeToken
from robo.wire.reports import NodeStatus


@pytest.fixture
def logger() -> logging.Logger:
    return logging.Logger("robo.node.r1.base", logging.DEBUG)


def test_a_record_is_a_line_with_its_level_and_lines_without_below(logger: logging.Logger) -> None:
    kept = LastLines("/r1/base")
    logger.addHandler(kept)
    logger.warning("low", extra={"fields": {"voltage": 10.5}})
    logger.error("one\ntwo")
    assert [(one.node, one.level, one.message) for one in kept.after(0).lines] == [
        ("r1/base", "WARN", "low voltage=10.5"),
        ("r1/base", "ERROR", "one"),
        ("r1/base", None, "two"),
    ]


def test_times_grow_though_the_clock_does_not() -> None:
    kept = LastLines("/r1/base")
    for text, created in (("a", 20.0), ("b", 10.0), ("c", 10.0)):
        record = logging.LogRecord("r1.base", logging.INFO, __file__, 1, text, (), None)
        record.created = created
        kept.handle(record)
    times = [one.time for one in kept.after(0).lines]
    assert times == [20_000_000_000, 20_000_000_001, 20_000_000_002]
    assert [one.message for one in kept.after(times[1]).lines] == ["c"]


def test_the_newest_are_kept_and_long_ones_are_cut(logger: logging.Logger) -> None:
    kept = LastLines("/r1/base")
    logger.addHandler(kept)
    for number in range(MOST + 1):
        logger.info("%d", number)
    logger.info("x" * 10_000)
    lines = kept.after(0).lines
    assert len(lines) == MOST
    assert lines[0].message == "2"
    assert len(lines[-1].message) == 2_000
    assert kept.after(0).time <= time.time_ns()


def test_a_record_that_cannot_be_formatted_is_told_and_breaks_nothing(
    logger: logging.Logger, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = LastLines("/r1/base")
    logger.addHandler(kept)
    logger.info("%d", "no number")
    logger.info("goes on")
    assert [one.message for one in kept.after(0).lines] == ["goes on"]
    assert "no number" in capsys.readouterr().err


def status(uptime: float, used: float, published: int) -> NodeStatus:
    return NodeStatus("/r1/base", {"r1/odom": published}, {}, {}, {}, 0, uptime=uptime, processor_time=used, memory=7)


def test_figures_are_of_the_time_since_the_look_before() -> None:
    token = NodeToken("r1", "base", "base:Base", 12, "host")
    first = row_of(token, status(10.0, 1.0, 500), None)
    assert first.cpu == pytest.approx(10.0)
    assert (first.published, first.memory, first.run) == ({"r1/odom": 50.0}, 7, "")
    then = row_of(token, status(12.0, 1.1, 520), status(10.0, 1.0, 500))
    assert then.cpu == pytest.approx(5.0)
    assert then.published == {"r1/odom": pytest.approx(10.0)}


def test_one_that_does_not_answer_or_whose_supervisor_is_silent_says_so() -> None:
    row = row_of(NodeToken("r1", "base", "base:Base", 12, "host", "run"), None, None)
    assert (row.health, row.trouble) == ("stale", "it does not answer")
    assert row.reason == "its supervisor does not answer"
    assert (row.cpu, row.memory, row.uptime, row.published) == (None, None, None, {})


def test_a_robot_has_the_nodes_of_its_namespace_and_of_those_within() -> None:
    names = [("r1", "base"), ("r1/arm", "base"), ("r10", "base"), ("", "r1")]
    there = [NodeToken(namespace, node, "", 1, "host") for namespace, node in names]
    assert [one.full_name for one in of_robot(there, "r1")] == ["/r1/base", "/r1/arm/base"]
    assert of_robot(there, "") == there
