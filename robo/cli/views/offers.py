"""The table of services, and that of actions."""

import sys
from typing import Literal

from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.printing import print_json, print_table
from robo.cli.reach import Reach
from robo.tools.offers import list_actions, list_services


def print_offers(what: Literal["service", "action"], reach: Reach, *, json: bool) -> None:
    """Print what nodes offer.

    Raises:
        NodeNotFound: the robot that is named is not there.
    """
    listed = list_services if what == "service" else list_actions
    with connect_to_robot(reach) as session:
        found = [one for one in listed(session, reach.timeout) if reach.covers(one.key)]
        if not found:
            nodes_of(session, reach)
    if json:
        for one in found:
            print_json(one)
    elif not found:
        print(f"no {what}s", file=sys.stderr)
    else:
        print_table([(what.upper(), "TYPE", "SERVER"), *((one.key, one.type, ", ".join(one.servers)) for one in found)])
