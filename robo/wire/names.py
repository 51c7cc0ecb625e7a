"""Names as ROS has them, and the key expressions they become.

A name is *relative* (`odom`), *absolute* (`/odom`) or *private* (`~/state`, below the node). Resolved
in namespace `r1` for node `tracker` they are the keys `r1/odom`, `odom` and `r1/tracker/state`: a
fully qualified name without its leading slash is the key expression.
"""

import re
from collections.abc import Mapping

from robo.errors import InvalidName

RULE = "letters, digits and _, not starting with a digit"

_CHUNK = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_WILD = ("*", "**")


def is_word(name: str) -> bool:
    """Whether a name is one chunk: letters, digits and `_`, not starting with a digit."""
    return _CHUNK.match(name) is not None


def is_name(name: str) -> bool:
    """Whether a name is one of a topic or service: relative, absolute or private."""
    try:
        _expand(name, "", "node")
    except InvalidName:
        return False
    return True


def check_node_name(name: str) -> str:
    """A node's name: one chunk.

    Raises:
        InvalidName: it is empty or holds anything but letters, digits and `_`.
    """
    if not _CHUNK.match(name):
        raise InvalidName(f"node name {name!r}: use {RULE}")
    return name


def normalize_namespace(namespace: str) -> str:
    """A namespace without its outer slashes; `""` and `"/"` are the root.

    Raises:
        InvalidName: a part of it is no valid name.
    """
    stripped = namespace.strip("/")
    if stripped:
        _check_chunks("namespace", namespace, stripped)
    return stripped


def robot_name(name: str) -> str:
    """A robot's name without its outer slashes: it is the namespace of its nodes.

    Raises:
        InvalidName: it is empty, or a part of it is no valid name.
    """
    stripped = name.strip("/")
    if not stripped:
        raise InvalidName(f"robot name {name!r} is empty; give it one, for example r1")
    _check_chunks("robot name", name, stripped)
    return stripped


def join(*parts: str) -> str:
    """Join parts of a key, leaving out empty ones."""
    return "/".join(part for part in parts if part)


def resolve(name: str, *, namespace: str, node: str, remappings: Mapping[str, str] | None = None) -> str:
    """The key expression of a topic or service name, after remapping.

    A remapping's left side may be written like the name itself (`odom`), or be any name that
    resolves to the same key (`/r1/odom`); its right side is resolved like a name.

    Args:
        name: relative, absolute or private.
        namespace: the node's namespace, without outer slashes.
        node: the node's name.
        remappings: from name to name.

    Raises:
        InvalidName: the name or a remapping breaks the rules.
    """
    key = _expand(name, namespace, node)
    for old, new in (remappings or {}).items():
        if old == name or _expand(old, namespace, node) == key:
            return _expand(new, namespace, node)
    return key


def absolute(name: str, namespace: str) -> str:
    """A node's full name as somebody in a namespace means it: `monitor` in `r1` to `/r1/monitor`."""
    return name if name.startswith("/") else "/" + join(namespace, name)


def key_of(name: str) -> str:
    """The key expression of a topic's full name as people type it, with or without its outer slashes.

    `*` stands for one part and `**` for any number of parts. Beside letters `*` stands for any others within a
    part: `r*/odom`, which Zenoh writes `r$*/odom`.

    Raises:
        InvalidName: the name is empty or no valid key expression.
    """
    chunks: list[str] = []
    for part in name.strip("/").split("/"):
        chunk = part.replace("$*", "*")
        wrong = _fault_of_key_chunk(chunk)
        if wrong:
            raise InvalidName(f"name {name!r} {wrong}; write a full name, for example r1/odom, 'r*/odom' or 'r1/**'")
        if chunk in _WILD:
            if chunk == "*" and chunks[-1:] == ["**"]:
                chunks.insert(-1, chunk)  # Zenoh knows `**/*` only as `*/**`
            elif chunks[-1:] != ["**"]:
                chunks.append(chunk)
        else:
            chunks.append(chunk.replace("*", "$*"))
    return "/".join(chunks)


def shown_key(key: str) -> str:
    """A key expression as somebody would type it."""
    return key.replace("$*", "*")


def split(full_name: str) -> tuple[str, str]:
    """The namespace and the name of a node: `/r1/arm/driver` to `r1/arm` and `driver`."""
    namespace, _, name = full_name.strip("/").rpartition("/")
    return namespace, name


def label(namespace: str, full_name: str) -> str:
    """What a node is called in a robot's output: its full name, without the robot's namespace if it is in there."""
    return full_name.strip("/").removeprefix(f"{namespace.strip('/')}/")


def _fault_of_key_chunk(chunk: str) -> str:
    """What is wrong with a part of a key expression, after `the name …`; empty where it is fine."""
    if not chunk:
        return "has an empty part"
    if "**" in chunk and chunk not in _WILD:
        return f"has ** within the part {chunk!r}: it stands alone between slashes"
    bad = next((c for c in chunk if c in "#?$~ " or not c.isprintable()), None)
    return "" if bad is None else f"holds {bad!r}"


def _expand(name: str, namespace: str, node: str) -> str:
    if name.startswith("/"):
        body, key = name[1:], name[1:]
    elif name == "~" or name.startswith("~/"):
        body = name[2:] if name != "~" else node
        key = join(namespace, node, name[2:])
    else:
        body, key = name, join(namespace, name)
    _check_chunks("name", name, body)
    return key


def _check_chunks(what: str, shown: str, body: str) -> None:
    for chunk in body.split("/"):
        if not _CHUNK.match(chunk):
            fault = "is not valid" if chunk == shown else f"has part {chunk!r}" if chunk else "has an empty part"
            raise InvalidName(f"{what} {shown!r} {fault}; use {RULE}, parts joined by /{_instead(body)}")


def _instead(body: str) -> str:
    """A hint at a name that obeys the rules and is close to one that does not."""
    import unicodedata  # a name that is wrong is rare, and the table of all characters large

    plain = unicodedata.normalize("NFKD", body).encode("ascii", "ignore").decode()
    chunks = [re.sub(r"^(?=[0-9])|[^A-Za-z0-9_]+", "_", chunk) for chunk in plain.split("/")]
    return f"; did you mean {'/'.join(chunks)}?" if all(map(is_word, chunks)) else ""
