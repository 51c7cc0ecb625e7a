import logging
import sys

import pytest

from robo.errors import UsageError
from robo.node.log import ConsoleFormatter, NodeLogger
from robo.text.levels import level_name, level_of


class Keep(logging.Handler):
    """Keeps records."""

    def __init__(self) -> None:
        super().__init__()
        self.records: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.records.append(record)


@pytest.fixture
def kept() -> Keep:
    return Keep()


def make(kept: Keep, clock: list[float]) -> NodeLogger:
    logger = NodeLogger("test.log", clock=lambda: clock[0])
    logger.logger.setLevel(logging.INFO)
    logger.logger.propagate = False
    logger.logger.handlers[:] = [kept]
    return logger


def test_throttled_texts_are_counted_while_held_back(kept: Keep) -> None:
    clock = [0.0]
    logger = make(kept, clock)
    for _ in range(5):
        logger.warning("near %d", 1, throttle=1.0)
    logger.warning("other", throttle=1.0)
    clock[0] = 1.5
    logger.warning("near %d", 2, throttle=1.0)
    assert [r.getMessage() for r in kept.records] == ["near 1", "other", "near 2 (4 more like this)"]


def test_a_record_knows_who_wrote_it(kept: Keep) -> None:
    logger = make(kept, [0.0])
    logger.info("here", fields={"x": 1})
    logger.debug("not shown")
    (record,) = kept.records
    assert record.funcName == "test_a_record_knows_who_wrote_it"
    assert ConsoleFormatter(supervised=True, colour=False).format(record) == "INFO  here x=1"
    assert ConsoleFormatter(supervised=False, colour=False).format(record).endswith(" INFO  test.log: here x=1")


def test_an_error_carries_its_traceback(kept: Keep) -> None:
    logger = make(kept, [0.0])
    try:
        raise ValueError("broken")
    except ValueError as error:
        logger.error("failed", exception=error)
    text = ConsoleFormatter(supervised=True, colour=True).format(kept.records[0])
    assert text.startswith("\x1b[31mERROR\x1b[0m failed\nTraceback")
    assert text.endswith("ValueError: broken")
    assert sys.exc_info() == (None, None, None)


def test_levels() -> None:
    assert level_of("WARN") == 30
    assert level_name(35) == "WARN"
    with pytest.raises(UsageError, match="debug, info, warn"):
        level_of("loud")
