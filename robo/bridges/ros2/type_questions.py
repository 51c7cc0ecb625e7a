"""Asks nodes of ROS's what their types are, to say in which field one differs from robo's."""

import itertools
import time
from collections.abc import Callable

import zenoh

from robo.bridges.ros2 import stamps, tokens
from robo.bridges.ros2.announced import Announced
from robo.bridges.ros2.calls import Answer, Asking, Workers
from robo.bridges.ros2.descriptions import GetTypeDescription, difference
from robo.bridges.ros2.quality import RosQoS
from robo.bridges.ros2.tokens import EndToken
from robo.interfaces import cdr
from robo.wire import names
from robo.wire.queries import Fault

SERVICE = "get_type_description"
TYPE = "type_description_interfaces::srv::dds_::GetTypeDescription_"
HASH = "RIHS01_69b9c19c1021405984cc60dbbb1edceb147a6538b411d812ba6afabeed962cd5"
"""As Jazzy and later publish it: its names are texts of at most 255 characters, which types of robo's do not say."""
_WITHIN = 5.0
"""s."""


class TypeQuestions:
    """Asks nodes of ROS's for their types."""

    def __init__(self, ros: zenoh.Session, announced: Announced, workers: Workers, node: str) -> None:
        """
        Args:
            ros: ROS's network.
            announced: what is announced there.
            workers: hand answers back.
            node: the bridge's full name.
        """
        self._ros, self._announced, self._workers, self._node = ros, announced, workers, node
        self._numbers = itertools.count(1)

    def ask(self, token: EndToken, name: str, tell: Callable[[str], None]) -> None:
        """Ask the node of an end in which field its type differs.

        Args:
            token: of the end.
            name: of robo's type.
            tell: gets the field in words, if the node answers.
        """
        service = names.join(token.node.namespace, token.node.name, SERVICE)
        key = tokens.data_key(self._announced.domain, service, TYPE, HASH)
        gid = self._announced.end(self._node, "SC", service, TYPE, HASH, RosQoS(depth=10))
        request = GetTypeDescription.Request(tokens.ros_type(token.type), token.hash, False)

        def take(answer: Answer) -> None:
            self._announced.withdraw_end(self._node, "SC", service, TYPE)
            if isinstance(answer, Fault):
                return  # it serves no descriptions
            found = cdr.decoder(GetTypeDescription.Response)(answer)
            if found.successful and (field := difference(name, found.type_description)):
                tell(field)

        stamp = stamps.pack(next(self._numbers), time.time_ns(), gid)
        data = cdr.encoder(GetTypeDescription.Request)(request)
        asking = Asking(self._ros, key, self._workers, _WITHIN)
        asking.ask(take, payload=data, encoding="application/cdr", attachment=stamp)
