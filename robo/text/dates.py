"""Times for people, by the clock here. Pure but for its zone."""

from datetime import datetime


def date(nanoseconds: int) -> str:
    """A time as `2026-11-23 18:30:00.123 +0100`; one that no calendar has in ns since the epoch."""
    try:
        time = datetime.fromtimestamp(nanoseconds // 10**9).astimezone()
    except (ValueError, OverflowError, OSError):
        return f"{nanoseconds} ns"
    return f"{time:%Y-%m-%d %H:%M:%S}.{nanoseconds // 10**6 % 1000:03d} {time:%z}"
