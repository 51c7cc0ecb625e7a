"""The last seconds of a robot, and the files that are made of them when something happens."""
