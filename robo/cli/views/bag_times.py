"""Times of recordings for people, by the clock here. Pure but for its zone."""

from datetime import datetime


def date(nanoseconds: int) -> str:
    """A time as `2026-11-23 18:30:00.123 +0100`; one that no calendar has in ns since the epoch."""
    try:
        time = datetime.fromtimestamp(nanoseconds // 10**9).astimezone()
    except (ValueError, OverflowError, OSError):
        return f"{nanoseconds} ns"
    return f"{time:%Y-%m-%d %H:%M:%S}.{nanoseconds // 10**6 % 1000:03d} {time:%z}"


def duration(nanoseconds: int) -> str:
    """`0.991 s`; `1:02:03 (3,723.0 s)` where it is long."""
    seconds = nanoseconds * 1e-9
    if seconds < 60:
        return f"{seconds:.3f} s"
    hours, rest = divmod(round(seconds), 3600)
    minutes, left = divmod(rest, 60)
    clock = f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"
    return f"{clock} ({seconds:,.1f} s)"
