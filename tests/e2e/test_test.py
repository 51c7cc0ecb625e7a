"""`robo test`: the tests of packages, and what is said of them."""

from pathlib import Path
from xml.etree import ElementTree

import msgspec
import pytest

from robo.cli.views import test as view
from robo.errors import UsageError
from robo.packages import tests
from robo.packages.tests import Failure, Result
from tests.support import run_robo

ARM = """
import pytest


def agree(value):
    assert value == 2


def test_fine():
    pass


def test_wrong():
    agree(1)


@pytest.fixture
def port():
    raise OSError("no device")


def test_port(port):
    pass


@pytest.mark.skip(reason="the arm is not built")
def test_later():
    pass
"""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Two packages, and what looks like one."""
    for name, text in {
        "src/arm": ARM,
        "src/base": "def test_fine():\n    pass\n",
        ".cache/old": "",
        "build/arm": "",
    }.items():
        folder = tmp_path / name
        (folder / "tests").mkdir(parents=True)
        (folder / "pyproject.toml").write_text(f"[project]\nname = 'my_{folder.name}'\n")
        (folder / "tests" / f"test_{folder.name}.py").write_text(text)
    return tmp_path


def test_packages_are_found_below_a_folder(workspace: Path) -> None:
    assert [(one.name, one.folder.name) for one in tests.find(workspace)] == [("my_arm", "arm"), ("my_base", "base")]
    assert [one.name for one in tests.find(workspace / "src" / "arm")] == ["my_arm"]
    (workspace / "src" / "arm" / "pyproject.toml").write_text("no toml")
    assert [one.name for one in tests.find(workspace)] == ["arm", "my_base"]
    with pytest.raises(UsageError, match=r"there is no folder .*nowhere"):
        tests.find(workspace / "nowhere")
    with pytest.raises(UsageError, match="a package is a folder with a"):
        tests.find(workspace / "src" / "arm" / "tests")


def test_failures_are_summed_up_with_their_places(workspace: Path) -> None:
    ended = run_robo("test", "--junit", "results.xml", "--", "-p", "no:randomly", cwd=str(workspace))
    assert ended.returncode == 1
    said = ended.stdout.splitlines()
    assert not [line for line in said if "xml" in line], "where pytest had its report is gone"
    summary = said[-5:]
    assert "    src/arm/tests/test_arm.py:6 test_wrong: assert 1 == 2" in summary
    assert '    src/arm/tests/test_arm.py:19 test_port: failed on setup with "OSError: no device"' in summary
    assert summary[-1] == "2 packages: 5 tests, 1 error, 1 failure, 1 skipped"
    suites = list(ElementTree.parse(workspace / "results.xml").getroot())
    assert [suite.get("name") for suite in suites] == ["my_arm", "my_base"]


def test_a_test_that_fails_twice_is_one(tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'twice'\n")
    (tmp_path / "test_twice.py").write_text(
        "import pytest\n\n@pytest.fixture\ndef torn():\n    yield\n    raise OSError('torn')\n\n"
        "def test_it(torn):\n    assert 1 == 2\n"
    )
    ended = run_robo("test", "--", "-q", cwd=str(tmp_path))
    assert "!!  twice: 1 test, 1 error, 1 failure, 0 skipped" in ended.stdout


def test_the_summary_for_programs(workspace: Path) -> None:
    ended = run_robo("test", "src/arm", "--json", cwd=str(workspace))
    told = msgspec.json.decode(ended.stdout)
    result = msgspec.convert(told["packages"][0], Result)
    assert not told["fine"]
    assert (result.package, result.tests, result.failures, result.errors, result.skipped) == ("my_arm", 4, 1, 1, 1)
    assert result.failed == [
        Failure("test_wrong", "failure", "tests/test_arm.py", 6, "assert 1 == 2"),
        Failure("test_port", "error", "tests/test_arm.py", 19, 'failed on setup with "OSError: no device"'),
    ]
    assert "test session starts" in ended.stderr


def test_what_pytest_refuses_is_a_failure_and_no_test_is_none(workspace: Path) -> None:
    refused = run_robo("test", "src/base", "--", "--no-such-option", cwd=str(workspace))
    assert refused.returncode == 1
    assert (
        "my_base: 0 tests, 0 errors, 0 failures, 0 skipped, in 0.0 s; pytest ended with exit code 4" in refused.stdout
    )
    none = run_robo("test", "src/base", "--", "-k", "nothing", cwd=str(workspace))
    assert none.returncode == 0
    assert run_robo("test", "elsewhere", cwd=str(workspace)).returncode == 2
    twice = run_robo("test", "src/base", "--", "--junit-xml=mine.xml", cwd=str(workspace))
    assert twice.returncode == 2
    assert "robo test --junit FILE" in twice.stderr


def test_without_pytest_it_says_what_to_install(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view, "find_spec", lambda _: None)
    with pytest.raises(UsageError, match="pytest is not installed here: pip install pytest"):
        view.run_tests([str(workspace)], junit=None, json=False)


def test_a_report_that_cannot_be_written_is_told_first(workspace: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        view.run_tests([str(workspace)], junit=workspace / "no" / "such.xml", json=False)
