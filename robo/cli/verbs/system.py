"""The running system and the machine it runs on: groups of verbs, and `robo top`, `graph`, `net` and `doctor`."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import HowThemed, Json, JsonLines, Theme
from robo.cli.reach import Reach
from robo.cli.tree import Section
from robo.cli.verb import verb

verbs = Section("Running system")
verbs.group("topic", "Topics")
verbs.group("node", "Nodes")
verbs.group("param", "Parameters of running nodes")
verbs.group("service", "Services of nodes, and robots as services of systemd")
verbs.group("action", "Actions: goals with feedback and a result")
verbs.group("lifecycle", "States of managed nodes")
verbs.group("tf", "Coordinate frames: where they stand, and who says so")
verbs.group("bag", "Recordings: made, played, looked at, changed")
verbs.group("bridge", "Other systems, by their own protocols")
verbs.group("view", "Viewers of others")
verbs.group("interface", "Types of messages, services and actions")
verbs.group("pkg", "Packages of nodes, messages and manifests")


@verb(
    verbs,
    "top",
    "robo top",
    "robo top --robot-name r1",
    "robo top --once --json | jq '.topics[] | select(.stale)'",
    short_help="Watch nodes and topics live: cpu, memory, rates, age, loss.",
)
def top(
    reach: Reach,
    once: Annotated[bool, typer.Option("--once", help="Measure once, print, end.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON, an object for each look.")] = False,
    interval: Annotated[float, typer.Option("--interval", metavar="S", help="How long to measure.", min=0.2)] = 1.0,
) -> None:
    """Watch nodes and topics live, until Ctrl-C or q.

    Nodes with state, processor, memory and restarts; topics with rate, age of the last message (red when it is
    stale: far older than the topic's own pace), bandwidth and loss. It receives every topic of the robot that is
    named, or of all.
    """
    from robo.cli.views.top import watch

    watch(reach, once=once, json=json, interval=interval)


@verb(
    verbs,
    "dashboard",
    "robo dashboard",
    "robo dashboard --listen 127.0.0.1:0 --json",
    "robo dashboard --listen 0.0.0.0:8080 --name r1.local",
    short_help="Show and drive robots by a page in the browser.",
)
def dashboard(
    reach: Reach,
    listen: Annotated[
        str, typer.Option("--listen", metavar="HOST:PORT", help="Where the page is; port 0 is any free one.")
    ] = "127.0.0.1:8080",
    token_file: Annotated[
        Path | None,
        typer.Option(
            "--token-file", metavar="FILE", help="A line with the token to drive, one to look; else they are made up."
        ),
    ] = None,
    names: Annotated[
        list[str] | None, typer.Option("--name", metavar="HOST", help="A name by which the page may be called.")
    ] = None,
    json: Json = False,
) -> None:
    """Show and drive robots by a page in the browser, until Ctrl-C.

    The page has everything with it and asks no other host for anything. By default it is for this machine alone; at
    another address who opens it needs a token, which is printed with the address. It drives by `cmd_vel_dashboard`, an
    input of the robot's mux: what the robot itself forbids stays forbidden.
    """
    from robo.cli.views.dashboard import serve

    serve(reach, listen=listen, token_file=token_file, names=names or [], json=json)


@verb(
    verbs,
    "map",
    "robo map drive.mcap -o drive.svg",
    "robo map run.log.gz -o run.png --theme dark",
    "robo map drive.mcap -o drive.svg --json | jq .length",
    short_help="Draw the way of a recorded robot, and what its lasers hit.",
)
def map_(
    recording: Annotated[
        str,
        typer.Argument(
            metavar="BAG",
            help="A recording, or a log of CARMEN, plain or gzip.",
            autocompletion=completion.recordings,
        ),
    ],
    output: Annotated[
        str,
        typer.Option("-o", "--output", metavar="FILE", help="The picture: .svg or .png; - prints SVG."),
    ],
    robot_name: Annotated[
        str | None, typer.Option("--robot-name", metavar="NAME", help="Whose way.", show_default=False)
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option("--frame", metavar="FRAME", help="In which all is drawn; else map, or odom.", show_default=False),
    ] = None,
    corrected: Annotated[
        bool, typer.Option("--corrected", help="By the poses that a mapping tool has written into a log of CARMEN.")
    ] = False,
    theme: HowThemed = Theme.AUTO,
    json: Json = False,
) -> None:
    """Draw the way of a recorded robot, and what its lasers hit, as a picture with a scale.

    Poses are those of the transforms, or of the odometry where there are none. What is hit often is dark; a cell is
    0.05 m, or larger where the picture would have too many. Auto is light in a PNG. JSON: file, scans, left_out
    (scans), malformed (messages, lines), points, length (m), frame, resolution (m).
    """
    from robo.cli.views.map import draw_map
    from robo.recording.map.sources import Wanted

    draw_map(recording, output, Wanted(robot_name, frame, corrected), theme.value, json=json)


@verb(
    verbs,
    "graph",
    "robo graph",
    "robo graph --hide-system --svg graph.svg",
    "robo graph --robot-name r1 --hide-system --format dot | dot -Tsvg > r1.svg",
    "robo graph --format json | jq '.topics[] | select(.problems != [])'",
    short_help="Draw nodes, topics and services as they run.",
)
def graph(
    reach: Reach,
    form: Annotated[
        str | None,
        typer.Option("--format", metavar="FORM", help="text (the default), mermaid, dot or json.", show_default=False),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="As --format json.")] = False,
    hide_system: Annotated[
        bool, typer.Option("--hide-system", help="Leave out log, parameter_events, diagnostics and clock.")
    ] = False,
    svg: Annotated[
        Path | None,
        typer.Option(
            "--svg", metavar="FILE", help="A picture in this file rather than words; - prints it.", show_default=False
        ),
    ] = None,
    theme: HowThemed = Theme.AUTO,
) -> None:
    """Draw nodes, topics and services as they run; dead ends and type clashes are marked.

    `robo check MANIFEST --graph FORM` draws the same of a manifest.
    """
    from robo.cli.views.graph import print_graph

    print_graph(reach, form="json" if json else form, hide_system=hide_system, svg=svg, theme=theme.value)


@verb(
    verbs,
    "net",
    "robo net",
    "robo net --json",
    "robo net position_tracker safety_monitor",
    short_help="Show the Zenoh network, and why two nodes do not see each other.",
)
def net(
    reach: Reach,
    nodes: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NODE NODE]", help="Two nodes that should see each other.", autocompletion=completion.nodes
        ),
    ] = None,
    json: Json = False,
) -> int:
    """Show what this machine sees of the Zenoh network: routers, where they listen, who is linked, latency.

    With two nodes: whether they see each other, and if not, why.

    Exit code: 0 fine, 1 something is wrong, 2 words that make no sense.
    """
    from robo.cli.views.net import print_network

    return print_network(nodes or [], reach, json=json)


@verb(
    verbs,
    "doctor",
    "robo doctor",
    "robo doctor --kill-test",
    "robo doctor --ask-ports",
    "robo doctor --json",
    short_help="Check this machine.",
)
def doctor(
    reach: Reach,
    kill_test: Annotated[
        bool, typer.Option("--kill-test", help="Start a robot, kill -9 its supervisor, and look whether all is gone.")
    ] = False,
    ask_ports: Annotated[
        bool,
        typer.Option(
            "--ask-ports",
            help="Ask each serial port that nobody has open for a base's encoders; whatever is there gets these bytes.",
        ),
    ] = False,
    json: JsonLines = False,
) -> int:
    """Check this machine: Python, packages, ports, multicast, router, clock, permissions, leftovers, serial ports.

    Exit code: 0 all is well, 1 something has to be mended.
    """
    from robo.cli.views.doctor import examine

    return examine(kill_test=kill_test, ask_ports=ask_ports, json=json, connect=reach.connect)
