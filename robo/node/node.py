"""The node: a class whose contract can be read without running it."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence, Set
from contextlib import ExitStack, nullcontext
from functools import partial
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec
import zenoh

from robo.environment import NAMESPACE_VARIABLE, RUN_VARIABLE
from robo.errors import ContractError, ParameterError
from robo.node import log
from robo.node.clock import Clock, SimClock
from robo.node.contract import Contract, check_plain, contract_of, takes_info
from robo.node.declare import Declares
from robo.node.intake import Intake
from robo.node.loops import TimerLoop, checked_period, period_of
from robo.node.memory import Memory
from robo.node.message_info import PLAIN, MessageInfo
from robo.node.parameter_server import ParameterServer
from robo.node.services import ServiceClient, ServiceServer, service_token
from robo.node.topics import TopicPublisher, TopicSubscription, endpoint_token
from robo.node.turn import Turn, name_of, taking
from robo.parameters.model import Parameters as AnyParameters
from robo.parameters.model import build, change, flat
from robo.wire import discovery, keys, names
from robo.wire.keys import NodeToken
from robo.wire.network import Network
from robo.wire.qos import DEFAULT_DEPTH, DEFAULT_TIMEOUT, KEEP_ALL
from robo.wire.queries import QueryLoop, reply
from robo.wire.reports import NodeStatus, Setting
from robo.wire.session import close_session, open_session
from robo_messages import Clock as ClockMessage
from robo_messages import Log, Message, Parameter, ParameterEvent, Time

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Message)

SET_WHILE_RUNNING = "set while running"

READY_PERIOD = 0.05
"""How often a node that has a `ready` of its own is asked, s."""

STOP_TIMEOUT = 2.0
"""How long `close` waits for callbacks that are running, all together, s."""

MALFORMED_PERIOD = 60.0
"""How often a topic on which malformed messages come is told of, s: at once, and then with how many there were."""

GRACE = 0.1
"""How long they have at least, where `main` took all the time, s."""


def exit_code_of(stop: SystemExit) -> int:
    """The exit code that a SystemExit asks for, as Python reads it."""
    return stop.code if isinstance(stop.code, int) else int(stop.code is not None)


class Node(Declares):
    """Base of every node. A subclass declares what it publishes, subscribes and how it is tuned:

        class Talker(Node):
            class Parameters(robo.Parameters):
                rate: Annotated[float, Meta(gt=0, description="Hz")] = 1.0

            parameters: Parameters
            chatter = Publisher(String, "chatter")

            @timer(rate="rate")
            def speak(self) -> None:
                self.chatter.publish(String("hello"))

    Callbacks never run at the same time, so they need no locks. A callback that raises is logged and
    counted, and the node goes on; `raise SystemExit(code)` ends it. In a process of its own it also ends,
    with exit code 1, when a thread dies of an exception, be it one that the subclass has started.
    """

    parameters: AnyParameters

    def __init__(
        self,
        *,
        name: str | None = None,
        namespace: str | None = None,
        parameters: Mapping[str, object] | None = None,
        remappings: Mapping[str, str] | None = None,
        sources: Mapping[str, Sequence[Setting]] | None = None,
        session: zenoh.Session | None = None,
    ) -> None:
        """
        Args:
            name: the node's name; by default the class's in snake_case.
            namespace: where its relative names live, usually the robot's name; by default
                ROBO_NAMESPACE or the root.
            parameters: values over the declared defaults, by name.
            remappings: other names for topics and services, from declared name to new name.
            sources: by parameter, all that was said of it, from the weakest to what holds.
            session: a Zenoh session to use, which stays the caller's to close; by default the node
                opens one of its own when it starts.

        Raises:
            ContractError, ParameterError, InvalidName: the class, a value or a name is wrong.
        """
        self.contract: Contract = contract_of(type(self))
        self.name = names.check_node_name(name or self.contract.name)
        if namespace is None:
            namespace = os.environ.get(NAMESPACE_VARIABLE, "")
        self.namespace = names.normalize_namespace(namespace)
        self.full_name = "/" + names.join(self.namespace, self.name)
        self.parameters = build(type(self).Parameters, parameters or {}, self.full_name)
        self.clock: Clock = SimClock() if self.parameters.use_sim_time else Clock()
        self.logger = log.NodeLogger(self.full_name[1:].replace("/", "."), lambda: self.clock.monotonic())
        self.exit_code = 0
        self.memory = Memory()
        """What it keeps when it is started again within a run."""
        self._remappings = dict(remappings or {})
        self._given_session = session
        self._session: zenoh.Session | None = None
        self._turn = Turn(self.thread_died)
        self._publishers: list[TopicPublisher[Any]] = []
        self._subscriptions: list[TopicSubscription[Any]] = []
        self._timers: list[TimerLoop] = []
        self._services: list[ServiceServer[Any, Any]] = []
        self._clients: list[ServiceClient[Any, Any]] = []
        self._said = {name: list(said) for name, said in (sources or {}).items()}
        self._events: deque[ParameterEvent] = deque()
        self._events_lock = threading.Lock()
        self._callback_errors = 0
        self._malformed_told: dict[str, float] = {}
        self._started_at = time.monotonic()
        self._running = False
        self._event_publisher: TopicPublisher[ParameterEvent] | None = None
        self._parameter_server: ParameterServer | None = None
        self._readiness: TimerLoop | None = None
        self._token: zenoh.LivelinessToken | None = None
        self._main_thread: threading.Thread | None = None
        self._shutdown = threading.Event()
        self._stop_timeout = STOP_TIMEOUT
        self._made = ExitStack()
        """What `close` has to undo."""
        self._on_stop_due = False
        self._left = False
        """Whether it has been part of the network, and is no more."""

    # -- for subclasses ------------------------------------------------------------------------

    def on_start(self) -> None:
        """Called when the publishers exist and before any other callback runs."""

    def ready(self) -> bool:
        """Whether the node can do its work. Override it where starting is not all: a sensor has to warm up.

        It is asked as a callback until it says yes; then the node's liveliness token shows, and what
        needs this node starts.
        """
        return True

    def on_stop(self) -> None:
        """Called after the last callback, while the publishers still exist."""

    def on_parameters_changing(self, new: Any) -> None:
        """Called with the parameters as they would be, before they are changed; raise ValueError to refuse."""

    def on_parameters_changed(self, names: Set[str]) -> None:
        """Called after parameters were changed while the node runs, with their names."""

    def main(self) -> None:
        """Work that is no reaction: a player, a script, a test drive.

        Runs in a thread of its own once the node is ready, beside the callbacks. When it returns the
        node ends; when it raises, with exit code 1. It should return soon once `stopping` is true.
        """

    def sleep(self, seconds: float) -> bool:
        """Wait, in `main`. Returns False at once when the node is told to stop."""
        if seconds > 0:
            jumps = self.clock.jumps
            self.clock.wait(self._shutdown, self.clock.monotonic() + seconds, jumps)
        return not self.stopping

    @property
    def stopping(self) -> bool:
        """Whether the node is told to stop."""
        return self._shutdown.is_set()

    def now(self) -> Time:
        """The time for stamps."""
        return self.clock.now()

    def shutdown(self, exit_code: int = 0) -> None:
        """End the node; returns at once. A process that runs it exits with `exit_code`."""
        self.exit_code = exit_code
        self._shutdown.set()
        self.clock.wake()

    def obey(self, wish: SystemExit) -> None:
        """End the node as `sys.exit(3)` or `sys.exit("why")` says."""
        if exit_code_of(wish) and not isinstance(wish.code, int):
            self.logger.fatal("%s", wish.code)
        self.shutdown(exit_code_of(wish))

    def thread_died(self, error: BaseException) -> None:
        """End the node, as one of its threads has died of an exception, and with it a part of its work.

        It exits with code 1, and its policy decides what then. Called in the thread that dies.
        """
        thread = threading.current_thread().name
        if self.stopping:
            self.logger.warning("%s ended while the node stopped: %s: %s", thread, type(error).__name__, error)
            return
        self.logger.error(f"the thread {thread} died; the node ends", exception=error)
        self.shutdown(self.exit_code or 1)

    # -- parameters ----------------------------------------------------------------------------

    def set_parameters(self, changes: Mapping[str, object] | None = None, /, **values: object) -> None:
        """Change parameters while the node runs: all of them, or none.

        They are checked, offered to `on_parameters_changing`, set at once, told to
        `on_parameters_changed`, and announced on the topic `parameter_events`.

        Args:
            changes: values by name.
            values: more of them.

        Raises:
            ParameterError: a name is unknown, a value does not fit, is read-only, or was refused.
        """
        wanted = {**(changes or {}), **values}
        change(self.parameters, wanted, self.full_name)  # what is wrong with them costs callbacks no time
        with taking(self._turn, "set_parameters"):
            self._commit(wanted)
        self._publish_events()

    def _commit(self, changes: Mapping[str, object]) -> None:
        old = self.parameters
        new = change(old, changes, self.full_name)
        try:
            self.on_parameters_changing(new)
        except BaseException as error:
            if not isinstance(error, ValueError):
                self._handler(self.on_parameters_changing)(error)
            raise ParameterError(f"{self.full_name} refuses: {error}") from None
        self.parameters = new
        try:
            for timer in list(self._timers):
                timer.period()
        except Exception as error:
            self.parameters = old
            if isinstance(error, ParameterError):
                raise
            raise ParameterError(f"{self.full_name} refuses: {error}") from None
        before = flat(old)
        changed = {name: value for name, value in flat(new).items() if value != before[name]}
        for name, value in changed.items():
            said = self._said.setdefault(name, [])
            if said and said[-1].source == SET_WHILE_RUNNING:
                said.pop()
            said.append(Setting(value, SET_WHILE_RUNNING))
        for timer in list(self._timers):
            timer.reschedule()
        try:
            self.on_parameters_changed(changed.keys())
        except BaseException as error:
            self._handler(self.on_parameters_changed)(error)
        event = [Parameter(name, value) for name, value in changed.items()]
        self._events.append(ParameterEvent(self.now(), self.full_name, changed_parameters=event))

    def _publish_events(self) -> None:
        """Announce changes in the order in which they were made, whoever made them."""
        with self._events_lock:
            while self._events:
                event = self._events.popleft()
                if self._running and self._event_publisher is not None and event.changed_parameters:
                    self._event_publisher.publish(event)

    def _explain(self, name: str) -> list[Setting]:
        default = flat(type(self).Parameters())[name]
        return [Setting(default, "declared default"), *self._said.get(name, ())]

    # -- endpoints made while running ----------------------------------------------------------

    @property
    def session(self) -> zenoh.Session:
        """The Zenoh session of a node that has started."""
        if self._session is None:
            raise RuntimeError(f"{self.full_name} has not started; use it as `with node:` or call start()")
        return self._session

    def _joined(self, making: str) -> zenoh.Session:
        """The session, for what is made on it."""
        if self._session is None:
            frame = sys._getframe(2)  # of the caller of create_…
            raise ContractError(
                f"{frame.f_code.co_filename}:{frame.f_lineno}: {making} before {self.full_name} has started; call it in"
                " on_start(), or declare what the class always has (Publisher, @subscribe, @timer, @service, Client)"
            )
        return self._session

    def resolve(self, name: str) -> str:
        """The key expression of a topic name for this node, after namespace and remapping.

        Raises:
            InvalidName: the name breaks the rules.
        """
        return names.resolve(name, namespace=self.namespace, node=self.name, remappings=self._remappings)

    def create_publisher(self, message_type: type[M], topic: str, depth: int = DEFAULT_DEPTH) -> TopicPublisher[M]:
        """Make a publisher while running; for one the class always has, declare a `Publisher`."""
        session = self._joined("create_publisher")
        token = endpoint_token(self.namespace, self.name, "pub", message_type, depth, self.resolve(topic))
        publisher = TopicPublisher(session, token, message_type)
        self._publishers.append(publisher)
        return publisher

    def create_subscription(
        self,
        message_type: type[M],
        topic: str,
        callback: Callable[[M], None] | Callable[[M, MessageInfo], None],
        depth: int = DEFAULT_DEPTH,
        sole_source: Callable[[], str] | None = None,
    ) -> TopicSubscription[M]:
        """Subscribe while running; for a topic the class always reads, use `@subscribe`.

        Args:
            message_type: what is read.
            topic: its name: relative, absolute or private.
            callback: takes the message and, if it has a second parameter, its `MessageInfo`.
            depth: keep the newest n messages while the node is busy; KEEP_ALL to lose none.
            sole_source: says whose messages alone count, as for `@subscribe`; the callback takes a `MessageInfo`.

        Raises:
            ContractError: the node has not started, the callback is async, or there is a sole source and it takes
                no `MessageInfo`.
        """
        session = self._joined("create_subscription")
        check_plain(callback)
        informed = takes_info(callback)
        if sole_source is not None and not informed:
            raise ContractError(f"{name_of(callback)}: a sole source needs a callback that takes a MessageInfo too")
        token = endpoint_token(self.namespace, self.name, "sub", message_type, depth, self.resolve(topic))
        intake = self._intake(token.topic, sole_source) if informed else None
        subscription = TopicSubscription(
            session,
            token,
            message_type,
            self._turn,
            callback,
            self._handler(callback),
            self._report_malformed,
            intake,
        )
        self._subscriptions.append(subscription)
        if self._running:
            subscription.start()
        return subscription

    def create_timer(
        self, period: float | Callable[[], float], callback: Callable[[], None], clock: Clock | None = None
    ) -> TimerLoop:
        """Call `callback` every `period` seconds; a function is asked before each tick.

        Args:
            period: in s.
            callback: what to call.
            clock: whose seconds; by default the node's, which may be simulated.

        Raises:
            ContractError: the period is not 1e-6 to 1e9 s, or the callback is async.
        """
        check_plain(callback)
        ask = period if callable(period) else lambda: period
        checked_period(ask())
        timer = TimerLoop(name_of(callback), ask, self._turn, callback, self._handler(callback), clock or self.clock)
        self._timers.append(timer)
        if self._running:
            timer.start()
        return timer

    def create_service(
        self, request_type: type[Q], response_type: type[A], name: str, handler: Callable[[Q], A]
    ) -> ServiceServer[Q, A]:
        """Serve while running; for a service the class always has, use `@service`.

        Raises:
            ContractError: the node has not started, or the handler is async.
        """
        session = self._joined("create_service")
        check_plain(handler)
        token = service_token(self.namespace, self.name, "srv", request_type, response_type, self.resolve(name))
        server = ServiceServer(session, token, request_type, response_type, self._turn, handler, self._handler(handler))
        self._services.append(server)
        return server

    def create_client(
        self, request_type: type[Q], response_type: type[A], name: str, timeout: float = DEFAULT_TIMEOUT
    ) -> ServiceClient[Q, A]:
        """Make a client of a service while running; for one the class always has, declare a `Client`."""
        session = self._joined("create_client")
        token = service_token(self.namespace, self.name, "cli", request_type, response_type, self.resolve(name))
        client = ServiceClient(session, token, request_type, response_type, timeout)
        self._clients.append(client)
        return client

    # -- life ----------------------------------------------------------------------------------

    def start(self, session: zenoh.Session | None = None) -> None:
        """Join the network, make the declared endpoints and begin to run callbacks.

        All or nothing: where it raises, be it in `on_start`, the node has left the network again and
        nothing of it runs.

        Args:
            session: a session to use, if none was given when the node was made.

        Raises:
            NetworkError: the network cannot be reached.
            RuntimeError: it has started already.
        """
        if self._session is not None:
            raise RuntimeError(f"{self.full_name} has started already")
        self._given_session = session or self._given_session
        if self._left:  # what told an earlier start to end does not end this one; a Ctrl-C before the first one does
            self._left = False
            self._shutdown.clear()
        for of_an_earlier_start in (self._publishers, self._subscriptions, self._timers, self._services, self._clients):
            of_an_earlier_start.clear()
        self._parameter_server = None
        with ExitStack() as made:  # unwinds, the last thing first, unless all of it comes about
            self._join(made)
            made.callback(self._stop_callbacks)
            self.on_start()
            self._on_stop_due = True
            self._declare_callbacks()
            self._run_callbacks()
            self._made = made.pop_all()

    def _join(self, made: ExitStack) -> None:
        """Make what works without a callback: the session, the log topic, publishers, clients, the status."""
        self._session = session = self._given_session or open_session(Network.from_environment("router"))
        made.callback(self._leave)
        made.callback(self._withdraw)
        log_handler = log.BusHandler(self.create_publisher(Log, self._log_topic()), self.full_name, self.now)
        self.logger.logger.addHandler(log_handler)
        made.callback(self.logger.logger.removeHandler, log_handler)
        self._event_publisher = self.create_publisher(
            ParameterEvent, "/" + names.join(self.namespace, "parameter_events"), KEEP_ALL
        )
        for declared in self.contract.publishers:
            publisher = self.create_publisher(declared.message_type, declared.topic, declared.depth)
            vars(self)[declared.attribute] = publisher
        for called in self.contract.clients:
            vars(self)[called.attribute] = self.create_client(
                called.request_type, called.response_type, called.service, called.timeout
            )
        key = keys.status_key(self.namespace, self.name)
        # Not complete: of two nodes with one name both are asked.
        queries = QueryLoop(session, key, self._answer_status, tells=[key], complete=False)
        made.callback(queries.stop, GRACE)
        queries.start()

    def _declare_callbacks(self) -> None:
        for served in self.contract.services:
            handler = getattr(self, served.method)
            self.create_service(served.request_type, served.response_type, served.service, handler)
        for wanted in self.contract.subscriptions:
            method, sole_source = getattr(self, wanted.method), self._text_parameter(wanted.sole_source)
            self.create_subscription(wanted.message_type, wanted.topic, method, wanted.depth, sole_source)
        for ticking in self.contract.timers:
            self.create_timer(self._period(ticking.rate), getattr(self, ticking.method))

    def _run_callbacks(self) -> None:
        self._running = True
        if isinstance(self.clock, SimClock):
            self._follow_clock(self.clock)
        for subscription in self._subscriptions:
            subscription.start()
        for timer in self._timers:
            timer.start()
        self._parameter_server = ParameterServer(
            self.session,
            self.namespace,
            self.name,
            lambda: self.parameters,
            self.contract.parameters,
            self._explain,
            self.set_parameters,
        )
        if type(self).ready is Node.ready:
            self._declare_ready()
        else:
            self._readiness = self.create_timer(READY_PERIOD, self._check_ready, Clock())
        if type(self).main is not Node.main:
            self._main_thread = threading.Thread(target=self._run_main, name="robo-main", daemon=True)
            self._main_thread.start()

    def _declare_ready(self) -> None:
        self._token = self.session.liveliness().declare_token(self._node_token().key())

    def _check_ready(self) -> None:
        if self._token is None and self._readiness is not None and self.ready():
            self._declare_ready()
            self._timers.remove(self._readiness)
            self._readiness.stop(0)

    def wait(self, timeout: float | None = None) -> bool:
        """Block until the node is shut down. Returns whether it was, within `timeout` seconds."""
        return self._shutdown.wait(timeout)

    def close(self, timeout: float = STOP_TIMEOUT) -> None:
        """Stop callbacks, let those that run finish, leave the network. Safe to call twice.

        Args:
            timeout: how long `main` and all callbacks together may take to return, s.
        """
        self._stop_timeout = timeout
        self._made.close()

    def _stop_callbacks(self) -> None:
        end = time.monotonic() + self._stop_timeout
        self.shutdown(self.exit_code)
        self._running = False
        if self._token is not None:
            self._token.undeclare()
            self._token = None
        if self._main_thread is not None and self._main_thread is not threading.current_thread():
            self._main_thread.join(self._stop_timeout)
            end = max(end, time.monotonic() + GRACE)
        for client in self._clients:
            client.abandon()
        loops: list[TimerLoop | TopicSubscription[Any] | ServiceServer[Any, Any] | ParameterServer] = [
            *self._timers,
            *self._subscriptions,
            *self._services,
        ]
        if self._parameter_server is not None:
            loops.append(self._parameter_server)
        # One after the other against one deadline: each is told to stop, be there time left to wait for it or not.
        returned = [loop.stop(max(0.0, end - time.monotonic())) for loop in loops]
        stuck = not all(returned)
        if stuck:
            self.logger.error("a callback did not return within %g s; leaving without it", self._stop_timeout)
        if self._on_stop_due:
            self._on_stop_due = False
            with taking(self._turn, "on_stop") if not stuck else nullcontext():
                try:
                    self.on_stop()
                except BaseException as error:
                    self._handler(self.on_stop)(error)

    def _withdraw(self) -> None:
        with ExitStack() as ends:  # each of them, should one fail
            for publisher in self._publishers:
                ends.callback(publisher.undeclare)
            for client in self._clients:
                ends.callback(client.close)

    def _leave(self) -> None:
        if self._session is not None and self._given_session is None:
            close_session(self._session)
        self._session = None
        self._left = True

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- what it has seen ----------------------------------------------------------------------

    @property
    def status(self) -> NodeStatus:
        """Counters of this node, as a query on its status key would get them."""
        subscriptions = list(self._subscriptions)
        turn, now = self._turn, time.monotonic()
        running = turn.running  # it may end while this looks, and then the time is that of the next one
        running_for = max(0.0, now - turn.since) if running else 0.0
        return NodeStatus(
            node=self.full_name,
            published={p.topic: p.published for p in list(self._publishers)},
            received={s.topic: s.received for s in subscriptions},
            malformed={s.topic: s.malformed for s in subscriptions},
            dropped={s.topic: s.dropped for s in subscriptions},
            refused={s.topic: s.refused for s in subscriptions if s.refused},
            callback_errors=self._callback_errors,
            missed=self._missed(),
            served={s.key: s.served for s in list(self._services)},
            uptime=now - self._started_at,
            busy=turn.busy + running_for,
            running=running,
            running_for=running_for,
        )

    def _missed(self) -> dict[str, int]:
        missed: dict[str, int] = {}
        for timer in list(self._timers):
            missed[timer.name] = missed.get(timer.name, 0) + timer.missed
        return missed

    def flush(self, timeout: float = 5.0) -> None:
        """Wait until the nodes in this namespace have received all that was published so far.

        A query follows the messages before it on the same link, so a node that answers has them.

        Args:
            timeout: how long to wait for a node that does not answer, s.
        """
        everybody = keys.status_key(self.namespace, "*")
        for _ in self.session.get(everybody, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE):
            pass

    def _follow_clock(self, clock: SimClock) -> None:
        """Take the time from the topic `/clock`, past the callbacks: these may wait for it."""
        token = endpoint_token(self.namespace, self.name, "sub", ClockMessage, 1, self.resolve("/clock"))
        follower = TopicSubscription(
            self.session,
            token,
            ClockMessage,
            Turn(self.thread_died),
            lambda message: clock.advance(message.clock.to_nanoseconds()),
            self._handler(self._follow_clock),
            self._report_malformed,
        )
        self._subscriptions.append(follower)

    # -- inside --------------------------------------------------------------------------------

    def _log_topic(self) -> str:
        return "/" + names.join(self.namespace, "log")

    def _node_token(self) -> NodeToken:
        cls = type(self)
        class_name = f"{cls.__module__}:{cls.__qualname__}"
        run = os.environ.get(RUN_VARIABLE, "")
        return NodeToken(self.namespace, self.name, class_name, os.getpid(), discovery.hostname(), run)

    def _period(self, rate: float | str) -> Callable[[], float]:
        if isinstance(rate, str):
            name = rate
            return lambda: self._period_by(name)
        period = period_of(rate)
        return lambda: period

    def _period_by(self, parameter: str) -> float:
        try:
            return period_of(getattr(self.parameters, parameter))
        except ContractError as error:
            raise ParameterError(f"{self.full_name}: {parameter}: {error}") from None

    def _text_parameter(self, name: str | None) -> Callable[[], str] | None:
        return None if name is None else lambda: str(getattr(self.parameters, name))

    def _intake(self, topic: str, sole_source: Callable[[], str] | None) -> Intake:
        """What examines the messages of a topic, and tells of those that are left out."""

        def wanted() -> str:
            said = sole_source() if sole_source is not None else ""
            return said if said in ("", PLAIN) else names.absolute(said, self.namespace)

        def tell(sender: str, count: int) -> None:
            source = {"": "the node that came first", PLAIN: "a plain Zenoh client"}.get(wanted(), wanted())
            text = f"left out messages of {sender} on {topic}, %d so far: it takes those of %s alone"
            self.logger.warning(text, count, source, throttle=60.0)

        return Intake(self.session, topic, wanted if sole_source is not None else None, tell)

    def _handler(self, callback: Callable[..., object]) -> Callable[[BaseException], None]:
        """What to do with an exception of a callback: it ends neither its thread nor, unless asked, the node."""
        name = name_of(callback)

        def handle(error: BaseException) -> None:
            if isinstance(error, SystemExit):
                self.obey(error)
                return
            self._callback_errors += 1
            self.logger.error(f"{name} raised", throttle=1.0, exception=error)

        return handle

    def _run_main(self) -> None:
        try:
            self.main()
        except SystemExit as stop:
            self._handler(self.main)(stop)
        except BaseException as error:
            self._handler(self.main)(error)
            self.exit_code = 1
        self._shutdown.set()

    def _report_malformed(self, topic: str, count: int, reason: str, sample: zenoh.Sample) -> None:
        now = time.monotonic()
        if now - self._malformed_told.get(topic, float("-inf")) < MALFORMED_PERIOD:
            return
        self._malformed_told[topic] = now
        # Who has sent it is asked of the network: not in the thread that runs callbacks.
        work = partial(self._tell_malformed, self.session, topic, count, reason, sample.source_info)
        threading.Thread(target=work, name="robo-malformed", daemon=True).start()

    def _tell_malformed(
        self, session: zenoh.Session, topic: str, count: int, reason: str, source: zenoh.SourceInfo | None
    ) -> None:
        sender = "a plain Zenoh client"
        if source is not None:
            try:
                announced = discovery.publishers_of(session, topic, timeout=0.5)
            except zenoh.ZError:  # the node has just left
                announced = []
            wanted = keys.source_id(source.source_id)
            sender = next((token.full_name for token in announced if token.id == wanted), f"{wanted}, unannounced")
        self.logger.warning("dropped a malformed message on %s (%d so far): %s; from %s", topic, count, reason, sender)

    def _answer_status(self, query: zenoh.Query, key: str) -> None:
        info = self.session.info
        status = msgspec.structs.replace(
            self.status,
            zid=str(info.zid()),
            links=[str(zid) for zid in (*info.routers_zid(), *info.peers_zid())],
            time=time.time_ns(),
        )
        reply(query, key, status)
