"""One process from the layers in which it is written, but for what can only be known when all processes are."""

from collections.abc import Sequence
from typing import Any, Literal

import msgspec

from robo.errors import ContractError, InvalidName
from robo.launch import sharing, values
from robo.launch.forms import is_name, text_of
from robo.launch.language import Written, fill, keys_of, merged, values_of
from robo.launch.layers import Layer
from robo.launch.manifest import Need, TopicPromise
from robo.launch.plan import ProcessPlan, ReadyPlan, TopicPlan
from robo.launch.substitution import Complain, Scope
from robo.launch.values import Files, Mention
from robo.text.tree import Entry, Map, Position, Scalar
from robo.wire import names
from robo.wire.qos import QoS

_PROGRAM = {"service", "run"}


class Origin(msgspec.Struct, frozen=True):
    """Where something is said of a process, and whether of its whole group."""

    position: Position
    shared: bool


class Draft(msgspec.Struct, frozen=True, kw_only=True):
    """A process but for what can only be known when all are."""

    plan: ProcessPlan
    key: str
    """What it is called in its group, without the number of a repetition."""
    position: Position
    service_at: Position
    remap_at: dict[str, Origin]
    mentions: dict[str, list[Mention]]
    needs: Sequence[Need]


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """Where in a launch a process stands."""

    namespace: str
    group: str
    hosts: tuple[str, ...]


def draft(
    key: str, default_name: str, layers: Sequence[Layer], place: Place, files: Files, complain: Complain
) -> Draft | None:
    """One process.

    Args:
        key: what it is called in its group.
        default_name: its name where none is said.
        layers: from the outermost group to the last override, the node itself among them.
        place: where it stands.
        files: the parameter files of the launch.
        complain: takes the mistakes.

    Returns:
        The draft; None where its name is not valid.
    """
    own = [layer for layer in layers if not layer.of_group]
    plain = merged(keys_of(ProcessPlan), _of_one_program(layers))
    said = values_of(keys_of(ProcessPlan), {"name": Scalar(default_name, own[0].position)} | plain, complain)
    is_named = "name" in said  # else its other mistakes are told all the same
    said.setdefault("name", default_name)
    namespace = within(_last_namespace(own), place.namespace, complain)
    remap = _remap(layers, complain)
    renamed = {old: new for old, (new, _) in remap.items()}
    env = _env(layers, complain)
    sharing.check_own(said.get("process"), plain, {name: where for name, (_, where) in env.items()}, complain)
    mentions, read = values.gather(layers if is_named else (), namespace, said["name"], files, complain)
    plan = ProcessPlan(
        **_with_defaults(said, plain, namespace, renamed),
        namespace=namespace,
        group=place.group,
        hosts=place.hosts,
        settings={},
        parameter_files=read,
        remap=renamed,
        env={variable: value for variable, (value, _) in env.items()},
        needs={},
        publishes=_endpoints("publishes", own, complain),
        subscribes=_endpoints("subscribes", own, complain),
        sources={
            "remap": {old: origin.position for old, (_, origin) in remap.items()},
            "env": {variable: position for variable, (_, position) in env.items()},
        },
        source=own[0].position,
    )
    needs = [layer.needs for layer in own if layer.needs is not None]
    if not is_named:
        return None
    return Draft(
        plan=plan,
        key=key,
        position=own[0].position,
        service_at=plain["service"].position if "service" in said else own[0].position,
        remap_at={old: origin for old, (_, origin) in remap.items()},
        mentions=mentions,
        needs=needs[-1] if needs else (),
    )


def _of_one_program(layers: Sequence[Layer]) -> list[Written]:
    """What layers say, a service that is replaced by a command left out, and the other way round."""
    saying = [layer.plain for layer in layers if _PROGRAM & layer.plain.keys()]
    return [
        {name: tree for name, tree in layer.plain.items() if name not in _PROGRAM or layer.plain is saying[-1]}
        for layer in layers
    ]


def _with_defaults(said: dict[str, Any], plain: Written, namespace: str, remap: dict[str, str]) -> dict[str, Any]:
    """The values of a process, with the defaults that depend on what it runs."""
    is_node = "service" in said
    ready: ReadyPlan = said.get("ready", ReadyPlan())
    written = plain.get("ready")
    if not is_node and not (isinstance(written, Map) and written.get("when") is not None):
        ready = msgspec.structs.replace(ready, when="started")
    keys = [names.resolve(topic, namespace=namespace, node="node", remappings=remap) for topic in ready.topics]
    process = sharing.process_name(said.get("process"), namespace)
    found = said | {"ready": msgspec.structs.replace(ready, topics=tuple(keys)), "process": process}
    if not is_node or "prefix" in plain:  # a debugger stands still on purpose
        found.setdefault("watchdog", 0.0)
    return found


def _last_namespace(layers: Sequence[Layer]) -> Scalar | None:
    return next((layer.namespace for layer in reversed(layers) if layer.namespace is not None), None)


def within(written: Scalar | None, outer: str, complain: Complain) -> str:
    """A filled namespace within the outer one; one that begins with / is in no other."""
    text = text_of(written, complain) if written is not None else None
    if text is None or written is None:
        return outer
    try:
        inner = names.normalize_namespace(text)
    except InvalidName as error:
        complain(written.position, str(error))
        return outer
    return inner if text.startswith("/") else names.join(outer, inner)


def _remap(layers: Sequence[Layer], complain: Complain) -> dict[str, tuple[str, Origin]]:
    """By name, the other name; those that are not valid are mistakes."""
    found: dict[str, tuple[str, Origin]] = {}
    for layer in layers:
        for entry in layer.remap:
            text = _text(entry, complain)
            if text is None or not is_name(entry.key, entry.position, complain):
                continue
            if is_name(text, entry.value.position, complain):
                found[entry.key] = (text, Origin(entry.position, layer.of_group))
    return found


def _env(layers: Sequence[Layer], complain: Complain) -> dict[str, tuple[str, Position]]:
    """Environment variables, and where each is said."""
    found: dict[str, tuple[str, Position]] = {}
    for layer in layers:
        for variable in layer.env:
            text = text_of(variable.value, complain)
            if text is not None and "\0" in text:
                complain(variable.value.position, f"env {variable.name} holds a zero character")
            elif text is not None:
                found[variable.name] = (text, variable.position)
    return found


def _endpoints(key: Literal["publishes", "subscribes"], layers: Sequence[Layer], complain: Complain) -> dict[str, str]:
    """What a command is said to publish or to subscribe."""
    entries = [entry for layer in layers for entry in (layer.publishes if key == "publishes" else layer.subscribes)]
    named = [entry for entry in entries if is_name(entry.key, entry.position, complain)]
    return {entry.key: text for entry in named if (text := _text(entry, complain)) is not None}


def _text(entry: Entry, complain: Complain) -> str | None:
    return text_of(entry.value, complain) if isinstance(entry.value, Scalar) else None


def promise(topic: TopicPromise, scope: Scope, namespace: str, complain: Complain) -> TopicPlan | None:
    """What is promised of a topic; None where its name is not valid."""
    if not is_name(topic.name, topic.position, complain):
        return None
    if topic.name.startswith("~"):
        complain(topic.position, f"topic {topic.name}: private names are a node's; write it whole")
        return None
    filled = fill(keys_of(TopicPlan), topic.promise, scope)
    plan = TopicPlan(
        key=names.resolve(topic.name, namespace=namespace, node="node"),
        source=topic.position,
        **values_of(keys_of(TopicPlan), filled, complain),
    )
    if plan.qos is not None:
        try:
            plan.qos.over(QoS.DEFAULT).of_publisher()
        except ContractError as error:
            complain(topic.position, f"topic {topic.name}: {error}")
    return plan
