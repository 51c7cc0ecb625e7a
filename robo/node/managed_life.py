"""A managed node's time on the network: its states between its start and its close, and who may ask for them."""

import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Protocol

import zenoh

from robo.errors import LifecycleError
from robo.node.factory import EndpointFactory
from robo.node.gate import Gate
from robo.node.identity import Identity
from robo.node.life import Life, Living
from robo.node.lifecycle import (
    TRANSITIONS,
    WAY_DOWN,
    WAY_UP,
    Lifecycle,
    LifecycleState,
    Transition,
    TransitionCallbackReturn,
)
from robo.node.topics import TopicPublisher
from robo.node.troubles import Troubles
from robo.node.tuning import Tuning
from robo.node.turn import taking
from robo.node.turns import Turns
from robo.wire.qos import QoS
from robo_messages import ParameterEvent
from robo_messages import lifecycle as wire


class Managed(Living, Protocol):
    """What its life needs of a managed node, beside its hooks, which it finds by name."""

    @property
    def stopping(self) -> bool:
        """Whether it is told to end."""


class ManagedLife(Life):
    """The time of a managed node on the network: its states between the start and the close."""

    def __init__(
        self,
        node: Managed,
        session: zenoh.Session | None,
        identity: Identity,
        turns: Turns,
        troubles: Troubles,
        tuning: Tuning,
        shutdown: threading.Event,
    ) -> None:
        """The arguments are those of `Life`."""
        self.lifecycle = Lifecycle(self._call, self._moved)
        self._gate = Gate(lambda: self.lifecycle.state.label)
        super().__init__(node, session, identity, turns, troubles, tuning, shutdown, self._gate)
        self._managed = node
        self._events: TopicPublisher[wire.TransitionEvent] | None = None
        # What only tells is answered while a hook runs, too.
        aside = Turns(turns.own.on_death, node.clock)
        self._aside = EndpointFactory(self.session, identity, self.ends, aside, troubles, node.clock, node.qualities)
        self._wrong: BaseException | None = None
        """What the last hook that went wrong has raised."""
        self._main_due = True
        self._beat: Callable[[], None] = lambda: None

    def beat_every(self, period: float, beat: Callable[[], None]) -> None:
        """See `Life`; there is a beat with each new state, too."""
        super().beat_every(period, beat)
        self._beat = beat

    def change(self, label: str = "", id: int = 0) -> TransitionCallbackReturn:  # noqa: A002
        """Go through a transition, by its label or its id, in turn with the callbacks.

        Raises:
            LifecycleError: there is no such transition in the present state; says which there are.
        """
        with taking(self._turn, label or "change_state"):
            self._wrong = None
            outcome = self.lifecycle.change(self.lifecycle.find(label, id))
        if self.lifecycle.state is LifecycleState.FINALIZED and not self._managed.stopping:
            # ROS: the state in which a node is immediately before being destroyed. Nothing leads out of it.
            failed = outcome is TransitionCallbackReturn.ERROR
            self._node.shutdown(1 if failed else self._node.exit_code)
        return outcome

    def _join(self, made: ExitStack) -> TopicPublisher[ParameterEvent]:
        self._events = self._own.publisher(wire.TransitionEvent, "~/transition_event", QoS.DEFAULT)
        return super()._join(made)

    def _begin_work(self) -> None:
        with taking(self._turn, "autostart"):  # who asks for a transition waits until it has come up
            self._serve()
            for label in WAY_UP if self.autostart else ():
                if not self._managed.stopping:  # it may be told to end meanwhile
                    self._bring(label)

    def _bring(self, label: str) -> None:
        """Go through a transition that has to succeed."""
        outcome = self.change(label)
        if outcome is TransitionCallbackReturn.SUCCESS or isinstance(self._wrong, SystemExit):
            return
        raised = self._wrong
        why = f"said {outcome.name}" if raised is None else f"raised {type(raised).__name__}: {raised}"
        state = self.lifecycle.state.label
        text = f"{self._node.full_name} does not come to active: on_{label} {why}; it is {state}, and ends"
        raise LifecycleError(text) from raised

    def _serve(self) -> None:
        """Answer ROS's services of a managed node."""
        make, aside = self._own.service, self._aside.service
        make(wire.ChangeState.Request, wire.ChangeState.Response, "~/change_state", self._on_change)
        aside(wire.GetState.Request, wire.GetState.Response, "~/get_state", self._on_get_state)
        states = wire.GetAvailableStates
        aside(states.Request, states.Response, "~/get_available_states", self._on_get_states)
        transitions = wire.GetAvailableTransitions
        aside(transitions.Request, transitions.Response, "~/get_available_transitions", self._on_get_transitions)
        aside(transitions.Request, transitions.Response, "~/get_transition_graph", self._on_get_graph)

    def _on_change(self, request: wire.ChangeState.Request) -> wire.ChangeState.Response:
        wanted = request.transition
        try:
            outcome = self.change(wanted.label, wanted.id)
        except LifecycleError as error:
            self._node.logger.warning("refused a transition: %s", error)
            return wire.ChangeState.Response(success=False)
        return wire.ChangeState.Response(success=outcome is TransitionCallbackReturn.SUCCESS)

    def _on_get_state(self, _: wire.GetState.Request) -> wire.GetState.Response:
        return wire.GetState.Response(current_state=_state(self.lifecycle.state))

    def _on_get_states(self, _: wire.GetAvailableStates.Request) -> wire.GetAvailableStates.Response:
        return wire.GetAvailableStates.Response(available_states=[_state(one) for one in LifecycleState])

    def _on_get_transitions(self, _: wire.GetAvailableTransitions.Request) -> wire.GetAvailableTransitions.Response:
        found = [_description(one) for one in self.lifecycle.available]
        return wire.GetAvailableTransitions.Response(available_transitions=found)

    def _on_get_graph(self, _: wire.GetAvailableTransitions.Request) -> wire.GetAvailableTransitions.Response:
        return wire.GetAvailableTransitions.Response(available_transitions=[_description(one) for one in TRANSITIONS])

    def _call(self, hook: str) -> TransitionCallbackReturn:
        """Call a hook of the node, under its turn, and tell what it raises."""
        before, self._turn.running = self._turn.running, hook
        try:
            outcome = getattr(self._node, hook)()
            if outcome is None:
                return TransitionCallbackReturn.SUCCESS
            return TransitionCallbackReturn(outcome)
        except BaseException as error:
            self._wrong = self._wrong or error
            self._troubles.handler(getattr(self._node, hook))(error)
            return TransitionCallbackReturn.ERROR
        finally:
            self._turn.running = before

    def _moved(self, transition: Transition) -> None:
        """The node has come to another state."""
        start, goal = transition.start, transition.goal
        self._gate.shut()
        if goal is LifecycleState.ACTIVATING:
            self._gate.for_messages = True
        elif goal.is_primary and goal is not LifecycleState.ACTIVE:
            self._gate.for_messages = False
        if goal is LifecycleState.UNCONFIGURED:
            self._gate.forget()
        if goal is LifecycleState.ACTIVE:
            self._become_ready()
            if self._main_due:
                self._main_due = False
                self._start_main()
        elif start is LifecycleState.ACTIVE:
            self._be_ready_no_more()
        self._tell(transition)
        self._beat()
        if (
            goal is LifecycleState.ACTIVE
        ):  # last: a callback may give away the turn, and the node be taken back meanwhile
            self._gate.open()

    def _tell(self, transition: Transition) -> None:
        assert self._events is not None
        named = wire.Transition(id=transition.id, label=transition.label)
        now = self._node.now().to_nanoseconds()
        with suppress(zenoh.ZError):  # without a network, too, a node comes to its end
            self._events.publish(wire.TransitionEvent(now, named, _state(transition.start), _state(transition.goal)))

    def _be_ready_no_more(self) -> None:
        super()._be_ready_no_more()
        if self._readiness is not None:  # active, and its `ready` has not said yes yet
            self.ends.drop(self._readiness)
            self._readiness = None

    def _say_farewell(self) -> None:
        for label in WAY_DOWN:
            with suppress(LifecycleError):  # what is not possible is not needed
                self.lifecycle.change(self.lifecycle.find(label))
        super()._say_farewell()


def _state(state: LifecycleState) -> wire.State:
    return wire.State(id=int(state), label=state.label)


def _description(one: Transition) -> wire.TransitionDescription:
    transition = wire.Transition(id=one.id, label=one.label)
    return wire.TransitionDescription(transition, _state(one.start), _state(one.goal))
