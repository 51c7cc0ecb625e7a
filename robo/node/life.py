"""A node's time on the network: what it holds from its start to its close, and the order of both."""

import threading
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import ExitStack, nullcontext
from typing import TYPE_CHECKING, Any, Protocol

import zenoh

from robo.errors import ActionError, ServiceTimeout
from robo.node import log
from robo.node.clock import Clock, SimClock
from robo.node.contract import Contract
from robo.node.diagnostics import Diagnostics
from robo.node.ending import NodeStopping
from robo.node.endpoints import Endpoints
from robo.node.factory import EndpointFactory
from robo.node.hooks import Hooks, overrides
from robo.node.identity import Identity
from robo.node.last_lines import LastLines
from robo.node.loops import TimerLoop
from robo.node.parameter_server import Answers, ParameterServer
from robo.node.part import found_in, put_into
from robo.node.status import StatusServer
from robo.node.topics import TopicPublisher
from robo.node.troubles import Troubles
from robo.node.tuning import Tuning
from robo.node.turn import taking
from robo.node.turns import Turns
from robo.parameters.model import Parameters
from robo.wire.keys import DIAGNOSTICS_TOPIC, LOG_TOPIC, PARAMETER_EVENTS_TOPIC
from robo.wire.network import Network
from robo.wire.qos import KEEP_ALL, QoS, Quality
from robo.wire.reports import NodeStatus
from robo.wire.session import close_session, open_session
from robo_messages import DiagnosticArray, Log, ParameterEvent, Time

if TYPE_CHECKING:
    from robo.node.gate import Gate

STOP_TIMEOUT = 2.0
"""How long a stop waits for callbacks that are running, all together, s."""

READY_PERIOD = 0.05
"""How often a node that has a `ready` of its own is asked, s."""

GRACE = 0.1
"""How long callbacks have at least to return, where `main` took all the time, s."""


class Living(Protocol):
    """What its life needs of a node."""

    contract: Contract
    full_name: str
    parameters: Parameters
    clock: Clock
    logger: log.NodeLogger
    exit_code: int
    qualities: Mapping[str, Quality]

    @property
    def status(self) -> NodeStatus:
        """Its counters."""

    def now(self) -> Time:
        """The time for stamps."""

    def shutdown(self, exit_code: int = 0) -> None:
        """Tell it to end."""

    def on_start(self) -> None:
        """See `Hooks`, as for the others."""

    def ready(self) -> bool:
        """Whether it can do its work."""

    def main(self) -> Coroutine[Any, Any, None] | None:
        """Its work beside its callbacks."""

    def on_stop(self) -> None:
        """What it does after its last callback."""


class Life:
    """Joins, runs and leaves: all of the start comes about, or nothing of it stays."""

    def __init__(
        self,
        node: Living,
        session: zenoh.Session | None,
        identity: Identity,
        turns: Turns,
        troubles: Troubles,
        tuning: Tuning,
        shutdown: threading.Event,
        gate: "Gate | None" = None,
    ) -> None:
        """
        Args:
            node: whose life it is.
            session: the network, which stays its giver's to close; by default one of its own is opened.
            identity, turns, troubles, tuning: the node's; they outlive it.
            shutdown: tells the node to end.
            gate: of a managed node: what stands before its ends.

        Raises:
            NetworkError: the network cannot be reached.
        """
        self.session = session or open_session(Network.from_environment("router"))
        self.ends = Endpoints()
        self.diagnostics = Diagnostics(node, self.ends, turns, troubles)
        common = self.session, identity, self.ends, turns, troubles, node.clock, node.qualities
        self._own = EndpointFactory(*common)
        """Makes what every node has, in every state."""
        self.factory = self._own
        """Makes what the node's class declares, and what its code adds."""
        if gate is not None:
            self.factory = EndpointFactory(*common, gate)
        self.autostart = True
        """Whether a managed node is brought to active at its start."""
        self.is_over = False
        """Whether the node has left the network."""
        self._node = node
        self._identity = identity
        self._turn = turns.own
        self._troubles = troubles
        self._tuning = tuning
        self._shutdown = shutdown
        self._owns_session = session is None
        self._made = ExitStack()
        """What the end has to undo."""
        self._on_stop_due = False
        self._stop_timeout = STOP_TIMEOUT
        self._token: zenoh.LivelinessToken | None = None
        self._readiness: TimerLoop | None = None
        self._main_thread: threading.Thread | None = None

    def begin(self) -> None:
        """Join the network and begin to run callbacks. Where `on_start` raises, the node has left again."""
        with ExitStack() as made:  # unwinds, the last thing first, unless all of it comes about
            made.callback(self._leave)
            made.callback(self.ends.withdraw)
            events = self._join(made)
            made.callback(self._stop_callbacks)
            self._node.on_start()
            self._on_stop_due = True
            self._declare_callbacks()
            self._run_callbacks(events)
            self._made = made.pop_all()

    def end(self, timeout: float) -> None:
        """Stop callbacks, let those that run finish, leave the network. Safe to call twice.

        Args:
            timeout: how long `main` and all callbacks together may take to return, s.
        """
        self._stop_timeout = timeout
        self._made.close()

    def beat_every(self, period: float, beat: Callable[[], None]) -> None:
        """Call `beat` under the node's turn every `period` seconds of the wall clock, in every state."""
        self._own.timer(period, beat, Clock())

    def _join(self, made: ExitStack) -> TopicPublisher[ParameterEvent]:
        """Make what works without a callback: what every node publishes, publishers, clients, the status.

        Returns:
            The publisher of parameter events.
        """
        node, make = self._node, self.factory
        logger = node.logger.logger
        log_topic = self._own.publisher(Log, self._identity.absolute(LOG_TOPIC), QoS.DEFAULT)
        log_handler = log.BusHandler(log_topic, node.full_name, node.now)
        logger.addHandler(log_handler)
        made.callback(logger.removeHandler, log_handler)
        changes = self._identity.absolute(PARAMETER_EVENTS_TOPIC)
        events = self._own.publisher(ParameterEvent, changes, QoS(depth=KEEP_ALL))
        told = self._own.publisher(DiagnosticArray, self._identity.absolute(DIAGNOSTICS_TOPIC), QoS.DEFAULT)
        self.diagnostics.publish, self.diagnostics.apart = told.publish, {t.topic for t in (log_topic, events, told)}
        for p in node.contract.publishers:
            put_into(node, p.attribute, make.publisher(p.message_type, p.topic, p.qos))
        for c in node.contract.clients:
            client = make.client(c.request_type, c.response_type, c.service, c.timeout, c.priority)
            put_into(node, c.attribute, client)
        for a in node.contract.action_clients:
            vars(node)[a.attribute] = make.action_client(a.types, a.action, a.timeout)
        last_lines = None if log.is_supervised() else LastLines(node.full_name)
        if last_lines is not None:
            logger.addHandler(last_lines)
            made.callback(logger.removeHandler, last_lines)
        lines = None if last_lines is None else last_lines.after
        status = StatusServer(self.session, self._identity, lambda: node.status, lines)
        made.callback(status.stop, GRACE)
        return events

    def _declare_callbacks(self) -> None:
        node, make = self._node, self.factory
        for served in node.contract.services:
            handler = found_in(node, served.method)
            make.service(served.request_type, served.response_type, served.service, handler, served.turn)
        for executed in node.contract.actions:
            period = self._tuning.period(executed.rate)
            make.action(executed.types, executed.action, executed.handling(node, period), executed.turn)
        for wanted in node.contract.subscriptions:
            method, sole_source = found_in(node, wanted.method), self._tuning.text(wanted.sole_source)
            make.subscription(wanted.message_type, wanted.topic, method, wanted.qos, sole_source, wanted.turn)
        for ticking in node.contract.timers:
            method = found_in(node, ticking.method)
            make.timer(self._tuning.period(ticking.rate), method, node.clock, ticking.turn)

    def _run_callbacks(self, events: TopicPublisher[ParameterEvent]) -> None:
        node, clock = self._node, self._node.clock
        self._tuning.announce = events.publish
        if isinstance(clock, SimClock):
            self._own.follow_clock(clock)
        self.ends.begin()
        self.diagnostics.begin()
        tuning = self._tuning
        answers = Answers(node.full_name, lambda: node.parameters, tuning.explain, tuning.set)
        self.ends.add_other(ParameterServer(self.session, self._identity, answers))
        self._begin_work()

    def _begin_work(self) -> None:
        """Show that the node is ready, as soon as it is, and run its `main`."""
        self._become_ready()
        self._start_main()

    def _become_ready(self) -> None:
        if not overrides(self._node, Hooks.ready):
            self._declare_ready()
        else:
            self._readiness = self._own.timer(READY_PERIOD, self._check_ready, self._node.clock.wall)

    def _start_main(self) -> None:
        if overrides(self._node, Hooks.main):
            self._main_thread = threading.Thread(target=self._run_main, name="robo-main", daemon=True)
            self._node.clock.expect(self._main_thread, strict=False)
            self._main_thread.start()

    def _be_ready_no_more(self) -> None:
        """Withdraw the token, so that nobody takes the node as ready."""
        if self._token is not None:
            self._token.undeclare()
            self._token = None

    def _declare_ready(self) -> None:
        token = self._identity.token(type(self._node))
        self._token = self.session.liveliness().declare_token(token.key())

    def _check_ready(self) -> None:
        if self._readiness is None or self._shutdown.is_set() or not self._node.ready():
            return
        if self._readiness is not None and not self._shutdown.is_set():  # it may have been told to end meanwhile
            self._declare_ready()
            self.ends.drop(self._readiness)
            self._readiness = None

    def _run_main(self) -> None:
        node = self._node
        try:
            self._own.plain(node.main, self._turn)()
        except BaseException as error:
            # What it has waited for is given up with the node.
            if not (self._shutdown.is_set() and isinstance(error, (ActionError, ServiceTimeout))):
                self._troubles.handler(node.main)(error)
                if not isinstance(error, (SystemExit, NodeStopping)):
                    node.exit_code = 1
        self._shutdown.set()

    def _stop_callbacks(self) -> None:
        node = self._node
        deadline = time.monotonic() + self._stop_timeout
        node.shutdown(node.exit_code)
        self._tuning.announce = None
        self._be_ready_no_more()
        self.ends.interrupt()
        if self._main_thread is not None and self._main_thread is not threading.current_thread():
            self._main_thread.join(self._stop_timeout)
            deadline = max(deadline, time.monotonic() + GRACE)
        all_returned = self.ends.stop(deadline)
        self._be_ready_no_more()  # which it may just have become
        if not all_returned:
            node.logger.error("a callback did not return within %g s; leaving without it", self._stop_timeout)
        if self._on_stop_due:
            self._on_stop_due = False
            with taking(self._turn, "on_stop") if all_returned else nullcontext():
                self._say_farewell()

    def _say_farewell(self) -> None:
        """Do what is to be done after the last callback."""
        try:
            self._node.on_stop()
        except BaseException as error:
            self._troubles.handler(self._node.on_stop)(error)

    def _leave(self) -> None:
        if self._owns_session:
            close_session(self.session)
        self.is_over = True
