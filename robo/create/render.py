"""From what is asked to the files of a package: their paths and texts. Pure."""

import json
from collections.abc import Iterable

import msgspec

from robo.create import names
from robo.create.asked import NodePlan, ServiceEnd, TopicUse
from robo.create.python_text import tidy
from robo.create.template import Filling, filled, sample, sample_files
from robo.create.types import TypeUse

PACKAGE = "sample_robot"
NODE = "sample_node"
"""What the sample's package and its node are called."""

MANIFEST = "launch/robot.yaml"
PARAMETERS = "config/robot.yaml"

_NODE_FILES = (f"{PACKAGE}/{NODE}.py", f"{PACKAGE}/{NODE}_logic.py", f"tests/test_{NODE}.py")
_HIDDEN = {"dockerignore": ".dockerignore", "gitignore": ".gitignore", "github": ".github"}
"""Names that would mean something to tools where the sample lies."""

CodeNames = dict[tuple[str, str], str]
"""By module and class, what code calls a message type."""


class PackagePlan(msgspec.Struct, frozen=True):
    """A package that is to be made."""

    name: str
    description: str
    license: str | None
    nodes: tuple[NodePlan, ...]
    messages: tuple[str, ...]


def package_files(plan: PackagePlan) -> dict[str, str]:
    """The files of a new package: from path, within its folder, to text."""
    filling = _package_filling(plan)
    files = {}
    for path in sample_files():
        if path not in _NODE_FILES:
            first, slash, rest = path.partition("/")
            where = f"{_HIDDEN.get(first, first)}{slash}{rest}".replace(PACKAGE, plan.name)
            files[where] = _ended(filled(sample(path), filling))
    for node in plan.nodes:
        files |= node_files(plan.name, node)
    return dict(sorted(files.items()))


def node_files(package: str, node: NodePlan) -> dict[str, str]:
    """The files that a node has for itself: what it is connected to, what it decides, its tests."""
    code_names = _code_names(node)
    filling = _node_filling(package, node, code_names)
    imports = {
        f"{package}.{node.name}": {names.class_of(node.name)},
        f"{package}.{node.name}_logic": set(_functions(node)),
    }
    for type_ in _types(node):
        name = code_names[type_.module, type_.imported]
        renamed = name if name == type_.imported else f"{type_.imported} as {name}"
        imports.setdefault(type_.module, set()).add(renamed)
    files = {}
    for path in _NODE_FILES:
        where = path.replace(PACKAGE, package).replace(NODE, node.name)
        others = {module: these for module, these in imports.items() if f"{module.replace('.', '/')}.py" != where}
        files[where] = tidy(filled(sample(path), filling), others, package)
    return files


def message_text(package: str, name: str) -> str:
    """The class of a message, as `messages.py` has it."""
    whole = sample(f"{PACKAGE}/messages.py")
    block = whole[whole.index("# each message") :]
    return _ended(filled(block, Filling(words={PACKAGE: package}, each={"message": [_message_filling(name)]})))


def parameters_of(node: NodePlan) -> str:
    """The entry of a node in a parameter file."""
    filling = Filling(words={}, each={"node": [_entry_filling(node)]})
    return "".join(filled(sample(PARAMETERS), filling).splitlines(keepends=True)[1:])


def _package_filling(plan: PackagePlan) -> Filling:
    published = {names.key(end.topic, node.name) for node in plan.nodes for end in node.publishes}
    external = {
        names.key(end.topic, node.name): Filling(words={"sample_input": end.topic, "sensor/LaserScan": end.type.name})
        for node in plan.nodes
        for end in node.subscribes
        if names.key(end.topic, node.name) not in published
    }
    true = {
        name
        for name, holds in (("license", plan.license), ("messages", plan.messages), ("external", external))
        if holds
    }
    return Filling(
        words={
            PACKAGE: plan.name,
            NODE: plan.nodes[0].name,
            '"A sample robot"': json.dumps(plan.description, ensure_ascii=False),
            "A sample robot": plan.description,
            '"MIT"': json.dumps(plan.license),
        },
        true=frozenset(true),
        each={
            "node": [_entry_filling(node) for node in plan.nodes],
            "message": [_message_filling(name) for name in plan.messages],
            "external": list(external.values()),
        },
    )


def _entry_filling(node: NodePlan) -> Filling:
    """A node in the manifest and in the parameter file."""
    return Filling(words={NODE: node.name}, true=_conditions(node))


def _message_filling(name: str) -> Filling:
    return Filling(words={"SampleMessage": name})


def _conditions(node: NodePlan) -> frozenset[str]:
    true = {"publishes"} if node.publishes else set()
    return frozenset(true | ({"listens"} if node.subscribes or node.serves else set()))


def _node_filling(package: str, node: NodePlan, code_names: CodeNames) -> Filling:
    """A node in its own files."""
    published = names.labels(end.topic for end in node.publishes)
    heard = names.labels(end.topic for end in node.subscribes)
    served = names.labels(end.service for end in node.serves)
    return Filling(
        words={PACKAGE: package, NODE: node.name, "SampleNode": names.class_of(node.name)},
        true=_conditions(node),
        each={
            "publisher": [
                _publisher(end, published[end.topic], _spelt(end.type, code_names)) for end in node.publishes
            ],
            "subscription": [
                _subscription(end, heard[end.topic], _spelt(end.type, code_names)) for end in node.subscribes
            ],
            "service": [_service(end, served[end.service], code_names) for end in node.serves],
        },
    )


def _publisher(end: TopicUse, label: str, spelt: str) -> Filling:
    made, expected = _example(spelt, end)
    attribute = names.attribute(label)
    return Filling(
        words={
            'String(data=f"sample_output {count}")': made,
            'assert message.data == "sample_output 3"': expected,
            '"sample_output"': f'"{end.topic}"',
            "on sample_output": f"on {end.topic}",
            "    sample_output =": f"    {attribute} =",
            "self.sample_output": f"self.{attribute}",
            "sample_output": label,
            "String": spelt,
        }
    )


def _subscription(end: TopicUse, label: str, spelt: str) -> Filling:
    name = end.type.path.rpartition(".")[2]
    return Filling(
        words={
            '"sample_input"': f'"{end.topic}"',
            '"sample_input:': f'"{end.topic}:',
            "on sample_input": f"on {end.topic}",
            "of sample_input": f"of {end.topic}",
            "def on_sample_input": f"def {names.handler(label)}",
            "sample_input": label,
            '"LaserScan"': f'"{name}"',
            ' LaserScan" in': f' {name}" in',
            "LaserScan": spelt,
        }
    )


def _service(end: ServiceEnd, label: str, code_names: CodeNames) -> Filling:
    return Filling(
        words={
            '"sample_service"': f'"{end.service}"',
            '"sample_service is': f'"{end.service} is',
            "of sample_service": f"of {end.service}",
            "def handle_sample_service": f"def {names.answerer(label)}",
            "sample_service": label,
            "Trigger.Request": _spelt(end.type.request, code_names),
            "Trigger.Response": _spelt(end.type.response, code_names),
        }
    )


def _spelt(type_: TypeUse, code_names: CodeNames) -> str:
    """A type as code names it."""
    return code_names[type_.module, type_.imported] + type_.path.removeprefix(type_.imported)


def _functions(node: NodePlan) -> Iterable[str]:
    """What the module that decides for a node defines."""
    yield from (f"next_{label}" for label in names.labels(end.topic for end in node.publishes).values())
    yield from (f"about_{label}" for label in names.labels(end.topic for end in node.subscribes).values())
    yield from (f"answer_{label}" for label in names.labels(end.service for end in node.serves).values())


def _example(spelt: str, end: TopicUse) -> tuple[str, str]:
    """The code that makes the message number `count` of a topic, and what a test says of the one number 3."""
    data = {
        "str": (f'f"{end.topic} {{count}}"', f'== "{end.topic} 3"'),
        "int": ("count % 100", "== 3"),
        "float": ("float(count)", "== 3.0"),
        "bool": ("count % 2 == 0", "is False"),
    }
    if end.type.data is None:
        return f"{spelt}()", f"assert isinstance(message, {spelt})"
    made, expected = data[end.type.data]
    return f"{spelt}(data={made})", f"assert message.data {expected}"


def _types(node: NodePlan) -> Iterable[TypeUse]:
    """The types that a node's files name."""
    yield from (end.type for end in (*node.publishes, *node.subscribes))
    for served in node.serves:
        yield from (served.type.request, served.type.response)


def _code_names(node: NodePlan) -> CodeNames:
    """By module and class what code calls a type: its own name, unless something else has it already."""
    taken = {*names.USED, names.class_of(node.name)}
    found: CodeNames = {}
    for type_ in _types(node):
        if (type_.module, type_.imported) in found:
            continue
        group = names.class_of(type_.name.partition("/")[0])
        name = type_.imported
        for candidate in (name, f"{name}Message", f"{group}{name}", f"{group}{name}Message"):
            if candidate not in taken:
                name = candidate
                break
        taken.add(name)
        found[type_.module, type_.imported] = name
    return found


def _ended(text: str) -> str:
    """A text with one newline at its end."""
    return text.rstrip("\n") + "\n" if text.strip() else ""
