"""Recordings of a robot that runs: what its topics say, written down, and said again."""
