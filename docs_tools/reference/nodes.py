"""The page of nodes that ship, from their contracts."""

import importlib
import math
import pkgutil
from collections.abc import Iterable, Iterator

import robo
import robo_services
from docs_tools.reference import messages
from docs_tools.reference.markdown import Gap, code, described, paragraphs, prose, sentence, table
from robo.launch.expression import as_text
from robo.node.contract import ClientDeclaration, Contract, ServiceDeclaration, contract_of
from robo.packages.absent import installing
from robo.parameters.hints import ParameterInfo, range_text
from robo.text.docstrings import attribute_docs, first_sentence
from robo.wire.keys import SYSTEM_TOPICS
from robo_messages import service_type_name, type_name

WITHOUT_UNIT = {
    "bag_player.rate",
    "camera.playback_rate",
    "carmen_player.rate",
    "diff_drive_controller.left_wheel_radius_multiplier",
    "diff_drive_controller.right_wheel_radius_multiplier",
    "diff_drive_controller.wheel_separation_multiplier",
    "diff_drive_sim.errors.left_wheel_radius",
    "diff_drive_sim.errors.right_wheel_radius",
    "diff_drive_sim.errors.wheel_separation",
    "diff_drive_sim.real_time_factor",
    "ekf_filter.sources.*.rejection_threshold",
    "emulated_board.cut",
    "emulated_board.garbled",
    "emulated_board.noise",
    "emulated_board.ticks_per_revolution",
    "emulated_lidar.garbled",
    "emulated_lidar.lost",
    "joy.deadzone",
    "mujoco_sim.friction",
    "mujoco_sim.real_time_factor",
    "nmea_gps.playback_rate",
    "safety_monitor.zones.*.share",
    "serial_base.left_wheel_radius_multiplier",
    "serial_base.right_wheel_radius_multiplier",
    "serial_base.ticks_per_revolution",
    "serial_base.trim",
    "serial_base.wheel_separation_multiplier",
}
"""Numbers with a point that are ratios; all others have a unit."""


def lines() -> list[str]:
    """The page's lines."""
    found = [
        "Names of topics and services are relative: they stand in the node's namespace, which is the robot's name, and",
        "can be remapped. *At the start* marks a parameter that can be set only then; all others can be set while",
        "the node runs.",
        "",
        "Every node also publishes " + ", ".join(
            f"{code(topic)} ({messages.link_to(type_)})" for topic, type_ in SYSTEM_TOPICS.items()
        ) + f", has the parameter {code('use_sim_time')}, and answers the queries of [the key space](keys.md).",
        "",
    ]  # fmt: skip
    for cls in shipped():
        found += _node(cls)
    return found


def shipped() -> Iterator[type[robo.Node]]:
    """The node classes that ship, by the names of their modules."""
    for module in sorted(one.name for one in pkgutil.iter_modules(robo_services.__path__)):
        for value in vars(importlib.import_module(f"robo_services.{module}")).values():
            if isinstance(value, type) and issubclass(value, robo.Node) and value.__module__.endswith(f".{module}"):
                yield value


def _node(cls: type[robo.Node]) -> list[str]:
    contract = contract_of(cls)
    return [
        f"## {contract.name}",
        "",
        *paragraphs(described(contract.description, contract.name)),
        f"{code(f'robo run {cls.__module__}')}, or {code(f'service: {cls.__module__}')} in a manifest.",
        "",
        *(f"It needs {code(m)}: {code(installing(what))}.\n" for m, what in cls.REQUIRES.items()),
        *_topics(cls, contract),
        *_services(cls, contract),
        *_parameters(contract),
    ]


def _topics(cls: type[robo.Node], contract: Contract) -> list[str]:
    header = ("topic", "type", "quality of service", "what")
    subscribed = [
        (code(s.topic), messages.link_to(type_name(s.message_type)), str(s.qos), _said(cls, s.method, s.turn))
        for s in contract.subscriptions
    ]
    published = [
        (
            code(p.topic),
            messages.link_to(type_name(p.message_type)),
            str(p.qos),
            prose(_documented(cls, p.attribute)),
        )
        for p in contract.publishers
    ]
    checks = [(c.name, _said(cls, c.method, "")) for c in contract.checks]
    timers = [(code(t.method), _rate(t.rate), _said(cls, t.method, t.turn)) for t in contract.timers]
    return [
        *_titled("Subscribes", table(header, subscribed)),
        *_titled("Publishes", table(header, published)),
        *_titled("Timers", table(("callback", "rate", "what"), timers)),
        *_titled("Checks", table(("check", "what"), checks)),
    ]


def _services(cls: type[robo.Node], contract: Contract) -> list[str]:
    served = [(code(s.service), _service_type(s), _said(cls, s.method, s.turn)) for s in contract.services]
    called = [
        (
            code(c.service),
            _service_type(c),
            prose(_documented(cls, c.attribute)),
        )
        for c in contract.clients
    ]
    header = ("service", "type", "what")
    return [*_titled("Services", table(header, served)), *_titled("Calls", table(header, called))]


def _documented(cls: type[robo.Node], path: str) -> str:
    """What is said of an attribute of a node class, or of one of its parts."""
    owner, name = _owner(cls, path)
    return described(attribute_docs(owner).get(name, ""), f"{cls.__name__}.{path}")


def _owner(cls: type[robo.Node], path: str) -> tuple[type[object], str]:
    """The class that declares what is found at a path, `part.name` for a part of a node, and its name there."""
    part, _, name = path.rpartition(".")
    return (type(getattr(cls, part)), name) if part else (cls, name)


def _service_type(declared: ServiceDeclaration | ClientDeclaration) -> str:
    return messages.link_to(service_type_name(declared.request_type, declared.response_type))


def _parameters(contract: Contract) -> list[str]:
    own = [one for one in contract.parameters if one.name != "use_sim_time"]
    header = ("parameter", "type", "default", "unit", "range", "set", "what")
    return _titled("Parameters", table(header, [_parameter(contract.name, one) for one in own]))


def _parameter(node: str, info: ParameterInfo) -> tuple[str, ...]:
    name = f"{node}.{info.name}"
    if info.type == "float" and not info.unit and name not in WITHOUT_UNIT:
        raise Gap(f"parameter {name} has no unit; put Unit(…) beside its type")
    return (
        code(info.name),
        info.type,
        "needed" if info.default is None else code(as_text(info.default)) if info.default != "" else "empty",
        info.unit,
        prose(range_text({key: _short(value) for key, value in info.constraints.items()})),
        "at the start" if info.read_only else "",
        prose(sentence(described(info.description, f"parameter {name}"))),
    )


def _short(value: object) -> object:
    """A limit; of one that is a multiple of π what it is made of."""
    if isinstance(value, float) and value and value % math.pi == 0:
        return f"{value / math.pi:g}π"
    return f"{value:.15g}" if isinstance(value, float) else value


def _rate(rate: float | str) -> str:
    return code(rate) if isinstance(rate, str) else f"{rate:g} Hz"


def _said(cls: type[robo.Node], method: str, turn: str) -> str:
    owner, name = _owner(cls, method)
    said = prose(described(first_sentence(getattr(owner, name).__doc__ or ""), f"{cls.__name__}.{method}"))
    return f"{said} Has the turn {code(turn)}." if turn else said


def _titled(title: str, body: Iterable[str]) -> list[str]:
    """A table under its title; nothing for an empty one."""
    rows = list(body)
    return [f"**{title}**", "", *rows] if rows else []
