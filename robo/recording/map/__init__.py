"""The way of a robot and what its lasers have hit, as a picture."""
