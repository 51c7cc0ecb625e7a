"""The robot sample_robot: its nodes, what they decide, and its messages."""
