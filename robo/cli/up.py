"""`robo up`: from words to a plan to a run."""

import sys
from collections.abc import Sequence

import msgspec

from robo import log
from robo.errors import UsageError
from robo.launch import plan as planning
from robo.launch.find import find_manifest
from robo.launch.plan import Plan
from robo.parameters import parse_value
from robo.session import Network

DEFAULT_MANIFEST = "robot.yaml"


def run_up(
    words: Sequence[str],
    *,
    robot_name: str | None,
    dry_run: bool,
    json: bool,
    connect: Sequence[str],
    listen: Sequence[str],
    log_level: str | None,
) -> int:
    """Do what `robo up` was asked to.

    Returns:
        The exit code.

    Raises:
        RoboError: the words, the manifest or the network are wrong.
    """
    manifest, groups, arguments = split_words(words)
    if log_level is not None:
        log.level_of(log_level)
    plan = planning.load(find_manifest(manifest), arguments, robot=robot_name, groups=groups)
    if dry_run:
        if json:
            sys.stdout.buffer.write(msgspec.json.format(msgspec.json.encode(plan)) + b"\n")
        else:
            print(plan_text(plan))
        return 0
    if not plan.processes:
        raise UsageError(f"{plan.manifest} starts nothing with these arguments")
    from robo.supervisor import supervisor

    return supervisor.run(plan, Network.from_environment("router", connect, listen), log_level=log_level)


def split_words(words: Sequence[str]) -> tuple[str, list[str], dict[str, object]]:
    """Manifest, groups and arguments: `replay.yaml player log:=run.log`.

    Raises:
        UsageError: there are two manifests.
    """
    manifest: str | None = None
    groups: list[str] = []
    arguments: dict[str, object] = {}
    for word in words:
        name, assign, value = word.partition(":=")
        if assign:
            arguments[name] = parse_value(value)
        elif word.endswith((".yaml", ".yml")) or "/" in word:
            if manifest is not None:
                raise UsageError(f"two manifests: {manifest} and {word}; one run takes one (include joins several)")
            manifest = word
        else:
            groups.append(word)
    return manifest or DEFAULT_MANIFEST, groups, arguments


def plan_text(plan: Plan) -> str:
    """The plan for people."""
    lines = [f"{plan.manifest}: {plan.description}", f"robot {plan.robot}"]
    lines += [f"  {name}:={value}" for name, value in plan.arguments.items() if name != "robot_name"]
    for process in plan.processes:
        notes = [f"needs {', '.join(process.needs)}"] if process.needs else []
        notes += ["required"] if process.required else []
        lines.append(f"\n{process.full_name}  ({process.group}{'; ' if notes else ''}{'; '.join(notes)})")
        lines.append(f"  service  {process.service}")
        lines += [f"  remap    {old} -> {new}" for old, new in process.remap.items()]
        lines += [f"  env      {name}={value}" for name, value in process.env.items()]
        width = max(map(len, process.parameters), default=0)
        lines += [
            f"  param    {name:{width}} = {said.value!r}  # {said.source}" for name, said in process.parameters.items()
        ]
    return "\n".join(lines)
