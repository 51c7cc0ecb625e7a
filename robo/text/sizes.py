"""Sizes in memory, as manifests write them."""

_UNITS = ((1 << 40, "T"), (1 << 30, "G"), (1 << 20, "M"), (1 << 10, "K"))


def in_short(size: int) -> str:
    """A size in bytes, with three digits that count at most: `256M`, `1.5G`; 1024 of a unit are the next one."""
    for unit, letter in _UNITS:
        if size >= unit:
            return f"{size / unit:.4g}{letter}" if size % unit == 0 else f"{size / unit:.3g}{letter}"
    return str(size)
