"""Log levels: names and numbers."""

from robo.errors import UsageError

LEVELS = {"debug": 10, "info": 20, "warn": 30, "warning": 30, "error": 40, "fatal": 50}
_NAMES = {10: "DEBUG", 20: "INFO", 30: "WARN", 40: "ERROR", 50: "FATAL"}
LEVEL_NAMES = frozenset(_NAMES.values())
"""As they stand at the beginning of a line."""


def level_of(name: str) -> int:
    """The number of a level's name.

    Raises:
        UsageError: there is no such level.
    """
    try:
        return LEVELS[name.lower()]
    except KeyError:
        raise UsageError(f"log level {name!r}: use debug, info, warn, error or fatal") from None


def level_name(level: int) -> str:
    """ROS's name of a level, `INFO` for 20."""
    return _NAMES.get(level - level % 10, "INFO")
