"""Whether this machine is fit to run robots: one check a function, each with what to do about it."""

import os
import platform
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal, TypeVar

import msgspec
import psutil
import zenoh

from robo.environment import CONNECT_VARIABLE, KILL_TEST_VARIABLE, LOG_FOLDER_VARIABLE
from robo.errors import NetworkError
from robo.machine import orphans, serial_ports
from robo.machine.cgroup import ControlGroup
from robo.text.folders import log_base
from robo.tools import fleet, nodes, runs, topics
from robo.tools import strangers as unannounced
from robo.wire import knocking, listeners, meeting, whereabouts
from robo.wire.claims import PATIENCE, port_taken
from robo.wire.network import PORT, RENDEZVOUS, Network
from robo.wire.session import close_session, open_session
from robo.wire.tcp import HeldPort

T = TypeVar("T")

Verdict = Literal["ok", "note", "fault"]

_ENDED_WITHIN = 3.0
"""How long the watchdog of a run may take to end what a killed supervisor has left behind, s."""

KILL_TEST_LIMIT = 10.0
"""Within how many seconds after `kill -9` of its supervisor nothing of a run may live, on a busy machine too; told is
how long it took."""

_MULTICAST = ("224.0.0.224", 7446)


class Finding(msgspec.Struct, frozen=True):
    """What one check has found."""

    check: str
    verdict: Verdict
    message: str
    fix: str = ""
    """What to do, where there is something to do."""


def examine(connect: Sequence[str], *, kill_test: bool = False, ask_ports: bool = False) -> Iterator[Finding]:
    """All checks, one after the other.

    Args:
        connect: where a robot is looked for.
        kill_test: whether a robot is started and killed.
        ask_ports: whether serial ports are asked who is there.
    """
    checks: list[Callable[[], Finding]] = [
        python,
        packages,
        meeting_place,
        lambda: port(connect),
        lambda: router(connect),
        lambda: twins(connect),
        lambda: strangers(connect),
        lambda: qualities(connect),
        lambda: sites(connect),
        lambda: versions(connect),
        multicast,
        clock,
        files,
        memory,
        leftovers,
        no_orphans,
    ]
    for check in checks:
        yield check()
    yield from ports(ask=ask_ports)
    if kill_test:
        yield kill_and_look()


def python() -> Finding:
    """The interpreter, and whether it is in a virtual environment."""
    where = f"{platform.python_implementation()} {platform.python_version()} at {sys.executable}"
    if sys.prefix == sys.base_prefix:
        return Finding("python", "note", f"{where}, in no virtual environment", "python3 -m venv .venv")
    return Finding("python", "ok", where)


def packages() -> Finding:
    """What robo stands on."""
    found, missing = [], []
    for name in ("robo-zenoh", "eclipse-zenoh", "msgspec", "psutil", "PyYAML", "rich", "typer"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    if missing:
        return Finding("packages", "fault", f"not installed: {', '.join(missing)}", "pip install robo-zenoh")
    return Finding("packages", "ok", ", ".join(found))


def meeting_place() -> Finding:
    """Whether the folder in which this user's robots meet is the user's alone."""
    try:
        meeting.prepare()
    except NetworkError as error:
        fault, _, fix = str(error).partition("\n")
        return Finding("meeting", "fault", fault, fix.strip())
    return Finding("meeting", "ok", f"robots of this user meet in {meeting.folder()}, where nobody else comes")


def port(connect: Sequence[str]) -> Finding:
    """Whether a robot can listen where it is to, or whether a Zenoh router has the port."""
    return _port_told(connect) if whereabouts.is_told(connect) else _door()


def _door() -> Finding:
    """Who has the port at which others look at the robots of this machine."""
    door = _door_here()
    there = listeners.in_the_way([door], PATIENCE)
    if there:
        fix = "robo up --listen tcp/127.0.0.1:7448 opens another door"
        return Finding("port", "note", f"{there[0]}: your robots do not dial it, and others do not see them there", fix)
    holder = listeners.holder(door)
    if holder is None:
        return Finding("port", "ok", f"nobody is known to have {door}, where others look at a robot")
    return Finding("port", "ok", f"{holder}: others look there at what runs here")


def _port_told(connect: Sequence[str]) -> Finding:
    address = _tcp_of(connect)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
        except OSError as error:
            if _reaches_router(connect):
                return Finding("port", "ok", f"port {address[1]} is taken by a Zenoh router: robots join it")
            fault, _, fix = port_taken(f"tcp/{address[0]}:{address[1]}").partition("\n")
            return Finding("port", "fault", f"{fault} ({error.strerror})", fix.strip())
    return Finding("port", "ok", f"port {address[1]} on {address[0]} is free")


def router(connect: Sequence[str]) -> Finding:
    """Whether a robot or a router answers."""
    where = ", ".join(connect) or os.environ.get(CONNECT_VARIABLE) or _where_yours_meet()
    reached = _asked(connect, lambda session: [str(link.dst) for link in session.info.links()])
    if reached is not None:
        return Finding("router", "ok", f"a router answers at {', '.join(reached) or where}")
    return Finding("router", "note", f"no router answers at {where}", "robo up starts one with each robot")


def _where_yours_meet() -> str:
    return f"{meeting.endpoint()} and {_door_here()}"


def _door_here() -> str:
    """Where others look at robots of this machine: with security on, by TLS."""
    return whereabouts.door_of(Network.from_environment("client"))


def twins(connect: Sequence[str]) -> Finding:
    """Whether each name is that of one node."""
    there = _asked(connect, nodes.list_nodes) or []
    found = nodes.twins(there)
    if found:
        fix = "stop one of them: they publish on the same topics, each against the other"
        return Finding("names", "fault", "; ".join(map(str, found)), fix)
    return Finding("names", "ok", f"each of {len(there)} nodes has a name of its own" if there else "no node runs")


def strangers(connect: Sequence[str]) -> Finding:
    """Whether all who publish on the topics of nodes have said so, and nobody fights over one."""
    found = _asked(connect, unannounced.find) or []
    if found:
        return Finding("sources", "fault", "; ".join(map(str, found)), "find out who that is, and end it")
    return Finding("sources", "ok", "every message that nodes receive is of a publisher that is announced")


def qualities(connect: Sequence[str]) -> Finding:
    """Whether subscriptions get of publishers what they want."""
    found = _asked(connect, topics.all_misfits) or []
    if found:
        fix = "say at both ends what is meant, or for both in the manifest: topics: {map: {qos: latched}}"
        return Finding("topics", "fault", "; ".join(found), fix)
    return Finding("topics", "ok", "every subscription gets of publishers what it wants of them")


def sites(connect: Sequence[str]) -> Finding:
    """Whether robots reach the sites that they were told to dial."""
    lost = _asked(connect, runs.lost_sites) or []
    if lost:
        fix = "look at the network there, or start it again with another --connect"
        return Finding("sites", "note", "; ".join(lost), fix)
    return Finding("sites", "ok", "no robot looks for a site that it does not reach")


def versions(connect: Sequence[str]) -> Finding:
    """Whether robots run one version of robo, and manifests of one name are the same."""
    robots = _asked(connect, lambda session: fleet.robots_of(fleet.Watch(session, runs.TIMEOUT).look())) or []
    found = fleet.differences(robots)
    if found:
        return Finding("versions", "note", "; ".join(map(str, found)), "update those, or leave it: robo ps --fleet")
    known = sorted({robot.version for robot in robots if robot.version})
    if not known:
        return Finding("versions", "ok", "no robot tells of its version")
    return Finding("versions", "ok", f"all robots run robo {known[0]}, and manifests of one name are the same")


def _asked(connect: Sequence[str], ask: Callable[[zenoh.Session], T]) -> T | None:
    """What the robots here say; None where there is none."""
    try:
        network = msgspec.structs.replace(whereabouts.of_tool(connect, 0.0), timeout=0.5)
        tried = knocking.tried(network.connect, 0.1)
        if {one for one, wrong in tried if isinstance(wrong, ConnectionRefusedError)} == set(network.connect):
            return None  # at once: Zenoh would try again and again
        session = open_session(network)
    except NetworkError:
        return None
    try:
        return ask(session)
    finally:
        close_session(session)


def multicast() -> Finding:
    """Whether multicast works; robo does not need it, other Zenoh programs find each other by it."""
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(("", 0))
            group = socket.inet_aton(_MULTICAST[0]) + socket.inet_aton("127.0.0.1")
            listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            listener.settimeout(0.5)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
            sender.sendto(b"robo", (_MULTICAST[0], listener.getsockname()[1]))
            listener.recv(16)
    except OSError as error:
        return Finding("multicast", "note", f"does not work on loopback ({error}); robo does not need it")
    return Finding("multicast", "ok", "works on loopback; robo does not need it")


def clock() -> Finding:
    """Whether the clock is set, and by whom."""
    now = time.time()
    if not 1_700_000_000 < now < 4_000_000_000:
        return Finding("clock", "fault", f"the clock says {time.ctime(now)}", "set it: stamps would be wrong")
    try:
        shown = subprocess.run(
            ["timedatectl", "show", "-p", "NTPSynchronized", "--value"], capture_output=True, text=True, timeout=2
        ).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        shown = ""
    if shown == "no":
        return Finding("clock", "note", "is not synchronised", "between hosts, stamps differ: timedatectl set-ntp true")
    return Finding(
        "clock", "ok", f"{time.strftime('%Y-%m-%d %H:%M:%S %Z')}{', synchronised' if shown == 'yes' else ''}"
    )


def files() -> Finding:
    """Whether log files and sockets can be written."""
    for what, folder in (("log files", log_base()), ("sockets", Path(tempfile.gettempdir()))):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=folder):
                pass
        except OSError as error:
            return Finding("files", "fault", f"{what} cannot be written: {error}", "set ROBO_LOG_DIR or TMPDIR")
    free = shutil.disk_usage(log_base()).free
    if free < 500e6:
        return Finding("files", "note", f"{free / 1e6:.0f} MB are free for logs in {log_base()}", "make room")
    return Finding("files", "ok", f"logs are kept in {log_base()}, {free / 1e9:.1f} GB are free")


def memory() -> Finding:
    """Whether there is room for a few nodes: about 30 MB each."""
    try:
        free = psutil.virtual_memory().available
    except OSError:
        return Finding("memory", "note", "nobody tells here how much is free", "a node needs about 30 MB")
    if free < 300e6:
        return Finding("memory", "note", f"{free / 1e6:.0f} MB are free", "a node needs about 30 MB")
    return Finding("memory", "ok", f"{free / 1e9:.1f} GB are free, {os.cpu_count()} processors")


def leftovers() -> Finding:
    """Whether processes of earlier runs live on without their supervisor.

    What has just lost its supervisor is being ended, and gets the time for it.
    """
    end = time.monotonic() + _ENDED_WITHIN
    while (found := orphans.leftovers()) and time.monotonic() < end:
        time.sleep(0.1)
    if found:
        pids = ", ".join(map(str, found))
        return Finding("leftovers", "fault", f"processes of a run that is over: {pids}", "the next robo up ends them")
    return Finding("leftovers", "ok", "no process of an earlier run is left")


def no_orphans() -> Finding:
    """By which means nothing survives its run here."""
    means = ["a run id that children inherit", "a watchdog"]
    if sys.platform == "linux":
        means.append("orphans are adopted")
    group = ControlGroup.make(f"doctor-{os.getpid()}")
    if group is not None:
        group.remove()
        means.append("a control group")
    return Finding("orphans", "ok", ", ".join(means))


def ports(*, ask: bool) -> Iterator[Finding]:
    """The serial ports, whether this user may open them, and, if wanted, who answers."""
    there = serial_ports.found()
    if not there:
        yield Finding("serial", "ok", "no serial port is there")
    for one in there:
        yield _port(one, ask=ask)


def _port(one: serial_ports.FoundPort, *, ask: bool) -> Finding:
    if not serial_ports.may_open(one):
        group = serial_ports.group_of(one)
        fix = (
            f"sudo usermod -aG {group} $USER, and log in again"
            if group
            else "give this user the right to read and write it"
        )
        return Finding("serial", "note", f"{one}: this user may not open it", fix)
    held = serial_ports.holders(one)
    if held:
        return Finding("serial", "ok", f"{one} is open in process {', '.join(map(str, held))}")
    if not ask:
        return Finding("serial", "ok", f"{one} can be opened", "robo doctor --ask-ports asks it for a base's encoders")
    try:
        answer = serial_ports.ask(one)
    except OSError as error:
        return Finding("serial", "note", f"{one}: {error.strerror}")
    if answer is None:
        return Finding("serial", "ok", f"{one} is open elsewhere")
    if answer.reading:
        text = (
            f"{one} answers as the board of a base, its encoders are at {answer.reading}, {answer.baud} bits per second"
        )
        options = "" if answer.baud == serial_ports.STOCK_BAUD else f" -p serial_base.baud:={answer.baud}"
        return Finding("serial", "ok", text, f"robo up real_robot.yaml port:={one.path}{options}")
    if answer.said:
        return Finding("serial", "note", f"{one} does not answer as the board of a base: {answer.said[:60]!r}")
    return Finding("serial", "note", f"{one} says nothing", "is the firmware on it? docs: the first real robot")


_TROUBLEMAKER = """\
import os, signal, sys, time
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_IGN)
for _ in range(3):
    if os.fork() == 0:
        os.setsid()
        if os.fork():
            os._exit(0)
        time.sleep(600)
        os._exit(0)
print("up", flush=True)
time.sleep(600)
"""


def kill_and_look() -> Finding:
    """Run a robot with processes that hide and ignore signals, `kill -9` its supervisor, and look what is left."""
    with tempfile.TemporaryDirectory(prefix="robo-doctor-") as folder, closing(HeldPort()) as port:
        Path(folder, "trouble.py").write_text(_TROUBLEMAKER)
        manifest = Path(folder, "kill_test.yaml")
        manifest.write_text(
            "groups:\n  test:\n    namespace: robo_kill_test\n    nodes:\n"
            f"      trouble: {{run: [python, {folder}/trouble.py], ready: {{log: up}}}}\n"
        )
        command = [sys.executable, "-m", "robo", "up", str(manifest), "--listen", f"tcp/127.0.0.1:{port.number}"]
        mark = {**os.environ, LOG_FOLDER_VARIABLE: folder, KILL_TEST_VARIABLE: folder}
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=mark) as run:
            assert run.stdout is not None
            ready = any("is ready" in line for line in run.stdout)
            before = _marked(folder)
            run.send_signal(signal.SIGKILL)
            killed = time.monotonic()
        if not ready:
            return Finding("kill test", "fault", "the test robot did not start", f"try {' '.join(command)}")
        while (alive := _marked(folder)) and time.monotonic() - killed < KILL_TEST_LIMIT:
            time.sleep(0.02)
        took = time.monotonic() - killed
        for process in alive:
            with suppress(psutil.Error):  # which may just have gone
                process.kill()
    if alive:
        return Finding("kill test", "fault", f"{len(alive)} of {len(before)} processes survived {took:.1f} s")
    return Finding(
        "kill test", "ok", f"kill -9 of the supervisor: {len(before)} processes, all gone after {took:.2f} s"
    )


def _marked(folder: str) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        try:
            if process.environ().get(KILL_TEST_VARIABLE) == folder and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (psutil.Error, OSError):
            continue
    return found


def _tcp_of(connect: Sequence[str]) -> tuple[str, int]:
    endpoint = next(iter(connect), None) or os.environ.get(CONNECT_VARIABLE, "").split(",")[0] or RENDEZVOUS
    host, _, number = endpoint.rpartition("/")[2].rpartition(":")
    return (host, int(number)) if number.isdecimal() else ("127.0.0.1", PORT)


def _reaches_router(connect: Sequence[str]) -> bool:
    return _asked(connect, lambda _: True) is not None
