"""What the node sample_node decides: plain functions, tested by themselves."""

from robo_messages import LaserScan, String, Trigger


# each publisher
def next_sample_output(count: int) -> String:
    """The message number `count`, from 0, on sample_output."""
    return String(data=f"sample_output {count}")


# end
# each subscription
def about_sample_input(message: LaserScan) -> str:
    """What the log says of a message on sample_input."""
    return str(message)[:80]


# end
# each service
def answer_sample_service(request: Trigger.Request) -> Trigger.Response:
    """The answer to a call of sample_service."""
    return Trigger.Response()


# end
