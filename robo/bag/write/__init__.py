"""Writing a recording: its files, what each begins with, and what is counted."""
