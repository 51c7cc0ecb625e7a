"""A manifest as a service of systemd."""
