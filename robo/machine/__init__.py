"""What the operating system does for a run: children, their output, log files, and that nothing outlives it."""
