"""A plan, and the arguments of a manifest, for people to read."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from robo.launch.arguments import ROBOT_NAME, ArgumentInfo
from robo.launch.expression import as_text
from robo.launch.plan import LimitsPlan, Plan, ProcessPlan, ReadyPlan
from robo.text.sizes import in_short
from robo.wire.codec import jsonable


def arguments_text(file: Path, name: str, description: str, args: Sequence[ArgumentInfo]) -> str:
    """The arguments of a manifest, as `--show-args` lists them; `name` is how the command line called it."""
    lines = [f"{file}: {description}" if description else str(file), ""]
    width = max(len(arg.name) for arg in args)
    for arg in args:
        default = "required" if arg.required else f"default {as_text(arg.default) or 'empty'}"
        choices = f", one of {', '.join(map(as_text, arg.choices))}" if arg.choices else ""
        lines.append(f"  {arg.name:{width}}  {arg.type}, {default}{choices}")
        if arg.description:
            lines.append(f"  {'':{width}}  {arg.description}")
    return "\n".join([*lines, "", f"Give them as robo up {shlex.quote(name)} name:=value"])


def plan_data(plan: Plan) -> object:
    """The plan for programs, with the words that start each process."""
    data: dict[str, Any] = msgspec.to_builtins(plan)
    del data["files"]
    data["processes"] = list(map(_process_data, plan.processes))
    for topic, promised in zip(plan.topics, data["topics"], strict=True):
        promised["source"] = str(topic.source)
    return jsonable(data)


def _process_data(process: ProcessPlan) -> dict[str, Any]:
    printed = {
        "settings": {
            name: {"value": last.value, "source": last.source, "over": weaker}
            for name, (*weaker, last) in process.settings.items()
        },
        "sources": {
            what: {name: str(position) for name, position in positions.items()}
            for what, positions in process.sources.items()
        },
        "source": str(process.source),
    }
    data: dict[str, Any] = msgspec.to_builtins(msgspec.structs.asdict(process) | printed)
    renamed = {"parameters" if key == "settings" else key: value for key, value in data.items()}
    return renamed | {"command": process.command()}


def plan_text(plan: Plan) -> str:
    """The plan for people."""
    title = f"{plan.manifest}: {plan.description}" if plan.description else plan.manifest
    lines = [title, f"robot {plan.robot}"]
    lines += [f"  {name}:={as_text(value)}" for name, value in plan.arguments.items() if name != ROBOT_NAME]
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
    notes += ["waits in unconfigured"] if not process.autostart else []
    lines = [f"\n{process.full_name}  ({'; '.join(notes)})"]
    if process.service is not None:
        lines.append(f"  service  {process.service}")
    lines.append(f"  command  {shlex.join(process.command())}")
    if process.cwd:
        lines.append(f"  cwd      {process.cwd}")
    for kind, entries in (("remap", process.remap), ("env", process.env)):
        joined = " -> " if kind == "remap" else "="
        lines += [
            f"  {kind:8} {left}{joined}{right}  # {process.sources[kind][left]}" for left, right in entries.items()
        ]
    width = max(map(len, process.settings), default=0)
    lines += [
        f"  param    {name:{width}} = {last.value!r}  # {last.source}" for name, (*_, last) in process.settings.items()
    ]
    if conditions := ready_text(process.ready):
        lines.append(f"  ready    {conditions}")
    if process.restart.policy != "never":
        restart = process.restart
        lines.append(
            f"  restart  {restart.policy}, after {restart.delay:g} s, later up to {restart.max_delay:g} s;"
            f" degraded from {restart.max + 1} in {restart.window:g} s"
        )
    if process.log.output != "both" or process.log.level:
        lines.append(f"  log      {process.log.output}, from level {process.log.level or 'info'}")
    if process.priority is not None:
        lines.append(f"  nice     {process.priority}")
    if process.cpus:
        lines.append(f"  cpus     {', '.join(map(str, process.cpus))}")
    if process.limits:
        lines.append(f"  limits   {limits_text(process.limits)}")
    return lines


def limits_text(limits: LimitsPlan) -> str:
    """What a process may use at most."""
    memory = [f"memory {in_short(limits.memory)}"] if limits.memory is not None else []
    cpu = [f"cpu {limits.cpu:g}"] if limits.cpu is not None else []
    files = [f"files {limits.files}"] if limits.files is not None else []
    return ", ".join([*memory, *cpu, *files])


def ready_text(ready: ReadyPlan) -> str:
    """What a process has to show besides its token or its start."""
    conditions = []
    if ready.log is not None:
        conditions.append(f"its output holds {ready.log!r}")
    if ready.port is not None:
        conditions.append(f"{ready.port} accepts connections")
    if ready.probe:
        conditions.append(f"`{shlex.join(ready.probe)}` succeeds")
    if ready.topics:
        conditions.append(f"data come on {', '.join(ready.topics)}")
    return f"when {' and '.join(conditions)}" if conditions else ""
