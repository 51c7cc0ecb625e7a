"""ROS 2, live: a part of its graph over the wire of rmw_zenoh, without ROS installed."""
