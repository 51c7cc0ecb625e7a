"""`robo node`: printing which nodes there are, and all about one."""

from collections.abc import Sequence

import msgspec

from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.printing import (
    data_size,
    note,
    paint,
    print_json,
    print_line,
    print_lines,
    print_table,
    print_text,
)
from robo.cli.reach import Reach
from robo.text import colours
from robo.text.columns import aligned
from robo.text.durations import duration
from robo.tools import nodes
from robo.tools.nodes import NodeInfo
from robo.wire.reports import EVERY_NODES, HEALTH_LEVELS, check_name
from robo_messages import DiagnosticStatus


def print_nodes(reach: Reach, *, json: bool) -> None:
    """Print the nodes that are ready.

    Raises:
        NodeNotFound: the robot that is named has none.
    """
    with connect_to_robot(reach) as session:
        found = nodes_of(session, reach, of_ros=True)
    if json:
        for token in found:
            print_json(
                {
                    "node": token.full_name,
                    "name": token.node,
                    "namespace": token.namespace,
                    "class_name": token.class_name,
                    "pid": token.pid,
                    "host": token.host,
                }
            )
    elif not found:
        note("no nodes: a router answers, and no node is there")
    else:
        rows = [(token.full_name, token.class_name, str(token.pid), token.host) for token in found]
        print_table([("NODE", "CLASS", "PID", "HOST"), *rows])
    for same in nodes.twins(found):
        note(f"warning: {same}; stop one of them")


def print_info(name: str, reach: Reach, *, json: bool) -> int:
    """Print all about one node.

    Returns:
        1 where the node does not answer.

    Raises:
        NodeNotFound: there is no such node.
    """
    with connect_to_robot(reach) as session:
        node = nodes.find_node(nodes_of(session, reach, of_ros=True), name)
        info = nodes.node_info(session, node, max(reach.timeout, 1.0))
    if json:
        print_json(info)
    else:
        print_lines(_lines(info))
    if info.problem:
        note(f"error: {info.problem}")
    return 1 if info.problem else 0


def _lines(info: NodeInfo) -> list[str]:
    stuck = info.running_for > nodes.LONG_CALLBACK
    facts = [
        ("class", "a node of ROS 2, as a bridge shows it" if info.is_of_ros else info.class_name),
        ("process", "" if info.is_of_ros else f"{info.pid} on {info.host}"),
        ("state", info.state or ""),
        ("restarts", "" if info.restarts is None else str(info.restarts)),
        ("uptime", "" if info.uptime is None else duration(info.uptime)),
        (
            "callback",
            f"{info.running} has been running for {duration(info.running_for)}; all others of its turn wait"
            if stuck
            else "",
        ),
        ("load", "" if info.load is None else f"{info.load:.1%} of the time in callbacks"),
        ("cpu", "" if info.cpu is None else f"{info.cpu:.1f}% of a core"),
        ("memory", "" if info.memory is None else data_size(info.memory)),
        ("large", f"messages through {info.large_messages}" if info.large_messages else ""),
        ("timers", ", ".join(f"{name} skipped {count} ticks" for name, count in info.missed.items())),
        ("errors", f"its callbacks raised {info.callback_errors} exceptions" if info.callback_errors else ""),
    ]
    lines = [paint(info.node, colours.BOLD), *(f"  {label:9} {text}" for label, text in facts if text)]
    lines += _section(
        "checks", [(check_name(c), HEALTH_LEVELS[c.level].upper(), c.message, _figures(c)) for c in info.checks]
    )

    def counted(*figures: str) -> tuple[str, ...]:
        return () if info.is_of_ros else figures  # whoever shows it does not count for it

    lines += _section(
        "publishers",
        [
            (p.topic, p.type, str(p.qos), *counted(f"{p.rate:.1f} Hz", f"{p.published} published"))
            for p in info.publishers
        ],
    )
    lines += _section(
        "subscriptions",
        [
            (
                s.topic,
                s.type,
                str(s.qos),
                *counted(f"{s.rate:.1f} Hz", f"{s.received} received, {s.dropped} dropped, {s.malformed} malformed"),
            )
            for s in info.subscriptions
        ],
    )
    lines += _section("services", [(s.service, s.type, *counted(f"{s.served} calls")) for s in info.services])
    lines += _section(
        "turns of their own", [(t.turn, ", ".join(t.callbacks), f"{t.load:.1%} of the time") for t in info.turns]
    )
    lines += _section("clients", [(c.service, c.type) for c in info.clients])
    lines += _section("actions", [(a.service, a.type) for a in info.actions])
    lines += _section("sends goals to", [(a.service, a.type) for a in info.action_clients])
    values = info.parameters or {}
    lines += _section("parameters", [(name, msgspec.json.encode(value).decode()) for name, value in values.items()])
    return lines


def _figures(check: DiagnosticStatus) -> str:
    """The figures of a node's own check; those of the others stand elsewhere."""
    if check_name(check) in EVERY_NODES:
        return ""
    return ", ".join(f"{value.key} {value.value}" for value in check.values)


def _section(title: str, rows: Sequence[tuple[str, ...]]) -> list[str]:
    return [f"  {title}", *(f"    {line}" for line in aligned(rows))] if rows else []


def print_contract(service: str, *, json: bool) -> None:
    """Print the contract of a node class, without running it.

    Raises:
        ContractError: there is no such class, or it says something wrong.
    """
    from robo.node.contract_text import contract_data, contract_text
    from robo.node.loading import load_node_class

    contract = contract_data(load_node_class(service))
    if json:
        print_json(contract)
        return
    print_line(paint(contract.class_name, colours.BOLD))
    if contract.description:
        print_text(f"{contract.description}\n")
    print_text(contract_text(contract))
