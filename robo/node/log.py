"""Logging as ROS users know it, on top of the standard library's.

`node.logger.warning("obstacle at %.2f m", distance, throttle=1.0)`: ROS's levels, a throttle in
seconds, structured fields (`fields={"distance": 0.27}`). Records go to stderr and to the robot's
`log` topic.
"""

import logging
import os
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol, TextIO

from robo.environment import LOG_LEVEL_VARIABLE, SUPERVISED_VARIABLE
from robo.text import colours
from robo.text.levels import level_name, level_of
from robo.text.terminal import visible_but_colours
from robo_messages import Log, Time

ROOT = "robo.node"

Fields = Mapping[str, object] | None


class NodeLogger:
    """A node's logger. Each method takes the text, the values to put into it, and optionally

    - `throttle`: show the same text at most once in so many seconds, and count the rest;
    - `fields`: figures to go along with the text.
    """

    def __init__(self, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.logger = logging.getLogger(f"{ROOT}.{name}")
        """The standard library's logger below."""
        self._clock = clock
        self._throttled: dict[str, tuple[float, int]] = {}

    def debug(self, text: str, *values: object, throttle: float | None = None, fields: Fields = None) -> None:
        """For those who look for a fault."""
        self._log(logging.DEBUG, text, values, throttle, fields)

    def info(self, text: str, *values: object, throttle: float | None = None, fields: Fields = None) -> None:
        """What goes as it should."""
        self._log(logging.INFO, text, values, throttle, fields)

    def warning(self, text: str, *values: object, throttle: float | None = None, fields: Fields = None) -> None:
        """What may need somebody's attention."""
        self._log(logging.WARNING, text, values, throttle, fields)

    def error(
        self,
        text: str,
        *values: object,
        throttle: float | None = None,
        fields: Fields = None,
        exception: BaseException | None = None,
    ) -> None:
        """What does not work; with `exception`, its traceback follows."""
        self._log(logging.ERROR, text, values, throttle, fields, exception)

    def fatal(self, text: str, *values: object, throttle: float | None = None, fields: Fields = None) -> None:
        """What ends the node."""
        self._log(logging.CRITICAL, text, values, throttle, fields)

    def _log(
        self,
        level: int,
        text: str,
        values: tuple[object, ...],
        throttle: float | None,
        fields: Fields,
        exception: BaseException | None = None,
    ) -> None:
        if not self.logger.isEnabledFor(level):
            return
        if throttle is not None:
            held_back = self._skip(text, throttle)
            if held_back is None:
                return
            if held_back:
                text = f"{text} ({held_back} more like this)"
        # The caller is three frames up: this method and the level's method lie between.
        self.logger.log(level, text, *values, exc_info=exception, stacklevel=3, extra={"fields": dict(fields or {})})

    def _skip(self, text: str, throttle: float) -> int | None:
        """How many of this text were held back since the last one shown; None to hold this one back."""
        now = self._clock()
        last, held = self._throttled.get(text, (float("-inf"), 0))
        if 0.0 <= now - last < throttle:  # simulated time may step back
            self._throttled[text] = (last, held + 1)
            return None
        self._throttled[text] = (now, 0)
        return held


class ConsoleFormatter(logging.Formatter):
    """`12:00:01.123 INFO  r1/tracker: text`; under a supervisor, which adds time and node, `INFO  text`."""

    def __init__(self, *, supervised: bool, colour: bool) -> None:
        super().__init__()
        self._supervised = supervised
        self._colour = colour

    def format(self, record: logging.LogRecord) -> str:
        """One line, and the traceback below it if there is one."""
        level = level_name(record.levelno)
        text = record.getMessage()
        fields: Mapping[str, object] = getattr(record, "fields", {})
        if fields:
            text += " " + " ".join(f"{key}={value}" for key, value in fields.items())
        if record.exc_info:
            text += "\n" + self.formatException(record.exc_info)
        shown = f"{level:5}"
        if self._colour and level in colours.LEVELS:
            shown = colours.painted(shown, colours.LEVELS[level])
        if self._supervised:
            return f"{shown} {text}"
        # As a supervisor does it for its nodes.
        text = "\n".join(visible_but_colours(line, colour=self._colour) for line in text.split("\n"))
        stamp = time.strftime("%H:%M:%S", time.localtime(record.created))
        name = record.name.removeprefix(f"{ROOT}.")
        return f"{stamp}.{int(record.msecs):03d} {shown} {name}: {text}"


class LogPublisher(Protocol):
    """What a record needs to reach the bus."""

    def publish(self, message: Log) -> None:
        """Send one record."""


class BusHandler(logging.Handler):
    """Publishes a node's records on its robot's `log` topic."""

    def __init__(self, publisher: LogPublisher, node: str, now: Callable[[], Time]) -> None:
        super().__init__()
        self._publisher = publisher
        self._node = node
        self._now = now

    def emit(self, record: logging.LogRecord) -> None:
        """Publish one record; a bus that is gone must not break the node that logs about it."""
        try:
            self._publisher.publish(
                Log(
                    stamp=self._now(),
                    level=min(record.levelno, Log.FATAL),
                    name=self._node,
                    msg=record.getMessage(),
                    file=record.pathname,
                    function=record.funcName or "",
                    line=record.lineno,
                )
            )
        except Exception:
            self.handleError(record)


def setup(level: str | None = None, *, colour: bool | None = None) -> None:
    """Send this process's node logs to stderr, once. `level` defaults to ROBO_LOG_LEVEL, then info.

    Raises:
        UsageError: there is no such level.
    """
    logger = logging.getLogger(ROOT)
    logger.setLevel(level_of(level or os.environ.get(LOG_LEVEL_VARIABLE) or "info"))
    logger.propagate = False
    if logger.handlers:
        return
    handler = logging.StreamHandler(sys.stderr)
    if colour is None:
        colour = colours.shown_on(sys.stderr)
    handler.setFormatter(ConsoleFormatter(supervised=is_supervised(), colour=colour))
    logger.addHandler(handler)


def apart(logger: logging.Logger, stream: TextIO, level: str | None) -> Callable[[], None]:
    """Send the records of one node to a stream of its own, where several nodes share a process.

    Args:
        logger: the node's.
        stream: takes its lines.
        level: the least that is shown; by default what the process shows.

    Returns:
        What undoes it.

    Raises:
        UsageError: there is no such level.
    """
    handler = logging.StreamHandler(stream)
    handler.setFormatter(ConsoleFormatter(supervised=is_supervised(), colour=False))
    logger.setLevel(level_of(level) if level is not None else logging.NOTSET)
    logger.propagate = False
    logger.addHandler(handler)
    return partial(logger.removeHandler, handler)


def is_supervised() -> bool:
    """Whether a supervisor reads what this process prints, and adds time and node to it."""
    return SUPERVISED_VARIABLE in os.environ
