"""`robo up`: from words to a plan to a run."""

import sys
from collections.abc import Callable
from pathlib import Path

from robo.cli.json_text import document
from robo.cli.launch import show
from robo.cli.launch.background import Starter, start_in_background
from robo.cli.launch.request import UpRequest
from robo.cli.launch.words import assignment, manifest_file, split_words
from robo.cli.options import words_of
from robo.errors import RoboError, UnreadableFile, UsageError
from robo.launch import arguments, faults, missing, reader, resolve
from robo.launch.check import unmatched
from robo.launch.faults import ManifestFaults
from robo.launch.plan import Plan
from robo.launch.resolve import Resolution
from robo.process import lean
from robo.supervisor.early import HeadStart, search_path
from robo.text import levels
from robo.text.files import read_text
from robo.text.tree import Problem


def run_up(request: UpRequest, begun: HeadStart | None) -> int:
    """Do what `robo up` was asked to.

    Args:
        request: its words and options.
        begun: what of the run has begun already.

    Returns:
        The exit code.

    Raises:
        RoboError: the words, the manifest or the network are wrong.
    """
    name, groups, given = split_words(request.words or ())
    _check_options(request)
    file = manifest_file(name)
    if request.show_args:
        return _show_arguments(file, name, request)
    if not request.dry_run:
        # Before node classes are looked at in a forked process, which then has Zenoh already.
        lean.import_asyncio()
        from robo.cli.launch.network import check_listeners, router_network, shared
        from robo.cli.secured import secure
        from robo.supervisor import supervisor

        secure(request.security, request.robot_name or "")
        network = router_network(request.listen or (), request.connect or (), request.config)
        check_listeners(network)
    parameters = [assignment(text) for text in request.param or ()]

    def read() -> Resolution:
        robot, host = request.robot_name, request.host
        return resolve.resolve(file, given, robot=robot, groups=groups, parameters=parameters, host=host)

    found = read()
    problems = found.problems
    if not request.dry_run:
        absent = (*missing.programs(found, search_path()), *missing.for_nodes(found), *missing.files(found))
        problems = (*problems, *absent)
    if problems:
        return _refuse(problems, request)
    warnings = [*found.loose, *found.warnings, *(problem for problem, _ in unmatched(found))]
    if warnings:
        print(faults.as_notes(warnings, "warning"), file=sys.stderr)
    if request.dry_run:
        print(document(show.plan_data(found.plan)) if request.json else show.plan_text(found.plan))
        return 0
    if not found.plan.processes:
        raise UsageError(f"{found.plan.manifest} starts nothing with these arguments")
    if request.share:
        network = shared(network, found.plan.robot, [process.namespace for process in found.plan.processes])
    if request.detach:
        return _start_in_background(request, found.plan.robot)
    starter = Starter.from_environment()
    options = supervisor.RunOptions(
        log_level=request.log_level,
        timing=request.timing,
        reload=_reading_again(read) if request.watch else None,
        notify=starter.notify if starter is not None else None,
        unread=starter.gone if starter is not None else None,
        begun=begun,
    )
    return supervisor.run(found.plan, network, options)


def _check_options(request: UpRequest) -> None:
    """Refuse what does not go together.

    Raises:
        UsageError: two options contradict each other, or there is no such level.
    """
    if request.json and not (request.dry_run or request.show_args):
        raise UsageError("--json goes with --dry-run or --show-args")
    if request.wait and not request.detach:
        raise UsageError("--wait goes with -d: in the foreground `robo up` tells when all is ready")
    if request.log_level is not None:
        levels.level_of(request.log_level)


def _show_arguments(file: Path, name: str, request: UpRequest) -> int:
    problems: list[Problem] = []
    try:
        manifest = reader.read(read_text(file), file, problems)
    except UnreadableFile as error:
        raise UsageError(f"manifest {file} cannot be read: {error}") from None
    if manifest is None:
        raise ManifestFaults(problems)
    found = arguments.describe(manifest)
    print(document(found) if request.json else show.arguments_text(file, name, manifest.description, found))
    return 0


def _refuse(problems: tuple[Problem, ...], request: UpRequest) -> int:
    if not request.json:
        raise ManifestFaults(problems)
    print(document({"faults": faults.as_data(problems)}))
    return faults.exit_code(problems)


def _start_in_background(request: UpRequest, robot: str) -> int:
    """Have another process do the same: here is known already that the manifest is fine, and which robot it is."""
    same = request._replace(robot_name=robot, detach=False, wait=False)
    return start_in_background([*(request.words or ()), *words_of(same)], robot, wait=request.wait)


def _reading_again(read: Callable[[], Resolution]) -> Callable[[], Plan | str]:
    """Reads the manifest once more: its plan, or its mistakes."""

    def read_again() -> Plan | str:
        try:
            again = read()
        except RoboError as error:
            return str(error)
        return faults.as_text(again.problems) if again.problems else again.plan

    return read_again
