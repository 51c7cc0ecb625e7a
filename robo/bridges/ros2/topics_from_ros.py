"""Topics of ROS's in robo: what comes as CDR is published under the bridge's own name."""

import threading
import time
from collections.abc import Callable

import zenoh

from robo.bridges.ros2 import quality, stamps, tokens
from robo.bridges.ros2.announced import Announced
from robo.bridges.ros2.forms import Form, NoForm, form_of, robo_type
from robo.bridges.ros2.gids import gid_of
from robo.bridges.ros2.intake import LARGE, MOST_ROUTES, Intake, ask_kept
from robo.bridges.ros2.misfits import Misfits
from robo.bridges.ros2.outlets import RoboOutlet
from robo.bridges.ros2.presence import Presence, Steward
from robo.bridges.ros2.quality import RosQoS
from robo.bridges.ros2.rules import Crossing, Rules
from robo.bridges.ros2.scope import Scope
from robo.bridges.ros2.sources import COMMANDS, Commander, Numbers
from robo.bridges.ros2.tally import Count, Tally
from robo.bridges.ros2.tokens import DataKey, EndToken
from robo.node.message_info import Clocks
from robo.wire import keys
from robo.wire.codec import Malformed
from robo.wire.qos import QoS

ASK_AGAIN = (0.3, 1.0, 3.0)
"""After how long a latched publisher of which nothing was heard is asked again, s."""


class Route:
    """One topic, of one type, on its way to robo. Used under its lock."""

    def __init__(self, crossing: Crossing, form: Form, outlet: RoboOutlet, count: Count, commander: Commander | None):
        self.crossing, self.form, self.outlet, self.count, self.commander = crossing, form, outlet, count, commander
        self.lock = threading.Lock()
        self.numbers = Numbers()
        self.clocks = Clocks()
        self.latched: set[bytes] = set()
        """The ids of publishers that keep what they have said."""


class TopicsFromRos:
    """All topics that come from ROS."""

    def __init__(
        self,
        robo: zenoh.Session,
        ros: zenoh.Session,
        rules: Rules,
        presence: Callable[[], Presence],
        announced: Announced,
        tally: Tally,
        misfits: Misfits,
        steward: Steward,
        scope: Scope,
        own: set[str],
    ) -> None:
        """
        Args:
            robo, ros: the networks.
            rules: for topics.
            presence: who is there; there is one before anything comes.
            announced: what is announced in ROS.
            tally: where it is counted.
            misfits: is told of types that do not fit.
            steward: does what is to be done later.
            scope: on whose behalf.
            own: where the ids of what publishes in robo are kept.
        """
        self._robo, self._ros, self._rules, self._presence = robo, ros, rules, presence
        self._announced, self._tally, self._misfits, self._steward = announced, tally, misfits, steward
        self._scope, self._own = scope, own
        self._lock = threading.Lock()
        self._routes: dict[str, Route | None] = {}
        """By key; None for what does not cross."""
        patterns = (f"{announced.domain}/{pattern}/*/*" for pattern in rules.patterns_from_ros())
        self._intake = Intake(ros, patterns, self.take, tally, "robo-ros2-from-ros")

    def start(self) -> None:
        """Begin to receive: before any publisher is known, for one may say a word and leave."""
        for rule in self._rules.rules:
            if rule.from_ros and rule.is_exact and rule.plan.type is not None:
                self._expect(rule.robo, rule.ros, rule.plan.type)
        self._intake.start()

    def meet(self, token: EndToken, is_there: bool) -> None:
        """A publisher of ROS's has come, or is gone. For the steward."""
        if token.kind != "MP" or self._rules.from_ros(token.topic) is None:
            return
        key, gid = token.data_key, gid_of(token.said)
        route = self._route(key, token)
        if route is None:
            return
        if not is_there:
            with route.lock:
                route.latched.discard(gid)
            return
        self._announce(route.crossing.name, route.form, token.quality)
        if token.quality.transient_local:
            with route.lock:
                self._latch(route, token.quality)
                route.latched.add(gid)
            self._ask(key, token.quality.depth, gid, route)

    def close(self) -> None:
        """Receive and publish no more."""
        self._intake.close()
        with self._lock:
            routes = [route for route in self._routes.values() if route is not None]
            self._routes.clear()
        for route in routes:
            with route.lock:  # what came last may still be on its way out
                route.outlet.close()

    # -- messages ------------------------------------------------------------------------------------------------------

    def take(self, key: str, sample: zenoh.Sample) -> None:
        """Pass a message on. Any thread may."""
        attachment = sample.attachment
        stamp = stamps.unpack(attachment.to_bytes()) if attachment is not None else None
        if stamp is not None and stamp.gid in self._announced.gids:
            return  # it has come from robo
        try:
            route = self._routes[key]
        except KeyError:
            route = self._route(key, None)
        if route is None:
            return
        if stamp is None:
            route.count.refused += 1
            name = route.crossing.name
            self._tally.fault(
                f"stamp {key}", f"/{name}: a message without rmw_zenoh's attachment is left out, as in ROS"
            )
            return
        try:
            with route.lock:
                self._pass(route, stamp, sample)
        except zenoh.ZError:
            route.count.dropped += 1  # the network has just been left

    def _pass(self, route: Route, stamp: stamps.Stamp, sample: zenoh.Sample) -> None:
        count, gid = route.count, stamp.gid
        end = self._presence().end(gid)
        if end is not None and self._presence().is_of_bridge(end.node.session):
            count.refused += 1  # another bridge says it on behalf of robo's nodes
            return
        if self._scope.alone and self._presence().is_brought(route.crossing.key):
            count.refused += 1
            key = route.crossing.key
            self._tally.fault(
                f"twice {key}", f"/{key} comes from ROS by a bridge of the robot, a hop more; leave it out there"
            )
            return
        missed = route.numbers.missed(gid, stamp.number, once=route.outlet.qos.latched)
        if missed < 0:
            return
        count.dropped += missed
        payload = sample.payload
        if len(payload) > LARGE and not route.outlet.qos.latched and not route.outlet.is_heard:
            return
        if route.commander is not None:
            sender = end.node.full_name if end is not None else ""
            if not route.commander.admits(gid.hex(), sender, time.monotonic()):
                count.refused += 1
                return
        try:
            message = route.form.to_robo(payload.to_bytes())
        except Malformed as reason:
            count.refused += 1
            self._tally.fault(f"message {route.crossing.key}", f"/{route.crossing.name} of ROS: {reason}")
            return
        age = route.clocks.age(gid.hex(), stamp.time, time.monotonic_ns(), time.time_ns())
        route.outlet.send(message, age)
        count.crossed += 1

    # -- routes --------------------------------------------------------------------------------------------------------

    def _route(self, key: str, token: EndToken | None) -> Route | None:
        with self._lock:
            if key in self._routes:
                return self._routes[key]
            said = tokens.parse_data_key(key, self._announced.domain)
            crossing = self._rules.from_ros(said.topic) if said is not None else None
            if said is None or crossing is None:
                if len(self._routes) < MOST_ROUTES:
                    self._routes[key] = None
                return None
            form = self._form(crossing, said, token)
            if form is None or len(self._routes) >= MOST_ROUTES:
                return None
            found = self._routes[key] = self._made(crossing, form, token)
            return found

    def _form(self, crossing: Crossing, said: DataKey, token: EndToken | None) -> Form | None:
        """Robo's type of messages; None where it has none that fits, which is told."""
        name, wanted = robo_type(said.type), crossing.rule.plan.type
        what = f"/{said.topic} of ROS"
        if name is None or (wanted is not None and wanted != name):
            self._misfits.unknown(what, crossing.key, said.type, wanted)
            return None
        try:
            form = form_of(name)
        except NoForm as reason:
            self._tally.fault(f"type {what}", f"{what} does not cross: {reason}")
            return None
        if form.hash != said.hash:
            self._misfits.hash(what, form, said.hash, token)
            return None
        return form

    def _made(self, crossing: Crossing, form: Form, token: EndToken | None) -> Route:
        promised = token.quality if token is not None else RosQoS(depth=10)
        outlet = self._outlet(crossing, form, self._robo_qos(crossing, form, promised))
        commander = None
        if form.name in COMMANDS:
            name = crossing.name
            commander = Commander(
                lambda who: self._tally.fault(
                    f"source {name} {who}", f"/{name} of ROS: commands of {who} are left out, another one commands"
                )
            )
        return Route(crossing, form, outlet, self._tally.of(crossing.key, crossing.name, "from_ros"), commander)

    def _outlet(self, crossing: Crossing, form: Form, qos: QoS) -> RoboOutlet:
        scope = self._scope
        made = RoboOutlet(self._robo, scope.node, crossing.key, form.name, qos, to_itself=scope.alone)
        self._own.add(made.id)
        return made

    def _robo_qos(self, crossing: Crossing, form: Form, promised: RosQoS) -> QoS:
        plan = crossing.rule.plan
        found = quality.to_robo(
            quality.to_ros(quality.to_robo(promised), plan.reliability, plan.durability, plan.depth)
        )
        # A command goes before all data, and never waits behind an older one.
        return found if form.name not in COMMANDS or found.latched else QoS.COMMAND

    def _latch(self, route: Route, promised: RosQoS) -> None:
        """A topic whose first message came before it was known that its publisher keeps it."""
        qos = self._robo_qos(route.crossing, route.form, promised)
        if qos.latched and not route.outlet.qos.latched:
            before, route.outlet = route.outlet, self._outlet(route.crossing, route.form, qos)
            before.close()
            route.numbers = Numbers()  # what it has said before is to be kept, too

    def _expect(self, key: str, name: str, type_name: str) -> None:
        try:
            form = form_of(type_name)
        except NoForm as reason:
            self._tally.fault(f"type {key}", f"/{key} does not cross: {reason}")
            return
        self._announce(name, form, RosQoS(depth=10))
        self._route(tokens.data_key(self._announced.domain, name, form.type, form.hash), None)

    def _announce(self, name: str, form: Form, wanted: RosQoS) -> None:
        self._announced.end(self._scope.node, "MS", name, form.type, form.hash, wanted)

    def _ask(self, key: str, depth: int, gid: bytes, route: Route, again: int = 0) -> None:
        """What a latched publisher has said before; it is asked again as long as nothing of it was heard."""
        if gid not in route.latched:
            return
        ask_kept(self._ros, keys.latched_key(key, depth), lambda sample: self.take(key, sample))
        if again < len(ASK_AGAIN) and not route.numbers.knows(gid):
            self._steward.do_later(ASK_AGAIN[again], lambda: self._ask(key, depth, gid, route, again + 1))
