"""What the words of a command line mean to a launch: manifests, groups, arguments, parameters."""

from collections.abc import Sequence
from pathlib import Path

from robo.errors import ManifestError, UsageError
from robo.launch.find import find_manifest, names_manifest
from robo.launch.substitution import Word
from robo.launch.values import Assignment
from robo.parameters.words import sides_of, sorted_out

DEFAULT_MANIFEST = "robot.yaml"


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
        UsageError: it is not a valid assignment.
    """
    left, value = sides_of(text) or ("", "")
    if not left:
        raise UsageError(f"-p {text}: write NODE.NAME:=VALUE, for example waypoint_follower.speed:=0.3")
    return Assignment(left, Word(value))
