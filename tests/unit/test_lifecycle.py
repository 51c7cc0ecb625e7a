"""The states of managed nodes beside those of ROS 2: each transition asked for in each state, with each outcome."""

from collections.abc import Iterator

import pytest

from robo.errors import LifecycleError
from robo.node.lifecycle import (
    HOOKS,
    TRANSITIONS,
    Lifecycle,
    LifecycleState,
    Transition,
    TransitionCallbackReturn,
)
from robo_messages import lifecycle as wire

SUCCESS, FAILURE, ERROR = TransitionCallbackReturn
OUTCOMES = (SUCCESS, FAILURE, ERROR)

# As rcl_lifecycle registers them (default_state_machine.c), by the constants of lifecycle_msgs.
ROS = """
configure          CONFIGURE               UNCONFIGURED    CONFIGURING
transition_success ON_CONFIGURE_SUCCESS    CONFIGURING     INACTIVE
transition_failure ON_CONFIGURE_FAILURE    CONFIGURING     UNCONFIGURED
transition_error   ON_CONFIGURE_ERROR      CONFIGURING     ERRORPROCESSING
cleanup            CLEANUP                 INACTIVE        CLEANINGUP
transition_success ON_CLEANUP_SUCCESS      CLEANINGUP      UNCONFIGURED
transition_failure ON_CLEANUP_FAILURE      CLEANINGUP      INACTIVE
transition_error   ON_CLEANUP_ERROR        CLEANINGUP      ERRORPROCESSING
activate           ACTIVATE                INACTIVE        ACTIVATING
transition_success ON_ACTIVATE_SUCCESS     ACTIVATING      ACTIVE
transition_failure ON_ACTIVATE_FAILURE     ACTIVATING      INACTIVE
transition_error   ON_ACTIVATE_ERROR       ACTIVATING      ERRORPROCESSING
deactivate         DEACTIVATE              ACTIVE          DEACTIVATING
transition_success ON_DEACTIVATE_SUCCESS   DEACTIVATING    INACTIVE
transition_failure ON_DEACTIVATE_FAILURE   DEACTIVATING    ACTIVE
transition_error   ON_DEACTIVATE_ERROR     DEACTIVATING    ERRORPROCESSING
shutdown           UNCONFIGURED_SHUTDOWN   UNCONFIGURED    SHUTTINGDOWN
shutdown           INACTIVE_SHUTDOWN       INACTIVE        SHUTTINGDOWN
shutdown           ACTIVE_SHUTDOWN         ACTIVE          SHUTTINGDOWN
transition_success ON_SHUTDOWN_SUCCESS     SHUTTINGDOWN    FINALIZED
transition_failure ON_SHUTDOWN_FAILURE     SHUTTINGDOWN    FINALIZED
transition_error   ON_SHUTDOWN_ERROR       SHUTTINGDOWN    ERRORPROCESSING
transition_success ON_ERROR_SUCCESS        ERRORPROCESSING UNCONFIGURED
transition_failure ON_ERROR_FAILURE        ERRORPROCESSING FINALIZED
transition_error   ON_ERROR_ERROR          ERRORPROCESSING FINALIZED
"""

# What ROS's machine does with each request in each state in which one may ask: the hook, and where each outcome leads.
# A dash: refused, and nothing changes.
REQUESTS = """
state        configure     activate      deactivate      cleanup      shutdown
unconfigured on_configure  -             -               -            on_shutdown
inactive     -             on_activate   -               on_cleanup   on_shutdown
active       -             -             on_deactivate   -            on_shutdown
finalized    -             -             -               -            -
"""
LEADS_TO = """
hook          success       failure
on_configure  inactive      unconfigured
on_activate   active        inactive
on_deactivate inactive      active
on_cleanup    unconfigured  inactive
on_shutdown   finalized     finalized
on_error      unconfigured  finalized
"""
AFTER_ERROR = {SUCCESS: "unconfigured", FAILURE: "finalized", ERROR: "finalized"}
WAYS = {
    "unconfigured": [],
    "inactive": ["configure"],
    "active": ["configure", "activate"],
    "finalized": ["shutdown"],
}
"""How one comes to each state in which one may ask."""


def table(text: str) -> dict[str, dict[str, str]]:
    head, *rows = (line.split() for line in text.strip().splitlines())
    return {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}


class Hooks:
    """Says how hooks go, and notes which were called."""

    def __init__(self) -> None:
        self.called: list[str] = []
        self.outcomes: dict[str, TransitionCallbackReturn] = {}
        self.moves: list[Transition] = []
        self.machine = Lifecycle(self.call, self.moves.append)

    def call(self, hook: str) -> TransitionCallbackReturn:
        assert HOOKS[self.machine.state] == hook
        assert not self.machine.state.is_primary
        self.called.append(hook)
        return self.outcomes.get(hook, SUCCESS)

    def ask(self, label: str) -> TransitionCallbackReturn:
        return self.machine.change(self.machine.find(label))


def in_state(state: str) -> Hooks:
    hooks = Hooks()
    for label in WAYS[state]:
        hooks.ask(label)
    assert hooks.machine.state.label == state
    hooks.called.clear()
    hooks.moves.clear()
    return hooks


def test_the_transitions_are_those_of_ros_with_its_ids_in_its_order() -> None:
    constants = {
        name.removeprefix("PRIMARY_STATE_").removeprefix("TRANSITION_STATE_"): value
        for name, value in vars(wire.State).items()
        if isinstance(value, int) and name.isupper()
    }
    assert {state.name: state.value for state in LifecycleState} == constants
    rows = (line.split() for line in ROS.strip().splitlines())
    expected = [
        (getattr(wire.Transition, f"TRANSITION_{name}"), label, constants[start], constants[goal])
        for label, name, start, goal in rows
    ]
    assert [(one.id, one.label, int(one.start), int(one.goal)) for one in TRANSITIONS] == expected


def test_the_answers_of_hooks_have_the_numbers_of_ros() -> None:
    for outcome in OUTCOMES:
        assert getattr(wire.Transition, f"TRANSITION_CALLBACK_{outcome.name}") == outcome


def cases() -> Iterator[tuple[str, str, str, TransitionCallbackReturn, TransitionCallbackReturn]]:
    for state, requests in table(REQUESTS).items():
        for label, hook in requests.items():
            for outcome in OUTCOMES:
                for of_error in OUTCOMES if outcome is ERROR and hook != "-" else (SUCCESS,):
                    yield state, label, hook, outcome, of_error


@pytest.mark.parametrize(("state", "label", "hook", "outcome", "of_error"), list(cases()))
def test_every_request_in_every_state_with_every_outcome(
    state: str, label: str, hook: str, outcome: TransitionCallbackReturn, of_error: TransitionCallbackReturn
) -> None:
    hooks = in_state(state)
    hooks.outcomes = {hook: outcome, "on_error": of_error}
    if hook == "-":
        with pytest.raises(LifecycleError, match=f"it is {state} and cannot {label}"):
            hooks.ask(label)
        assert (hooks.machine.state.label, hooks.called, hooks.moves) == (state, [], [])
        return
    assert hooks.ask(label) is outcome
    assert hooks.called == ([hook] if outcome is not ERROR else [hook, "on_error"])
    leads_to = table(LEADS_TO)
    if outcome is ERROR:
        assert hooks.machine.state.label == AFTER_ERROR[of_error]
    else:
        assert hooks.machine.state.label == leads_to[hook][outcome.name.lower()]
    assert hooks.machine.before.label == state
    for one, following in zip(hooks.moves, hooks.moves[1:], strict=False):
        assert one.goal is following.start, "one transition leads to the next"
    assert all(one in TRANSITIONS for one in hooks.moves)
    assert hooks.moves[0].start.label == state
    assert hooks.moves[-1].goal is hooks.machine.state


@pytest.mark.parametrize("state", list(WAYS))
@pytest.mark.parametrize("id", range(100))
def test_by_its_id_a_transition_can_be_asked_for_where_ros_has_it(state: str, id: int) -> None:  # noqa: A002
    machine = in_state(state).machine
    possible = {one.id for one in machine.available}
    if id in possible:
        assert machine.find("", id).id == id
        assert id < 10, "those that follow from a hook are nobody's to ask for"
    else:
        with pytest.raises(LifecycleError, match=f"it is {state} and cannot go through transition {id}"):
            machine.find("", id)


def test_the_label_counts_rather_than_the_id() -> None:
    machine = in_state("inactive").machine
    assert machine.find("cleanup", 3).label == "cleanup"
    with pytest.raises(LifecycleError, match="cannot configure; it can cleanup or activate or shutdown"):
        machine.find("configure", 3)


@pytest.mark.parametrize("label", ["transition_success", "transition_error", "on_configure", "create", "destroy", "?"])
def test_nothing_else_is_a_request(label: str) -> None:
    machine = in_state("unconfigured").machine
    with pytest.raises(LifecycleError, match="it can configure or shutdown"):
        machine.find(label)


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_nobody_can_ask_for_anything_while_a_hook_runs(outcome: TransitionCallbackReturn) -> None:
    refused: list[str] = []

    def call(hook: str) -> TransitionCallbackReturn:
        for label in ("configure", "activate", "shutdown", "transition_success"):
            with pytest.raises(LifecycleError, match="it can do nothing else now"):
                machine.find(label)
        refused.append(hook)
        return outcome if hook == "on_configure" else SUCCESS

    machine = Lifecycle(call)
    machine.change(machine.find("configure"))
    assert refused[0] == "on_configure"
