"""Files that a user names: what is no file, too large or no text ends in one sentence, at once."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from robo.bag.forms import carmen
from robo.cli.launch.network import router_network
from robo.errors import ManifestError, ParameterFileError, RoboError, UnreadableFile, UsageError
from robo.launch import resolve
from robo.launch.faults import as_text
from robo.launch.find import find_manifest
from robo.parameters import files as parameter_files
from robo.text.brief import brief, brief_lines, marked, shown
from robo.text.files import read_bytes, read_text
from robo_services import world

# `/dev/zero` never ends and a pipe never begins: where one of them is read, this file does not come to its end.
pytestmark = pytest.mark.timeout(120)

HUGE = 500_000_000


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    Path("folder").mkdir()
    with open("huge", "wb") as file:
        file.truncate(HUGE)  # takes no room on the disk
    Path("binary").write_bytes(b"a: 1\nb: \xff\n")


ODD = [
    ("/dev/zero", "it is a device, not a file"),
    ("pipe", "it is a pipe, not a file"),
    ("folder", "it is a folder, not a file"),
    ("huge", "it has 500,000,000 bytes, and at most 2,000,000 are read"),
    ("binary", "it is not text in UTF-8: byte 0xff in line 2"),
]


@pytest.mark.parametrize(("path", "expected"), [*ODD, ("nope", "No such file"), ("a\0b", "null")])
def test_what_is_no_file_of_text_is_refused_before_it_is_read(path: str, expected: str) -> None:
    with pytest.raises(UnreadableFile, match=expected) as error:
        read_text(path)
    assert error.value.missing == (path == "nope")


def test_a_socket_and_a_file_that_tells_no_size_are_refused_too() -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        with pytest.raises(UnreadableFile, match="it is a socket"):
            read_bytes("socket")
    with pytest.raises(UnreadableFile, match="more than 10 bytes"):
        read_bytes("/proc/self/status", 10)


@pytest.mark.parametrize(("path", "expected"), ODD)
def test_parameter_files(path: str, expected: str) -> None:
    with pytest.raises(ParameterFileError, match=f"parameter file {path} cannot be read: {expected}"):
        parameter_files.load(path)
    Path("m.yaml").write_text(f"groups: {{g: {{nodes: {{a: {{run: x, params: {path}}}}}}}}}\n")
    (problem,) = resolve.resolve(Path("m.yaml"), {}).problems
    assert str(problem).startswith("m.yaml:1:42: parameter file")
    assert expected in str(problem)


@pytest.mark.parametrize(("path", "expected"), ODD)
def test_manifests(path: str, expected: str) -> None:
    problems = resolve.resolve(Path(path), {}).problems
    assert any(f"manifest {path} cannot be read: {expected}" in problem.text for problem in problems)
    assert "cannot be read" in as_text(problems), "the excerpt does not read it either"


def test_a_pipe_is_no_manifest() -> None:
    Path("pipe").rename("pipe.yaml")
    with pytest.raises(ManifestError, match=r"manifest pipe\.yaml cannot be read: it is not a file"):
        find_manifest("pipe.yaml")


def test_an_include_that_is_huge_is_told_where_it_is_asked_for() -> None:
    Path("huge").rename("huge.yaml")
    Path("m.yaml").write_text("include: huge.yaml\n")
    (problem,) = resolve.resolve(Path("m.yaml"), {}).problems
    assert str(problem).startswith("m.yaml:1:10: manifest huge.yaml cannot be read: it has 500,000,000 bytes")


def _network(path: str) -> object:
    return router_network((), (), Path(path))


def _log(path: str) -> object:
    return next(carmen.read(path))


@pytest.mark.parametrize(("path", "expected"), ODD)
@pytest.mark.parametrize(("read", "error"), [(_network, UsageError), (world.load, world.WorldError)])
def test_network_settings_and_worlds(
    read: Callable[[str], object], error: type[RoboError], path: str, expected: str
) -> None:
    with pytest.raises(error, match=expected):
        read(path)


@pytest.mark.parametrize(("path", "expected"), ODD[:3])
def test_logs(path: str, expected: str) -> None:
    with pytest.raises(carmen.LogError, match=expected):
        _log(path)


def test_network_settings_that_unfold_without_end_are_refused() -> None:
    Path("net.yaml").write_text("a: &a [*a]\n")
    with pytest.raises(UsageError, match=r"net\.yaml:1:8: alias \*a names nothing"):
        _network("net.yaml")
    Path("net.yaml").write_text("a: {b: [1, 2\n")
    with pytest.raises(UsageError, match=r"net\.yaml:2:1: not valid YAML"):
        _network("net.yaml")


def test_long_values_are_cut_and_the_end_of_a_message_is_kept() -> None:
    assert shown("x" * 1_000_000) == "'" + "x" * 56 + "…"
    assert shown("short") == "'short'"
    assert shown([1] * 1_000)[-1] == "…"
    text = brief(f"no node {'x' * 1_000_000}; did you mean base?")
    assert len(text) < 1_100
    assert text.endswith("; did you mean base?")
    assert brief("as it is") == "as it is"
    lines = brief_lines("\n".join(["x" * 5_000] * 1_000)).split("\n")
    assert len(lines) == 201
    assert max(map(len, lines)) < 1_100
    assert lines[-1] == "… and 800 lines more"


def test_a_long_line_is_shown_around_its_mark() -> None:
    assert marked("a: [1", 4) == ("a: [1", "    ^")
    excerpt, mark = marked("x" * 50_000 + "!" + "x" * 50_000, 50_000)
    assert len(excerpt) == 100
    assert excerpt[mark.index("^")] == "!"
    assert marked("a\tb", 2) == ("a b", "  ^")
