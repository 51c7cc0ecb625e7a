"""The node: a class whose contract can be read without running it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import ClassVar, Self

import zenoh

from robo.node.clock import Clock, SimClock
from robo.node.contract import Contract, contract_of
from robo.node.creating import Creating
from robo.node.ending import end_without, obey
from robo.node.endpoints import Endpoints
from robo.node.identity import Identity
from robo.node.life import STOP_TIMEOUT, Life
from robo.node.log import NodeLogger
from robo.node.memory import Memory
from robo.node.status import Status
from robo.node.troubles import Troubles
from robo.node.tuning import Tuning
from robo.node.turns import Turns
from robo.parameters.model import build
from robo.wire import keys
from robo.wire.keys import EndpointToken
from robo.wire.qos import Quality
from robo.wire.reports import NodeStatus, Setting
from robo_messages import Time


class Node(Creating):
    """Base of every node. A subclass declares what it publishes, subscribes and how it is tuned:

        class Talker(Node):
            class Parameters(robo.Parameters):
                rate: Annotated[float, Meta(gt=0, description="Hz")] = 1.0

            parameters: Parameters
            chatter = Publisher(String, "chatter")

            @timer(rate="rate")
            def speak(self) -> None:
                self.chatter.publish(String("hello"))

    Callbacks never run at the same time, so they need no locks; one that must not wait for the others has a
    turn of its own, `@service("emergency_stop", turn="stop")`. A callback that raises is logged and
    counted, and the node goes on; `raise SystemExit(code)` ends it. In a process of its own it also ends,
    with exit code 1, when a thread dies of an exception, be it one that the subclass has started.
    """

    _LIFE: ClassVar[type[Life]] = Life

    def __init__(
        self,
        *,
        name: str | None = None,
        namespace: str | None = None,
        parameters: Mapping[str, object] | None = None,
        remappings: Mapping[str, str] | None = None,
        sources: Mapping[str, Sequence[Setting]] | None = None,
        session: zenoh.Session | None = None,
        clock: Clock | None = None,
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
            clock: its time; by default the wall clock, or with the parameter `use_sim_time` what `/clock` says.

        Raises:
            ContractError, ParameterError, InvalidName: the class, a value or a name is wrong.
        """
        self.contract: Contract = contract_of(type(self))
        self._identity = Identity.of(name or self.contract.name, namespace, remappings)
        self.name, self.namespace = self._identity.name, self._identity.namespace
        self.full_name = self._identity.full_name
        # Its type is inferred: one that is declared may not be narrower in a subclass, as pyright sees it.
        self.parameters = build(type(self).Parameters, parameters or {}, self.full_name)
        self.clock: Clock = clock or (SimClock() if self.parameters.use_sim_time else Clock())
        self.logger = NodeLogger(self.full_name[1:].replace("/", "."), lambda: self.clock.monotonic())
        self.exit_code = 0
        self.memory = Memory()
        """What it keeps when it is started again within a run."""
        self.qualities: Mapping[str, Quality] = {}
        """By topic, what its launch says of its ends, over what it says itself."""
        self._given_session, self._shutdown = session, threading.Event()
        self._turns = Turns(partial(end_without, self), self.clock)
        self._troubles = Troubles(self.logger, partial(obey, self))
        turn, handler = self._turns.own, self._troubles.handler
        self._tuning = Tuning(self, sources or {}, turn, lambda: list(self._ends.timers), handler)
        self._status = Status(self.full_name, self._turns)
        self._life: Life | None = None
        """The present one, or the last."""

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
        """End the node; returns at once. A process that runs it exits with `exit_code`.

        Not for the handler of a signal, which may interrupt `wait` at a moment at which both want one lock: let a
        thread call it there. `robo.run` does.
        """
        self.exit_code = exit_code
        self._shutdown.set()
        self.clock.wake()

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
        self._tuning.set({**(changes or {}), **values})

    @property
    def session(self) -> zenoh.Session:
        """The Zenoh session of a node that has started."""
        if self._life is None or self._life.is_over:
            raise RuntimeError(f"{self.full_name} has not started; use it as `with node:` or call start()")
        return self._life.session

    def resolve(self, name: str) -> str:
        """The key expression of a topic name for this node, after namespace and remapping.

        Raises:
            InvalidName: the name breaks the rules.
        """
        return self._identity.resolve(name)

    def start(self, session: zenoh.Session | None = None, *, autostart: bool = True) -> None:
        """Join the network, make the declared endpoints and begin to run callbacks.

        All or nothing: where it raises, be it in `on_start`, the node has left the network again and
        nothing of it runs.

        Args:
            session: a session to use, if none was given when the node was made.
            autostart: of a `LifecycleNode`: whether it is brought to active; else it waits in unconfigured.

        Raises:
            NetworkError: the network cannot be reached.
            RuntimeError: it has started already.
        """
        if self._life is not None:
            if not self._life.is_over:
                raise RuntimeError(f"{self.full_name} has started already")
            self._shutdown.clear()  # what told an earlier start to end does not end this one; a Ctrl-C before it does
        self._given_session = session or self._given_session
        of_all_lives = self._identity, self._turns, self._troubles, self._tuning, self._shutdown
        self._life = self._LIFE(self, self._given_session, *of_all_lives)
        self._life.autostart = autostart
        self._life.begin()

    def wait(self, timeout: float | None = None) -> bool:
        """Block until the node is shut down. Returns whether it was, within `timeout` seconds."""
        return self._shutdown.wait(timeout)

    def close(self, timeout: float = STOP_TIMEOUT) -> None:
        """Stop callbacks, let those that run finish, leave the network. Safe to call twice.

        Args:
            timeout: how long `main` and all callbacks together may take to return, s.
        """
        if self._life is not None:
            self._life.end(timeout)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def status(self) -> NodeStatus:
        """Counters of this node, as a query on its status key would get them."""
        checks = self._life.diagnostics.last if self._life is not None else ()
        return self._status.of(self._ends, self._troubles.callback_errors, checks)

    def flush(self, timeout: float = 5.0) -> None:
        """Wait until the nodes in this namespace have received all that was published so far.

        A query of the least priority follows the messages before it on the same link, so a node that answers has them.

        Args:
            timeout: how long to wait for a node that does not answer, s.
        """
        everybody = keys.status_key(self.namespace, "*")
        last, each = zenoh.Priority.BACKGROUND, zenoh.ConsolidationMode.NONE
        list(self.session.get(everybody, timeout=timeout, priority=last, consolidation=each))

    def beat_every(self, period: float, beat: Callable[[], None]) -> None:
        """Call `beat` every `period` seconds in turn with the callbacks: for whoever looks after the node's process."""
        assert self._life is not None
        self._life.beat_every(period, beat)

    def announced(self) -> list[EndpointToken]:
        """What it has announced of its ends on topics, services and actions: for whoever shows it elsewhere."""
        return self._ends.announced()

    @property
    def _ends(self) -> Endpoints:
        return self._life.ends if self._life is not None else Endpoints()
