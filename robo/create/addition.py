"""More nodes and messages in a package that is there: new files, and more lines in those that it has. Pure.

Everything is worked out, and every reason why it cannot be done is collected, before anything is written.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import msgspec

from robo.create import names
from robo.create.asked import Contents, NodePlan, TopicUse
from robo.create.message_insert import with_message
from robo.create.render import MANIFEST, PACKAGE, PARAMETERS, node_files, parameters_of
from robo.create.template import sample
from robo.create.yaml_insert import Style, inserted
from robo.errors import CreateError
from robo.text.tree import Map, Tree, plain
from robo.text.yaml_tree import parse

MESSAGES = "messages.py"
MESSAGE_TESTS = "tests/test_messages.py"


class Published(msgspec.Struct, frozen=True):
    """A topic that a node of the manifest publishes."""

    topic: str
    """As other nodes of the robot name it."""
    type: str
    node: str


class Addition(msgspec.Struct, frozen=True):
    """What becomes of a package."""

    new: dict[str, str]
    """Files that it gets, by path within its folder."""
    changed: dict[str, str]
    """The new texts of files that it has."""
    problems: tuple[str, ...]
    """Why it cannot be done: what is there already, or cannot be added to."""


def added(
    package: str,
    sources: str,
    wanted: Contents,
    files: Mapping[str, str],
    published: Sequence[Published],
    *,
    code_only: bool = False,
) -> Addition:
    """What becomes of a package that gets more nodes and messages.

    Args:
        package: what it is imported as.
        sources: the path of its Python files, within its folder.
        wanted: the nodes and messages.
        files: by path, the texts of manifest, parameters, messages and their tests, where these are there.
        published: what nodes of the manifest publish already.
        code_only: leave manifest and parameters as they are.
    """
    work = _Work(dict(files))
    new: dict[str, str] = {}
    messages = f"{sources}/{MESSAGES}"
    for name in wanted.messages:
        if messages in files:
            work.change(messages, partial(with_message, file=messages, package=package, name=name))
        else:
            new[messages] = with_message(
                new.get(messages, f'"""The message types of {package}."""\n'), messages, package, name
            )
    if wanted.messages and MESSAGE_TESTS not in files:
        new[MESSAGE_TESTS] = sample(MESSAGE_TESTS).replace(PACKAGE, package)
    for node in wanted.nodes:
        for path, text in node_files(package, node).items():
            new[path.replace(f"{package}/", f"{sources}/", 1) if path.startswith(f"{package}/") else path] = text
        if not code_only:
            work.change(MANIFEST, partial(_in_manifest, package=package, node=node))
            if PARAMETERS in files:
                work.change(PARAMETERS, partial(_in_parameters, node=node))
    if not code_only:
        for end in _from_outside(wanted.nodes, published, work.problems):
            work.change(MANIFEST, partial(_external, package=package, end=end))
    changed = {path: text for path, text in work.files.items() if text != files.get(path)}
    return Addition(new, changed, tuple(dict.fromkeys(work.problems)))


class _Work:
    """The texts as far as they have come, and what stood in the way."""

    def __init__(self, files: dict[str, str]) -> None:
        self.files = files
        self.problems: list[str] = []

    def change(self, path: str, step: Callable[[str], str]) -> None:
        """One change of a file."""
        if path not in self.files:
            self.problems.append(f"there is no {path}; --code-only makes code and tests alone")
            return
        try:
            self.files[path] = step(self.files[path])
        except CreateError as error:
            self.problems.append(str(error))


def _in_manifest(text: str, package: str, node: NodePlan) -> str:
    service = f"{package}.{node.name}"

    def entry(style: Style) -> Sequence[str]:
        if style.inline:
            return [f"{node.name}: {{service: {service}}}"]
        return [f"{node.name}:", f"{' ' * style.step}service: {service}"]

    return inserted(text, MANIFEST, [*_group(text, package), "nodes"], node.name, entry)


def _in_parameters(text: str, node: NodePlan) -> str:
    def entry(style: Style) -> Sequence[str]:
        lines = parameters_of(node).splitlines()
        depths = [(len(line) - len(line.lstrip())) // 2 for line in lines]
        return [f"{' ' * style.step * depth}{line.lstrip()}" for line, depth in zip(lines, depths, strict=True)]

    return inserted(text, PARAMETERS, [], node.name, entry)


def _external(text: str, package: str, end: TopicUse) -> str:
    """The manifest with the word that a topic comes from outside."""
    group = _group(text, package)
    said = f"{end.topic}: {{type: {end.type.name}, external: true}}"
    topics = _at(_tree(text), [*group, "topics"])
    if topics is None:
        return inserted(text, MANIFEST, group, "topics", lambda style: ["topics:", f"{' ' * style.step}{said}"])
    if isinstance(topics, Map) and topics.get(end.topic) is not None:
        return text
    return inserted(text, MANIFEST, [*group, "topics"], end.topic, lambda _: [said])


def _from_outside(nodes: Iterable[NodePlan], published: Sequence[Published], problems: list[str]) -> Iterable[TopicUse]:
    """What the new nodes subscribe and no node publishes. A topic that would have two types is a problem."""
    known = {one.topic: one for one in published}
    own = {names.key(end.topic, node.name) for node in nodes for end in node.publishes}
    found: dict[str, TopicUse] = {}
    for node in nodes:
        for end in (*node.publishes, *node.subscribes):
            key = names.key(end.topic, node.name)
            there = known.get(key)
            if there is not None and there.type != end.type.name:
                problems.append(
                    f"topic {end.topic} has the type {there.type} in {there.node}; give it that one here too"
                )
        for end in node.subscribes:
            key = names.key(end.topic, node.name)
            if key not in known and key not in own:
                found.setdefault(key, end)
    return found.values()


def _group(text: str, package: str) -> list[str]:
    """The keys that lead to the group that has the package's nodes.

    Raises:
        CreateError: it cannot be told which one that is.
    """
    groups = list(_groups(_tree(text), []))
    own = [path for path, nodes in groups if any(_service(node.value).startswith(f"{package}.") for node in nodes)]
    if own:
        return own[-1]
    if len(groups) == 1:
        return groups[0][0]
    what = "no group with nodes" if not groups else f"several groups and none with nodes of {package}"
    raise CreateError(
        f"{MANIFEST} has {what}; --code-only makes code and tests alone, then name the node there by hand"
    )


def _groups(tree: Tree | None, path: list[str]) -> Iterable[tuple[list[str], Map]]:
    """Each group that has nodes, with the keys that lead to it."""
    groups = tree.get("groups") if isinstance(tree, Map) else None
    for name, _, group in groups if isinstance(groups, Map) else ():
        nodes = group.get("nodes") if isinstance(group, Map) else None
        here = [*path, "groups", name]
        if isinstance(nodes, Map):
            yield here, nodes
        yield from _groups(group, here)


def _service(node: Tree) -> str:
    data = plain(node)
    return str(data.get("service", "")) if isinstance(data, dict) else ""


def _tree(text: str) -> Tree | None:
    return parse(text, MANIFEST, [], placeholders=True)


def _at(tree: Tree | None, path: Sequence[str]) -> Tree | None:
    for step in path:
        tree = tree.get(step) if isinstance(tree, Map) else None
    return tree
