"""What the command line does, without the command line: functions on a session that return data."""
