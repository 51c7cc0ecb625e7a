"""How long recordings are, for people. Pure."""


def duration(nanoseconds: int) -> str:
    """`0.991 s`; `1:02:03 (3,723.0 s)` where it is long."""
    seconds = nanoseconds * 1e-9
    if seconds < 60:
        return f"{seconds:.3f} s"
    hours, rest = divmod(round(seconds), 3600)
    minutes, left = divmod(rest, 60)
    clock = f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"
    return f"{clock} ({seconds:,.1f} s)"
