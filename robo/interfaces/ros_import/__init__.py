"""ROS's `.msg`, `.srv` and `.action` files as message types of robo: read, put together, written as Python."""
