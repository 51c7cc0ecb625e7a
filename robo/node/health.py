"""How well something does, as a check of a node says it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from robo_messages.diagnostic import DiagnosticStatus, KeyValue


class Health(msgspec.Struct, frozen=True):
    """How well something does: what a `@check` returns. Made with `ok`, `warn` or `error`.

    return Health.warn(f"{volts:.1f} V: charge it", volts=volts, cells=6)
    """

    level: int = DiagnosticStatus.OK
    """As in `diagnostic/DiagnosticStatus`."""
    message: str = ""
    """How it does, in a sentence; where all is well it may be empty."""
    values: Mapping[str, object] = {}
    """Figures beside it, by name."""

    @classmethod
    def ok(cls, message: str = "", /, **values: object) -> Health:
        """All is well."""
        return cls(DiagnosticStatus.OK, message, values)

    @classmethod
    def warn(cls, message: str, /, **values: object) -> Health:
        """It works, and somebody should have a look."""
        return cls(DiagnosticStatus.WARN, message, values)

    @classmethod
    def error(cls, message: str, /, **values: object) -> Health:
        """It does not work."""
        return cls(DiagnosticStatus.ERROR, message, values)

    def status(self) -> DiagnosticStatus:
        """The same as a message, without a name.

        Raises:
            TypeError, ValueError: a field is not of its type, or the level is none.
        """
        # 1.0 and True are in it, and no reader takes them for a level.
        if type(self.level) is not int or self.level not in _LEVELS:
            raise ValueError(f"{self.level!r} is no level: use Health.ok, Health.warn or Health.error")
        values = [KeyValue(str(name), _figure(value)) for name, value in self.values.items()]
        return DiagnosticStatus(self.level, message=str(self.message), values=values)


_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


def _figure(value: object) -> str:
    """A value as text: numbers as people write them, others as they are."""
    return f"{value:.6g}" if isinstance(value, float) and math.isfinite(value) else str(value)
