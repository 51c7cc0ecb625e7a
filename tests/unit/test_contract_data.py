"""A node class's contract as others get it: plain data, and text for people."""

import pickle
import subprocess
import sys
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, Client, Node, Publisher, Unit, service, subscribe, timer
from robo.node.contract_data import ClientData, ContractData, ServedData, SubscriptionData, TimerData, TopicData
from robo.node.contract_text import contract_data, contract_text
from robo.wire.qos import QoS
from robo_messages import Odometry, Point, Trigger


class Tracker(Node):
    """Follows a robot.

    It says where it is.
    """

    class Parameters(robo.Parameters):
        rate: Annotated[float, Meta(gt=0, le=1000, description="reports a second"), Unit("Hz")] = 1.0
        frame: Annotated[Literal["odom", "map"], READ_ONLY] = "odom"

    parameters: Parameters
    position = Publisher(Point, "~/position", depth=0)
    clear = Client(Trigger.Request, Trigger.Response, "/clear", timeout=2.5)

    @subscribe("odom", depth=3)
    def on_odometry(self, _: Odometry) -> None:
        """Take it."""

    @service("reset")
    def reset(self, _: Trigger.Request) -> Trigger.Response:
        return Trigger.Response()

    @timer(rate="rate")
    def report(self) -> None:
        """Say it."""

    @timer(rate=0.25)
    def rest(self) -> None:
        """Say nothing."""


class Idle(Node):
    """Does nothing."""


def test_a_contract_as_data_names_its_types() -> None:
    data = contract_data(Tracker)
    assert data.class_name == f"{__name__}:Tracker"
    assert (data.name, data.description) == ("tracker", "Follows a robot.\n\nIt says where it is.")
    assert data.publishers == (TopicData("~/position", "geometry/Point", QoS(depth=0)),)
    assert data.subscriptions == (SubscriptionData("odom", "nav/Odometry", QoS(depth=3)),)
    assert data.services == (ServedData("reset", "std/Trigger"),)
    assert data.clients == (ClientData("/clear", "std/Trigger", 2.5),)
    assert data.timers == (TimerData("report", "rate"), TimerData("rest", 0.25))
    assert data.parameter_types == {"rate": "float", "frame": "odom or map", "use_sim_time": "bool"}


def test_it_crosses_to_another_process_whole() -> None:
    data = contract_data(Tracker)
    assert pickle.loads(pickle.dumps(data)) == data
    assert msgspec.json.decode(msgspec.json.encode(data), type=ContractData) == data


def test_it_is_read_without_the_message_types() -> None:
    code = (
        "import sys; import robo.node.contract_data; print([m for m in sys.modules if m in ('zenoh', 'robo_messages')])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == "[]\n"


def test_people_read_what_it_subscribes_publishes_serves_calls_and_how_it_is_tuned() -> None:
    assert (
        contract_text(contract_data(Tracker))
        == """\
subscribes:
  odom               nav/Odometry  depth 3
publishes:
  ~/position         geometry/Point  keeps all
services:
  reset              std/Trigger
calls:
  /clear             std/Trigger
timers:
  report             rate
  rest               0.25 Hz
parameters:
  rate         1.0      reports a second, Hz; > 0 and <= 1000
  frame        'odom'
  use_sim_time False    follow the topic /clock"""
    )


def test_what_a_class_does_not_have_is_not_mentioned() -> None:
    assert contract_text(contract_data(Idle)) == "parameters:\n  use_sim_time False    follow the topic /clock"
