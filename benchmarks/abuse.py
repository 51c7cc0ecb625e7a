"""`python -m benchmarks.abuse`: a stranger throws 100,000 random things at a running robot.

Tokens, queries, messages and requests about parameters, 1,000 a second, from a plain client: random bytes,
MessagePack of the wrong shape, megabytes, deep nesting, odd encodings and attachments. It fails if a log
holds a traceback, a process has ended, memory is not back within 5 MB, or a control loop paused for more
than 50 ms (on a machine that is otherwise quiet).
"""

import argparse
import json
import os
import random
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import msgspec
import psutil
import zenoh

from robo.wire.codec import unpack_attachment
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

ROBOT = "r1"
NODES = ("diff_drive_sim", "position_tracker", "safety_monitor", "velocity_controller")
TOPICS = ("odom", "scan", "cmd_vel", "cmd_vel_raw", "log", "current_position", "safety_state", "parameter_events")
SERVICES = ("emergency_stop", "reset_emergency_stop", "reset", "reset_distance")
VERBS = ("list", "get", "describe", "explain", "set", "", "delete")
COMMANDS = ("ps", "why", "events", "logs", "stop", "start", "restart", "down", "destroy")
LOOPS = ("cmd_vel", "odom")
"""Topics by which the control loops are timed."""

LONGEST_GAP = 0.05
"""s."""
MOST_GROWTH = 5e6
"""Bytes."""
SETTLING = 10.0
"""How long memory and counters may take to settle, s."""

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
        self.keys: list[str] = []
        """Of the tokens that it has declared."""
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
        self.keys.append(key)

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


class LoopWatch:
    """How long a robot's control loops paused, by the times at which their messages were published."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._last: dict[str, tuple[int, int]] = {}
        self.longest = dict.fromkeys(LOOPS, 0.0)
        """s, by topic."""
        self._subscribers = [session.declare_subscriber(f"{robot}/{topic}", self._notice) for topic in LOOPS]

    def _notice(self, sample: zenoh.Sample) -> None:
        topic = str(sample.key_expr).rpartition("/")[2]
        stamp = unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
        if stamp is None or abs(stamp.source_time - time.time_ns()) > 60e9:
            return  # not the robot's own
        number, at = self._last.get(topic, (0, 0))
        if stamp.sequence_number == number + 1 and number:
            self.longest[topic] = max(self.longest[topic], (stamp.source_time - at) / 1e9)
        self._last[topic] = (stamp.sequence_number, stamp.source_time)

    def close(self) -> None:
        """Look no more."""
        for subscriber in self._subscribers:
            subscriber.undeclare()


def log_lines(folder: Path) -> list[tuple[str, str]]:
    """What a robot's processes have logged: node and text."""
    records = [
        json.loads(line) for file in sorted(folder.rglob("*.jsonl")) for line in file.read_text().splitlines() if line
    ]
    return [(record["node"], record["message"]) for record in records]


def kinds(lines: list[tuple[str, str]]) -> Counter[str]:
    """How often each kind of line stands there; figures and quoted words make no difference."""
    shape = re.compile(r"'[^']*'|\"[^\"]*\"|[-+]?[\d,.]+(e[-+]?\d+)?|nan|inf")
    return Counter(f"{node}: {shape.sub('#', text)[:100]}" for node, text in lines)


def throw(stranger: Stranger, count: int, rate: float) -> float:
    """Throw so many things, so many a second. Returns the rate that was reached."""
    begin = time.monotonic()
    for i in range(count):
        ahead = begin + i / rate - time.monotonic()
        if ahead > 0:
            time.sleep(ahead)
        stranger.throw()
    stranger.leave()
    return count / (time.monotonic() - begin)


def processes(supervisor: psutil.Process) -> dict[int, str]:
    """The robot's processes that run: pid and last word of the command."""
    found: dict[int, str] = {}
    with suppress(psutil.Error):
        for process in [supervisor, *supervisor.children(recursive=True)]:
            with suppress(psutil.Error):
                found[process.pid] = process.cmdline()[-1][:60]
    return found


def memory(pids: dict[int, str]) -> dict[str, int]:
    """Resident memory by process, bytes."""
    return {f"{name} ({pid})": psutil.Process(pid).memory_info().rss for pid, name in pids.items()}


_PLAIN = """\
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", sys.argv[1])
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/delay", "0")
config.insert_json5(sys.argv[2], sys.argv[3])
session = zenoh.open(config)
subscriber = session.liveliness().declare_subscriber("@robo/**", lambda _: None) if "client" in sys.argv[1] else None
print("open", flush=True)
sys.stdin.read()
"""
"""A router, or a client that watches tokens, of plain Zenoh."""


def plain_growth(keys: list[str]) -> dict[str, int]:
    """By how much a router and a client of plain Zenoh grow where these tokens come and go, bytes.

    Zenoh 1.10 keeps some of the memory of each token key that it has ever seen.
    """
    where = json.dumps([free_endpoint()])
    with ExitStack() as ending:
        programs: dict[str, psutil.Process] = {}
        for name, mode, path in (("router", "router", "listen/endpoints"), ("client", "client", "connect/endpoints")):
            words = [sys.executable, "-c", _PLAIN, json.dumps(mode), path, where]
            program = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            ending.callback(program.wait)
            ending.callback(program.terminate)
            assert program.stdout is not None
            program.stdout.readline()
            programs[name] = psutil.Process(program.pid)
        session = open_session(Network(mode="client", connect=tuple(json.loads(where))))
        time.sleep(1.0)
        before = {name: program.memory_info().rss for name, program in programs.items()}
        for i, key in enumerate(keys):
            session.liveliness().declare_token(key).undeclare()
            if i % 10 == 0:
                time.sleep(0.01)
        time.sleep(2.0)
        growth = {name: program.memory_info().rss - before[name] for name, program in programs.items()}
        close_session(session)
    return growth


def free_endpoint() -> str:
    """An endpoint on loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def running(folder: str, endpoint: str) -> Iterator[psutil.Process]:
    """The reference robot with its logs in a folder; its supervisor."""
    command = [sys.executable, "-m", "robo", "up", "robot.yaml", "--robot-name", ROBOT, "--listen", endpoint]
    with Path(folder, "console.txt").open("w") as console:
        run = subprocess.Popen(command, stdout=console, stderr=console, env={**os.environ, "ROBO_LOG_DIR": folder})
    try:
        end = time.monotonic() + 30
        while "is ready" not in Path(folder, "console.txt").read_text():
            if run.poll() is not None or time.monotonic() > end:
                sys.exit("the robot did not start:\n" + Path(folder, "console.txt").read_text())
            time.sleep(0.1)
        yield psutil.Process(run.pid)
    finally:
        run.terminate()
        run.wait()


def main() -> None:
    """Run, print, and exit with 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--rate", type=float, default=1_000.0, help="per second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--lines", type=int, default=40, help="kinds of log lines that are shown")
    options = parser.parse_args()
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as folder, running(folder, endpoint) as supervisor:
        faults = abuse(supervisor, folder, endpoint, options)
    for fault in faults:
        print("FAILED:", fault)
    sys.exit(1 if faults else 0)


def abuse(supervisor: psutil.Process, folder: str, endpoint: str, options: argparse.Namespace) -> list[str]:
    """Abuse a robot and print what comes of it. Returns what must not have come of it."""
    network = Network(mode="client", connect=(endpoint,))
    watching, abusing = open_session(network), open_session(network)
    quiet = LoopWatch(watching, ROBOT)
    time.sleep(SETTLING)
    quiet.close()
    stranger = Stranger(abusing, ROBOT, options.seed)
    before = processes(supervisor)
    sizes = memory(before)
    loops = LoopWatch(watching, ROBOT)
    reached = throw(stranger, options.count, options.rate)
    time.sleep(1.0)
    loops.close()
    close_session(abusing)
    time.sleep(SETTLING)
    after = processes(supervisor)
    growth = {name: size - sizes.get(name, 0) for name, size in memory(after).items()}
    lines = log_lines(Path(folder))
    console = Path(folder, "console.txt").read_text()
    close_session(watching)
    print(
        f"{options.count} things at {reached:.0f} a second: {dict(stranger.thrown)}; Zenoh refused {stranger.refused}"
    )
    for when, watch in (("before", quiet), ("meanwhile", loops)):
        print(f"longest pause of a loop {when}, ms:", {k: round(gap * 1e3, 1) for k, gap in watch.longest.items()})
    plain = plain_growth(stranger.keys)
    print("growth, MB:", {name: round(grown / 1e6, 2) for name, grown in growth.items()})
    print("growth of plain Zenoh by the same tokens, MB:", {name: round(size / 1e6, 2) for name, size in plain.items()})
    print(f"{len(lines)} log lines")
    for kind, often in kinds(lines).most_common(options.lines):
        print(f"  {often:5} {kind}")
    if "Traceback" in console or supervisor.pid not in after:
        print(console[-5000:])
    faults = [f"a process has ended: {name} ({pid})" for pid, name in before.items() if pid not in after]
    for name, grown in growth.items():
        most = MOST_GROWTH + plain["router" if "robo.process.router" in name else "client"]
        faults += [f"{name} grew by {grown / 1e6:.1f} MB"] * (grown > most)
    faults += [f"{topic} paused for {gap:.3f} s" for topic, gap in loops.longest.items() if gap > LONGEST_GAP]
    faults += ["a traceback in the log"] * ("Traceback" in console or any("Traceback" in text for _, text in lines))
    return faults


if __name__ == "__main__":
    main()
