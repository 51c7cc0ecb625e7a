"""From the words of a command line to a run, a check or a file."""
