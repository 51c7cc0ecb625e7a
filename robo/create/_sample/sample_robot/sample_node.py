"""What the node sample_node is connected to; what it decides stands beside it."""

from typing import Annotated

import robo
from msgspec import Meta
from robo import Node, Publisher, Unit, service, subscribe, timer
from robo_messages import LaserScan, String, Trigger

from sample_robot.sample_node_logic import about_sample_input, answer_sample_service, next_sample_output


class SampleNode(Node):
    """Say in a sentence what sample_node does."""

    class Parameters(robo.Parameters):
        """What can be set, here with defaults; config/robot.yaml has the robot's values."""

        # if publishes
        rate: Annotated[float, Meta(gt=0, description="messages per second"), Unit("Hz")] = 1.0
        # end
        # if listens
        log_period: Annotated[float, Meta(ge=0, description="between two lines of the log"), Unit("s")] = 1.0
        # end

    parameters: Parameters

    # each publisher
    sample_output = Publisher(String, "sample_output")
    # end

    # if publishes
    def on_start(self) -> None:
        """Begin to count."""
        self.count = 0

    @timer(rate="rate")
    def send(self) -> None:
        """Publish what comes next."""
        # each publisher
        self.sample_output.publish(next_sample_output(self.count))
        # end
        self.count += 1

    # end
    # each subscription
    @subscribe("sample_input")
    def on_sample_input(self, message: LaserScan) -> None:
        """Take a message of sample_input."""
        self.logger.info("sample_input: %s", about_sample_input(message), throttle=self.parameters.log_period)

    # end
    # each service
    @service("sample_service")
    def handle_sample_service(self, request: Trigger.Request) -> Trigger.Response:
        """Answer a call of sample_service."""
        self.logger.info("sample_service is called", throttle=self.parameters.log_period)
        return answer_sample_service(request)

    # end


if __name__ == "__main__":
    robo.run(SampleNode)
