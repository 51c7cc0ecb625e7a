"""What supervisors would tell, made up."""

from robo.wire.reports import ProcessStatus


def process(robot: str, node: str, group: str = "") -> ProcessStatus:
    """A process that is ready."""
    return ProcessStatus(
        robot=robot, group=group, node=node, state="ready", reason="", pid=1, restarts=0, uptime=1.0, cpu=0.0,
        memory=1, published={}, received={}, run="", host="",
    )  # fmt: skip
