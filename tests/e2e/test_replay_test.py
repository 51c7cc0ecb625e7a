"""`robo replay-test`: what it prints, and with what it ends."""

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import msgspec
import psutil
import pytest

from robo.bag.regression.report import ReplayReport
from tests import replays
from tests.support import Running, eventually, plain_environment, run_robo

pytestmark = pytest.mark.timeout(240)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with nodes, a recording, and a reference of what one of them says of it."""
    replays.nodes(tmp_path)
    recording = str(replays.words(tmp_path / "words.mcap"))
    said = run_robo("replay-test", recording, "--node", "birds:Parrot", "--accept", cwd=str(tmp_path))
    assert (said.returncode, said.stderr) == (0, "")
    assert said.stdout.splitlines()[-1] == f"ACCEPTED: {recording} is what /r1/parrot says now"
    return tmp_path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with nodes, and a recording without what they say."""
    folder = replays.nodes(tmp_path_factory.mktemp("birds"))
    replays.words(folder / "words.mcap")
    (folder / "bad.yaml").write_text('topics: {"**": {\n  feilds: {x: 1}}}\n')
    return folder


def test_what_is_as_it_was_passes(project: Path) -> None:
    done = run_robo("replay-test", "words.mcap", "--node", "parrot", "--manifest", "birds.yaml", cwd=str(project))
    assert (done.returncode, done.stderr) == (0, "")
    first, *_, topic, last = done.stdout.splitlines()
    assert first.startswith("/r1/parrot: 20 messages of 1 topic from words.mcap, 1.9 s in ")
    assert (topic, last) == ("r1/said: same, 20 messages", "SAME: /r1/parrot says what it said")
    assert sorted(one.name for one in project.iterdir() if one.name != "__pycache__") == [
        "birds.py", "birds.yaml", "words.mcap",
    ]  # fmt: skip


def test_what_has_changed_fails_with_the_first_difference(project: Path) -> None:
    source = (project / "birds.py").read_text()
    changed = source.replace(
        "String(word.data))\n\n\nclass WallClock", 'String(word.data.replace("7", "8")))\n\n\nclass W'
    )
    (project / "birds.py").write_text(changed)
    words = "replay-test", "words.mcap", "--node", "birds:Parrot"
    done = run_robo(*words, cwd=str(project))
    assert (done.returncode, done.stderr) == (1, "")
    lines = done.stdout.splitlines()
    assert lines[-1] == "DIFFERENT: r1/said"
    assert "  data: 2 values in 2 messages of 20" in lines
    (first,) = [line for line in lines if line.startswith("    first")]
    assert first.startswith("    first   at 0.700 s (")
    assert first.endswith("message 7: 7 recorded, 8 now")
    report = run_robo(*words, "--json", cwd=str(project))
    assert report.returncode == 1
    told = msgspec.json.decode(report.stdout, type=ReplayReport)
    assert (told.verdict, told.topics[0].fields[0].first.index) == ("different", 7)
    assert run_robo(*words, "--ignore", "r1/said:data", cwd=str(project)).returncode == 0


def test_what_is_not_deterministic_fails_and_is_no_reference(project: Path) -> None:
    before = (project / "words.mcap").read_bytes()
    for more in ((), ("--accept",)):
        done = run_robo("replay-test", "words.mcap", "--node", "birds:WallClock", *more, cwd=str(project))
        assert done.returncode == 1
        last = done.stdout.splitlines()[-1]
        assert last.startswith("NOT DETERMINISTIC: /r1/wall_clock says something else in each run, in r1/said data;")
    assert (project / "words.mcap").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("no.mcap", "--node", "parrot"), "there is no recording no.mcap"),
        (("words.mcap",), "say which node"),
        (("words.mcap", "two.mcap", "--node", "parrot"), "two.mcap: one recording is replayed"),
        (("words.mcap", "--node", "birds:Parrot", "-o", "other.mcap"), "say --accept too"),
        (("birds.py", "--node", "birds:Parrot"), "birds.py"),
        (("words.mcap", "--node", "birds:Parrot", "--ignore", ":x"), "write FIELD or TOPIC:FIELD"),
        (("words.mcap", "--node", "birds:Parrot", "--patience", "nan"), "a patience of nan s"),
        (("words.mcap", "--node", "birds:Parrot", "--tolerances", "no.yaml"), "no.yaml"),
        (
            ("words.mcap", "--node", "birds:Parrot", "--tolerances", "bad.yaml"),
            "bad.yaml:2:3: there is no key 'feilds'",
        ),
        (("words.mcap", "--node", "parrot", "--manifest", "bad.yaml"), "bad.yaml:1:1"),
    ],
)
def test_mistakes_are_sentences(recorded: Path, words: tuple[str, ...], told: str) -> None:
    done = run_robo("replay-test", *words, cwd=str(recorded))
    assert done.returncode == 2, done.stdout + done.stderr
    assert told in done.stderr
    assert "Traceback" not in done.stderr


def test_a_callback_has_as_long_as_is_said(recorded: Path) -> None:
    words = "replay-test", "words.mcap", "--node", "birds:Hangs", "--patience", "0.5"
    done = run_robo(*words, cwd=str(recorded))
    assert (done.returncode, done.stdout.splitlines()[-1]) == (1, "FAILED: /r1/hangs")
    assert "has been running for 0." in done.stdout


def _words(process: psutil.Process) -> list[str]:
    with suppress(psutil.Error):  # it may be just ending
        return process.cmdline()
    return []


def test_ctrl_c_leaves_nothing_behind(project: Path) -> None:
    command = [sys.executable, "-m", "robo", "replay-test", "words.mcap", "--node", "birds:Hangs"]
    running = Running(command, cwd=str(project), env=plain_environment() | {"TMPDIR": str(project)}, terminal=True)
    try:
        eventually(lambda: any("robo.testing.regression.run" in _words(one) for one in running.children()), "a run")
        running.interrupt()
        assert running.wait() == 130, running.output
        assert "Traceback" not in running.output
    finally:
        running.close()
    assert not list(project.glob("robo-replay-*"))
    assert not [
        one for one in psutil.process_iter() if "robo.testing.regression.run" in _words(one) and _in(one, project)
    ]


def _in(process: psutil.Process, folder: Path) -> bool:
    with suppress(psutil.Error):
        return process.cwd() == str(folder)
    return False


def test_the_helper_in_a_test_of_pytest(project: Path) -> None:
    (project / "test_birds.py").write_text(
        "from robo.testing import replay\n\n\n"
        "def test_it_says_what_it_said():\n"
        '    replay("words.mcap", "parrot", manifest="birds.yaml")\n'
        "\n\ndef test_it_says_less():\n"
        '    replay("words.mcap", "birds:Raises")\n'
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n0", "test_birds.py"]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 failed, 1 passed" in done.stdout
    assert "ReplayDiffers: /r1/raises: 20 messages of 1 topic from words.mcap" in done.stdout
    assert "/r1/raises at 0.700 s" in done.stdout
