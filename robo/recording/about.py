"""What a recording says of the robot beside its messages: parameters, graph, manifests, versions."""

import platform
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import msgspec
import zenoh

from robo.bag.of_robot import PARAMETERS, ROBOTS
from robo.bag.publishers import GRAPH
from robo.text import graph
from robo.text.brief import brief
from robo.text.paths import nested
from robo.text.terminal import visible
from robo.text.unreadable import UNREADABLE
from robo.version import VERSION
from robo.wire import codec, discovery, liveliness, names
from robo.wire.keys import EndpointToken, NodeToken, parameters_key, parse_token

TIMEOUT = 1.0
"""How long nodes may take to tell their parameters, s."""
SETTLE = 0.5
"""After a node has appeared: how long it is waited for others, s."""
PERIOD = 10.0
"""So often, at most, it is looked again, s."""
MOST_LOOKS = 50
"""Of one recording: nodes that come and go fill no file."""
_MOST_NODES = 10_000
"""Of one recording: those of more are not looked for."""
_MOST_PARAMETERS = 10_000_000
"""Of all nodes together, bytes."""

Manifests = Callable[[Iterable[str]], Mapping[str, bytes]]
"""The manifests of runs, by their ids: the text of each by its file's name, as far as this machine has them."""


class Attachment(NamedTuple):
    """A file that goes into a recording."""

    name: str
    data: bytes
    media_type: str


class About(NamedTuple):
    """What there was to see at one moment."""

    attachments: list[Attachment]
    metadata: dict[str, str]


def no_manifests(_: Iterable[str]) -> Mapping[str, bytes]:
    """Of no run a manifest is at hand."""
    return {}


def look(session: zenoh.Session, manifests: Manifests = no_manifests, timeout: float = TIMEOUT) -> About:
    """See what runs.

    Args:
        session: the network.
        manifests: has those of runs.
        timeout: how long nodes may take to answer, s.
    """
    tokens = discovery.tokens(session, timeout)
    nodes = [token for token in tokens if isinstance(token, NodeToken)]
    attachments = [
        Attachment(PARAMETERS, parameters_yaml(_parameters(session, timeout)).encode(), "text/yaml"),
        Attachment(GRAPH, msgspec.json.format(msgspec.json.encode(graph_of(tokens))), "application/json"),
    ]
    for name, text in manifests({token.run for token in nodes if token.run}).items():
        attachments.append(Attachment(f"manifests/{name}", text, "text/yaml"))
    return About(attachments, words(nodes))


def words(nodes: Iterable[NodeToken]) -> dict[str, str]:
    """Who records what, and with which versions."""
    nodes = list(nodes)
    return {
        ROBOTS: " ".join(sorted({token.namespace for token in nodes})),
        "nodes": " ".join(sorted(token.full_name for token in nodes)),
        "runs": " ".join(sorted({token.run for token in nodes if token.run})),
        "host": discovery.hostname(),
        "robo": VERSION,
        "python": platform.python_version(),
        "zenoh": _version("eclipse-zenoh"),
        "platform": platform.platform(),
    }


def graph_of(tokens: Iterable[NodeToken | EndpointToken]) -> graph.Graph:
    """Nodes, topics, services and actions, as `robo graph --json` has them."""
    tokens = list(tokens)
    return graph.build(
        [graph.GraphNode(token.full_name, token.class_name) for token in tokens if isinstance(token, NodeToken)],
        [
            graph.Edge(token.full_name, token.kind, token.topic, token.type_name)
            for token in tokens
            if isinstance(token, EndpointToken)
        ],
    )


def parameters_yaml(by_node: Mapping[str, Mapping[str, object]]) -> str:
    """Parameters by node's full name as a file that `robo up` and ROS 2 read."""
    from robo.parameters.files import ROS_KEY  # a node that may record carries YAML only if it does
    from robo.text.yaml_tree import as_yaml

    found = []
    for node, values in sorted(by_node.items()):
        try:
            tree = nested({str(name): codec.jsonable(value) for name, value in values.items()}, ".")
            found.append(as_yaml({node: {ROS_KEY: tree}}))
        except Exception as error:  # a stranger's: a name that is a value and a group too, objects, lists without end
            found.append(f"# {visible(node)}: its parameters make no sense: {brief(type(error).__name__)}\n")
    return "".join(found) or as_yaml({})


def _parameters(session: zenoh.Session, timeout: float) -> dict[str, dict[str, object]]:
    found: dict[str, dict[str, object]] = {}
    left = _MOST_PARAMETERS
    for reply in session.get(parameters_key("", "**", "get"), timeout=timeout):
        if reply.ok is None:
            continue
        payload = reply.ok.payload.to_bytes()
        left -= len(payload)
        node = str(reply.ok.key_expr).removesuffix("/parameters/get")
        if left < 0 or not all(map(names.is_word, node.split("/"))):
            continue
        try:
            found[f"/{node}"] = msgspec.msgpack.decode(payload, type=dict[str, object])
        except UNREADABLE:
            continue
    return found


def _version(distribution: str) -> str:
    from importlib.metadata import PackageNotFoundError, version  # 4 MB

    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


class Watch:
    """Looks at what runs: at once, and again when nodes have appeared, on a thread of its own."""

    def __init__(
        self,
        session: zenoh.Session,
        told: Callable[[About], object],
        failed: Callable[[str], object],
        manifests: Manifests = no_manifests,
    ) -> None:
        """
        Args:
            session: the network.
            told: is called with what there was to see, by that thread.
            failed: is called with why nothing could be seen, in a sentence; it looks no more then.
            manifests: has those of runs.
        """
        self._session = session
        self._told, self._failed = told, failed
        self._manifests = manifests
        self._appeared = False
        self._changed = threading.Event()
        self._over = threading.Event()
        self._seen: set[str] = set()
        self._there: set[str] = set()
        """The nodes that were heard of and have not gone, by full name."""
        handler = zenoh.handlers.Callback(self._notice, indirect=False)
        self._subscriber = liveliness.hear(session, NodeToken.ALL, handler)
        self._thread = threading.Thread(target=self._run, name="robo-about", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Look no more; a look that has begun is waited for."""
        self._over.set()
        self._changed.set()
        self._thread.join(2 * TIMEOUT + 1.0)
        self._subscriber.undeclare()

    def _notice(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        token = parse_token(key)
        if not isinstance(token, NodeToken):
            return
        if sample.kind == zenoh.SampleKind.DELETE:
            self._there.discard(token.full_name)
        elif key not in self._seen and len(self._seen) < _MOST_NODES:
            self._seen.add(key)
            self._there.add(token.full_name)
            self._appeared = True
            self._changed.set()

    def _run(self) -> None:
        """Look; again when nodes have appeared, ever less often; and once more before it is over, where some have."""
        for number in range(MOST_LOOKS):
            self._appeared = False
            try:
                found = look(self._session, self._manifests)
                self._told(found)
            except Exception as error:  # of the network, of a disk with manifests, of what strangers say
                if not self._over.is_set():
                    why = str(error) if isinstance(error, zenoh.ZError) else f"{type(error).__name__}: {error}"
                    self._failed(brief(f"parameters and graph are not in the recording: {why}"))
                return
            # On a busy machine the answer may lack who has been heard of meanwhile.
            self._appeared |= not self._there <= set(found.metadata["nodes"].split())
            while not self._appeared:
                if self._over.is_set():
                    return
                self._changed.wait()
                self._changed.clear()
            self._over.wait(min(SETTLE * 2**number, PERIOD))
