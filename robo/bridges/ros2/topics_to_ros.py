"""Topics of robo's in ROS: what is published there comes as CDR, from ends that are announced as its own nodes'."""

import threading
import time
from collections.abc import Callable, Container

import zenoh

from robo.bridges.ros2 import quality
from robo.bridges.ros2.announced import Announced
from robo.bridges.ros2.forms import Form, NoForm, form_of
from robo.bridges.ros2.intake import LARGE, MOST_ROUTES, Intake, ask_kept
from robo.bridges.ros2.outlets import RosOutlet
from robo.bridges.ros2.presence import Presence
from robo.bridges.ros2.quality import RosQoS
from robo.bridges.ros2.rules import Crossing, Rules
from robo.bridges.ros2.scope import Scope
from robo.bridges.ros2.sources import Numbers
from robo.bridges.ros2.tally import Count, Tally
from robo.wire import codec, keys
from robo.wire.codec import Malformed
from robo.wire.keys import EndpointToken, source_id
from robo.wire.qos import QoS

MOST_OUTLETS = 64
"""Publishers of one topic that ROS sees as different ones."""


class Route:
    """One topic on its way to ROS. Used under its lock."""

    def __init__(self, crossing: Crossing, form: Form, count: Count) -> None:
        self.crossing, self.form, self.count = crossing, form, count
        self.lock = threading.Lock()
        self.outlets: dict[str, RosOutlet] = {}
        """By the ids of publishers; one without a name, of those of which nobody knows."""
        self.latched: set[str] = set()
        self.numbers = Numbers()


class TopicsToRos:
    """All topics that go to ROS."""

    def __init__(
        self,
        robo: zenoh.Session,
        ros: zenoh.Session,
        rules: Rules,
        presence: Callable[[], Presence],
        announced: Announced,
        tally: Tally,
        scope: Scope,
        own: Container[str],
    ) -> None:
        """
        Args:
            robo, ros: the networks.
            rules: for topics.
            presence: who is there; there is one before anything comes.
            announced: what is announced in ROS.
            tally: where it is counted.
            scope: on whose behalf.
            own: the ids of the publishers in robo that say what has come from ROS.
        """
        self._ros, self._rules, self._presence = ros, rules, presence
        self._announced, self._tally, self._scope, self._own = announced, tally, scope, own
        self._robo = robo
        self._lock = threading.Lock()
        self._routes: dict[str, Route | None] = {}
        """By key; None for a topic that does not cross."""
        self._intake = Intake(robo, rules.patterns_to_ros(), self.take, tally, "robo-ros2-to-ros", local=scope.alone)

    def start(self) -> None:
        """Begin to receive."""
        self._intake.start()

    def meet(self, token: EndpointToken, is_there: bool) -> None:
        """A publisher of robo's has come, or is gone. For the steward."""
        crossing = self._rules.to_ros(token.topic)
        if crossing is None:
            return
        if not is_there:
            self._part(token)
            return
        route = self._route(token.topic, crossing.rule.plan.type or token.type_name)
        if route is None:
            return
        with route.lock:
            self._outlet(route, token.id, token)
        if token.qos.latched and token.id:
            self._ask(token, route)

    def close(self) -> None:
        """Receive and publish no more."""
        self._intake.close()
        with self._lock:
            routes = [route for route in self._routes.values() if route is not None]
            self._routes.clear()
        for route in routes:
            with route.lock:  # what came last may still be on its way out
                for outlet in route.outlets.values():
                    outlet.close()

    # -- messages ------------------------------------------------------------------------------------------------------

    def take(self, key: str, sample: zenoh.Sample) -> None:
        """Pass a message on. Any thread may."""
        source = sample.source_info
        sender = source_id(source.source_id) if source is not None else ""
        if sender in self._own:
            return  # it has come from ROS
        try:
            route = self._routes[key]
        except KeyError:
            route = self._route(key, str(sample.encoding).partition(";")[2])
        if route is None:
            return
        try:
            self._pass(route, sender, sample)
        except zenoh.ZError:
            route.count.dropped += 1  # the network has just been left

    def _pass(self, route: Route, sender: str, sample: zenoh.Sample) -> None:
        with route.lock:
            outlet = route.outlets.get(sender)
            if outlet is None:
                token = self._presence().publisher(sender)
                if token is not None and self._presence().is_alone(token.full_name):
                    return  # it says it there itself
                if token is not None and not self._scope.has(token):
                    route.count.refused += 1  # of another bridge: it has come from ROS, too
                    return
                outlet = self._outlet(route, sender if token is not None else "", token)
            attachment = sample.attachment
            stamp = codec.unpack_attachment(attachment.to_bytes()) if attachment is not None else None
            if stamp is not None and sender:
                missed = route.numbers.missed(sender, stamp.sequence_number, once=sender in route.latched)
                if missed < 0:
                    return
                route.count.dropped += missed
            payload = sample.payload
            if len(payload) > LARGE and not outlet.is_heard:
                return
            try:
                data = route.form.to_cdr(payload.to_bytes())
            except Malformed as reason:
                route.count.refused += 1
                self._tally.fault(f"message {route.crossing.key}", f"/{route.crossing.key}: {reason}")
                return
            outlet.send(data, stamp.source_time if stamp is not None else time.time_ns())
            route.count.crossed += 1

    # -- routes --------------------------------------------------------------------------------------------------------

    def _route(self, key: str, type_name: str) -> Route | None:
        with self._lock:
            if key in self._routes:
                return self._routes[key]
            crossing = self._rules.to_ros(key)
            if crossing is None or len(self._routes) >= MOST_ROUTES:
                if len(self._routes) < MOST_ROUTES:
                    self._routes[key] = None
                return None
            type_name = crossing.rule.plan.type or type_name
            if not type_name:
                self._tally.fault(
                    f"type {key}", f"/{key} does not cross: nobody says what type it is; say `type` in its rule"
                )
                return None  # somebody may say it yet
            try:
                form = form_of(type_name)
            except NoForm as reason:
                self._tally.fault(f"type {key}", f"/{key} does not cross: {reason}")
                return None
            self._tally.mend(f"type {key}")
            found = self._routes[key] = Route(crossing, form, self._tally.of(key, crossing.name, "to_ros"))
            return found

    def _outlet(self, route: Route, sender: str, token: EndpointToken | None) -> RosOutlet:
        """Where a publisher's messages go out; those of whom nobody knows share one."""
        if token is None or len(route.outlets) >= MOST_OUTLETS:
            sender = ""
        outlet = route.outlets.get(sender)
        if outlet is None:
            known = token if sender else None
            node, promised = (known.full_name, known.qos) if known is not None else (self._scope.node, QoS.DEFAULT)
            held = self._quality(route, promised)
            crossing, form = route.crossing, route.form
            gid = self._announced.end(node, "MP", crossing.name, form.type, form.hash, held)
            key = f"{self._announced.domain}/{crossing.name}/{form.type}/{form.hash}"
            outlet = route.outlets[sender] = RosOutlet(self._ros, key, gid, held)
            if held.transient_local:
                route.latched.add(sender)
        return outlet

    def _quality(self, route: Route, promised: QoS) -> RosQoS:
        plan = route.crossing.rule.plan
        return quality.to_ros(promised, plan.reliability, plan.durability, plan.depth)

    def _part(self, token: EndpointToken) -> None:
        route = self._routes.get(token.topic)
        if route is None:
            return
        with route.lock:
            outlet = route.outlets.pop(token.id, None)
            route.latched.discard(token.id)
        if outlet is not None:
            outlet.close()
            others = (other for other in self._presence().robo_ends() if other.full_name == token.full_name)
            if not any(other.kind == "pub" and other.topic == token.topic for other in others):
                self._announced.withdraw_end(token.full_name, "MP", route.crossing.name, route.form.type)

    def _ask(self, token: EndpointToken, route: Route) -> None:
        """What a latched publisher has said before."""
        kept = keys.latched_key(route.crossing.key, token.qos.depth)
        ask_kept(self._robo, kept, lambda sample: self.take(str(sample.key_expr), sample))
