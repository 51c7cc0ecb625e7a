"""The words of the launch language: every key a manifest may hold, what it says and which form it takes.

The reader refuses keys that are not here; the published JSON Schema is made from the same tables.
"""

from typing import Any, Final, NamedTuple

Schema = dict[str, Any]


MOST: Final = 1_000_000_000
"""No number of a manifest is larger."""

MOST_PROCESSES: Final = 2_000
"""A launch starts no more."""


class Limits(NamedTuple):
    """The numbers that a key takes, the limits included."""

    low: float
    high: float = MOST
    whole: bool = False

    def hold(self, value: object) -> bool:
        """Whether a value is such a number."""
        kinds = int if self.whole else (int, float)
        return isinstance(value, kinds) and not isinstance(value, bool) and self.low <= value <= self.high

    def __str__(self) -> str:
        noun = "a whole number" if self.whole else "a number"
        return f"{noun} of at least {self.low}" if self.high == MOST else f"{noun} from {self.low} to {self.high}"


class Key(NamedTuple):
    """A key of a map."""

    about: str
    schema: Schema
    limits: Limits | None = None
    """Of a key that takes a number: the reader refuses others, and so does the schema."""


def _one_of(*forms: Schema) -> Schema:
    return {"anyOf": list(forms)}


def _ref(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _map_of(form: Schema) -> Schema:
    return {"type": "object", "additionalProperties": form}


def _words(*values: str) -> Schema:
    return _one_of({"enum": list(values)}, PLACEHOLDER)


PLACEHOLDER: Final[Schema] = {"type": "string", "pattern": r"\$\{"}
"""Wherever a value is expected, text with `${…}` in it may stand."""

TEXT: Final[Schema] = {"type": "string"}
SCALAR: Final[Schema] = {"type": ["string", "number", "boolean", "null"]}
CONDITION: Final[Schema] = {"type": ["boolean", "string"]}
_LIST: Final[Schema] = {"type": "array", "items": TEXT}
_RATE: Final[Schema] = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": MOST}
_PORT: Final[Schema] = {"type": "integer", "minimum": 1, "maximum": 65_535}
_CPU: Final[Schema] = {"type": "integer", "minimum": 0, "maximum": 9_999}
COMMAND: Final[Schema] = _one_of(TEXT, {"type": "array", "items": SCALAR, "minItems": 1})


def _number(about: str, low: float, high: float = MOST, *, whole: bool = False) -> Key:
    form: Schema = {"type": "integer" if whole else "number", "minimum": low, "maximum": high}
    return Key(about, _one_of(form, PLACEHOLDER), Limits(low, high, whole))


ARG_TYPES: Final = ("str", "int", "float", "bool", "path", "choice")
RESTART_POLICIES: Final = ("never", "on-failure", "always")
LOG_OUTPUTS: Final = ("screen", "file", "both")
LOG_LEVELS: Final = ("debug", "info", "warn", "error", "fatal")
NEEDS: Final = ("started", "ready", "completed")
READY_WHEN: Final = ("node", "started")
STOP_SIGNALS: Final = ("INT", "TERM", "HUP", "QUIT", "USR1", "USR2", "KILL")
SIGNAL_WORDS: Final = (*STOP_SIGNALS, *(f"SIG{name}" for name in STOP_SIGNALS))

_CONDITIONS = {
    "if": Key("Only where this expression is true: use_sim and mode == 'gazebo'.", CONDITION),
    "unless": Key("Only where this expression is false.", CONDITION),
}
_SETTINGS = {
    "namespace": Key("Put before every relative name; within the outer one, unless it begins with /.", TEXT),
    "params": Key("Parameter files and values, in order.", _ref("params")),
    "remap": Key("Other names for topics: {cmd_vel: cmd_vel_raw}.", _map_of(TEXT)),
    "env": Key("Environment variables.", _ref("env")),
    "restart": Key("When a process that ends is started again.", _ref("restart")),
    "log": Key("The least level shown, and where output goes.", _ref("log")),
    "replicas": _number("So many of it; ${index} counts from 1.", 0, MOST_PROCESSES, whole=True),
    "for_each": Key("One for each item of a list: {robot: [r1, r2]}; ${robot} and ${index} differ.", _ref("for_each")),
    **_CONDITIONS,
}

MANIFEST: Final = {
    "description": Key("What this starts, in a line.", TEXT),
    "args": Key("What can be chosen at the start: robo up FILE name:=value.", _map_of(_ref("arg"))),
    "include": Key("Other manifests, started as part of this one.", _ref("includes")),
    "groups": Key("Nodes that share settings and can be started by themselves.", _map_of(_ref("group"))),
    "topics": Key("What is promised of topics.", _map_of(_ref("topic"))),
}
ARG: Final = {
    "default": Key("The value where none is given; without it one has to be.", SCALAR),
    "required": Key("True where there is no default, which says it as well.", {"type": "boolean"}),
    "type": Key("By default the type of the default value.", {"enum": list(ARG_TYPES)}),
    "exists": Key("False for a path that the robot itself makes: others have to be there.", {"type": "boolean"}),
    "choices": Key("The only values allowed.", {"type": "array", "items": SCALAR, "minItems": 1}),
    "description": Key("What it means, shown by --show-args.", TEXT),
}
INCLUDE: Final = {
    "file": Key("Beside this file, in the workspace's launch/, or among the shipped ones.", TEXT),
    "args": Key("Values for its arguments.", _map_of(SCALAR)),
    "namespace": _SETTINGS["namespace"],
    "without": Key("Names of its nodes that are left out.", _one_of(TEXT, {"type": "array", "items": TEXT})),
    "override": Key("By the name of a node, what is different here.", _map_of(_ref("override"))),
    **_CONDITIONS,
}
GROUP: Final = {
    **_SETTINGS,
    "include": Key("Manifests that are part of this group.", _ref("includes")),
    "args": Key("Values for the arguments of the included manifests.", _map_of(SCALAR)),
    "nodes": Key("Processes to start.", _map_of(_ref("node"))),
    "groups": Key("Groups within this one; they inherit its settings.", _map_of(_ref("group"))),
    "hosts": Key(
        "The hosts that it runs on, where a robot has several: robo up --host NAME.",
        _one_of(TEXT, {"type": "array", "items": TEXT, "minItems": 1}),
    ),
    "topics": MANIFEST["topics"],
}
NODE: Final = {
    **_SETTINGS,
    "service": Key("A node class: package.module or package.module:Class.", TEXT),
    "run": Key("Any command, in any language: a list of words, or a line.", COMMAND),
    "name": Key("The node's name; by default the key.", TEXT),
    "args": Key("More words for the command.", COMMAND),
    "cwd": Key("The folder it runs in; by default the current one.", TEXT),
    "prefix": Key("Words before the command: gdb -ex run --args, valgrind.", COMMAND),
    "needs": Key("Nodes that come first: {position_tracker: ready}.", _ref("needs")),
    "ready": Key("What tells that it is ready.", _ref("ready")),
    "watchdog": _number("A node that gives no sign of life for so long hangs, s; 0 for never.", 0),
    "required": Key("Whether the launch ends with it.", CONDITION),
    "stop": Key("How it is told to end.", _ref("stop")),
    "priority": _number("The nice value; lower runs first.", -20, 19, whole=True),
    "cpus": Key("The processors it may use: [0, 1] or 0-3.", _ref("cpus")),
    "publishes": Key("What a command publishes, for the check: {scan: sensor/LaserScan}.", _map_of(TEXT)),
    "subscribes": Key("What a command subscribes, for the check.", _map_of(TEXT)),
}
RESTART: Final = {
    "policy": Key("never, on-failure or always.", _words(*RESTART_POLICIES)),
    "delay": _number("Before it is started again the first time, s.", 0),
    "backoff": _number("What each further delay is multiplied with.", 1),
    "max_delay": _number("The longest delay, s.", 0),
    "jitter": _number("The part of a delay that is left to chance, 0 to 1.", 0, 1),
    "max": _number("More restarts than these in a window make it degraded: from then on max_delay.", 0, whole=True),
    "window": _number("The window, s.", 0),
    "reset_after": _number("After being ready for so long it is healthy: delays begin anew, s.", 0),
    "propagate": Key("Whether what needs it is started again with it.", CONDITION),
}
STOP: Final = {
    "signal": Key("The first signal.", _words(*SIGNAL_WORDS)),
    "timeout": _number("How long until the next, harder one, s.", 0),
}
LOG: Final = {
    "level": Key("The least level that is shown.", _words(*LOG_LEVELS)),
    "output": Key("Where output goes.", _words(*LOG_OUTPUTS)),
}
READY: Final = {
    "when": Key("node: its liveliness token; started: its start.", _words(*READY_WHEN)),
    "log": Key("A line of output in which this pattern is found.", TEXT),
    "port": Key("Something listens there: 8080 or host:8080.", _one_of(_PORT, TEXT)),
    "probe": Key("A command that ends with exit code 0, tried again and again.", COMMAND),
    "topics": Key("Its topics that carry data, at the rate that is promised of them.", _one_of(TEXT, _LIST)),
    "timeout": _number("How long it may take, s; 0 for ever. Then it has failed.", 0),
}
TOPIC: Final = {
    "type": Key("The message type: sensor/LaserScan.", TEXT),
    "rate": Key("Messages per second: '>= 5', '<= 50', 10.", _one_of(_RATE, TEXT)),
    "max_age": _number("The newest message is never older, s.", 0),
    "external": Key("Whether somebody outside of this launch publishes it.", CONDITION),
}
PARAMS_ITEM: Final = {
    **_CONDITIONS,
    "file": Key("A parameter file.", TEXT),
    "values": Key("Values by name.", {"type": "object"}),
}
VARIABLE: Final = {
    **_CONDITIONS,
    "value": Key("Its value.", SCALAR),
}

SHORT_FORMS: Final[dict[str, tuple[dict[str, Key], tuple[Schema, ...]]]] = {
    "arg": (ARG, (SCALAR,)),
    "group": (GROUP, ()),
    "node": (NODE, ()),
    "override": (NODE, ()),
    "include": (INCLUDE, (TEXT,)),
    "restart": (RESTART, (_words(*RESTART_POLICIES),)),
    "stop": (STOP, (_words(*SIGNAL_WORDS),)),
    "log": (LOG, (_words(*LOG_OUTPUTS, *LOG_LEVELS),)),
    "ready": (READY, (_words(*READY_WHEN),)),
    "topic": (TOPIC, (TEXT,)),
    "params_item": (PARAMS_ITEM, (TEXT,)),
    "variable": (VARIABLE, (SCALAR,)),
}
"""Each part that is a map of known keys, with the shorter forms it may take."""

OTHER_FORMS: Final[dict[str, Schema]] = {
    "includes": _one_of(_ref("include"), {"type": "array", "items": _ref("include")}),
    # A map of plain values is as good as one with a condition.
    "params": _one_of(
        TEXT, {"type": "object"}, {"type": "array", "items": _one_of(_ref("params_item"), {"type": "object"})}
    ),
    "env": _map_of(_ref("variable")),
    "needs": _one_of(TEXT, {"type": "array", "items": TEXT}, _map_of({"enum": list(NEEDS)})),
    "for_each": {
        "type": "object",
        "minProperties": 1,
        "maxProperties": 1,
        "additionalProperties": {"type": "array"},
    },
    "cpus": _one_of(_CPU, TEXT, {"type": "array", "items": _one_of(_CPU, TEXT)}),
}
"""The parts that are not maps of known keys."""
