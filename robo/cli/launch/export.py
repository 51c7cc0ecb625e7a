"""`robo export`: a manifest in the forms of other systems."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from robo.cli.launch.up import DEFAULT_MANIFEST, manifest_file
from robo.cli.printing import note
from robo.errors import UsageError
from robo.export.compose import dockerfile
from robo.export.compose import file as compose
from robo.export.placeholders import Placeholders
from robo.launch import resolve
from robo.launch.faults import ManifestFaults
from robo.launch.find import names_manifest
from robo.launch.plan import ProcessPlan
from robo.launch.resolve import Resolution
from robo.launch.substitution import Word
from robo.parameters.words import sorted_out

ROBOT_VARIABLE = "ROBOT_NAME"


def export_compose(words: Sequence[str], *, robot: str | None, output: Path | None, keeper: bool = False) -> None:
    """Print the Compose file of a manifest, or write it.

    Args:
        words: the manifest, and its arguments.
        robot: its name, if it is not to be a variable.
        output: where to write it.
        keeper: with a profile for the container that starts killed ones again.

    Raises:
        ManifestError: the manifest has mistakes.
        UsageError: the words make no sense, or the file cannot be written.
    """
    files, values = sorted_out(words)
    if len(files) > 1 or not all(map(names_manifest, files)):
        raise UsageError("name one manifest, and arguments as name:=value")
    given = {name: Word(value) for name, value in values.items()}
    file = manifest_file(files[0] if files else DEFAULT_MANIFEST)
    names = Placeholders()
    if robot is None:
        robot = names.word(ROBOT_VARIABLE, _resolved(file, given, None, names).plan.robot)
    base = _resolved(file, given, robot, names)
    more = _profiles(file, given, robot, base, names)
    folder = output.parent if output is not None else Path.cwd()
    made_by = " ".join(["robo export compose", *words, *(["--keeper"] if keeper else [])])
    recipe = compose.context(folder) / "Dockerfile"
    build = recipe.is_file()
    image = dockerfile.image_for(recipe) if build else dockerfile.IMAGE
    text = compose.export(
        base.plan, more, names, folder=folder, made_by=made_by, image=image, build=build, keeper=keeper
    )
    if not build:
        note(
            f"there is no {recipe}: the file builds no image, it takes {image} or what ROBO_IMAGE names. "
            "For nodes of your own, `robo export dockerfile > Dockerfile` and export again"
        )
    if output is None:
        sys.stdout.write(text)
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{output} cannot be written: {error.strerror}") from None


def export_dockerfile() -> None:
    """Print a Dockerfile for the package of the current folder."""
    sys.stdout.write(dockerfile.TEXT)


def _resolved(file: Path, given: Mapping[str, object], robot: str | None, names: Placeholders) -> Resolution:
    found = resolve.resolve(file, given, robot=robot, environment=names.environment)
    if found.problems:
        raise ManifestFaults(found.problems)
    return found


def _profiles(
    file: Path, given: Mapping[str, object], robot: str, base: Resolution, names: Placeholders
) -> dict[str, list[ProcessPlan]]:
    """What each argument that is false by default adds when it is true, where it changes nothing else."""
    always = {process.full_name: process for process in base.plan.processes}
    found: dict[str, list[ProcessPlan]] = {}
    for name, value in base.plan.arguments.items():
        if value is not False or name in given:
            continue
        switched = resolve.resolve(file, {**given, name: True}, robot=robot, environment=names.environment)
        processes = {process.full_name: process for process in switched.plan.processes}
        added = [process for full_name, process in processes.items() if full_name not in always]
        if added and not switched.problems and all(processes.get(name) == process for name, process in always.items()):
            found[name] = added
    return found
