"""A node's parameters on the network: queries on `<namespace>/<node>/parameters/<verb>`.

| verb | request | reply |
|---|---|---|
| `list` | | `{names: […]}` |
| `get` | `{names: […]}`, or nothing for all | `{name: value}` |
| `describe` | the same | `{name: {type, value, default, description, unit, constraints, read_only}}` |
| `explain` | the same | `{name: [{value, source}, …]}`, the last one wins |
| `set` | `{name: value}` | `{successful, reason}`; all are set or none |

One query may read several verbs of several nodes (`r1/*/parameters/get`); `set` answers a query on exactly its key.
Requests and replies are MessagePack; JSON requests are read too and answered in JSON. A request may name
1,000 parameters and be 1,000,000 bytes long.
"""

from collections.abc import Callable, Mapping

import msgspec
import zenoh

from robo.errors import ParameterError
from robo.node.identity import Identity
from robo.parameters import model as parameters
from robo.parameters.hints import ParameterInfo
from robo.parameters.model import Parameters
from robo.text.brief import shown
from robo.text.suggestions import hint
from robo.wire import codec, queries
from robo.wire.codec import Malformed
from robo.wire.keys import parameters_key
from robo.wire.queries import QueryLoop
from robo.wire.reports import Result, Setting

LONGEST_REQUEST = 1_000_000
"""A longer request, in bytes, is refused unread."""

MOST_NAMES = 1_000
"""A request that names more parameters is refused."""

READING = ("list", "get", "describe", "explain")


class Answers:
    """What a node answers to a request about its parameters; knows of no network."""

    def __init__(
        self,
        full_name: str,
        current: Callable[[], Parameters],
        explain: Callable[[str], list[Setting]],
        set_all: Callable[[Mapping[str, object]], None],
    ) -> None:
        """
        Args:
            full_name: the node's.
            current: the parameters now; their names stay as they are at first.
            explain: everything that was said of one, from the weakest to what holds.
            set_all: sets several, all or none; raises ParameterError.
        """
        self._full_name = full_name
        self._current = current
        self._infos = {info.name: info for info in parameters.describe_running(current())}
        self._explain = explain
        self._set_all = set_all

    def to(self, verb: str, payload: bytes) -> object:
        """The answer as plain data, or Structs.

        Raises:
            Malformed: the request cannot be read, or is too long.
            ParameterError: it names a parameter that is not there.
        """
        request = _read(payload)
        if verb == "set":
            try:
                self._set_all(_changes(request))
            except ParameterError as error:
                return Result(False, str(error))
            return Result(True)
        if verb == "list":
            return {"names": list(self._infos)}
        wanted = self._wanted(request)
        values = parameters.flat(self._current())
        if verb == "get":
            return {name: values[name] for name in wanted}
        if verb == "explain":
            return {name: self._explain(name) for name in wanted}
        return {name: _described(self._infos[name]) | {"value": values[name]} for name in wanted}

    def _wanted(self, request: object) -> list[str]:
        if request is None or request == {}:
            return list(self._infos)
        wanted = request.get("names") if isinstance(request, dict) else request
        if not isinstance(wanted, list):
            raise Malformed("expected {names: [...]}, or nothing for all parameters")
        for name in wanted:
            if not isinstance(name, str) or name not in self._infos:
                raise ParameterError(f"{self._full_name} has no parameter {shown(name)}{hint(str(name), self._infos)}")
        return wanted


def _described(info: ParameterInfo) -> dict[str, object]:
    """What is told of a parameter; which topics it makes the node subscribe, others see from the topics."""
    return {name: value for name, value in msgspec.structs.asdict(info).items() if name != "subscribes"}


class ParameterServer:
    """Answers queries about a node's parameters."""

    def __init__(self, session: zenoh.Session, identity: Identity, answers: Answers) -> None:
        namespace, node = identity.namespace, identity.name
        self._answers = answers
        self._loop = QueryLoop(
            session,
            parameters_key(namespace, node, "*"),
            self._answer,
            acts=[parameters_key(namespace, node, "set")],
            tells=[parameters_key(namespace, node, verb) for verb in READING],
        )
        self._loop.start()

    def stop(self, timeout: float) -> bool:
        """Take no more queries. Returns whether the last one was done within `timeout` seconds."""
        return self._loop.stop(timeout)

    def _answer(self, query: zenoh.Query, key: str) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            answer = self._answers.to(key.rpartition("/")[2], payload)
        except (Malformed, ParameterError) as error:
            queries.reply_error(query, queries.Fault.of(error))
            return
        if _is_json(payload, str(query.encoding)):
            query.reply(key, msgspec.json.encode(codec.jsonable(msgspec.to_builtins(answer))), encoding=codec.JSON)
        else:
            queries.reply(query, key, answer)


def _is_json(payload: bytes, encoding: str) -> bool:
    """Whether a request is JSON, and wants to be answered so."""
    return payload.lstrip()[:1] in (b"{", b"[") or encoding.startswith(codec.JSON)


def _read(payload: bytes) -> object:
    if len(payload) > LONGEST_REQUEST:
        raise Malformed(f"the request is longer than {LONGEST_REQUEST:,} bytes")
    request = codec.decode_any(payload) if payload else None
    named = request.get("names", request) if isinstance(request, dict) else request
    if isinstance(named, (dict, list)) and len(named) > MOST_NAMES:
        raise Malformed(f"the request names {len(named):,} parameters; name at most {MOST_NAMES:,}")
    return request


def _changes(request: object) -> dict[str, object]:
    """`{name: value}`, or ROS's list of `{name: …, value: …}`."""
    if isinstance(request, list) and all(
        isinstance(item, dict) and {"name", "value"} <= item.keys() and isinstance(item["name"], str)
        for item in request
    ):
        request = {item["name"]: item["value"] for item in request}
    if not isinstance(request, dict) or not request or not all(isinstance(name, str) for name in request):
        raise ParameterError("expected a map from names to values, {name: value}")
    return request
