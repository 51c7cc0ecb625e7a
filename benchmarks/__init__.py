"""Measurements beside raw zenoh-python and msgspec, in the same run: `python -m benchmarks`."""
