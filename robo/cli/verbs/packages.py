"""`robo create`, `robo test` and `robo replay-test`: packages of one's own."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli.replay_words import ReplayWords
from robo.cli.tree import Section
from robo.cli.verb import verb

verbs = Section("Packages")


_TOPIC = "[NODE:]TOPIC:TYPE"


@verb(
    verbs,
    "create",
    "robo create rover",
    "robo create arm --node gripper --publishes grip:std/String",
    "robo create eye --node camera --subscribes scan:sensor/LaserScan --service look:std/Trigger --dry-run",
    "cd rover && robo create --node gripper --publishes grip:std/String",
    "cd rover && robo create --message Grip",
    short_help="Make a package of your own, or add to it.",
)
def create(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="What the new package is called.", show_default=False)
    ] = None,
    node: Annotated[
        list[str] | None, typer.Option("--node", metavar="NAME", help="A node of it; may be said several times.")
    ] = None,
    publishes: Annotated[
        list[str] | None,
        typer.Option("--publishes", metavar=_TOPIC, help="What the node publishes, for example scan:sensor/LaserScan."),
    ] = None,
    subscribes: Annotated[
        list[str] | None, typer.Option("--subscribes", metavar=_TOPIC, help="What it subscribes.")
    ] = None,
    service: Annotated[
        list[str] | None,
        typer.Option("--service", metavar="[NODE:]NAME:TYPE", help="What it serves, for example close:std/Trigger."),
    ] = None,
    message: Annotated[
        list[str] | None, typer.Option("--message", metavar="NAME", help="A message type of it.")
    ] = None,
    license: Annotated[  # noqa: A002
        str | None,
        typer.Option(
            "--license",
            metavar="SPDX",
            help="Its license, for example MIT; with its text where robo has it.",
            show_default=False,
        ),
    ] = None,
    description: Annotated[
        str | None, typer.Option("--description", metavar="TEXT", help="What it is, in a line.", show_default=False)
    ] = None,
    code_only: Annotated[
        bool, typer.Option("--code-only", help="Within a package: leave its manifest and parameter file as they are.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the files and write nothing.")] = False,
) -> None:
    """Make a package of your own in a new folder: nodes, messages, manifest, parameters, tests, container.

    Within a package, without NAME, it adds nodes and messages: code, tests, and lines in the manifest and in the
    parameter file. Lines that are there stay as they are.

    Called without any words, it asks. Without --node a new package gets a node `talker` that publishes a text. Several
    nodes may have topics: write gripper:grip:std/String. Nothing is overwritten.
    """
    from robo.cli.views.create import run_create
    from robo.create.asked import Asked

    asked = Asked(
        nodes=tuple(node or ()),
        publishes=tuple(publishes or ()),
        subscribes=tuple(subscribes or ()),
        services=tuple(service or ()),
        messages=tuple(message or ()),
        license=license,
        description=description,
    )
    run_create(name, asked, dry_run=dry_run, code_only=code_only)


@verb(
    verbs,
    "test",
    "robo test",
    "robo test . --junit results.xml",
    "robo test -- -k gripper -x",
    "robo test --json | jq '.packages[].failed'",
    short_help="Run the tests of packages, and sum them up.",
)
def run_tests_of(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PATH] [-- PYTEST ARGUMENTS]",
            help="A package, or a folder with packages; by default this one.",
            show_default=False,
        ),
    ] = None,
    junit: Annotated[
        Path | None, typer.Option("--junit", metavar="FILE", help="Write a report of all packages, as JUnit has it.")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the summary as JSON; what pytest prints goes to stderr.")
    ] = False,
) -> int:
    """Run the tests of a package with pytest, or of each package below a folder, and sum them up.

    A package is a folder with a `pyproject.toml`. What stands after `--` is for pytest.

    Exit code: 0 all tests passed, 1 one did not, or could not be run, 2 words that make no sense.
    """
    from robo.cli.views.test import run_tests

    return run_tests(words or [], junit=junit, json=json)


@verb(
    verbs,
    "replay-test",
    "robo replay-test drive.mcap --node position_tracker",
    "robo replay-test drive.mcap demo:=none --node tracking --manifest robot.yaml",
    "robo replay-test drive.mcap --node robo_services.position_tracker --ignore z --runs 3",
    "robo replay-test drive.mcap --node position_tracker --tolerances tolerances.yaml --plot plots",
    "robo replay-test drive.mcap --node position_tracker --accept -o reference.mcap",
    "robo replay-test drive.mcap --node position_tracker --json | jq .verdict",
    short_help="Replay a recording to nodes, and compare what they say now.",
)
def replay_test(request: ReplayWords) -> int:
    """Feed recorded inputs to nodes as they are now, in lock step, and compare what they say with the recording.

    A node is named as in the manifest (position_tracker, /r1/position_tracker, or a group of it), or by its module. It
    gets recorded messages at their recorded times, and all is run more than once: a node that says something
    else in each run is told apart from one that has changed. Without tolerances all is compared bit for bit.
    NAME:=VALUE are arguments of the manifest.

    Exit code: 0 as recorded, or accepted, 1 something differs, is not deterministic or failed, 2 words that make no
    sense, or a file that cannot be read, 130 Ctrl-C.
    """
    from robo.cli.views.replay_test import run_replay_test

    return run_replay_test(request)


verbs.group("batch", "Run many recordings and parameters at once, on Ray")
