"""The manifests of runs on this machine, as their logs name them."""

from collections.abc import Iterable
from pathlib import Path

import msgspec

from robo.machine.log_files import RunInfo
from robo.text.folders import log_base
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE

_MOST = 1_000_000
"""A larger file is no manifest, bytes."""


def manifests_of(runs: Iterable[str], base: Path | None = None) -> dict[str, bytes]:
    """The text of the manifest of each run, by robot and file name; runs of other machines and users have none here.

    Args:
        runs: their ids.
        base: where logs are; by default where this user's are.
    """
    wanted = frozenset(runs)
    found: dict[str, bytes] = {}
    for file in sorted((base or log_base()).glob("*/*/run.json")) if wanted else ():
        try:
            info = msgspec.json.decode(file.read_bytes(), type=readable(RunInfo))
            manifest = Path(info.manifest)
            if info.run in wanted and manifest.is_file() and manifest.stat().st_size <= _MOST:
                found[f"{info.robot}/{manifest.name}"] = manifest.read_bytes()
        except (OSError, *UNREADABLE):
            continue  # cut short, just being removed, or somebody else's
    return found
