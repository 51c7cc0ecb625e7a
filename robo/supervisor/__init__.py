"""The supervisor owns processes: it starts a plan, watches it and stops it."""
