"""A recording that is played: its time, what is due, and where that goes."""
