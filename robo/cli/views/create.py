"""What `robo create` asks, does and prints."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from robo.cli.printing import amount, note, print_line
from robo.create import licenses, names
from robo.create.addition import Published
from robo.create.addition import added as addition
from robo.create.asked import FIRST_NODE, FIRST_TOPIC, Asked, about_faults, contents
from robo.create.files import conflicts, write
from robo.create.licenses import license_text
from robo.create.own_wheel import own_wheel
from robo.create.project import Project, find_project
from robo.create.render import MANIFEST, PARAMETERS, PackagePlan, package_files
from robo.errors import CreateError, UsageError
from robo.text.terminal import visible


def run_create(name: str | None, asked: Asked, *, dry_run: bool, code_only: bool = False) -> None:
    """Make a package; within one, without a name, add to it.

    Raises:
        UsageError: the words make no sense; a line for each mistake.
        CreateError: something is in the way, or cannot be written.
    """
    project = find_project(Path.cwd())
    if project is None:
        if code_only:
            raise UsageError("--code-only is for nodes that come into a package, and this folder is in none")
        if name is None:
            name, asked = _questioned(asked)
        _new_package(name, asked, dry_run=dry_run)
    elif name is None:
        _add(project, asked, dry_run=dry_run, code_only=code_only)
    else:
        raise CreateError(
            f"{project.folder} is the package {project.name}; robo create --node {name} adds a node to it, "
            "and a new package goes into a folder outside of it"
        )


def _add(project: Project, asked: Asked, *, dry_run: bool, code_only: bool) -> None:
    """Add nodes and messages to a package."""
    if asked == Asked():
        asked = _questioned_within(project)
    if asked.license is not None or asked.description is not None:
        raise UsageError(f"license and description of {project.name} stand in its pyproject.toml")
    sys.path.insert(0, str(project.package.parent))
    with contextlib.chdir(project.folder):  # there the package's own message types are found
        wanted = contents(asked, project.name)
        files = project.files()
        published = [] if code_only or MANIFEST not in files else _published(project)
    added = addition(project.name, project.sources, wanted, files, published, code_only=code_only)
    in_the_way = [*added.problems, *conflicts(project.folder, added.new)]
    if in_the_way:
        raise CreateError("\n".join(in_the_way))
    if not dry_run:
        changes = {project.folder / path: (files[path], text) for path, text in added.changed.items()}
        write(project.folder, added.new, changes)
    _list(project.folder / path for path in added.new)
    for path, text in added.changed.items():
        more = amount(len(text.splitlines()) - len(files[path].splitlines()), "line")
        print_line(f"{_near(project.folder / path)}: {more} more")
    if wanted.nodes and not code_only and PARAMETERS not in files:
        note(f"there is no {PARAMETERS}: the nodes start with what their classes say")


def _published(project: Project) -> list[Published]:
    """What the nodes of the package's manifest publish, as far as they can be read."""
    from robo.launch.check import ends_of
    from robo.launch.resolve import resolve

    resolution = resolve(project.folder / MANIFEST, {}, stand_ins=True)
    own = {one.full_name: one for one in resolution.plan.processes}
    found = []
    for end in ends_of(resolution):
        if end.kind == "pub":
            process = own[end.node]
            topic = process.remap.get(end.topic, end.topic)
            found.append(Published(names.key(topic, process.name), end.type, process.name))
    return found


def _new_package(name: str, asked: Asked, *, dry_run: bool) -> None:
    if not asked.nodes and not (asked.publishes or asked.subscribes or asked.services):
        asked = msgspec.structs.replace(asked, nodes=(FIRST_NODE,), publishes=(FIRST_TOPIC,))
    problems = [fault for fault in (names.package_fault(name), *about_faults(asked)) if fault]
    try:
        found = contents(asked, name)
    except UsageError as error:
        raise UsageError("\n".join([*problems, str(error)])) from None
    if problems:
        raise UsageError("\n".join(problems))
    about = (asked.description or f"The robot {name}").strip()
    files: dict[str, str | bytes] = {
        **package_files(PackagePlan(name, about, asked.license, found.nodes, found.messages))
    }
    text = license_text(asked.license, name) if asked.license is not None else None
    if text is not None:
        files[licenses.FILE] = text
    robo = own_wheel()
    if robo is not None:  # for the package's container: no package index has this robo
        files[f"wheels/{robo[0]}"] = robo[1]
    files = dict(sorted(files.items()))
    folder = Path(name)
    if dry_run:
        in_the_way = conflicts(folder, files)
        if in_the_way:
            raise CreateError("\n".join(in_the_way))
        _list(folder / path for path in files)
        return
    write(folder, files)
    _list(folder / path for path in files)
    if asked.license is not None:
        _about_license(asked.license, name, text)
    run, test = f"robo up {MANIFEST} --robot-name r1", "pip install -q pytest && python -m pytest"
    note(f"Next:\n  cd {name}\n  {run}   # run it\n  {test:{len(run)}}   # test it")


def _about_license(license_: str, package: str, text: str | None) -> None:
    """What of the license is left to the user."""
    if text is None:
        note(f"The text of {license_} is yours to add, as {package}/{licenses.FILE}")
    elif (holder := licenses.holder(package)) in text:
        note(f"{package}/{licenses.FILE} names {holder} as holders of the copyright; write your name there")


def _list(paths: Iterable[Path]) -> None:
    for path in paths:
        print_line(_near(path))


def _near(path: Path) -> str:
    """A path as somebody in the current folder writes it."""
    return os.path.relpath(path)


def _questioned_within(project: Project) -> Asked:
    """A node for a package, from a terminal.

    Raises:
        UsageError: there is no terminal.
    """
    if not _on_terminal():
        raise UsageError(
            f"say what to add to {project.name}: --node NAME, or --message NAME; on a terminal it is asked for"
        )
    node = _ask("Name of the node", "", lambda word: [names.node_fault(word)])
    topic = _ask(
        "What it publishes, as TOPIC:TYPE", f"{node}:std/String",
        lambda word: _faults(Asked(nodes=(node,), publishes=(word,)), project.name),
    )  # fmt: skip
    return Asked(nodes=(node,), publishes=(topic,))


def _on_terminal() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def _questioned(asked: Asked) -> tuple[str, Asked]:
    """The name of a package and what belongs into it, from a terminal.

    Raises:
        UsageError: there is no terminal, or words were given that belong to a package that has no name.
    """
    if asked != Asked():
        raise UsageError(
            "name the package: robo create NAME; to add to one that is there, call robo create in its folder"
        )
    if not _on_terminal():
        raise UsageError("name the package: robo create NAME; only on a terminal it is asked for")
    name = _ask("Name of the package", "my_robot", lambda word: [names.package_fault(word)])
    about = _ask("What it is, in a line", f"The robot {name}", lambda text: about_faults(Asked(description=text)))
    node = _ask("Its first node", FIRST_NODE, lambda word: [names.node_fault(word)])
    topic = _ask(
        "What that publishes, as TOPIC:TYPE", FIRST_TOPIC if node == FIRST_NODE else f"{node}:std/String",
        lambda word: _faults(Asked(nodes=(node,), publishes=(word,)), name),
    )  # fmt: skip
    license_ = _ask("License, an SPDX name; none", "", lambda word: about_faults(Asked(license=word)) if word else [])
    return name, Asked(nodes=(node,), publishes=(topic,), license=license_ or None, description=about)


def _faults(asked: Asked, package: str) -> list[str]:
    try:
        contents(asked, package)
    except UsageError as error:
        return [str(error)]
    return []


def _ask(question: str, default: str, faults_of: Callable[[str], Iterable[str | None]]) -> str:
    """An answer without mistakes; Enter takes the default.

    Raises:
        UsageError: the input has ended.
    """
    while True:
        try:
            answer = input(f"{question} [{default}]: " if default else f"{question}: ").strip() or default
        except EOFError:
            raise UsageError("the answers ended too early; nothing is created") from None
        faults = [fault for fault in faults_of(answer) if fault]
        if not faults:
            return answer
        for fault in faults:
            note(visible(fault))
