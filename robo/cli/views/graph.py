"""`robo graph`: drawing what runs."""

from pathlib import Path

from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.printing import amount, note, print_line, print_text
from robo.cli.reach import Reach
from robo.cli.views.pictures import STANDARD, check_picture, check_theme, written
from robo.errors import UsageError
from robo.text import graph
from robo.text.graph_svg import graph_svg
from robo.text.suggestions import MOST_LISTED
from robo.text.svg import Theme
from robo.text.terminal import escaped_json, visible
from robo.tools import graph as tools


def print_graph(
    reach: Reach, *, form: str | None, hide_system: bool, svg: Path | None = None, theme: Theme = "auto"
) -> None:
    """Print the graph of the running system, or write it as a picture.

    Raises:
        UsageError: there is no such form, or words do not go together, or the picture cannot be written.
        NodeNotFound: the robot that is named is not there.
    """
    check_theme(theme, svg)
    if svg is not None:
        if form is not None:
            raise UsageError(f"--svg and --format {form}: say one of both")
        check_picture(str(svg), (".svg",))
    form = form or "text"
    if form not in graph.FORMATS:
        raise UsageError(f"--format {form}: use one of {', '.join(graph.FORMATS)}")
    with connect_to_robot(reach) as session:
        nodes_of(session, reach)
        found = tools.running(session, reach.timeout)
    if reach.namespace:
        found = tools.of_robot(found, reach.namespace)
    if hide_system:
        found = graph.without_system(found)
    if svg is not None:
        counts = f"{amount(len(found.nodes), 'node')}, {amount(len(found.topics), 'topic')}"
        written(graph_svg(found, f"{reach.namespace or 'what runs'}: {counts}", theme), str(svg))
        if str(svg) != STANDARD:
            print_line(visible(f"{svg}: {counts}"))
    else:
        drawing = graph.draw(found, form)
        print_text(escaped_json(drawing) if form == "json" else drawing)
    problems = [topic.key for topic in found.topics if topic.problems]
    problems += [served.key for served in (*found.services, *found.actions) if served.problems]
    if problems:
        more = ", …" if len(problems) > MOST_LISTED else ""
        shown = ", ".join(map(visible, problems[:MOST_LISTED]))
        note(f"{amount(len(problems), 'key')} to look at: {shown}{more}")
