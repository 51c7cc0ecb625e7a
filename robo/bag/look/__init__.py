"""What is told of recordings: figures, faults, differences."""
