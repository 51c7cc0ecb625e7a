"""`robo export`: a manifest in the form of another system."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.launch.service_request import ServiceRequest
from robo.cli.options import RobotName
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

Exported = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[MANIFEST] [NAME:=VALUE]...",
        help="What to export.",
        show_default=False,
        autocompletion=completion.manifests,
    ),
]


@verb(
    verbs,
    "compose",
    "robo export compose launch/mine.yaml > docker-compose.yml",
    "robo export compose launch/mine.yaml -o docker-compose.yml",
    "robo export compose robot.yaml --robot-name r1 --security security -o docker-compose.yml",
    "robo export compose robot.yaml use_sim:=false --robot-name r1",
)
def export_compose(
    words: Exported = None,
    robot_name: RobotName = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write it there.")] = None,
    keeper: Annotated[
        bool, typer.Option("--keeper", help="With a profile `keeper`: a container that starts killed ones again.")
    ] = False,
    security: Annotated[
        str | None,
        typer.Option(
            "--security",
            metavar="DIR",
            help="The robot's name on a secured network (or ROBO_SECURITY): others come by TLS.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Write a manifest as a Compose file: a router for each robot, a container for each process.

    The robot's name becomes ${ROBOT_NAME}, unless --robot-name says it; ${env:NAME} becomes ${NAME}. An argument
    that is false by default, and starts more processes when it is true, becomes a profile. No container holds the
    engine's socket, unless --keeper asks for a profile with one that does: see `robo keeper --help`.
    The Dockerfile of the current folder makes the image; where there is none the file builds nothing.
    """
    from robo.cli.launch.export import export_compose as write

    write(words or [], robot=robot_name, output=output, keeper=keeper, security=security)


@verb(
    verbs,
    "kubernetes",
    "robo export kubernetes robot.yaml -o k8s",
    "robo export kubernetes robot.yaml --robot-name r1 > r1.yaml",
    "robo export kubernetes robot.yaml --robot-name r1 --security r1-keys -o k8s",
    "robo export kubernetes robot.yaml --deployments --connect tcp/192.168.1.20:7447 -o k8s",
)
def export_kubernetes(
    words: Exported = None,
    robot_name: RobotName = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FOLDER", help="Write a base and an overlay there.")
    ] = None,
    image: Annotated[str, typer.Option("--image", metavar="NAME", help="What containers are made of.")] = "robo:latest",
    deployments: Annotated[
        bool, typer.Option("--deployments", help="A deployment for each process, in the place of one pod for all.")
    ] = False,
    connect: Annotated[
        list[str] | None,
        typer.Option("--connect", metavar="ENDPOINT", help="Another router that this robot's dials. May be repeated."),
    ] = None,
    secret: Annotated[
        list[str] | None,
        typer.Option("--secret", metavar="NAME", help="A variable of the manifest that a Secret has. May be repeated."),
    ] = None,
    security: Annotated[
        str,
        typer.Option("--security", metavar="SECRET", help="The Secret with the files of a name: others come by TLS."),
    ] = "",
) -> None:
    """Write a manifest as objects of Kubernetes: one pod for the robot, its router first, a container for each process.

    In the pod nodes meet by unix sockets and shared memory. With --deployments each process has a pod of its own, and
    they meet by the network: what runs beside a robot and not on it. Pods may do nothing that they need not (the level
    `restricted`); without -o all is printed, for `kubectl apply -f -`. The robot's name is in the ConfigMap `settings`,
    unless --robot-name says it; ${env:NAME} of the manifest too, and --secret NAME has it come from a Secret.

    With --security the router is a name on a secured network: `robo security bundle r1` makes the files, and `kubectl
    create secret generic r1-keys --from-file=r1/` the Secret.
    """
    from robo.cli.launch.export import export_kubernetes as write
    from robo.export.kubernetes.folder import Wishes

    wishes = Wishes(
        image, "deployments" if deployments else "pod", tuple(connect or ()), frozenset(secret or ()), security
    )
    write(words or [], wishes, robot=robot_name, output=output)


@verb(
    verbs,
    "systemd",
    "robo export systemd robot.yaml --robot-name r1 > robo-r1.service",
    "robo export systemd robot.yaml --robot-name r1 --device /dev/ttyUSB0 -o units",
    "robo export systemd robot.yaml --robot-name r1 --user",
)
def export_systemd(
    request: ServiceRequest,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FOLDER", help="Write the unit, and a file for its variables, there."),
    ] = None,
) -> None:
    """Write a manifest as a service of systemd, which starts the robot at boot and sees that it does not hang.

    Printed is what `robo service install` would install: its first lines say who it runs as and which files it needs.
    It runs what you run by hand: this Python, in this folder. It may do nothing that a robot need not, and use no
    device but those of --device.
    """
    from robo.cli.launch.systemd import export_systemd as write

    write(request, output)


@verb(verbs, "dockerfile", "robo export dockerfile > Dockerfile")
def export_dockerfile() -> None:
    """Print a Dockerfile for nodes of your own: robo's image with the Python package of the current folder."""
    from robo.cli.launch.export import export_dockerfile as write

    write()
