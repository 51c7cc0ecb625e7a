"""`robo up`: from words to a plan to a run."""

import sys
from collections.abc import Sequence
from pathlib import Path

from robo.cli.json_text import document
from robo.cli.launch import show
from robo.cli.launch.background import notify_starter, start_in_background
from robo.errors import ManifestError, RoboError, UnreadableFile, UsageError
from robo.launch import arguments, faults, missing, reader, resolve
from robo.launch.check import unmatched
from robo.launch.faults import ManifestFaults
from robo.launch.find import find_manifest, names_manifest
from robo.launch.plan import Plan
from robo.launch.resolve import Resolution
from robo.launch.substitution import Word
from robo.launch.values import Assignment
from robo.parameters.words import sides_of, sorted_out
from robo.process import lean
from robo.supervisor.early import HeadStart, search_path
from robo.text import levels
from robo.text.files import read_text
from robo.text.tree import Problem

DEFAULT_MANIFEST = "robot.yaml"


def run_up(
    words: Sequence[str],
    *,
    robot_name: str | None,
    parameters: Sequence[str],
    dry_run: bool,
    show_args: bool,
    json: bool,
    connect: Sequence[str],
    listen: Sequence[str],
    log_level: str | None,
    timing: bool,
    watch: bool,
    host: str | None,
    config: Path | None,
    detach: bool,
    wait: bool,
    begun: HeadStart | None,
) -> int:
    """Do what `robo up` was asked to.

    Returns:
        The exit code.

    Raises:
        RoboError: the words, the manifest or the network are wrong.
    """
    name, groups, given = split_words(words)
    if json and not (dry_run or show_args):
        raise UsageError("--json goes with --dry-run or --show-args")
    if wait and not detach:
        raise UsageError("--wait goes with -d: in the foreground `robo up` tells when all is ready")
    if log_level is not None:
        levels.level_of(log_level)
    file = manifest_file(name)
    if show_args:
        description, args = _arguments_of(file)
        if json:
            print(document(args))
        else:
            print(show.arguments_text(file, name, description, args))
        return 0
    if not dry_run:
        # Before node classes are looked at in a forked process, which then has Zenoh already.
        lean.import_asyncio()
        from robo.cli.launch.network import router_network
        from robo.supervisor import supervisor

        network = router_network(listen, connect, config)

    assignments = [assignment(text) for text in parameters]

    def read() -> Resolution:
        return resolve.resolve(file, given, robot=robot_name, groups=groups, parameters=assignments, host=host)

    found = read()
    problems = found.problems
    if not dry_run:
        problems = (*problems, *missing.programs(found, search_path()), *missing.files(found))
    if problems:
        if json:
            print(document({"faults": faults.as_data(problems)}))
            return faults.exit_code(problems)
        raise ManifestFaults(problems)
    warnings = [*found.loose, *found.warnings, *(problem for problem, _ in unmatched(found))]
    if warnings:
        print(faults.as_notes(warnings, "warning"), file=sys.stderr)
    if dry_run:
        if json:
            print(document(show.plan_data(found.plan)))
        else:
            print(show.plan_text(found.plan))
        return 0
    if not found.plan.processes:
        raise UsageError(f"{found.plan.manifest} starts nothing with these arguments")
    if detach:
        options = [f"--robot-name={found.plan.robot}"] + ["--timing"] * timing + ["--watch"] * watch
        options += [f"--param={text}" for text in parameters] + [f"--log-level={log_level}"] * (log_level is not None)
        options += [f"--host={host}"] * (host is not None)
        options += [f"--network-config={config}"] * (config is not None)
        options += [f"--connect={e}" for e in connect] + [f"--listen={e}" for e in listen]
        return start_in_background([*words, *options], found.plan.robot, wait=wait)

    def read_again() -> Plan | str:
        try:
            again = read()
        except RoboError as error:
            return str(error)
        return faults.as_text(again.problems) if again.problems else again.plan

    run_options = supervisor.Options(
        log_level=log_level,
        timing=timing,
        reload=read_again if watch else None,
        notify=notify_starter(),
        begun=begun,
    )
    return supervisor.run(found.plan, network, run_options)


def split_words(words: Sequence[str]) -> tuple[str, list[str], dict[str, object]]:
    """Manifest, groups and arguments: `replay.yaml player log:=run.log`.

    Raises:
        UsageError: there are two manifests.
    """
    manifest: str | None = None
    groups: list[str] = []
    others, values = sorted_out(words)
    for word in others:
        if names_manifest(word):
            if manifest is not None:
                raise UsageError(f"two manifests: {manifest} and {word}; one run takes one (include joins several)")
            manifest = word
        else:
            groups.append(word)
    return manifest or DEFAULT_MANIFEST, groups, {name: Word(value) for name, value in values.items()}


def manifest_file(word: str) -> Path:
    """The file of a manifest that a command line names.

    Raises:
        UsageError: there is none.
    """
    try:
        return find_manifest(word)
    except ManifestError as error:
        raise UsageError(str(error)) from None


def assignment(text: str) -> Assignment:
    """`-p` of the command line.

    Raises:
        UsageError: it is none.
    """
    left, value = sides_of(text) or ("", "")
    if not left:
        raise UsageError(f"-p {text}: write NODE.NAME:=VALUE, for example velocity_controller.linear_velocity:=0.3")
    return Assignment(left, Word(value))


def _arguments_of(file: Path) -> tuple[str, list[arguments.ArgumentInfo]]:
    problems: list[Problem] = []
    try:
        manifest = reader.read(read_text(file), file, problems)
    except UnreadableFile as error:
        raise UsageError(f"manifest {file} cannot be read: {error}") from None
    if manifest is None:
        raise ManifestFaults(problems)
    return manifest.description, arguments.describe(manifest)
