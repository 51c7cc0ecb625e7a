"""What pages ask of robots: services, parameters, starting and stopping nodes. Functions on a session that block."""

import time
from typing import Any

import msgspec
import zenoh

import robo_messages
from robo.errors import InvalidName, ServiceTimeout, TopicNotFound, UsageError
from robo.interfaces import catalogue
from robo.interfaces.message_input import message_of
from robo.node import services
from robo.samples.publishing import Sender
from robo.tools import nodes, offers, parameters, runs
from robo.wire import codec, names
from robo.wire.keys import NodeToken
from robo.wire.qos import QoS, zenoh_priority
from robo_messages import Bool

TIMEOUT = 5.0
"""How long a service may take to answer, s."""
_FIND = 0.5
"""How long it may take to find a node, s."""
_PATIENCE = 1.0
"""How long to wait for somebody who listens, s."""
_PUBLISHED = {"waypoints": "nav/Path"}
"""All that pages publish: the last word of the topic, and its type."""
_LONGEST_NAME = 200
"""Of a robot, node, service or topic, characters: Zenoh ends the process where its announcements become too long."""
STOP, RESET = "emergency_stop", "reset_emergency_stop"


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
    _check_length("type", type_name)
    type_name = type_name or offers.find_service(session, service, _FIND).type
    asked, _ = robo_messages.halves_of(type_name)
    payload = msgspec.msgpack.encode(_checked(asked, request))
    stamp = codec.pack_attachment(1, time.time_ns())
    sample = services.ask(
        session, service, (payload, stamp), f"{codec.MSGPACK};{asked}", TIMEOUT, TIMEOUT, QoS.COMMAND.priority
    )
    return codec.jsonable(codec.decode_any(sample.payload.to_bytes()))


def say_stop(session: zenoh.Session, service: str) -> None:
    """Have a robot stop by the topic, which needs no answer.

    Args:
        session: the network.
        service: the key of its service; the topic has the same one.

    Raises:
        InvalidName: the service has no such name.
    """
    _check_name("service", service)
    session.put(
        service,
        robo_messages.encode(Bool(True)),
        encoding=codec.encoding_of(Bool),
        attachment=codec.pack_attachment(1, time.time_ns()),
        priority=zenoh_priority(QoS.COMMAND.priority),
    )


def stop(session: zenoh.Session, service: str) -> object:
    """Have a robot stop, by the topic and by the service of the same name.

    Raises:
        InvalidName: the service has no such name.
        ServiceTimeout: nobody serves it, or it does not answer; says that the stop is not confirmed.
        ServiceError: it refuses.
    """
    say_stop(session, service)
    begin = time.monotonic()
    try:
        return call(session, service, "std/Trigger", {})
    except ServiceTimeout:
        robot = service.rpartition("/")[0] or "the robot"
        if time.monotonic() - begin < TIMEOUT * 0.9:
            raise ServiceTimeout(f"NOT STOPPED: {robot} has no service {service}") from None
        raise ServiceTimeout(f"NOT CONFIRMED: {service} has not answered within {TIMEOUT:g} s") from None


def publish(session: zenoh.Session, topic: str, type_name: str, message: dict[str, Any]) -> None:
    """Publish a message once.

    Raises:
        InvalidName: the topic has no such name.
        UsageError: pages publish no such thing.
        MessageError: it is not one of its type.
        TopicNotFound: nobody listens.
    """
    _check_name("topic", topic)
    wanted = _PUBLISHED.get(topic.rpartition("/")[2])
    if wanted is None or type_name != wanted:
        raise UsageError(f"{topic}: pages publish nothing but waypoints, and drive by the joystick, one at a time")
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
        UsageError: not one node is meant.
        InvalidName: it cannot be the name of a robot.
    """
    if not node.startswith("/"):
        raise UsageError(f"{node[:_LONGEST_NAME]}: a page commands one node, by its full name, and no group")
    if names.normalize_namespace(robot) != robot:
        raise InvalidName(f"{robot[:_LONGEST_NAME]} is no name of a robot")
    _check_length("node", node)
    _check_length("robot", robot)
    target = runs.target_of(session, robot)
    if verb == "why":
        return runs.explain(session, target, [node])
    return runs.command(session, target, verb, [node])


def all_parameters(session: zenoh.Session, node: str) -> list[parameters.Described]:
    """The parameters of a node, with what is known of each.

    Raises:
        NodeNotFound, NodeUnreachable: it is not there, or does not answer.
    """
    _check_length("node", node)
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
    _check_length("node", node)
    parameters.set_all(session, _node(session, node), values)


def _check_name(what: str, text: str) -> None:
    """
    Raises:
        InvalidName: it is none of one topic or service: a pattern would reach those of several robots.
    """
    _check_length(what, text)
    if not names.is_name(f"/{text}"):
        raise InvalidName(f"{text!r} is no full name of a {what}")


def _check_length(what: str, text: str) -> None:
    """
    Raises:
        InvalidName: it is too long for what it names.
    """
    if len(text) > _LONGEST_NAME:
        raise InvalidName(f"{text[:20]}… is no full name of a {what}: it has more than {_LONGEST_NAME} characters")


def _node(session: zenoh.Session, name: str) -> NodeToken:
    return nodes.find_node(nodes.list_nodes(session, _FIND), name)


def _checked(type_name: str, data: dict[str, Any]) -> object:
    """A message, checked where its type is known here; else plain data, which its receiver checks."""
    type_ = catalogue.find_here(type_name)
    return data if type_ is None else message_of(type_, data)
