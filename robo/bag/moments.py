"""Times of a recording as people write them. Pure but for the time zone of this machine."""

import re
from datetime import datetime, timedelta
from decimal import Decimal

from robo.errors import UsageError
from robo.text.brief import shown

_NS = 10**9
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d*)?|[+-]?\.\d+")
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2})(?:\.(\d{1,9}))?)?")
_LEAST_EPOCH = 10**15
"""A whole number of this size is ns since the epoch, as `--json` prints times: so many seconds no recording lasts."""
_LEAST_EPOCH_SECONDS = 10**8
"""A number of this size is seconds since the epoch, as `date +%s` prints them: no recording lasts three years."""
_MOST = 2**64 - 1


def moment(text: str, begin: int, end: int, option: str = "") -> int:
    """A time of a recording, ns since the epoch.

    Args:
        text: seconds from the beginning, `12.5`; from the end, `-5`; a time of the clock here, `18:30:00`, that comes
            first after the beginning; a date, `2026-11-23T18:30:00`, here or with its zone; or s or ns since the epoch.
        begin: when the recording begins, ns since the epoch.
        end: when it ends.
        option: by which it is asked for, for messages.

    Raises:
        UsageError: it is none of these.
    """
    text = text.strip()
    try:
        found = _moment(text, begin, end)
    except (ValueError, OverflowError, OSError):
        what = f"{option} {shown(text)}" if option else shown(text)
        raise UsageError(
            f"{what} is no time: write seconds from the beginning (12.5) or from the end (-5), a time of the clock "
            "(18:30:00), or a date (2026-11-23T18:30:00)"
        ) from None
    return min(max(found, 0), _MOST)


def _moment(text: str, begin: int, end: int) -> int:
    if len(text) > 100:
        raise ValueError
    if _NUMBER.fullmatch(text):
        return _by_number(text, begin, end)
    if (clock := _CLOCK.fullmatch(text)) is not None:
        return _by_clock(clock, begin)
    return _nanoseconds(datetime.fromisoformat(text).astimezone())


def _by_number(text: str, begin: int, end: int) -> int:
    if text.isdecimal() and int(text) >= _LEAST_EPOCH:
        return int(text)
    seconds = Decimal(text)
    since = 0 if seconds >= _LEAST_EPOCH_SECONDS else end if text[0] == "-" else begin
    return since + round(seconds * _NS)


def _by_clock(clock: "re.Match[str]", begin: int) -> int:
    """The first time at which the clock here shows so, from the second of the beginning on."""
    hour, minute, second = int(clock[1]), int(clock[2]), int(clock[3] or 0)
    first = datetime.fromtimestamp(begin // _NS).astimezone()
    found = first.replace(hour=hour, minute=minute, second=second, microsecond=0, tzinfo=None)
    if found < first.replace(microsecond=0, tzinfo=None):
        found += timedelta(days=1)
    return _nanoseconds(found.astimezone()) + int((clock[4] or "0").ljust(9, "0"))


def _nanoseconds(time: datetime) -> int:
    return round(time.replace(microsecond=0).timestamp()) * _NS + time.microsecond * 1_000
