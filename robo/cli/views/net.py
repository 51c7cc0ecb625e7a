"""`robo net`: printing the Zenoh network."""

from collections.abc import Sequence

from robo.cli.connection import connect_to_robot
from robo.cli.printing import paint, print_json, print_line, print_table
from robo.cli.reach import Reach
from robo.errors import UsageError
from robo.text import colours
from robo.tools import net
from robo.tools.net import NetworkView


def print_network(names: Sequence[str], reach: Reach, *, json: bool) -> int:
    """Print what is seen of the network, or what is between two nodes.

    Returns:
        1 where something is wrong.

    Raises:
        UsageError: one node is named, or more than two.
        NodeNotFound: several nodes have a name.
    """
    if len(names) not in (0, 2):
        raise UsageError("name two nodes that should see each other, or none")
    timeout = max(reach.timeout, 0.2)
    with connect_to_robot(reach) as session:
        if names:
            reasons = net.why(session, names[0], names[1], timeout)
            if json:
                print_json({"nodes": names, "fine": all(r.fine for r in reasons), "reasons": reasons})
            else:
                for reason in reasons:
                    print_line(
                        f"{paint('ok', colours.GREEN) if reason.fine else paint('!!', colours.RED)}  {reason.text}"
                    )
            return 0 if all(reason.fine for reason in reasons) else 1
        seen = net.look(session, timeout)
    if json:
        print_json(seen)
    else:
        _print(seen, reach)
    return 1 if seen.problems else 0


def _print(seen: NetworkView, reach: Reach) -> None:
    print_line(f"this machine is {seen.host}; round trip to the router {_milliseconds(seen.latency)}")
    for link in seen.links:
        print_line(f"  {link.src} → {link.dst}")
    for router in seen.routers:
        print_line("")
        print_line(f"{paint(seen.names.get(router.zid, 'router'), colours.BOLD)}  zenoh {router.version}  {router.zid}")
        print_line(f"  listens at {', '.join(router.locators) or 'nowhere'}")
        for one in sorted(router.sessions, key=lambda one: (one.whatami, seen.names.get(one.zid, ""))):
            who = "this command" if one.zid == seen.zid else seen.names.get(one.zid, f"zenoh:{one.zid}")
            via = ", ".join(link.dst for link in one.links)
            print_line(f"  {one.whatami:6}  {who}{f'  {via}' if via else ''}")
    found = [node for node in seen.nodes if reach.covers(node.node)]
    if found:
        print_line("")
        head = ("NODE", "HOST", "PID", "LATENCY", "CLOCK", "LINKED TO")
        rows = [
            (
                node.node,
                node.host,
                str(node.pid),
                _milliseconds(node.latency),
                "-" if node.clock is None else f"{node.clock * 1e3:+.1f} ms",
                ", ".join(node.links) or "-",
            )
            for node in found
        ]
        print_table([head, *rows])
    refused = [(one.router, count) for one in seen.refused for count in one.counts]
    if refused:
        print_line("")
        told = [(router, str(count.count), count.sentence) for router, count in refused]
        print_table([("ROUTER", "REFUSED", "WHAT"), *told])
    for problem in seen.problems:
        print_line(f"{paint('!!', colours.RED)}  {problem}")


def _milliseconds(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1e3:.2f} ms"
