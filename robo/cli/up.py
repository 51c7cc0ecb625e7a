"""`robo up`: from words to a plan to a run."""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo import log
from robo.errors import UsageError
from robo.launch import arguments, faults, reader, resolve
from robo.launch.faults import ManifestFaults
from robo.launch.find import find_manifest
from robo.launch.plan import Plan, ProcessPlan
from robo.launch.substitution import Word
from robo.launch.values import Assignment
from robo.yaml_tree import Position, Problem

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
    if log_level is not None:
        log.level_of(log_level)
    file = find_manifest(name)
    if show_args:
        print(_args_json(file) if json else args_text(file))
        return 0
    if not dry_run:
        # Before node classes are looked at in a forked process, which then has Zenoh already.
        from robo.session import Network
        from robo.supervisor import supervisor
    found = resolve.resolve(
        file, given, robot=robot_name, groups=groups, parameters=[assignment(text) for text in parameters]
    )
    problems = found.problems
    if not dry_run:
        problems = (*problems, *_missing_programs(found.plan.processes, supervisor.search_path()))
    if problems:
        if json:
            print_json({"faults": faults.as_data(problems)})
            return 1
        raise ManifestFaults(problems)
    if found.loose:
        print(faults.as_notes(found.loose, "warning"), file=sys.stderr)
    if dry_run:
        if json:
            print_json(found.plan)
        else:
            print(plan_text(found.plan))
        return 0
    if not found.plan.processes:
        raise UsageError(f"{found.plan.manifest} starts nothing with these arguments")
    return supervisor.run(found.plan, Network.from_environment("router", connect, listen), log_level=log_level)


def split_words(words: Sequence[str]) -> tuple[str, list[str], dict[str, object]]:
    """Manifest, groups and arguments: `replay.yaml player log:=run.log`.

    Raises:
        UsageError: there are two manifests.
    """
    manifest: str | None = None
    groups: list[str] = []
    given: dict[str, object] = {}
    for word in words:
        name, assign, value = word.partition(":=")
        if assign:
            given[name] = Word(value)
        elif is_manifest(word):
            if manifest is not None:
                raise UsageError(f"two manifests: {manifest} and {word}; one run takes one (include joins several)")
            manifest = word
        else:
            groups.append(word)
    return manifest or DEFAULT_MANIFEST, groups, given


def is_manifest(word: str) -> bool:
    """Whether a word names a manifest, and no group: groups are named with `/` too."""
    return word.endswith((".yaml", ".yml")) or Path(word).is_file()


def assignment(text: str) -> Assignment:
    """`-p` of the command line.

    Raises:
        UsageError: it is none.
    """
    left, assign, value = text.partition(":=")
    if not (assign and left):
        raise UsageError(f"-p {text}: write NODE.NAME:=VALUE, for example velocity_controller.linear_velocity:=0.3")
    return Assignment(left, Word(value))


def print_json(value: object) -> None:
    """Data for programs, on a terminal easy to read too."""
    sys.stdout.buffer.write(msgspec.json.format(msgspec.json.encode(value)) + b"\n")
    sys.stdout.buffer.flush()


def _missing_programs(processes: Sequence[ProcessPlan], search: str) -> list[Problem]:
    """Commands that are not there: better said before the rest of the robot runs."""
    return [
        Problem(_position(process.source), f"{process.full_name}: there is no program {process.command[0]!r}")
        for process in processes
        if process.command
        and shutil.which(
            str(Path(process.cwd or ".") / process.command[0]) if "/" in process.command[0] else process.command[0],
            path=process.env.get("PATH", search),
        )
        is None
    ]


def _position(source: str) -> Position:
    file, line, column = source.rsplit(":", 2)
    return Position(file, int(line), int(column))


# -- what people read ------------------------------------------------------------------------------


def _read_args(file: Path) -> tuple[str, list[dict[str, object]]]:
    problems: list[Problem] = []
    try:
        manifest = reader.read(file.read_text(encoding="utf-8"), file, problems)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"manifest {file} cannot be read: {error}") from None
    if manifest is None:
        raise ManifestFaults(problems)
    return manifest.description, [
        {
            "name": arg.name,
            "type": arg.type,
            "required": arg.default is None,
            "default": arg.default.value if arg.default is not None else None,
            "choices": [choice.value for choice in arg.choices],
            "description": arg.description,
        }
        for arg in manifest.args
    ]


def _args_json(file: Path) -> str:
    return msgspec.json.format(msgspec.json.encode(_read_args(file)[1])).decode()


def args_text(file: Path) -> str:
    """The arguments of a manifest, as `--show-args` lists them."""
    description, args = _read_args(file)
    if not any(arg["name"] == arguments.ROBOT_NAME for arg in args):
        about = {"type": "str", "required": False, "default": arguments.DEFAULT_ROBOT, "choices": []}
        args.insert(0, {"name": arguments.ROBOT_NAME, "description": "the robot's name", **about})
    lines = [f"{file}: {description}" if description else str(file), ""]
    width = max(len(str(arg["name"])) for arg in args)
    for arg in args:
        default = "required" if arg["required"] else f"default {arg['default']!r}"
        choices = f", one of {arg['choices']}" if arg["choices"] else ""
        lines.append(f"  {arg['name']:{width}}  {arg['type']}, {default}{choices}")
        if arg["description"]:
            lines.append(f"  {'':{width}}  {arg['description']}")
    return "\n".join([*lines, "", f"Give them as robo up {file.name} name:=value"])


def plan_text(plan: Plan) -> str:
    """The plan for people."""
    lines = [f"{plan.manifest}: {plan.description}", f"robot {plan.robot}"]
    lines += [f"  {name}:={value}" for name, value in plan.arguments.items() if name != arguments.ROBOT_NAME]
    for process in plan.processes:
        lines += _process_lines(process)
    for topic in plan.topics:
        rate = [f">= {topic.min_rate:g} Hz"] if topic.min_rate else []
        rate += [f"<= {topic.max_rate:g} Hz"] if topic.max_rate else []
        age = [f"never older than {topic.max_age:g} s"] if topic.max_age is not None else []
        outside = ["from outside"] if topic.external else []
        promise = ", ".join([*([topic.type] if topic.type else []), *rate, *age, *outside])
        lines.append(f"\ntopic {topic.key}: {promise}  # {topic.source}")
    return "\n".join(lines)


def _process_lines(process: ProcessPlan) -> list[str]:
    notes = [process.group] if process.group else []
    notes += [f"needs {', '.join(f'{name} {until}' for name, until in process.needs.items())}"] if process.needs else []
    notes += ["required"] if process.required else []
    lines = [f"\n{process.full_name}  ({'; '.join(notes)})"]
    if process.service is not None:
        lines.append(f"  service  {process.service}")
    lines.append(f"  command  {' '.join(map(_quoted, process.command))}")
    if process.cwd:
        lines.append(f"  cwd      {process.cwd}")
    for kind, entries in (("remap", process.remap), ("env", process.env)):
        joined = " -> " if kind == "remap" else "="
        lines += [
            f"  {kind:8} {left}{joined}{right}  # {process.sources[kind][left]}" for left, right in entries.items()
        ]
    width = max(map(len, process.parameters), default=0)
    lines += [
        f"  param    {name:{width}} = {said.value!r}  # {said.source}" for name, said in process.parameters.items()
    ]
    if process.ready.when == "log":
        lines.append(f"  ready    when its output holds {process.ready.pattern!r}")
    if process.restart.policy != "never":
        restart = process.restart
        lines.append(
            f"  restart  {restart.policy}, after {restart.delay:g} s, at most {restart.max} in {restart.window:g} s"
        )
    if process.log.output != "screen" or process.log.level:
        lines.append(f"  log      {process.log.output}, from level {process.log.level or 'info'}")
    if process.priority is not None:
        lines.append(f"  nice     {process.priority}")
    if process.cpus:
        lines.append(f"  cpus     {', '.join(map(str, process.cpus))}")
    return lines


def _quoted(word: str) -> str:
    import shlex

    return shlex.quote(word)
