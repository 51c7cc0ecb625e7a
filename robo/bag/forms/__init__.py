"""Recordings in other forms: logs of CARMEN, JSON Lines, CSV; from them, and to them."""
