"""Foxglove and Lichtblick, live: a server of their WebSocket protocol."""
