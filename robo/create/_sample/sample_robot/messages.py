"""The message types of sample_robot."""

# if messages
from robo_messages import Message, message


# end
# each message
@message("sample_robot/SampleMessage")
class SampleMessage(Message):
    """Say in a sentence what SampleMessage tells."""

    data: float = 0.0
    """What it is, and its unit."""


# end
