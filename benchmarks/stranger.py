"""A stranger who throws random things at a robot: bytes, tokens, queries and requests of no sense."""

import json
import random
from collections import Counter
from collections.abc import Callable

import msgspec
import zenoh

NODES = ("diff_drive_sim", "position_tracker", "safety_monitor", "velocity_controller")
TOPICS = ("odom", "scan", "cmd_vel", "cmd_vel_raw", "log", "current_position", "safety_state", "parameter_events")
SERVICES = ("emergency_stop", "reset_emergency_stop", "reset", "reset_distance")
VERBS = ("list", "get", "describe", "explain", "set", "", "delete")
COMMANDS = ("ps", "why", "events", "logs", "stop", "start", "restart", "down", "destroy")

_CHUNKS = (
    "*",
    "**",
    "$*",
    "r1",
    "x",
    "³",
    "ü",
    "%",
    "-1",
    "99999999999999999999",
    "node",
    "pub",
    "srv",
    "\x1b[2J",
    "a b",
)
_ENCODINGS = (
    "application/msgpack;nav/Odometry", "application/msgpack;geometry/Twist", "application/json", "text/json",
    "application/json;\x1b]0;x\x07", "zenoh/bytes", "zenoh/string", "text/plain;charset=³", "", "nonsense;;;;",
)  # fmt: skip
_NUMBERS = (0, -1, 2**63, 2**64 - 1, -(2**63), 1e308, -1e308, float("nan"), float("inf"), 1e-300)


class Stranger:
    """A client that knows where a robot is, and has no idea what it is good for."""

    def __init__(self, session: zenoh.Session, robot: str, seed: int) -> None:
        self._session = session
        self._robot = robot
        self._random = random.Random(seed)
        self._tokens: list[zenoh.LivelinessToken] = []
        self.thrown: Counter[str] = Counter()
        """What was thrown, by kind."""
        self.refused = 0
        """What Zenoh itself did not let pass, such as keys that are none."""
        self._kinds: dict[str, tuple[Callable[[], None], int]] = {
            "message": (self.message, 50),
            "token": (self.token, 15),
            "query": (self.query, 15),
            "parameter request": (self.parameter_request, 15),
            "command": (self.command, 5),
        }

    def throw(self) -> None:
        """Throw one thing."""
        weights = [weight for _, weight in self._kinds.values()]
        (kind,) = self._random.choices([*self._kinds], weights)
        try:
            self._kinds[kind][0]()
        except zenoh.ZError:
            self.refused += 1
        self.thrown[kind] += 1

    def leave(self) -> None:
        """Withdraw what is declared."""
        while self._tokens:
            self._tokens.pop().undeclare()

    def message(self) -> None:
        """Publish something, or delete it, on one of the robot's topics or anywhere."""
        r = self._random
        prefix = r.choice(["", f"{self._robot}/", f"{self._robot}/", "@robo/r1/"])
        key = f"{prefix}{r.choice([*TOPICS, *TOPICS, 'clock', 'events', 'output', 'status/diff_drive_sim'])}"
        if r.random() < 0.05:
            self._session.delete(key, attachment=self._attachment())
            return
        self._session.put(key, self.payload(), encoding=r.choice(_ENCODINGS), attachment=self._attachment())

    def token(self) -> None:
        """Declare or withdraw a liveliness token that looks a little like one of robo's."""
        r = self._random
        if len(self._tokens) > 50 or (self._tokens and r.random() < 0.4):
            self._tokens.pop(r.randrange(len(self._tokens))).undeclare()
            return
        kind = r.choice(["node", "pub", "sub", "srv", "cli", "run", "status", r.choice(_CHUNKS)])
        last = [self._chunk() for _ in range(r.choice([0, 2, 3, 3, 3, 4]))]
        names = [r.choice([self._robot, self._chunk()]), kind, self._chunk(), *last]
        key = "/".join(["@robo", *filter(None, names)])
        self._tokens.append(self._session.liveliness().declare_token(key))

    def query(self) -> None:
        """Ask services with nonsense, and anybody with wildcards."""
        r = self._random
        wide = ["**", f"{self._robot}/**", "*/*", "@robo/**", "**/$*stop", f"{self._robot}/emergency_$*", "*/reset/**"]
        key = r.choice([*wide, *(f"{self._robot}/{service}" for service in SERVICES)])
        self._ask(key + r.choice(["", "", "?x=1;y", "?_anyke", "?_time=[now(-1h)..now()]"]), exact="*" not in key)

    def parameter_request(self) -> None:
        """Ask for parameters, and set some that there are not or to what they cannot be."""
        r = self._random
        node = r.choice([*NODES, "*", "nobody"])
        self._ask(f"{self._robot}/{node}/parameters/{r.choice([*VERBS, '*', '**', 's$*'])}".rstrip("/"), exact=True)

    def command(self) -> None:
        """Ask the supervisor."""
        verb = self._random.choice([*COMMANDS, "*", "**", "d$*"])
        self._ask(f"@robo/{self._robot}/supervisor/{verb}", exact=True)

    def payload(self) -> bytes:
        """Something that is no message."""
        r = self._random
        size = r.random()
        if size < 0.002:
            return r.randbytes(r.choice([10_000, 100_000, 1_000_000]))
        if size < 0.01:
            depth = r.choice([100, 1_000, 100_000])
            return r.choice([b"\x91" * depth, b"[" * depth, b'{"x":' * depth, b"\x81\xa1x" * depth])
        if size < 0.4:
            return r.randbytes(r.choice([0, 1, 2, 16, 100, 1_000]))
        made = self._value(3)
        if r.random() < 0.2:
            return json.dumps(made, default=repr).encode("utf-8", "surrogatepass")
        try:
            return msgspec.msgpack.encode(made)
        except (OverflowError, UnicodeEncodeError):
            return b"\xc1"

    def _ask(self, selector: str, *, exact: bool) -> None:
        """Send a query and forget its replies. One with an exact key carries what no handler takes as a request."""
        r = self._random
        payload = self._nonsense() if exact else r.choice([None, self.payload()])
        self._session.get(
            selector,
            lambda _: None,
            payload=payload,
            encoding=None if payload is None else r.choice(_ENCODINGS),
            attachment=self._attachment(),
            target=r.choice([zenoh.QueryTarget.ALL, zenoh.QueryTarget.BEST_MATCHING, zenoh.QueryTarget.ALL_COMPLETE]),
            consolidation=r.choice([zenoh.ConsolidationMode.NONE, zenoh.ConsolidationMode.AUTO]),
            timeout=1.0,
        )

    def _nonsense(self) -> bytes:
        """A request that nobody can mean: an empty one would be an emergency stop, or the end of the run."""
        r = self._random
        odd: list[object] = [{"no_such_parameter": 1}, {"names": [1]}, {"names": {}}, {"rate": "x"}, {"frame": []}, 7]
        odd += [{"publish_rate": r.choice(_NUMBERS[2:6])}, {"names": [self._chunk() * 1000]}, [], "x", None]
        kind = r.random()
        if kind < 0.6:
            return msgspec.msgpack.encode(r.choice(odd))
        if kind < 0.8:
            return b"\xc1" + r.randbytes(r.choice([0, 10, 1_000]))
        return r.choice(
            [b"\x91" * 100_000, b"{" * 1000, b"\xc1" * 2_000_000 if kind > 0.998 else b"\xff", b'{"\\ud800": 1}']
        )

    def _value(self, depth: int) -> object:
        r = self._random
        kind = r.randrange(7 if depth else 4)
        if kind == 0:
            return r.choice(_NUMBERS)
        if kind == 1:
            return r.choice(["", "x" * 1000, "\ud800", "\x1b[2J", "ü"])
        if kind == 2:
            return r.choice([None, True, b"", b"\xff" * 100])
        if kind == 3:
            return r.random() * 100
        if kind == 4:
            return [self._value(depth - 1) for _ in range(r.randrange(5))]
        fields = ("header", "pose", "position", "x", "linear", "ranges", "twist", "data", "msg", "level", "", "\x00")
        return {r.choice(fields): self._value(depth - 1) for _ in range(r.randrange(4))}

    def _attachment(self) -> bytes | None:
        r = self._random
        return r.choice([None, b"", r.randbytes(r.choice([1, 15, 16, 17, 33])), b"\xff" * 16, bytes(16)])

    def _chunk(self) -> str:
        r = self._random
        return r.choice([*_CHUNKS, *NODES, *TOPICS, str(r.getrandbits(r.choice([1, 40, 80])))])
