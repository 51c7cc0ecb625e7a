"""Running one node as a process: by hand with options, or under a supervisor with a finished spec."""

import atexit
import os
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, NoReturn, TextIO

import msgspec
import zenoh

from robo.environment import RUN_VARIABLE
from robo.errors import RoboError, RunError
from robo.node import log
from robo.node.contract import check_constructor
from robo.node.ending import end_without, exit_code_of, obey
from robo.node.memory import Memory
from robo.node.node import Node
from robo.process import heartbeat, signals
from robo.process.endings import end_process, end_with_threads
from robo.process.spec import NodeSpec
from robo.text.terminal import visible
from robo.wire.discovery import wait_for_nodes
from robo.wire.network import FOR_YOURS, Network
from robo.wire.run_id import new_run_id
from robo.wire.session import close_session, open_session

if TYPE_CHECKING:
    from robo.wire.claims import Claim

_ANSWERS_WITHIN = 0.5
"""How long a router may take to say whether a node may join it, s."""

SWITCH_INTERVAL = 0.001
"""How long a thread of a node may go on in Python while others want to, s. By Python's 0.005 s a timer beside five
subscriptions that a stranger keeps busy paused for 58 ms; so it is 27 to 38 ms (`python -m benchmarks.abuse`). An
emergency stop beside a computation answers within 12 ms instead of 51 ms (`python -m benchmarks.turns`)."""


def run(node_class: type[Node], arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a node until Ctrl-C, SIGTERM or its own `shutdown`, then exit with its exit code.

    `robo.run(PositionTracker)` at the end of a module makes it a command of its own; `--help` shows
    its options and its contract.
    """
    from robo.process import options as node_options

    try:
        code = run_spec(node_class, node_options.parse(node_class, sys.argv[1:] if arguments is None else arguments))
    except RoboError as error:
        code = report(error)
    sys.exit(code)


def report(error: BaseException, out: TextIO | None = None) -> int:
    """Tell what ended a node: a message for what robo raises on purpose, else a traceback.

    Args:
        error: what did.
        out: where it is told; by default stderr.

    Returns:
        The exit code.
    """
    if isinstance(error, SystemExit):
        return exit_code_of(error)
    if isinstance(error, RoboError):
        # Under a supervisor the first word of a line is its level.
        text = f"ERROR {error}" if log.is_supervised() else f"error: {error}"
    else:
        text = "".join(traceback.format_exception(error)).rstrip("\n")
    print(visible(text, keep="\n\t"), file=out or sys.stderr)
    return 1


def run_spec(node_class: type[Node], spec: NodeSpec) -> int:
    """Run a node in this process until it is told to stop.

    Returns:
        The node's exit code.

    Raises:
        RoboError: it cannot be built, or cannot join the network.
        Exception: what `on_start` raised.
    """
    log.setup()
    sys.setswitchinterval(SWITCH_INTERVAL)
    node = build(node_class, spec)

    signals.on_end(lambda: node.shutdown(node.exit_code))
    if threading.excepthook is threading.__excepthook__:  # who has set another one cares himself
        threading.excepthook = lambda died: thread_died(node, died)
    network = spec.network()
    claim = claim_names([node.full_name], network)
    session = open_session(msgspec.structs.replace(network, name=node.full_name))

    def started() -> None:
        tell_place(node, network)
        heartbeat.begin(node)

    failure: BaseException | None = None
    try:
        if claim is not None:
            claim.hold(session)
        elif RUN_VARIABLE not in os.environ:
            see_that_it_is_obeyed(node, session)
        live(node, session, spec, started)
    except BaseException as error:
        failure = error
        raise
    finally:
        if claim is not None:
            claim.close()
        if not close_session(session):  # and so Python would wait for Zenoh at exit
            end_process(node.exit_code if failure is None else report(failure))
    # The first of what runs at exit, as it is registered last.
    atexit.register(end_with_threads, node.exit_code)
    return node.exit_code


def build(node_class: type[Node], spec: NodeSpec) -> Node:
    """A node as its spec says, which has not started.

    Raises:
        RoboError: it cannot be built.
    """
    check_constructor(node_class)
    node = node_class(
        name=spec.name,
        namespace=spec.namespace,
        parameters=spec.parameters,
        remappings=spec.remappings,
        sources=spec.settings,
    )
    for text in node.lacking(node.parameters):
        raise RunError(f"{node_class.__name__} {text}")
    node.memory = Memory.of(node.full_name, spec.memory)
    node.qualities = spec.qos
    return node


def live(node: Node, session: zenoh.Session, spec: NodeSpec, started: Callable[[], None]) -> None:
    """Run a node until it is told to stop, and close it.

    Args:
        node: has not started.
        session: the network.
        spec: says which nodes it must see before it starts, and whether it comes to its work by itself.
        started: is called once it has started.

    Raises:
        RoboError: it cannot be started.
        Exception: what `on_start` raised.
    """
    try:
        unseen = wait_for_nodes(session, spec.needs, timeout=5.0)
        if unseen:
            node.logger.warning("starting although it does not see %s", ", ".join(sorted(unseen)))
        node.start(session, autostart=spec.autostart)
        try:
            with _in_ros(node, spec):
                started()
                node.wait()
        finally:
            node.close()
    except SystemExit as wish:  # of on_start
        obey(node, wish)


def _in_ros(node: Node, spec: NodeSpec) -> AbstractContextManager[None]:
    """While this goes on, a node is in ROS's graph, if its spec says so."""
    if spec.ros2 is None:
        return nullcontext()
    from robo.bridges.ros2.alone import in_ros  # which brings along what no other node needs

    return in_ros(node, spec.ros2.connect, spec.ros2.domain)


def see_that_it_is_obeyed(node: Node, session: zenoh.Session) -> None:
    """Refuse to run a node that nobody has launched where all that it says would come to nothing.

    Raises:
        ReadOnly: it was told to join another user's robot.
    """
    from robo.wire import doors  # routers have found out before they claimed their names

    doors.check(session, node.namespace, _ANSWERS_WITHIN, joins=True)


def tell_place(node: Node, network: Network) -> None:
    """Say where a node is on the network, to whoever has started it by hand."""
    if log.is_supervised():
        return
    where = network.reached if network.listen else f"at {', '.join(network.connect)}"
    if network.doors:
        from robo.wire import claims, listeners  # as in `claim_names`

        for holder in listeners.in_the_way(network.doors, claims.PATIENCE):
            node.logger.warning("%s: this node does not dial it, and others cannot look at it", holder)
            where = FOR_YOURS
    node.logger.info("runs as %s, %s; Ctrl-C stops", node.full_name, where)


def thread_died(node: Node, died: threading.ExceptHookArgs) -> None:
    """End a node of which a thread has died, unless that wanted to."""
    if died.exc_type is not SystemExit and died.exc_value is not None:  # with that a thread ends as it wants to
        end_without(node, died.exc_value)


def claim_names(full_names: Sequence[str], network: Network) -> "Claim | None":
    """Claim the names of nodes that nobody has launched; those of others are claimed by who has launched them.

    Raises:
        RunError: another node has one of the names.
        PortTaken: its port is held by a program that is no Zenoh router.
    """
    if network.mode != "router" or RUN_VARIABLE in os.environ:
        return None
    from robo.wire import claims

    claim = claims.Claim(network, "", full_names, new_run_id())
    taken = claim.take()
    if taken:
        claim.close()
        raise RunError(f"{claims.told(taken)}; stop it, or choose another --robot-name or --name")
    return claim
