"""One node as a process of its own, started by hand: how it begins, fails and ends."""

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import robo as package
from tests.support import PATIENCE, Command, Running, eventually, plain_environment, robo

pytestmark = pytest.mark.timeout(120)

FAILING = """\
import robo

class Failing(robo.Node):
    def on_start(self) -> None:
        raise {error}

if __name__ == "__main__":
    robo.run(Failing)
"""


@contextmanager
def program(*arguments: str, cwd: Path) -> Iterator["subprocess.Popen[str]"]:
    """A Python program in a folder; whatever happens, it does not survive the test."""
    running = subprocess.Popen(
        [sys.executable, *arguments], cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    with running:
        try:
            yield running
        finally:
            running.kill()


@pytest.fixture
def router(endpoint: str) -> Iterator[Command]:
    """A robot's meeting point, beside which nodes run: their sessions do not close at once."""
    with robo("router", "--listen", endpoint) as running:
        running.wait_for("router at")
        yield running


@pytest.mark.usefixtures("router")
@pytest.mark.parametrize(
    ("error", "told", "code"),
    [
        ("OSError('no such device')", "OSError: no such device", 1),
        ("robo.ParameterError('port: there is no /dev/ttyNOPE')", "error: port: there is no /dev/ttyNOPE", 1),
        ("SystemExit('no such device')", "failing: no such device", 1),
        ("SystemExit(3)", "", 3),
    ],
)
@pytest.mark.parametrize("words", [("-m", "robo", "run", "failing"), ("failing.py",)])
def test_what_on_start_raises_is_told_once_and_counts(
    endpoint: str, tmp_path: Path, words: tuple[str, ...], error: str, told: str, code: int
) -> None:
    (tmp_path / "failing.py").write_text(FAILING.format(error=error))
    with program(*words, "--listen", endpoint, cwd=tmp_path) as node:
        output, _ = node.communicate(timeout=PATIENCE)
        assert node.returncode == code, output
        assert output.count(told) == (1 if told else len(output) + 1)
        assert ("Traceback" in output) == (error.startswith("OSError"))


@pytest.mark.parametrize("file", ["failing.py", "./failing.py", "nodes/failing.py", "failing.py:Failing"])
def test_a_file_of_the_folder_is_run_as_its_module(endpoint: str, tmp_path: Path, file: str) -> None:
    (tmp_path / "nodes").mkdir()
    for folder in (tmp_path, tmp_path / "nodes"):
        (folder / "failing.py").write_text(FAILING.format(error="SystemExit(3)"))
    with robo("run", file, "--listen", endpoint, cwd=str(tmp_path)) as node:
        assert node.wait() == 3


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("run", "x.py"), "error: there is no file x.py"),
        (("run", "../x.py"), "error: there is no file ../x.py"),
        (("check", "m.yaml"), "'failing.py' is a file; write its module, failing"),
    ],
)
def test_a_file_that_is_no_service_is_told_in_a_sentence(tmp_path: Path, words: tuple[str, ...], told: str) -> None:
    (tmp_path / "failing.py").write_text(FAILING.format(error="SystemExit(3)"))
    (tmp_path / "m.yaml").write_text("groups: {g: {nodes: {bad: {service: failing.py}}}}")
    with robo(*words, cwd=str(tmp_path)) as command:
        assert command.wait() == 1
        assert told in command.output
        assert "Traceback" not in command.output


@pytest.mark.parametrize("words", [("run", "failing"), ("up", "m.yaml"), ("check", "m.yaml")])
def test_a_file_that_hides_robo_is_named(tmp_path: Path, words: tuple[str, ...]) -> None:
    (tmp_path / "failing.py").write_text(FAILING.format(error="SystemExit(3)"))
    (tmp_path / "m.yaml").write_text("groups: {g: {nodes: {bad: {service: failing}}}}")
    (tmp_path / "robo.py").write_text("")
    program = [str(Path(sys.executable).with_name("robo")), *words]
    result = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode != 0
    assert result.stderr.count("robo.py in this folder hides the package robo from every node") == 1
    assert len(result.stderr.splitlines()) == 1


def test_a_checkout_of_robo_does_not_hide_it(tmp_path: Path, endpoint: str) -> None:
    # As the README's first command does: an installed robo starts in the folder that it was installed from.
    shutil.copytree(Path(package.__file__).parent, tmp_path / "robo", ignore=shutil.ignore_patterns("__pycache__"))
    words = [str(Path(sys.executable).with_name("robo")), "up", "--robot-name", "r1", "--listen", endpoint]
    launch = Running(words, cwd=str(tmp_path), env=plain_environment())
    try:
        launch.wait_for("r1 is ready: 6 nodes")
    finally:
        launch.close()


def test_under_a_supervisor_it_is_told_once_too(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "failing.py").write_text(FAILING.format(error="OSError('no such device')"))
    (tmp_path / "m.yaml").write_text("groups: {g: {nodes: {bad: {service: failing, required: true}}}}")
    with robo("up", "m.yaml", "--listen", endpoint, cwd=str(tmp_path)) as launch:
        assert launch.wait(60) == 1
        assert launch.output.count('failing.py", line 5, in on_start') == 1
        assert "bad failed: exit code 1" in launch.output


UNLUCKY = """\
import os, signal, sys, threading
from robo.process import node, router
from robo.wire.network import Network

wait = threading.Condition.wait

def unlucky(condition, timeout=None):
    if threading.current_thread() is threading.main_thread() and sys._getframe(2).f_code.co_name in ("wait", "route"):
        os.kill(os.getpid(), signal.{name})
    return wait(condition, timeout)

threading.Condition.wait = unlucky
{run}
"""


RUN_NODE = "node.main()"
ROUTE = "router.route(Network(mode='router', listen=(sys.argv[-1],)), lambda: False)"


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("run", [RUN_NODE, ROUTE], ids=["node", "router"])
def test_a_signal_in_the_moment_in_which_it_begins_to_wait_for_its_end(endpoint: str, run: str, name: str) -> None:
    words = ["robo_services.safety_monitor", "--listen", endpoint]
    with program("-c", UNLUCKY.format(run=run, name=name), *words, cwd=Path()) as running:
        output, _ = running.communicate(timeout=PATIENCE)
        assert running.returncode == 0, output


ELSEWHERE = """\
import signal, threading
from robo.process import signals

ended = threading.Event()
signals.on_end(ended.set)
signal.pthread_sigmask(signal.SIG_BLOCK, signals.ENDING)  # another thread gets it, and nothing wakes this one
print("waits", flush=True)
ended.wait()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_does_not_wake_the_main_thread(number: signal.Signals) -> None:
    with program("-c", ELSEWHERE, cwd=Path()) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "waits\n"
        running.send_signal(number)
        output, _ = running.communicate(timeout=PATIENCE)
        assert running.returncode == 0, output


BUSY = """\
import threading
import robo
from robo_messages import String

class Busy(robo.Node):
    out = robo.Publisher(String, "out")

    def on_start(self) -> None:
        for _ in range(4):
            threading.Thread(target=self.work, daemon=True).start()

    def ready(self) -> bool:
        print("ready\\n", end="", flush=True)
        return True

    def work(self) -> None:
        while True:
            self.out.publish(String("x"))

if __name__ == "__main__":
    robo.run(Busy)
"""


def test_a_process_ends_quietly_while_threads_of_its_own_are_in_zenoh(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "busy.py").write_text(BUSY)
    for _ in range(5):
        with program("busy.py", "--listen", endpoint, cwd=tmp_path) as node:
            assert node.stdout is not None
            first = "".join(sorted(node.stdout.readline() for _ in range(2)))
            assert "runs as /busy" in first
            assert first.endswith("ready\n")
            node.send_signal(signal.SIGINT)
            output, _ = node.communicate(timeout=PATIENCE)
            assert (node.returncode, output) == (0, "")


MORTAL = """\
import os
import threading
import robo

class Mortal(robo.Node):
    def on_start(self) -> None:
        threading.Thread(target=self.watch, name="camera", daemon=True).start()

    def watch(self) -> None:
        if not os.path.exists("died"):
            open("died", "w").close()
            raise OSError("no more frames")

if __name__ == "__main__":
    robo.run(Mortal)
"""


def test_a_node_whose_own_thread_dies_fails(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "mortal.py").write_text(MORTAL)
    with program("mortal.py", "--listen", endpoint, cwd=tmp_path) as node:
        output, _ = node.communicate(timeout=PATIENCE)
        assert node.returncode == 1
        assert "ERROR mortal: the thread camera died; the node ends\nTraceback" in output
        assert output.count("OSError: no more frames") == 1


def test_a_node_whose_own_thread_dies_is_started_again_by_its_policy(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "mortal.py").write_text(MORTAL)
    policy = "restart: {policy: on-failure, delay: 0.1}"
    (tmp_path / "m.yaml").write_text(f"groups: {{g: {{nodes: {{mortal: {{service: mortal, {policy}}}}}}}}}")
    with robo("up", "m.yaml", "--listen", endpoint, cwd=str(tmp_path)) as launch:
        launch.wait_for("the thread camera died; the node ends")
        launch.wait_for("mortal ended with exit code 1; starting it again in 0.")
        eventually(lambda: " is ready" in launch.output.partition("starting it again")[2], "it is ready after that")


PAIR = """\
import robo
from robo import Node, Publisher, subscribe, timer
from robo_messages import String

class Talker(Node):
    class Parameters(robo.Parameters):
        word: str = "hello"
        rate: float = 20.0

    parameters: Parameters
    out = Publisher(String, "words")

    @timer(rate="rate")
    def speak(self) -> None:
        self.out.publish(String(self.parameters.word))

class Listener(Node):
    class Parameters(robo.Parameters):
        word: str = ""

    parameters: Parameters

    @subscribe("words")
    def hear(self, message: String) -> None:
        self.logger.info("heard %s, for %s", message.data, self.parameters.word, throttle=60.0)
        if message.data == "go":
            raise SystemExit(4)
"""


def test_several_nodes_run_in_one_process_by_hand(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "pair.py").write_text(PAIR)
    words = ["run", "pair:Talker", "pair.py:Listener", "--one-process", "--robot-name", "r1", "--listen", endpoint]
    values = ["-p", "talker.word:=two", "-p", "listener.word:=it", "-p", "rate:=30.0"]
    with robo(*words, *values, cwd=str(tmp_path)) as running:
        running.wait_for("r1.listener: heard two, for it")
        running.wait_for("r1.talker: runs as /r1/talker, at ")
        again = robo("run", "pair:Listener", "--robot-name", "r1", "--listen", endpoint, cwd=str(tmp_path))
        with again as refused:
            assert refused.wait() == 1
            assert "/r1/listener" in refused.output
        running.interrupt()
        assert running.wait() == 0
    with robo(*words, "-p", "word:=go", cwd=str(tmp_path)) as running:
        running.wait_for("r1.listener: heard go, for go")
        running.interrupt()
        assert running.wait() == 4, "one has failed"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["-p", "talker.wrod:=x"], "error: -p talker.wrod:=x: none of these nodes has such a parameter"),
        (["-p", "x"], "error: -p x: none of these nodes has such a parameter"),
        (["-p", "rate:=fast"], "rate"),
        (["-r", "x"], "error: remapping 'x': write from:=to"),
    ],
)
def test_an_option_that_no_node_of_a_process_takes_is_refused(tmp_path: Path, words: list[str], told: str) -> None:
    (tmp_path / "pair.py").write_text(PAIR)
    with robo("run", "pair:Talker", "pair:Listener", "--one-process", *words, cwd=str(tmp_path)) as running:
        assert running.wait() == 1
        assert told in running.output


def test_nodes_of_one_process_have_names_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "pair.py").write_text(PAIR)
    (tmp_path / "other.py").write_text(PAIR)
    for services in (["pair:Talker", "pair:Talker"], ["pair:Talker", "other:Talker"]):
        with robo("run", *services, "--one-process", cwd=str(tmp_path)) as running:
            assert running.wait() == 1
            assert "twice" in running.output or "two of these nodes are called /talker" in running.output
