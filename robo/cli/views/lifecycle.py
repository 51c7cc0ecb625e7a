"""`robo lifecycle`: which managed nodes there are, their states, and taking them from one to another."""

import sys

import zenoh

from robo.cli.connection import connect_to_robot, nodes_of, see_that_it_obeys
from robo.cli.printing import note, print_json, print_line, print_table
from robo.cli.reach import Reach
from robo.errors import NodeUnreachable
from robo.tools import lifecycle


def print_nodes(reach: Reach, *, json: bool) -> None:
    """Print the full names of managed nodes."""
    with connect_to_robot(reach) as session:
        found = _nodes(session, reach)
    for name in found:
        if json:
            print_json({"node": name})
        else:
            print_line(name)
    if not found and not json:
        print("no managed nodes", file=sys.stderr)


def print_states(node: str | None, reach: Reach, *, json: bool) -> None:
    """Print the state of one node, or those of all.

    Raises:
        NodeNotFound: there is no such node.
        NodeUnreachable: it does not answer.
    """
    with connect_to_robot(reach) as session:
        there = _nodes(session, reach)
        for name in there if node is None else [lifecycle.find(there, node)]:
            try:
                state = lifecycle.state(session, name, reach.timeout)
            except NodeUnreachable as error:
                if node is not None:
                    raise
                note(str(error))
                continue
            if json:
                print_json({"node": name, "state": state.label, "id": state.id})
            else:
                print_line(f"{state.label} [{state.id}]" if node is not None else f"{name}: {state.label} [{state.id}]")
    if not there and not json:
        print("no managed nodes", file=sys.stderr)


def print_ways(node: str, reach: Reach, *, every: bool, json: bool) -> None:
    """Print the transitions that begin in a node's present state, or all.

    Raises:
        NodeNotFound: there is no such node.
        NodeUnreachable: it does not answer.
    """
    with connect_to_robot(reach) as session:
        found = lifecycle.ways(session, lifecycle.find(_nodes(session, reach), node), reach.timeout, every=every)
    if json:
        for way in found:
            print_json(way)
    else:
        rows = [(way.label, str(way.id), way.start, way.goal) for way in found]
        print_table([("TRANSITION", "ID", "START", "GOAL"), *rows])


def set_state(node: str, transition: str, reach: Reach, *, patience: float, json: bool) -> int:
    """Take a node through a transition, and print where it is then.

    Returns:
        The exit code: 1 where its hook did not succeed.

    Raises:
        LifecycleError: the transition does not begin in its present state; says which do.
        NodeNotFound: there is no such node.
        NodeUnreachable: it does not answer in time.
    """
    with connect_to_robot(reach) as session:
        name = lifecycle.find(_nodes(session, reach), node)
        see_that_it_obeys(session, reach, name)
        done = lifecycle.change(session, name, transition, reach.timeout, patience)
    if json:
        print_json(done)
    elif done.success:
        print_line(f"{name} is {done.state}" if done.state else f"{name} has ended")
    else:
        now = f"is {done.state}" if done.state else "has ended"
        note(f"{name} {now}: its hook for {transition} did not succeed; robo logs {name} says why")
    return 0 if done.success else 1


def _nodes(session: zenoh.Session, reach: Reach) -> list[str]:
    """The managed nodes of the robot that is named, or of all."""
    found = [name for name in lifecycle.managed_nodes(session, reach.timeout) if reach.covers(name)]
    if not found:
        nodes_of(session, reach)  # says so where the robot that is named is not there
    return found
