"""`robo export`: a manifest in the forms of other systems."""

import shlex
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

from robo.cli.launch.words import DEFAULT_MANIFEST, manifest_file
from robo.cli.printing import note, write_file
from robo.cli.secured import keys_of_robot
from robo.errors import UsageError
from robo.export.compose import dockerfile
from robo.export.compose import file as compose
from robo.export.kubernetes import folder as kubernetes
from robo.export.kubernetes.folder import Wishes
from robo.export.profiles import Profiles, profiles_of
from robo.launch.find import names_manifest
from robo.launch.substitution import Word
from robo.parameters.words import sorted_out


def export_compose(
    words: Sequence[str], *, robot: str | None, output: Path | None, keeper: bool = False, security: str | None = None
) -> None:
    """Print the Compose file of a manifest, or write it.

    Args:
        words: the manifest, and its arguments.
        robot: its name, if it is not to be a variable.
        output: where to write it.
        keeper: with a profile for the container that starts killed ones again.
        security: the folder of the robot's name, or a keystore, for a secured network.

    Raises:
        ManifestError: the manifest has mistakes.
        SecurityError: the robot's keys are not there.
        UsageError: the words make no sense, or the file cannot be written.
    """
    profiles = _profiles_of(words, robot)
    keys = keys_of_robot(security, robot or "")
    options = [*(["--keeper"] if keeper else []), *(["--security", security or str(keys)] if keys else [])]
    folder = output.parent if output is not None else Path.cwd()
    recipe = compose.context(folder) / "Dockerfile"
    build = recipe.is_file()
    image = dockerfile.image_for(recipe) if build else dockerfile.IMAGE
    text = compose.export(
        profiles,
        folder=folder,
        made_by=" ".join(["robo export compose", *words, *options]),
        image=image,
        build=build,
        keeper=keeper,
        keys=keys,
    )
    if keys is not None and (owner := keys.stat().st_uid) != compose.USER:
        note(
            f"the keys in {keys} are of user {owner}, and have to be of user {compose.USER}, as whom containers run: "
            f"`sudo chown -R {compose.USER}` a copy of them, and name that"
        )
    if not build:
        note(
            f"there is no {recipe}: the file builds no image, it takes {image} or what ROBO_IMAGE names. "
            "For nodes of your own, `robo export dockerfile > Dockerfile` and export again"
        )
    if output is None:
        sys.stdout.write(text)
    else:
        write_file(text, output)


def export_kubernetes(words: Sequence[str], wishes: Wishes, *, robot: str | None, output: Path | None) -> None:
    """Print Kubernetes' objects of a manifest, or write them as a folder with a base and an overlay.

    Args:
        words: the manifest, and its arguments.
        wishes: how they are to be.
        robot: its name, if it is not to be a variable.
        output: the folder.

    Raises:
        ManifestError: the manifest has mistakes.
        UsageError: the words make no sense, or a file cannot be written.
    """
    profiles = _profiles_of(words, robot, wishes.secrets)
    made_by = " ".join(f"robo export kubernetes {shlex.join([*words, *wishes.words(robot)])}".split())
    found = kubernetes.export(profiles, wishes, folder=output or Path.cwd(), made_by=made_by)
    for left_out in found.left_out:
        note(f"left out, Kubernetes has no word for it: {left_out}")
    for name in found.unknown:
        note(f"say what {name} is: a key of the ConfigMap `settings`, or --secret {name}")
    if found.secret:
        literals = " ".join(f"--from-literal={name}=…" for name in found.secret)
        note(f"it needs a Secret: kubectl -n {found.namespace} create secret generic settings {literals}")
    if output is None:
        sys.stdout.write("---\n".join(found.objects))
        return
    for path, text in found.files.items():
        try:
            (output / path).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"the folder {(output / path).parent} cannot be made: {error.strerror}") from None
        write_file(text, output / path)
    note(f"kubectl apply -k {output}/base, or {output}/overlays/example for a robot of its own")


def export_dockerfile() -> None:
    """Print a Dockerfile for the package of the current folder."""
    sys.stdout.write(dockerfile.TEXT)


def _profiles_of(words: Sequence[str], robot: str | None, secrets: Collection[str] = ()) -> Profiles:
    files, values = sorted_out(words)
    if len(files) > 1 or not all(map(names_manifest, files)):
        raise UsageError("name one manifest, and arguments as name:=value")
    given = {name: Word(value) for name, value in values.items()}
    return profiles_of(manifest_file(files[0] if files else DEFAULT_MANIFEST), given, robot, secrets)
