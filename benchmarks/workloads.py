"""What is sent: messages of everyday sizes."""

from robo_messages import LaserScan, Message, Odometry, Twist, Vector3


def message(kind: str) -> Message:
    """A message of the named kind: `twist`, `odometry` or `scan`."""
    if kind == "twist":
        return Twist(Vector3(x=0.5), Vector3(z=0.2))
    if kind == "odometry":
        return Odometry(child_frame_id="base_link")
    return LaserScan(ranges=[1.0 + i * 0.01 for i in range(360)])
