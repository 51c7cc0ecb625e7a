"""`robo graph`: drawing what runs."""

from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.printing import amount, note, print_text
from robo.cli.reach import Reach
from robo.errors import UsageError
from robo.text import graph
from robo.text.suggestions import MOST_LISTED
from robo.text.terminal import escaped_json, visible
from robo.tools import graph as tools


def print_graph(reach: Reach, *, form: str, hide_system: bool) -> None:
    """Print the graph of the running system.

    Raises:
        UsageError: there is no such form.
        NodeNotFound: the robot that is named is not there.
    """
    if form not in graph.FORMATS:
        raise UsageError(f"--format {form}: use one of {', '.join(graph.FORMATS)}")
    with connect_to_robot(reach) as session:
        nodes_of(session, reach)
        found = tools.running(session, reach.timeout)
    if reach.namespace:
        found = tools.of_robot(found, reach.namespace)
    if hide_system:
        found = graph.without_system(found)
    drawing = graph.draw(found, form)
    print_text(escaped_json(drawing) if form == "json" else drawing)
    problems = [topic.key for topic in found.topics if topic.problems]
    problems += [served.key for served in (*found.services, *found.actions) if served.problems]
    if problems:
        more = ", …" if len(problems) > MOST_LISTED else ""
        shown = ", ".join(map(visible, problems[:MOST_LISTED]))
        note(f"{amount(len(problems), 'key')} to look at: {shown}{more}")
