"""The command line of a single node: `python -m robo_services.position_tracker --robot-name r1 …`."""

import argparse
import os
import sys
from collections.abc import Sequence

import msgspec

from robo.environment import MODE_VARIABLE, SPEC_VARIABLE
from robo.errors import UsageError
from robo.node.contract_data import ContractData
from robo.node.contract_text import contract_data, contract_text
from robo.node.node import Node
from robo.parameters import files as parameter_files
from robo.parameters.words import parse_assignment, sides_of
from robo.process.spec import InRos, NodeSpec
from robo.text.choices import choice_of
from robo.text.readable import readable
from robo.text.terminal import lenient
from robo.wire.keys import parse_number
from robo.wire.network import MODES, Mode
from robo.wire.reports import Setting

_MOST_DOMAIN = 232
"""The largest ROS_DOMAIN_ID."""


def parse(node_class: type[Node], arguments: Sequence[str]) -> NodeSpec:
    """The spec of a node from its command line. Exits on `--help` and on unknown options.

    Raises:
        ParameterError: a `-p` is not `name:=value`.
        ParameterFileError: a parameter file is missing or has mistakes.
        UsageError: a `-r` is not `from:=to`.
    """
    contract = contract_data(node_class)
    lenient(sys.stdout)  # units have characters such as those of m/s²
    options = _parser(node_class, contract).parse_args(arguments)
    launched = _launched()
    name = options.name or launched.name
    namespace = options.robot_name if options.robot_name is not None else launched.namespace
    settings = {parameter: list(found) for parameter, found in launched.settings.items()}
    for path in options.params_file:
        file = parameter_files.load(path)
        for warning in file.warnings:
            print(f"WARN {warning}", file=sys.stderr)
        for entry in file.entries:
            if entry.matches(namespace or "", name or contract.name):
                for parameter, value in entry.values.items():
                    settings.setdefault(parameter, []).append(Setting(value, str(entry.positions[parameter])))
    for parameter, value in (parse_assignment(text, node_class.Parameters) for text in options.param):
        settings.setdefault(parameter, []).append(Setting(value, "command line"))
    return msgspec.structs.replace(
        launched,
        service=contract.class_name,
        name=name,
        namespace=namespace,
        settings=settings,
        remappings=launched.remappings | dict(map(_remapping, options.remap)),
        connect=tuple(options.connect) or launched.connect,
        listen=tuple(options.listen) or launched.listen,
        autostart=launched.autostart and not getattr(options, "no_autostart", False),
        mode=launched.mode or _mode(),
        ros2=_in_ros(options),
    )


def _launched() -> NodeSpec:
    """What a launch has said of the command that runs this node; options stand above it."""
    given = os.environ.pop(SPEC_VARIABLE, None)
    return msgspec.json.decode(given, type=readable(NodeSpec)) if given else NodeSpec()


def _mode() -> Mode:
    """How a node that nobody has launched joins the network: ROBO_MODE, or alone as a router of its own.

    Raises:
        UsageError: ROBO_MODE is not a mode.
    """
    given = os.environ.get(MODE_VARIABLE) or "router"
    mode = choice_of(given, MODES)
    if mode is None:
        raise UsageError(f"ROBO_MODE={given}: use one of {', '.join(MODES)}")
    return mode


def _in_ros(options: argparse.Namespace) -> InRos | None:
    said = {
        name: value
        for name, value in (("connect", options.ros_connect), ("domain", options.ros_domain))
        if value is not None
    }
    if said and not options.ros2:
        raise UsageError(f"--ros-{next(iter(said))} says where the graph of ROS 2 is; add --ros2 to be in it")
    return InRos(**said) if options.ros2 else None


def _domain(text: str) -> int:
    found = parse_number(text)
    if found is None or found > _MOST_DOMAIN:
        raise argparse.ArgumentTypeError(f"{text} is no ROS_DOMAIN_ID: write a number from 0 to {_MOST_DOMAIN}")
    return found


def _parser(node_class: type[Node], contract: ContractData) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"robo run {_module_name(node_class)}",
        description=contract.description.split("\n")[0],
        epilog=contract_text(contract),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--robot-name", "--namespace", metavar="NAME", help="namespace of the node's names (or ROBO_NAMESPACE)")
    add("--name", metavar="NAME", help=f"the node's name (default {contract.name})")
    add("-p", "--param", metavar="NAME:=VALUE", action="append", default=[], help="set a parameter")
    add("--params-file", metavar="FILE", action="append", default=[], help="read parameters from a YAML file")
    add("-r", "--remap", metavar="FROM:=TO", action="append", default=[], help="use another name for a topic")
    add("--connect", metavar="ENDPOINT", action="append", default=[], help="dial a router (or ROBO_CONNECT)")
    add("--listen", metavar="ENDPOINT", action="append", default=[], help="listen here (or ROBO_LISTEN)")
    add("--ros2", action="store_true", help="be in the graph of ROS 2 as well, without a bridge between")
    add("--ros-connect", metavar="ENDPOINT", help=f"its router, with --ros2 (default {InRos().connect})")
    add("--ros-domain", metavar="N", type=_domain, help="its ROS_DOMAIN_ID, with --ros2 (default 0)")
    if contract.managed:
        add("--no-autostart", action="store_true", help="wait in unconfigured until somebody asks for a transition")
    return parser


def _module_name(node_class: type[Node]) -> str:
    """The module's importable name, also where Python runs it as `__main__`."""
    spec = getattr(sys.modules[node_class.__module__], "__spec__", None)
    return spec.name if spec is not None else node_class.__module__


def _remapping(text: str) -> tuple[str, str]:
    old, new = sides_of(text) or ("", "")
    if not (old and new):
        raise UsageError(f"remapping {text!r}: write from:=to, for example odom:=robot/odom")
    return old, new
