"""What pages ask of robots: services, parameters, starting and stopping nodes. Functions on a session that block."""

import time
from typing import Any

import msgspec
import zenoh

import robo_messages
from robo.errors import InvalidName, TopicNotFound, UsageError
from robo.interfaces import catalogue
from robo.interfaces.message_input import message_of
from robo.node import services
from robo.samples.publishing import Sender
from robo.tools import nodes, offers, parameters, runs
from robo.wire import codec, names
from robo.wire.keys import NodeToken
from robo.wire.qos import QoS

TIMEOUT = 5.0
"""How long a service may take to answer, s."""
_FIND = 0.5
"""How long it may take to find a node, s."""
_PATIENCE = 1.0
"""How long to wait for somebody who listens, s."""
_DRIVING = ("geometry/Twist", "geometry/TwistStamped")
"""Types that move a robot."""


def call(session: zenoh.Session, service: str, type_name: str, request: dict[str, Any]) -> object:
    """Call a service, before everything else that is on its way.

    Args:
        session: the network.
        service: its key.
        type_name: of the service; empty to have it looked up.
        request: by field.

    Raises:
        InvalidName: the service has no such name.
        ServiceError: it refuses, or nobody answers.
        MessageError: the request is not one of its type.
    """
    _check_name("service", service)
    type_name = type_name or offers.find_service(session, service, _FIND).type
    asked, _ = robo_messages.halves_of(type_name)
    payload = msgspec.msgpack.encode(_checked(asked, request))
    stamp = codec.pack_attachment(1, time.time_ns())
    sample = services.ask(
        session, service, (payload, stamp), f"{codec.MSGPACK};{asked}", TIMEOUT, TIMEOUT, QoS.COMMAND.priority
    )
    return codec.jsonable(codec.decode_any(sample.payload.to_bytes()))


def publish(session: zenoh.Session, topic: str, type_name: str, message: dict[str, Any]) -> None:
    """Publish a message once.

    Raises:
        InvalidName: the topic has no such name.
        UsageError: that would be driving, which has a lease.
        MessageError: it is not one of its type.
        TopicNotFound: nobody listens.
    """
    _check_name("topic", topic)
    if type_name in _DRIVING:
        raise UsageError(f"{topic}: a page drives by its joystick and keys, one at a time")
    payload = msgspec.msgpack.encode(_checked(type_name, message))
    sender = Sender(session, topic, type_name, QoS.DEFAULT, "/" + names.join(topic.rpartition("/")[0], "dashboard"))
    try:
        if not sender.wait_for_subscriber(_PATIENCE):
            raise TopicNotFound(f"nobody subscribes to {topic}")
        sender.send(payload)
    finally:
        sender.close()


def command(session: zenoh.Session, robot: str, verb: str, node: str) -> object:
    """Have a node started, stopped or restarted; or be told why it is as it is.

    Raises:
        NodeNotFound, RunError: as `tools.runs.command`.
    """
    target = runs.target_of(session, robot)
    if verb == "why":
        return runs.explain(session, target, [node])
    return runs.command(session, target, verb, [node])


def all_parameters(session: zenoh.Session, node: str) -> list[parameters.Described]:
    """The parameters of a node, with what is known of each.

    Raises:
        NodeNotFound, NodeUnreachable: it is not there, or does not answer.
    """
    return parameters.describe(session, _node(session, node))


def set_parameters(session: zenoh.Session, node: str, values: dict[str, Any]) -> None:
    """Set parameters of a node, all or none.

    Raises:
        ParameterError: it refuses; says why.
        NodeNotFound, NodeUnreachable: it is not there, or does not answer.
        UsageError: there is nothing to set.
    """
    if not values:
        raise UsageError("no parameter is said")
    parameters.set_all(session, _node(session, node), values)


def _check_name(what: str, text: str) -> None:
    """
    Raises:
        InvalidName: it is none of one topic or service: a pattern would reach those of several robots.
    """
    if not names.is_name(f"/{text}"):
        raise InvalidName(f"{text!r} is no full name of a {what}")


def _node(session: zenoh.Session, name: str) -> NodeToken:
    return nodes.find_node(nodes.list_nodes(session, _FIND), name)


def _checked(type_name: str, data: dict[str, Any]) -> object:
    """A message, checked where its type is known here; else plain data, which its receiver checks."""
    type_ = catalogue.find_here(type_name)
    return data if type_ is None else message_of(type_, data)
