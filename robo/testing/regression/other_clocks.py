"""Clocks of the wall that show something else, in a run that is compared with another one: so is found who reads them.

Modules of users get them where they `import time` or `datetime`. Robo keeps the true ones, for its patience is of the
wall; so do the standard library and other libraries, which would only be disturbed.
"""

import builtins
import datetime
import sys
import time
from collections.abc import Callable, Collection, Mapping
from pathlib import PurePath
from types import ModuleType
from typing import Any

LATER = ((400 * 24 + 5) * 60 + 7) * 60 * 10**9 + 13 * 10**9
"""By how much they are ahead, ns: another year, month, day of the week, hour, minute and second."""
FASTER = 24 * 60 * 60
"""So much faster they go: a run that takes a second takes a day, and what waits for minutes to pass sees them pass."""

_TRUE = frozenset({"__main__", "robo", "robo_messages", *sys.stdlib_module_names})
_INSTALLED = frozenset({"site-packages", "dist-packages"})


def install(own: Collection[str]) -> None:
    """Let modules of users that are imported from now on have other clocks, to the end of this process.

    Args:
        own: packages of users, wherever they are installed; and so is all that stands in no folder of libraries.
    """
    true, others = {"time": time, "datetime": datetime}, {"time": _clocks(), "datetime": _dates()}
    import_ = builtins.__import__

    def import_for(name: str, *arguments: Any, **words: Any) -> ModuleType:
        found = import_(name, *arguments, **words)
        asking = arguments[0] if arguments else words.get("globals")
        return others[name] if found is true.get(name) and is_of_users(asking or {}, own) else found

    setattr(builtins, "__import__", import_for)  # noqa: B010


def is_of_users(module: Mapping[str, object], own: Collection[str]) -> bool:
    """Whether a module, by its globals, is one of users."""
    package = str(module.get("__name__", "")).partition(".")[0]
    if package in own:
        return True
    file = module.get("__file__")
    return package not in _TRUE and isinstance(file, str) and _INSTALLED.isdisjoint(PurePath(file).parts)


def _other(clock: Callable[[], int]) -> Callable[[], int]:
    begin = clock()
    return lambda: begin + LATER + (clock() - begin) * FASTER


def _seconds(clock: Callable[[], int]) -> Callable[[], float]:
    return lambda: clock() * 1e-9


_wall = _other(time.time_ns)


def _clocks() -> ModuleType:
    """The module `time`, with other clocks."""
    copied = _copy(time)
    other: Any = copied
    clocks = {name: _other(getattr(time, f"{name}_ns")) for name in ("monotonic", "perf_counter", "process_time")}
    for name, clock in {**clocks, "time": _wall}.items():
        setattr(other, f"{name}_ns", clock)
        setattr(other, name, _seconds(clock))
    numbered: dict[int, Callable[[], int]] = {}

    def clock_gettime_ns(number: int) -> int:
        clock = numbered.get(number)
        if clock is None:
            clock = numbered[number] = _other(lambda: time.clock_gettime_ns(number))
        return clock()

    def now(seconds: float | None) -> float:
        return _wall() * 1e-9 if seconds is None else seconds

    other.clock_gettime_ns = clock_gettime_ns
    other.clock_gettime = lambda number: clock_gettime_ns(number) * 1e-9
    other.gmtime = lambda seconds=None: time.gmtime(now(seconds))
    other.localtime = lambda seconds=None: time.localtime(now(seconds))
    other.ctime = lambda seconds=None: time.ctime(now(seconds))
    other.asctime = lambda when=None: time.asctime(other.localtime() if when is None else when)
    other.strftime = lambda text, when=None: time.strftime(text, other.localtime() if when is None else when)
    return copied


class _Like(type):
    """What is a `datetime.datetime` is one of these too: all that they make are true ones."""

    def __instancecheck__(cls, instance: object) -> bool:
        true = _STANDS_FOR.get(cls)
        return isinstance(instance, true) if true is not None else super().__instancecheck__(instance)

    def __subclasscheck__(cls, subclass: type) -> bool:
        true = _STANDS_FOR.get(cls)
        return issubclass(subclass, true) if true is not None else super().__subclasscheck__(subclass)


class _Datetime(datetime.datetime, metaclass=_Like):
    def __new__(cls, *arguments: Any, **more: Any) -> Any:
        return super().__new__(_STANDS_FOR.get(cls, cls), *arguments, **more)

    @classmethod
    def now(cls, tz: datetime.tzinfo | None = None) -> Any:
        return cls.fromtimestamp(_wall() * 1e-9, tz)

    @classmethod
    def today(cls) -> Any:
        return cls.now()

    @classmethod
    def utcnow(cls) -> Any:
        return cls.now(datetime.UTC).replace(tzinfo=None)


class _Date(datetime.date, metaclass=_Like):
    def __new__(cls, *arguments: Any, **more: Any) -> Any:
        return super().__new__(_STANDS_FOR.get(cls, cls), *arguments, **more)

    @classmethod
    def today(cls) -> Any:
        return cls.fromtimestamp(_wall() * 1e-9)


_STANDS_FOR: dict[type, Any] = {_Datetime: datetime.datetime, _Date: datetime.date}


def _dates() -> ModuleType:
    """The module `datetime`, of which today is another day."""
    copied = _copy(datetime)
    vars(copied).update(datetime=_Datetime, date=_Date)
    return copied


def _copy(module: ModuleType) -> ModuleType:
    copied = ModuleType(module.__name__, module.__doc__)
    vars(copied).update(vars(module))
    return copied
