"""Nothing that nodes and strangers say reaches a terminal as a control character; any stdout will do."""

import json
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from fcntl import ioctl
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
import zenoh

from robo import Node, Parameters
from robo.wire.codec import pack_attachment
from robo.wire.keys import EndpointToken, NodeToken, SupervisorToken, control_key, event_key, log_key, status_key
from robo.wire.network import Network
from robo.wire.qos import QoS
from robo.wire.queries import Fault, reply_error
from robo.wire.reports import Event, Exit, Explanation, Input, LogRecord, ProcessStatus
from robo.wire.session import close_session, open_session
from tests.conftest import free_port
from tests.support import PATIENCE

# The title, the clipboard, a cleared screen, a colour, hidden text; C1, delete, backspace; the direction of text.
HOSTILE = "owned\x1b]0;T\x07\x1b]52;c;AAAA\x07\x1b[2J\x1b[41m\x1b[8m\x9b2J\x9d0;T\x9c\r\b\x7f\x00\u202e\u2066\u2028\x85"
IN_KEYS = HOSTILE.replace("\x00", "") + "\nFORGED"
"""What a key may hold."""
OWN = re.compile(r"\x1b\[(?:0|1|2|3[1-6]|9[0-7]|1;31)?m|\x1b\[H\x1b\[J")
"""Colours of robo's own, and its way to clear the screen."""
COLOURED = re.compile(rf"{OWN.pattern}|\x1b\[41m")
"""A process may colour what it prints."""
DRAWN = re.compile(r"\x1b\[(?:\?\d+[hl]|[0-9;]*[mHKA]|2J(?=\x1b\[H))|\r")
"""What Rich draws with."""
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


class Loud(Node):
    class Parameters(Parameters):
        word: str = HOSTILE

    parameters: Parameters


@pytest.fixture(scope="module")
def stranger() -> Iterator[str]:
    """A network on which all that can be said is hostile; its endpoint."""
    where = f"tcp/127.0.0.1:{free_port()}"
    session = open_session(Network(mode="router", listen=(where,)))
    stop = threading.Event()
    with ExitStack() as held:
        held.callback(close_session, session)
        node = Loud(name="loud", namespace="r1")
        held.enter_context(_started(node, session))
        tokens = [
            NodeToken("r1", f"evil{IN_KEYS}", IN_KEYS, 1, IN_KEYS).key(),
            NodeToken("r1", "silent", IN_KEYS, 1, IN_KEYS).key(),
            EndpointToken("r1", "evil", "pub", IN_KEYS, QoS(), "r1/evil").key(),
            EndpointToken("r1", "evil", "pub", "other/Type", QoS(), "r1/evil").key(),
            EndpointToken("r1", "evil", "sub", IN_KEYS, QoS(), f"r1/{IN_KEYS}").key(),
            EndpointToken("r1", "evil", "srv", IN_KEYS, QoS(), "r1/call").key(),
            EndpointToken("r1", "evil", "pub", IN_KEYS, QoS(), "r1/call").key(),
            SupervisorToken("r1", 1, IN_KEYS, "", "").key(),
        ]
        for key in tokens:
            held.callback(session.liveliness().declare_token(key).undeclare)
        held.callback(session.declare_queryable(control_key("r1", "*"), _supervise).undeclare)
        held.callback(session.declare_queryable(status_key("r1", "silent"), _refuse).undeclare)
        held.callback(session.declare_queryable("r1/call", _refuse, complete=True).undeclare)
        talk = threading.Thread(target=_talk, args=(session, stop))
        talk.start()
        held.callback(talk.join)
        held.callback(stop.set)
        yield where


@contextmanager
def _started(node: Node, session: zenoh.Session) -> Iterator[None]:
    node.start(session)
    yield
    node.close()


def _refuse(query: zenoh.Query) -> None:
    reply_error(query, Fault("RoboError", HOSTILE))


def _supervise(query: zenoh.Query) -> None:
    status = ProcessStatus(
        robot="r1", group=HOSTILE, node=f"/r1/{HOSTILE}", state="degraded", reason=HOSTILE, pid=1, restarts=0,
        uptime=1.0, cpu=1.0, memory=1, published={HOSTILE: 1.0}, received={}, run=HOSTILE, host=HOSTILE,
    )  # fmt: skip
    exits = [Exit(time=1, exit_code=1, reason=HOSTILE, uptime=1.0, last_lines=[HOSTILE])]
    inputs = [Input(topic=HOSTILE, received=0, age=9.0, malformed=1, dropped=1)]
    answers: dict[str, Any] = {
        "ps": [status],
        "why": [
            Explanation(
                process=status, exits=exits, unmet_needs=[HOSTILE], inputs=inputs, callback_errors=0, next_start=None
            )
        ],
        "events": [_event()],
        "logs": [_line()],
    }
    verb = str(query.key_expr).rpartition("/")[2]
    if verb in answers:
        query.reply(control_key("r1", verb), msgspec.msgpack.encode(answers[verb]))
    else:
        _refuse(query)


def _event() -> Event:
    return Event(time=time.time_ns(), robot="r1", node=HOSTILE, event=HOSTILE, reason=HOSTILE, pid=1, restarts=0)


def _line() -> LogRecord:
    return LogRecord(time=time.time_ns(), node=f"{HOSTILE}\nFORGED", message=f"{HOSTILE}\nFORGED", level="WARN")


def _talk(session: zenoh.Session, stop: threading.Event) -> None:
    message = msgpack.packb({"text": HOSTILE, HOSTILE: [HOSTILE], "number": 1.0})
    number = 0
    while not stop.wait(0.02):
        number += 1
        attachment = pack_attachment(number, time.time_ns())
        for key in ("r1/evil", f"r1/wild{IN_KEYS}"):
            session.put(key, message, encoding=f"application/msgpack;{IN_KEYS}", attachment=attachment)
        session.put("r1/bytes", b"\xc1", encoding=f"application/msgpack;{IN_KEYS}")
        session.put("r1/parameter_events", msgpack.packb({
            "node": HOSTILE, "changed_parameters": [{"name": HOSTILE, "value": HOSTILE}],
        }))  # fmt: skip
        session.put(log_key("r1"), msgspec.msgpack.encode(_line()))
        session.put(event_key("r1"), msgspec.msgpack.encode(_event()))


def on_a_terminal(*words: str, until: str | None = None, columns: int = 200, **environment: str) -> str:
    """What a command writes to a terminal, to its end or until a text stands there."""
    leader, follower = pty.openpty()
    ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    process = subprocess.Popen(
        [sys.executable, "-m", "robo", *words],
        stdin=follower, stdout=follower, stderr=follower,
        env={**os.environ, "TERM": "xterm", "COLUMNS": str(columns), "LINES": "40", **environment},
    )  # fmt: skip
    os.close(follower)
    data = b""
    end = time.monotonic() + 2 * PATIENCE
    try:
        while until is None or until.encode() not in data:
            assert time.monotonic() < end, f"{words} has not come to its end: {data[-1000:]!r}"
            if select.select([leader], [], [], 0.1)[0]:
                try:
                    chunk = os.read(leader, 65536)
                except OSError:  # the other end is closed
                    break
                data += chunk
    finally:
        process.kill()
        process.wait(40)
        os.close(leader)
    return data.decode(errors="surrogateescape").replace("\r\n", "\n")


def check(text: str, own: "re.Pattern[str]" = OWN) -> None:
    rest = own.sub("", text)
    assert "Traceback" not in rest
    assert CONTROL.findall(rest) == [], rest
    assert not re.search("^FORGED", rest, re.MULTILINE), rest


AT_ONCE = [
    "topic list", "topic list -v", "topic list --json", "topic info r1/evil", "topic info r1/evil --json",
    "topic type r1/evil", "topic echo r1/evil --once", "topic echo r1/** --count 9",
    "topic echo r1/** --count 9 --json",
    "topic echo r1/evil --once --yaml", "topic echo r1/evil --once --field text", "topic echo r1/evil --once --csv",
    "topic echo r1/evil --once --field text --csv", "topic echo r1/evil --once --truncate",
    "topic echo r1/evil --once --field none", "topic echo r1/** --field none --duration 1",
    "topic hz r1/** --count 1", "topic bw r1/** --count 1", "topic delay r1/** --count 1", "topic loss r1/** --count 1",
    "topic hz r1/** --count 1 --json", "topic plot r1/evil --duration 1", "topic pub r1/call std/Bool {data: true}",
    "node list", "node list --json", "node info silent", "node info loud", "node info loud --json",
    "param list loud", "param list loud --json", "param get loud word", "param describe loud", "param dump loud",
    "param explain loud", "service list", "service list --json", "service type r1/call",
    "service info r1/call", "service call r1/call", "graph", "graph --format json", "graph --format dot",
    "graph --format mermaid", "top --once", "top --once --json", "net", "net --json", "net loud silent", "ps",
    "ps --json",
    "why --robot-name r1", "why --robot-name r1 --json", "restart x --robot-name r1", "events --no-follow",
    "events --no-follow --json",
    # What is not there: errors name what is.
    "topic info r1/evi", "service call r1/cal", "node info evilowned", "param get loud wor",
]  # fmt: skip


@pytest.mark.parametrize("line", AT_ONCE)
def test_control_characters_of_strangers_are_shown(stranger: str, line: str, tmp_path: Path) -> None:
    words = re.findall(r"\{.*\}|\S+", line)
    text = on_a_terminal(*words, "--connect", stranger, ROBO_LOG_DIR=str(tmp_path))
    check(text, DRAWN if words[:2] in (["topic", "plot"], ["topic", "pub"]) else OWN)
    if line.startswith(TOLD):
        assert "owned" in text, text


TOLD = (
    "topic echo", "topic hz", "param list", "param get loud word", "top --once", "ps", "why", "events", "restart"
)  # fmt: skip
"""Where strangers get their say; tokens that are none are passed over."""


@pytest.mark.parametrize(
    "line",
    ["logs -f --robot-name r1", "logs -f --robot-name r1 --json", "events", "events --json", "param watch",
     "ps --watch"],
)  # fmt: skip
def test_control_characters_of_strangers_are_shown_as_they_come(stranger: str, line: str, tmp_path: Path) -> None:
    text = on_a_terminal(*line.split(), "--connect", stranger, until="owned", ROBO_LOG_DIR=str(tmp_path))
    check(text, COLOURED if line.startswith("logs") else OWN)


def test_a_drawn_view_shows_control_characters(stranger: str) -> None:
    check(on_a_terminal("top", "--connect", stranger, until="other/Type"), DRAWN)


def test_completion_leaves_out_what_nobody_can_type(stranger: str) -> None:
    line = f"robo topic echo --connect {stranger} r1/"
    found = subprocess.run(
        [sys.executable, "-m", "robo"], capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "_ROBO_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": "5"},
    )  # fmt: skip
    assert "r1/evil" in found.stdout.split("\n")
    assert CONTROL.findall(found.stdout) == []


# -- what a run prints ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A manifest of a process that prints all that it should not."""
    folder = tmp_path_factory.mktemp("noisy")
    lines = [f"print({HOSTILE!r} + '\\x1b[32mgreen\\x1b[0m')", "print('\\x1b[31mred')", "print('end')"]
    (folder / "noisy.py").write_text("\n".join(lines))
    manifest = folder / "noisy.yaml"
    command = f"{sys.executable} -u {folder}/noisy.py"
    manifest.write_text(f"groups: {{g: {{nodes: {{noisy: {{run: '{command}'}}}}}}}}\n")
    return manifest


def test_a_run_shows_control_characters_of_its_processes_and_keeps_their_colours(noisy: Path, tmp_path: Path) -> None:
    words = ("up", str(noisy), "--listen", f"tcp/127.0.0.1:{free_port()}")
    text = on_a_terminal(*words, ROBO_LOG_DIR=str(tmp_path))
    check(text, COLOURED)
    assert "\x1b[32mgreen\x1b[0m" in text
    assert re.search(r"\x1b\[31mred\x1b\[0m$", text, re.MULTILINE), "what is coloured ends with the line"
    assert r"owned\x1b]0;T\x07" in text
    check(on_a_terminal("logs", ROBO_LOG_DIR=str(tmp_path)), COLOURED)
    assert "owned" in on_a_terminal("logs", "--json", ROBO_LOG_DIR=str(tmp_path))
    files = "".join(file.read_text() for file in tmp_path.glob("*/*/*.jsonl"))
    assert CONTROL.findall(files) == []
    plain = on_a_terminal("logs", ROBO_LOG_DIR=str(tmp_path), NO_COLOR="1")
    check(plain, re.compile("(?!)"))
    assert "green" in plain


# -- any stdout ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "line",
    [*(line for line in AT_ONCE if "--json" in line), "topic echo r1/** --count 9", "top --once", "graph", "ps",
     "topic plot r1/evil --duration 1", "logs --robot-name r1", "up --dry-run", "up --show-args", "check robot.yaml",
     "interface show nav/Odometry", "interface list", "node show robo_services.safety_monitor", "schema manifest",
     "run robo_services.safety_monitor --help", "up --help", "export compose"],
)  # fmt: skip
def test_a_stdout_of_few_characters_is_no_mistake(stranger: str, line: str, tmp_path: Path) -> None:
    words = re.findall(r"\{.*\}|\S+", line)
    environment = {**os.environ, "ROBO_CONNECT": stranger, "ROBO_LOG_DIR": str(tmp_path), "PYTHONIOENCODING": "ascii"}
    found = subprocess.run(
        [sys.executable, "-m", "robo", *words], capture_output=True, timeout=60, check=False, env=environment
    )
    assert b"Traceback" not in found.stderr
    check(found.stdout.decode("ascii"), re.compile("(?!)"))
    if "--json" in words:
        for text in found.stdout.splitlines():
            json.loads(text)
