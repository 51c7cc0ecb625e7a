"""Measurements beside raw zenoh-python and msgspec, in the same run: `python -m benchmarks`."""

import os

# A checkout is measured as an installed package runs: with its modules compiled already.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
