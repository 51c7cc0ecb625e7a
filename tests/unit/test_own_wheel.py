"""robo as a wheel, made from what is installed."""

import io
import json
import zipfile
from importlib.metadata import Distribution, PathDistribution
from pathlib import Path

import pytest

from robo.create import own_wheel

FILES = {
    "robo/__init__.py": "X = 1\n",
    "robo/share/launch/robot.yaml": "groups: {}\n",
    "robo/__pycache__/__init__.cpython-311.pyc": "",
    "../../../bin/robo": "#!python\n",
    "robo_zenoh-0.1.0.dist-info/METADATA": "Name: robo-zenoh\nVersion: 0.1.0\n",
    "robo_zenoh-0.1.0.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    "robo_zenoh-0.1.0.dist-info/INSTALLER": "pip\n",
}


def installed(folder: Path, origin: dict[str, object] | None) -> Distribution:
    """robo as pip installs it, from somewhere."""
    site = folder / "lib" / "python3" / "site-packages"
    files = dict(FILES)
    if origin is not None:
        files["robo_zenoh-0.1.0.dist-info/direct_url.json"] = json.dumps(origin)
    files["robo_zenoh-0.1.0.dist-info/RECORD"] = "".join(f"{path},,\n" for path in files)
    for path, text in files.items():
        file = site / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return PathDistribution(site / "robo_zenoh-0.1.0.dist-info")


@pytest.mark.parametrize("origin", [{"url": "file:///x.whl", "archive_info": {}}, {"url": "file:///x", "dir_info": {}}])
def test_a_robo_that_no_index_has_is_packed_as_it_came(
    origin: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = installed(tmp_path, origin)
    monkeypatch.setattr(own_wheel, "distribution", lambda _: there)
    made = own_wheel.own_wheel()
    assert made is not None
    name, data = made
    assert name == "robo_zenoh-0.1.0-py3-none-any.whl"
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert sorted(archive.namelist()) == [
            "robo/__init__.py",
            "robo/share/launch/robot.yaml",
            "robo_zenoh-0.1.0.dist-info/METADATA",
            "robo_zenoh-0.1.0.dist-info/RECORD",
            "robo_zenoh-0.1.0.dist-info/WHEEL",
        ]
        record = archive.read("robo_zenoh-0.1.0.dist-info/RECORD").decode().splitlines()
    assert record[-1] == "robo_zenoh-0.1.0.dist-info/RECORD,,"
    assert record[0].startswith("robo/__init__.py,sha256=")
    assert record[0].endswith(",6")


@pytest.mark.parametrize("origin", [None, {"url": "file:///x", "dir_info": {"editable": True}}])
def test_a_robo_of_an_index_or_of_a_checkout_is_not(
    origin: dict[str, object] | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = installed(tmp_path, origin)
    monkeypatch.setattr(own_wheel, "distribution", lambda _: there)
    assert own_wheel.own_wheel() is None
