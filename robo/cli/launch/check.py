"""`robo check` and `robo schema`."""

import sys
from collections.abc import Sequence
from pathlib import Path

import robo_messages
from robo.cli.json_text import document
from robo.cli.launch.modules import check_nothing_hides_robo
from robo.cli.launch.words import manifest_file
from robo.errors import UsageError
from robo.launch import faults, missing, resolve
from robo.launch.check import Findings, check, ends_of
from robo.launch.find import names_manifest
from robo.launch.graph import graph_of
from robo.launch.schema import manifest_schema
from robo.launch.substitution import Word
from robo.parameters.words import sorted_out
from robo.supervisor.early import search_path
from robo.text.graph import FORMATS, draw
from robo.text.tree import Position, Problem


def run_check(words: Sequence[str], *, robot_name: str | None, json: bool, graph: str | None) -> int:
    """Check manifests.

    Returns:
        0 where they are fine, 1 where they have faults, 2 where the command line alone is at fault.

    Raises:
        UsageError: the words make no sense.
    """
    check_nothing_hides_robo()
    names, values = sorted_out(words)
    given: dict[str, object] = {name: Word(value) for name, value in values.items()}
    files: list[Path] = []
    for word in names:
        if not names_manifest(word):
            raise UsageError(f"{word!r} is no manifest and no name:=value")
        files.append(manifest_file(word))
    if not files:
        raise UsageError("name a manifest, for example robo check robot.yaml")
    if graph is not None and graph not in FORMATS:
        raise UsageError(f"--graph {graph}: use one of {', '.join(FORMATS)}")
    if graph is not None and (json or len(files) > 1):
        raise UsageError("--graph draws one manifest, and goes without --json; --graph json gives data")
    found: list[Problem] = []
    notes: list[Problem] = []
    for file in files:
        findings, drawing = _check_one(file, given, robot_name, graph)
        found += findings.faults
        notes += findings.notes
        if drawing is not None:
            print(drawing)
    if json:
        print(document({"faults": faults.as_data(found), "notes": faults.as_data(notes)}))
    else:
        _report(names, found, notes, to_stderr=graph is not None)
    return faults.exit_code(found) if found else 0


def _check_one(
    file: Path, given: dict[str, object], robot_name: str | None, graph: str | None
) -> tuple[Findings, str | None]:
    resolution = resolve.resolve(file, given, robot=robot_name, stand_ins=True)
    findings = check(resolution)
    # They may be there where the robot is.
    absent_here = [*missing.programs(resolution, search_path()), *missing.for_nodes(resolution)]
    findings = Findings(findings.faults, faults.in_order([*findings.notes, *absent_here]))
    absent = resolution.stood_in
    if absent:
        text = f"checked without {', '.join(absent)}; give {absent[0]}:=VALUE to check with it"
        note = Problem(Position(str(file), 1, 1), text)
        findings = Findings(findings.faults, (*findings.notes, note))
    return findings, draw(graph_of(resolution, ends_of(resolution)), graph) if graph is not None else None


def _report(files: Sequence[str], found: Sequence[Problem], notes: Sequence[Problem], *, to_stderr: bool) -> None:
    out = sys.stderr if to_stderr else sys.stdout
    if found:
        print(faults.as_text(found), file=out)
    if notes:
        print(faults.as_notes(notes, "note"), file=out)
    what = files[0] if len(files) == 1 else f"{len(files)} manifests"
    count = "fine" if not found else "1 fault" if len(found) == 1 else f"{len(found)} faults"
    more = "" if not notes else ", 1 note" if len(notes) == 1 else f", {len(notes)} notes"
    print(f"{what}: {count}{more}", file=out)


def print_schema(name: str) -> None:
    """The JSON Schema of manifests, or of a message type.

    Raises:
        UsageError: there is no such type.
    """
    if name == "manifest":
        schema: object = manifest_schema()
    else:
        try:
            schema = robo_messages.json_schema(name)
        except robo_messages.UnknownType as error:
            raise UsageError(f"{error.args[0]}; or write manifest") from None
    print(document(schema))
