"""Rerun, a viewer: what a robot or a recording says, on its timeline."""
