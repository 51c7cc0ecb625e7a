"""`python -m robo.process.together SERVICE… [OPTIONS]`: several nodes in one process, started by hand.

`robo run A B --one-process` becomes this. Nodes end by themselves, and the process after the last one, or with Ctrl-C.
"""

import signal

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until it is handled: no traceback of half a start

import argparse
import queue
import sys
import threading
from collections.abc import Sequence

import msgspec

from robo.errors import RoboError, UsageError
from robo.node import log
from robo.node.contract_text import contract_data
from robo.node.identity import Identity
from robo.node.loading import load_node_class
from robo.node.node import Node
from robo.parameters.model import build
from robo.parameters.shape import declared_as
from robo.parameters.words import sides_of
from robo.process import options as node_options
from robo.process import runner, signals, threads
from robo.process.endings import end_process
from robo.process.lodging import Lodgings
from robo.process.spec import NodeSpec
from robo.text.suggestions import suggest


def main() -> None:
    """Run the nodes, and exit with the largest of their exit codes."""
    try:
        code = run(specs(sys.argv[1:]))
    except RoboError as error:
        code = runner.report(error)
    end_process(code)  # threads of nodes and of Zenoh may be anywhere


def specs(arguments: Sequence[str]) -> list[NodeSpec]:
    """The specs of nodes from a command line. Exits on `--help` and on unknown options.

    Raises:
        RoboError: a service cannot be loaded, two nodes have one name, or an option makes no sense for them.
    """
    options = _parser().parse_args(arguments)
    classes = {service: load_node_class(service) for service in options.services}
    if len(classes) < len(options.services):
        raise UsageError("a node class stands there twice; a manifest can run it twice, under two names")
    shared = [*_repeated(options, "params_file", "remap", "connect", "listen")]
    if options.robot_name is not None:
        shared += ["--robot-name", options.robot_name]
    given = _parameters(options.param, list(classes.values()))
    found = []
    for (service, node_class), words in zip(classes.items(), given, strict=True):
        spec = node_options.parse(node_class, [*shared, *words])
        build(node_class.Parameters, spec.parameters, service)  # a mistake in one is to be told before others run
        found.append(msgspec.structs.replace(spec, service=service))
    full_names = [_full_name(node_class, spec) for node_class, spec in zip(classes.values(), found, strict=True)]
    for name in full_names:
        if full_names.count(name) > 1:
            raise UsageError(f"two of these nodes are called {name}; a manifest can give them other names")
    return found


def run(nodes: Sequence[NodeSpec]) -> int:
    """Run nodes until each has ended, or until Ctrl-C or SIGTERM.

    Returns:
        The largest of their exit codes.

    Raises:
        RoboError: a name is taken, or the network cannot be reached.
    """
    log.setup()
    sys.setswitchinterval(runner.SWITCH_INTERVAL)
    threads.follow()
    codes: list[int] = []
    changed: queue.SimpleQueue[None] = queue.SimpleQueue()
    full_names = [_full_name(load_node_class(spec.service), spec) for spec in nodes]
    lodgings = Lodgings(" ".join(full_names), lambda _number, code: codes.append(code), lambda: changed.put(None))
    signals.on_end(lodgings.end_all)
    threading.excepthook = lodgings.thread_died
    first = nodes[0]
    network = first.network()
    claim = runner.claim_names(full_names, network)
    try:
        session = lodgings.session.join(first)
        if claim is not None:
            claim.hold(session)
        for stay, spec in enumerate(nodes):
            lodgings.begin(stay, spec, None)
        while not lodgings.empty:
            changed.get()
    finally:
        if claim is not None:
            claim.close()
        lodgings.session.close()
    return max(codes, default=0)


def _full_name(node_class: type[Node], spec: NodeSpec) -> str:
    return Identity.of(spec.name or contract_data(node_class).name, spec.namespace, {}).full_name


def _repeated(options: argparse.Namespace, *names: str) -> list[str]:
    return [
        word for name in names for value in getattr(options, name) for word in (f"--{name.replace('_', '-')}", value)
    ]


def _parameters(texts: Sequence[str], classes: Sequence[type[Node]]) -> list[list[str]]:
    """The words that set parameters, for each class: `name:=value` for all that have it, `node.name:=value` for one.

    Raises:
        UsageError: nobody has the parameter.
    """
    contracts = [contract_data(node_class) for node_class in classes]
    found: list[list[str]] = [[] for _ in classes]
    for text in texts:
        name, value = sides_of(text) or (text, "")
        node, _, rest = name.partition(".")
        taken = False
        for contract, words in zip(contracts, found, strict=True):
            known = contract.parameter_types
            own = (
                name
                if declared_as(name, known)
                else rest
                if node == contract.name and declared_as(rest, known)
                else None
            )
            if own is not None:
                words += ["-p", f"{own}:={value}"]
                taken = True
        if not taken:
            every = [f"{contract.name}.{info.name}" for contract in contracts for info in contract.parameters]
            raise UsageError(f"-p {text}: none of these nodes has such a parameter; {suggest(name, every)}")
    return found


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robo run --one-process",
        description="Several nodes in one process: one Python, one session on the network, a turn for each.",
    )
    add = parser.add_argument
    add("services", metavar="SERVICE", nargs="+", help="package.module, or package.module:Class")
    add("--robot-name", "--namespace", metavar="NAME", help="namespace of the nodes' names (or ROBO_NAMESPACE)")
    add(
        "-p",
        "--param",
        metavar="[NODE.]NAME:=VALUE",
        action="append",
        default=[],
        help="of one, or of all that have it",
    )
    add("--params-file", metavar="FILE", action="append", default=[], help="read parameters from a YAML file")
    add("-r", "--remap", metavar="FROM:=TO", action="append", default=[], help="use another name for a topic, in all")
    add("--connect", metavar="ENDPOINT", action="append", default=[], help="dial a router (or ROBO_CONNECT)")
    add("--listen", metavar="ENDPOINT", action="append", default=[], help="listen here (or ROBO_LISTEN)")
    return parser


if __name__ == "__main__":
    main()
