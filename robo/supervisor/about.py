"""What a run tells of itself as a whole: of which version of robo it is, and of which files it was made."""

import hashlib
import time
from collections.abc import Iterable
from pathlib import Path

from robo.launch.plan import Plan
from robo.version import VERSION
from robo.wire import discovery
from robo.wire.reports import RunReport

_DIGITS = 12
"""Of a digest: enough to tell the manifests of a fleet from each other."""


def report(plan: Plan, run: str) -> RunReport:
    """What is told of a run that begins now."""
    return RunReport(
        robot=plan.robot,
        run=run,
        host=plan.host or discovery.hostname(),
        user=discovery.user(),
        version=VERSION,
        manifest=Path(plan.manifest).name,
        digest=digest_of(plan.files or (plan.manifest,)),
        since=time.time_ns(),
    )


def digest_of(files: Iterable[str]) -> str:
    """The beginning of a hash of files: of what they are called and what is in them, wherever they are.

    Empty where one cannot be read.
    """
    whole = hashlib.sha256()
    try:
        parts = sorted((Path(file).name, hashlib.sha256(Path(file).read_bytes()).digest()) for file in files)
    except OSError:
        return ""
    for name, content in parts:
        whole.update(f"{len(name)} {name} ".encode() + content)
    return whole.hexdigest()[:_DIGITS]
