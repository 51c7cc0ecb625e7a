"""Running one node as a process: by hand with options, or under a supervisor with a finished spec."""

import atexit
import os
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn

import msgspec

from robo.environment import RUN_VARIABLE
from robo.errors import RoboError, RunError
from robo.node import log
from robo.node.contract import check_constructor
from robo.node.ending import end_without, exit_code_of, obey
from robo.node.memory import Memory
from robo.node.node import Node
from robo.process import heartbeat
from robo.process.endings import end_process, end_with_threads
from robo.text.terminal import visible
from robo.wire.discovery import wait_for_nodes
from robo.wire.network import Network
from robo.wire.run_id import new_run_id
from robo.wire.session import close_session, open_session

if TYPE_CHECKING:
    from types import FrameType

    from robo.wire.claims import Claim
from robo.process.spec import NodeSpec


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


def report(error: BaseException) -> int:
    """Tell what ended a process: a message for what robo raises on purpose, else a traceback.

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
    print(visible(text, keep="\n\t"), file=sys.stderr)
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
    check_constructor(node_class)
    node = node_class(
        name=spec.name,
        namespace=spec.namespace,
        parameters=spec.parameters,
        remappings=spec.remappings,
        sources=spec.settings,
    )

    node.memory = Memory.of(node.full_name, spec.memory)

    def stop(_number: int, _frame: "FrameType | None") -> None:
        node.shutdown(node.exit_code)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    if threading.excepthook is threading.__excepthook__:  # who has set another one cares himself
        threading.excepthook = lambda died: _thread_died(node, died)
    network = Network.from_environment(spec.mode or "router", spec.connect, spec.listen)
    claim = _claim_name(node.full_name, network)
    session = open_session(msgspec.structs.replace(network, name=node.full_name))
    failure: BaseException | None = None
    try:
        if claim is not None:
            claim.hold(session)
        unseen = wait_for_nodes(session, spec.needs, timeout=5.0)
        if unseen:
            node.logger.warning("starting although it does not see %s", ", ".join(sorted(unseen)))
        node.start(session)
        if not log.is_supervised():
            places = ", ".join(network.listen or network.connect)
            node.logger.info("runs as %s, at %s; Ctrl-C stops", node.full_name, places)
        heartbeat.begin(node)
        node.wait()
        node.close()
    except SystemExit as wish:  # of on_start
        obey(node, wish)
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


def _thread_died(node: Node, died: threading.ExceptHookArgs) -> None:
    if died.exc_type is not SystemExit and died.exc_value is not None:  # with that a thread ends as it wants to
        end_without(node, died.exc_value)


def _claim_name(full_name: str, network: Network) -> "Claim | None":
    """Claim the name of a node that nobody has launched; the names of others are claimed by who has launched them.

    Raises:
        RunError: another node has the name.
        PortTaken: its port is held by a program that is no Zenoh router.
    """
    if network.mode != "router" or RUN_VARIABLE in os.environ:
        return None
    from robo.wire import claims

    claim = claims.Claim(network, "", [full_name], new_run_id())
    taken = claim.take()
    if taken:
        claim.close()
        raise RunError(f"{claims.told(taken)}; stop it, or choose another --robot-name or --name")
    return claim
