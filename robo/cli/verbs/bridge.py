"""`robo bridge`: other systems, by their own protocols."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli.options import Json, JsonLines
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()


@verb(
    verbs,
    "foxglove",
    "robo bridge foxglove",
    "robo bridge foxglove --robot-name r1",
    "robo bridge foxglove --listen 127.0.0.1:0 --json",
    "robo bridge foxglove --listen 0.0.0.0:8765",
    "robo bridge foxglove --look",
    "robo bridge foxglove --layout lichtblick --robot-name r1 > r1.json",
    short_help="Serve Foxglove and Lichtblick, live.",
)
def foxglove(
    reach: Reach,
    listen: Annotated[
        str, typer.Option("--listen", metavar="HOST:PORT", help="Where viewers connect; port 0 is any free one.")
    ] = "127.0.0.1:8765",
    token_file: Annotated[
        Path | None,
        typer.Option(
            "--token-file",
            metavar="FILE",
            help="A line with the token to drive, and one to look; else they are made up.",
        ),
    ] = None,
    without_token: Annotated[
        bool, typer.Option("--open", help="Ask for no token: whoever reaches the port drives the robot.")
    ] = False,
    look: Annotated[
        bool,
        typer.Option("--look", help="Let nobody do more than look, whatever their token: nothing is driven or set."),
    ] = False,
    origins: Annotated[
        list[str] | None,
        typer.Option(
            "--origin", metavar="URL", help="A page that is a viewer, such as https://viewer.example; * is any."
        ),
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(
            "--layout", metavar="VIEWER", help="Print a layout for foxglove or lichtblick, and serve nothing."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Serve Foxglove and Lichtblick, live, until Ctrl-C.

    Topics, services, parameters, what viewers publish, the graph of nodes, the clock, and the controls of `robo bag
    play`. It receives what a viewer shows and nothing else; a viewer that is slow gets the newest, and holds up nobody.

    The protocol has no login. By default it is for this machine alone; at another address who connects needs a token,
    which is a part of the address that is printed. It travels unencrypted: `ssh -L 8765:127.0.0.1:8765 ROBOT` is safer.
    """
    from robo.cli.views.bridge import Access, print_layout, serve

    if layout is not None:
        print_layout(layout, reach)
        return
    access = Access(token_file, without_token, tuple(origins or ()), look)
    serve(reach, listen=listen, access=access, json=json)


@verb(
    verbs,
    "ros2",
    "robo bridge ros2 --robot-name r1",
    "robo bridge ros2 --robot-name r1 --topic odom=/odom --topic cmd_vel_key=/cmd_vel,from_ros,depth=1",
    "robo bridge ros2 --robot-name r1 --domain 3 --parameters read --json",
    "robo bridge ros2 --robot-name r1 --service 'safety_monitor/*=/safety/*'",
    short_help="Let ROS 2 see a robot, and a robot ROS 2.",
)
def ros2(
    reach: Reach,
    domain: Annotated[int, typer.Option("--domain", help="ROS_DOMAIN_ID of the graph.", min=0, max=232)] = 0,
    ros_connect: Annotated[
        str, typer.Option("--ros-connect", metavar="ENDPOINT", help="ROS's router: rmw_zenohd, or a robot's.")
    ] = "tcp/localhost:7447",
    topics: Annotated[
        list[str] | None,
        typer.Option("--topic", metavar="NAME[=ROS][,WORD...]", help="A topic that crosses; without, all go to ROS."),
    ] = None,
    services: Annotated[
        list[str] | None,
        typer.Option("--service", metavar="NAME[=ROS][,WORD...]", help="A service; without, ROS may call all."),
    ] = None,
    actions: Annotated[
        list[str] | None,
        typer.Option("--action", metavar="NAME[=ROS][,WORD...]", help="An action; without, ROS may use all."),
    ] = None,
    parameters: Annotated[
        str, typer.Option("--parameters", metavar="WORD", help="What ROS may do with them: none, read or write.")
    ] = "write",
    rosout: Annotated[bool, typer.Option("--rosout/--no-rosout", help="Whether the log goes to /rosout.")] = True,
    json: JsonLines = False,
) -> None:
    """Connect a robot with a graph of ROS 2 over the wire of rmw_zenoh, until Ctrl-C. Nothing of ROS is needed.

    ROS's tools and nodes see the robot's nodes, topics, services, actions and parameters as their own. What comes from
    ROS is said: NAME=ROS,from_ros, or both for either direction. Names are within the robot; * and ** match. Other
    words are reliable, best_effort, volatile, transient_local, depth=N and type=GROUP/TYPE.

    In a manifest, `bridges: {ros2: {...}}` does the same, supervised.
    """
    from robo.cli.views.bridge_ros2 import Wanted, connect

    wanted = Wanted(domain, ros_connect, topics, services, actions, parameters, rosout)
    connect(reach, wanted, json=json)
