"""What `robo create` adds to files that are there: every line of them stays as it is."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import event, given
from hypothesis import strategies as st

from robo.create.addition import Addition, Published, added
from robo.create.asked import Asked, contents
from robo.create.files import write
from robo.create.message_insert import with_message
from robo.create.project import find_project
from robo.create.render import MANIFEST, PARAMETERS, PackagePlan, package_files
from robo.create.yaml_insert import Style, inserted
from robo.errors import CreateError
from robo.text.tree import Problem, plain
from robo.text.yaml_tree import parse

GRIPPER = Asked(
    nodes=("gripper",), publishes=("grip:std/Bool",), subscribes=("scan:sensor/LaserScan",), messages=("Grip",)
)


def data(text: str) -> object:
    """What a YAML file says."""
    problems: list[Problem] = []
    tree = parse(text, "file", problems, placeholders=True)
    assert not problems
    assert tree is not None
    return plain(tree)


def only_adds(before: str, after: str) -> bool:
    """Whether all that differs are whole lines in one place."""
    old, new = before.splitlines(keepends=True), after.splitlines(keepends=True)
    same = next((i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), min(len(old), len(new)))
    return len(new) > len(old) and new[same + len(new) - len(old) :] == old[same:]


def entry(style: Style) -> list[str]:
    return ["new: {service: x}"] if style.inline else ["new:", f"{' ' * style.step}service: x"]


def grown(asked: Asked, files: dict[str, str], published: tuple[Published, ...] = ()) -> Addition:
    """What becomes of the package my_robot."""
    return added("my_robot", "my_robot", contents(asked, "my_robot"), files, published)


def package() -> dict[str, str]:
    """The files of a new package."""
    found = contents(Asked(nodes=("talker",)), "my_robot")
    return package_files(PackagePlan("my_robot", "A robot", None, found.nodes, found.messages))


@pytest.mark.parametrize(
    ("before", "path", "after"),
    [
        ("a: 1\n", [], "a: 1\nnew:\n  service: x\n"),
        ("a: 1", [], "new:\n  service: x\na: 1"),
        ("# about a\na: 1\n# about b\nb: 2", [], "# about a\na: 1\nnew:\n  service: x\n# about b\nb: 2"),
        ("a: 1\r\n", [], "a: 1\r\nnew:\r\n  service: x\r\n"),
        ("a:\n    b: {c: 1}   # why\n    # more of it\n\nz: 1\n", ["a"],
         "a:\n    b: {c: 1}   # why\n    # more of it\n    new: {service: x}\n\nz: 1\n"),
        ("a:\n   b:\n      c: 1\nz: 1\n", ["a"], "a:\n   b:\n      c: 1\n   new:\n      service: x\nz: 1\n"),
        ("a:\n  p: [1,\n    2]\n# z\nz: 1\n", ["a"], "a:\n  p: [1,\n    2]\n  new:\n    service: x\n# z\nz: 1\n"),
        ("a:\n  t: |\n    text\n\n    more\nz: 1\n", ["a"],
         "a:\n  t: |\n    text\n\n    more\n  new:\n    service: x\nz: 1\n"),
        ("a:\n  b: {c: 1}\n\n  d: {e: 1}\n", ["a"], "a:\n  b: {c: 1}\n\n  d: {e: 1}\n\n  new: {service: x}\n"),
        ("a:\n  b:\n", ["a"], "a:\n  b:\n  new:\n    service: x\n"),
        ("a: &one\n  b: 1\nc: *one\n", [], "a: &one\n  b: 1\nc: *one\nnew:\n  service: x\n"),
        ("a:\n  - b: 1\n    c: 2\n", [], "a:\n  - b: 1\n    c: 2\nnew:\n  service: x\n"),
        ("a:\n  b:\n  - 1\n  - c: 2\n\nz: 1\n", ["a"], "a:\n  b:\n  - 1\n  - c: 2\n  new:\n    service: x\n\nz: 1\n"),
        ("x: &x {y: 1}\na:\n  - *x\n\n", [], "x: &x {y: 1}\na:\n  - *x\nnew:\n  service: x\n\n"),
        ("---\na: ${x}\n...\n", [], "---\na: ${x}\nnew:\n  service: x\n...\n"),
        ("# nothing yet\n", [], "# nothing yet\nnew:\n  service: x\n"),
        ("", [], "new:\n  service: x\n"),
    ],
)  # fmt: skip
def test_a_key_comes_where_it_belongs(before: str, path: list[str], after: str) -> None:
    assert inserted(before, "file", path, "new", entry) == after


@pytest.mark.parametrize(
    ("text", "path", "said"),
    [
        ("{a: 1}\n", [], "in braces"),
        ("a: {b: 1}\n", ["a"], "file:1: a is written in braces"),
        ("a: {}\n", ["a"], "in braces"),
        ("a:\n", ["a"], "is no map"),
        ("a: 1\n", ["b"], "file has no b"),
        ("a: [1]\n", ["a"], "is no map"),
        ("- a\n", [], "holds no map"),
        ("a: &x\n  b: 1\nc: *x\n", ["c"], "an alias"),
        ("a: &x\n  b: 1\nc: *x\n", ["a"], "without changing what is there"),
        ("new: 1\n", [], "file: new is there already"),
        ("a: 1\na: 2\n", [], "stands twice"),
        ("a: [1\n", [], "not valid YAML"),
        ("# nothing yet", [], "does not end with a newline"),
        ("a:\n  t: |+\n    text\n\n", ["a"], ""),
    ],
)
def test_what_cannot_be_added_to_safely_is_refused(text: str, path: list[str], said: str) -> None:
    if not said:  # the blank lines of such a text belong to it
        assert data(inserted(text, "file", path, "new", entry)) == {"a": {"t": "text\n\n", "new": {"service": "x"}}}
        return
    with pytest.raises(CreateError, match=said):
        inserted(text, "file", path, "new", entry)


scalars = st.sampled_from(["1", "true", "wörd😀", "'a: # b'", '"x\\n"', "${name}", "~", "two words", "a#b", ".nan", ""])
comments = st.sampled_from(["", "", "", "   # why", "\t# tab"])


@st.composite
def yaml_map(draw: st.DrawFn, depth: int = 0) -> list[str]:
    """The lines of a map, as people write them."""
    step = draw(st.integers(1, 4))
    lines: list[str] = []
    for number in range(draw(st.integers(1, 3))):
        lines += draw(st.lists(st.sampled_from(["", "# note", "  # deep note", "   "]), max_size=2))
        key = draw(st.sampled_from([f"k{number}", f'"q {number}"', f"/k{number}/x"]))
        kind = draw(st.sampled_from(["scalar", "flow", "text", "list", "map", "map"] if depth < 3 else ["scalar"]))
        comment = draw(comments)
        inner: list[str] = []
        if kind == "scalar":
            lines.append(f"{key}: {draw(scalars)}{comment}".rstrip(" "))
        elif kind == "flow":
            lines += draw(
                st.sampled_from([[f"{key}: {{a: 1, b: ${{x}}}}{comment}"], [f"{key}: [1,", f"  2]{comment}"]])
            )
        elif kind == "text":
            lines.append(f"{key}: {draw(st.sampled_from(['|', '>', '|-', '>-']))}")
            inner = ["some text", "", "  # no comment"]
        elif kind == "list":
            lines.append(f"{key}:{comment}")
            inner = ["- a", "- b: 1", "  c: 2", f"- {draw(scalars) or '1'}"]
        else:
            lines.append(f"{key}:{comment}")
            inner = draw(yaml_map(depth + 1))
        lines += [f"{' ' * step}{line}" if line.strip() else line for line in inner]
    return lines


def paths(value: object, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """The ways to all maps."""
    if not isinstance(value, dict):
        return []
    return [path, *(found for key, inner in value.items() for found in paths(inner, (*path, key)))]


@given(yaml_map(), st.sampled_from(["\n", "\r\n"]), st.booleans(), st.data())
def test_whatever_a_file_looks_like_lines_are_only_added(
    lines: list[str], ends: str, has_end: bool, pick: st.DataObject
) -> None:
    text = ends.join(lines) + (ends if has_end else "")
    problems: list[Problem] = []
    tree = parse(text, "file", problems, placeholders=True)
    assert tree is not None, problems
    path = pick.draw(st.sampled_from(paths(plain(tree))))
    refused, new = "", ""
    try:
        new = inserted(text, "file", path, "new", entry)
    except CreateError as error:
        refused = str(error)
    if refused:
        event(refused.rpartition(": ")[2])
        assert "in braces" in refused or not has_end
        return
    assert only_adds(text, new)
    assert new.endswith(ends) == text.endswith(ends)
    assert new.count("\r\n") == (new.count("\n") if "\r\n" in text else 0)
    wanted = plain(tree)
    inner = wanted
    for step in path:
        assert isinstance(inner, dict)
        inner = inner[step]
    assert isinstance(inner, dict)
    inner["new"] = {"service": "x"}
    assert repr(sorted_deep(data(new))) == repr(sorted_deep(wanted))


def sorted_deep(value: object) -> object:
    """Maps in the order of their keys."""
    if isinstance(value, dict):
        return {key: sorted_deep(value[key]) for key in sorted(value)}
    return [sorted_deep(item) for item in value] if isinstance(value, list) else value


def test_a_node_comes_into_manifest_and_parameters() -> None:
    files = package()
    addition = grown(GRIPPER, files)
    assert addition.problems == ()
    assert sorted(addition.changed) == [PARAMETERS, MANIFEST, "my_robot/messages.py"]
    assert all(only_adds(files[path], text) for path, text in addition.changed.items())
    assert "      gripper: {service: my_robot.gripper}\n" in addition.changed[MANIFEST]
    assert "scan: {type: sensor/LaserScan, external: true}" in addition.changed[MANIFEST]
    assert sorted(addition.new) == ["my_robot/gripper.py", "my_robot/gripper_logic.py", "tests/test_gripper.py"]


def test_two_nodes_and_topics_come_beside_those_that_are_there() -> None:
    asked = Asked(
        nodes=("eye", "brain"),
        publishes=("eye:seen:std/Bool",),
        subscribes=("brain:seen:std/Bool", "brain:chatter:std/String", "brain:scan:sensor/LaserScan", "eye:a:std/Bool"),
    )
    files = package()
    first = grown(asked, files, (Published("robot/chatter", "std/String", "talker"),)).changed[MANIFEST]
    group = data(first)["groups"]["my_robot"]  # type: ignore[index]
    assert list(group["nodes"]) == ["talker", "eye", "brain"]
    assert list(group["topics"]) == ["a", "scan"] or list(group["topics"]) == ["scan", "a"]
    more = Asked(nodes=("third",), subscribes=("b:std/Bool",))
    again = grown(more, files | {MANIFEST: first}).changed[MANIFEST]
    assert only_adds(first, again) or again.count("\n") == first.count("\n") + 2
    assert "b" in data(again)["groups"]["my_robot"]["topics"]  # type: ignore[index]


def test_the_group_is_the_one_that_has_the_packages_nodes() -> None:
    manifest = """
groups:
  base:
    nodes:
      sim: {service: robo_services.diff_drive_sim}
    groups:
      inner:
        nodes:
          talker:
            service: my_robot.talker   # ours
  last:
    nodes: {other: {run: sleep 1}}
"""
    changed = grown(Asked(nodes=("eye",)), package() | {MANIFEST: manifest}).changed[MANIFEST]
    assert "          eye:\n            service: my_robot.eye\n  last:" in changed
    foreign = manifest.replace("my_robot.talker", "other.talker")
    (said, *_) = grown(Asked(nodes=("eye",)), package() | {MANIFEST: foreign}).problems
    assert "several groups and none with nodes of my_robot" in said
    assert "--code-only" in said


def test_all_that_is_in_the_way_is_told_and_code_alone_needs_no_manifest() -> None:
    files = package() | {PARAMETERS: "{talker: {}}\n", "my_robot/messages.py": "class Grip: ...\n"}
    del files[MANIFEST]
    said = grown(GRIPPER, files, (Published("robot/scan", "std/Bool", "eye"),)).problems
    assert [part for part in ("braces", "no launch/robot.yaml", "Grip is there", "std/Bool in eye") if
            not any(part in one for one in said)] == []  # fmt: skip
    wanted = contents(Asked(nodes=("eye",)), "my_robot")
    alone = added("my_robot", "my_robot", wanted, {}, (), code_only=True)
    assert (alone.changed, alone.problems) == ({}, ())
    assert len(alone.new) == 3


@pytest.mark.parametrize(
    ("before", "has"),
    [
        ("", "from robo_messages import Message, message"),
        ('"""Ours."""\n', "from robo_messages import Message, message"),
        ("from robo_messages import Header, Message, message\n", "class Grip(Message)"),
        ("import robo_messages\n", "class Grip(robo_messages.Message)"),
        ('"""Ours."""\n\nfrom typing import Any\n\nX: Any = 1\n', "import robo_messages"),
        ("import math\n\nimport attr\nimport zenoh\nfrom robo_messages import Header\n\nX = math, attr, zenoh\n",
         "import attr\nimport robo_messages\nimport zenoh"),
        ("from my_robot.other import Thing\n\nX = Thing\n", "import robo_messages\n\nfrom my_robot"),
        ("from __future__ import annotations\r\n\r\nX = 1\r\n", "import robo_messages\r\n"),
    ],
)  # fmt: skip
def test_a_message_comes_below_what_is_there(before: str, has: str) -> None:
    after = with_message(before, "messages.py", "my_robot", "Grip")
    ast.parse(after)
    assert has in after
    assert '("my_robot/Grip")' in after
    kept = iter(after.splitlines())
    assert all(line in kept for line in before.splitlines()), "each line, in its order"
    assert after.count("\r\n") == (after.count("\n") if "\r\n" in before else 0)
    done = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "-q", "--isolated", "--select=I,F",
         '--config=lint.isort.known-first-party=["my_robot"]', "--stdin-filename", "m.py", "-"],
        input=after, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0 or "No module named" in done.stderr or "Header" in before, done.stdout


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("class Grip:\n    pass\n", "messages.py:1: Grip is there already"),
        ("from other import Grip\n", "is there already"),
        ("Grip = 1\n", "is there already"),
        ("@message('my_robot/Grip')\nclass Other: ...\n", "is there already"),
        ("class\n", "messages.py:1: this is no Python"),
        ("X = 1", "does not end with a newline"),
    ],
)
def test_a_message_that_cannot_be_added_is_refused(text: str, said: str) -> None:
    with pytest.raises(CreateError, match=said):
        with_message(text, "messages.py", "my_robot", "Grip")


def test_sources_may_be_in_a_folder_of_their_own(tmp_path: Path) -> None:
    files = {(f"src/{path}" if path.startswith("my_robot/") else path): text for path, text in package().items()}
    write(tmp_path, files)
    project = find_project(tmp_path)
    assert project is not None
    assert project.sources == "src/my_robot"
    addition = added("my_robot", project.sources, contents(GRIPPER, "my_robot"), project.files(), ())
    assert "src/my_robot/gripper.py" in addition.new
    assert "src/my_robot/messages.py" in addition.changed
