"""Reading recordings: files as one, messages in order, as values."""
