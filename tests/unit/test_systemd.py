"""What a manifest becomes as a unit of systemd, and what `robo service` does with it, without systemd."""

import os
import pwd
import stat
from pathlib import Path

import msgspec
import pytest

from robo.cli.launch import service, systemd
from robo.cli.launch.service_request import ServiceRequest, chosen_by_user
from robo.errors import SecurityError, SystemdError, UsageError
from robo.export.systemd import access, stamp, unit, words
from robo.export.systemd.access import Reader
from robo.export.systemd.devices import Found, devices, named_in
from robo.machine.systemd import Systemd
from robo.supervisor.stopping import LAST_RESORT
from robo.wire.identity import About

MANIFEST = """
description: "100 %% of\\n  a robot"
groups:
  g:
    namespace: ${robot_name}
    nodes:
      a: {run: [sleep, "${env:NAP}"], restart: %s, limits: {memory: 100M, cpu: 0.5}, priority: -5}
      b: {run: [cat, /dev/ttyACM0], stop: {timeout: 10}, limits: {memory: 50M}}
"""


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SUDO_USER", raising=False)
    monkeypatch.delenv("NAP", raising=False)
    monkeypatch.setenv("PYTHONPATH", "/opt/my packages")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "m.yaml").write_text(MANIFEST % "on-failure")


def made(*, by_user: bool = False, **changes: object) -> systemd.Made:
    usual = {"words": ["m.yaml"], "robot_name": "r1", "run_as": None if by_user else "daemon"}
    request = ServiceRequest(**usual | changes)  # type: ignore[arg-type]
    return systemd.make(request, by_user=by_user, verb="robo service install")


def test_the_unit_runs_what_runs_by_hand(tmp_path: Path) -> None:
    lines = made(connect=["tcp/site:7447"]).text.splitlines()
    (start,) = [line for line in lines if line.startswith("ExecStart=")]
    assert start.endswith(f" -m robo up {tmp_path}/m.yaml --robot-name r1 --connect tcp/site:7447")
    assert f"WorkingDirectory={tmp_path}" in lines
    assert 'Environment="PYTHONPATH=/opt/my packages"' in lines
    assert "EnvironmentFile=-%E/robo/r1.env" in lines
    assert "Description=Robot r1: 100 %% of a robot" in lines
    assert "User=daemon" in lines
    assert "# Runs as: daemon" in lines
    assert "ReadWritePaths=/tmp" in lines, "daemon's tools and its other robots meet it there"
    assert "PrivateTmp=yes" in made(run_as="dynamic").text.splitlines()
    assert f"# Needs: {tmp_path}/m.yaml" in lines
    assert f"TimeoutStopSec={15 + LAST_RESORT + 1:g}" in lines, "a stop of 10 s, a TERM of 5"
    assert "LimitNICE=-5" in lines
    assert "SystemCallFilter=~@privileged" in lines, "it sets a priority"
    assert "MemoryMax=662M" in lines
    assert not [line for line in lines if line.startswith("CPUQuota")], "b may use all"


def test_a_robot_with_keys_runs_with_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = tmp_path / "security" / "names" / "r1"
    keys.mkdir(parents=True, mode=0o700)
    (keys / "cert.pem").write_text("a certificate")
    about = About(name="r1", role="robot", not_after=2**40, serial="1")
    (keys / "about.json").write_bytes(msgspec.json.encode(about))
    for found in made(security="security"), made(security=str(keys)):
        assert f" --robot-name r1 --security {keys}\n" in found.text
        assert f"# Needs: {keys}\n" in found.text
        assert "a certificate" not in found.text + found.variables
        if os.getuid() == 0:
            assert f"daemon may not read {keys}" in "\n".join(found.notes)
    monkeypatch.setenv("ROBO_SECURITY", str(keys))
    assert f" --security {keys}\n" in made().text
    with pytest.raises(SecurityError, match="it has no name r2"):
        made(security="security", robot_name="r2")
    (keys / "about.json").write_bytes(msgspec.json.encode(msgspec.structs.replace(about, role="operator")))
    assert "--security" not in made().text, "who asks has a name, and the robot has none"
    with pytest.raises(SecurityError, match="r1 is there as operator"):
        made(security=str(keys))


@pytest.mark.parametrize(("policy", "wish", "restart"), [
    ("on-failure", None, "on-failure"),
    ("never", None, "no"),
    ("never", "on-failure", "on-failure"),
    ("always", "no", "no"),
])  # fmt: skip
def test_a_run_is_started_again_where_its_manifest_starts_anything_again(
    tmp_path: Path, policy: str, wish: str | None, restart: str
) -> None:
    (tmp_path / "m.yaml").write_text(MANIFEST % policy)
    found = made(restart=wish)
    assert f"Restart={restart}" in found.text.splitlines()
    assert any("neither is the run" in note for note in found.notes) == (policy == "never" and wish is None)


def test_what_somebody_has_to_say_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAP", "a secret")
    found = made()
    assert "say what NAP is, in /etc/robo/r1.env" in found.notes
    assert "it names /dev/ttyACM0, which it may not use; say --device /dev/ttyACM0" in found.notes
    assert found.variables.endswith("\n#NAP=\n")
    assert "a secret" not in found.text + found.variables
    (tmp_path / "m.yaml").chmod(0o600)
    if os.getuid() == 0:
        assert f"daemon may not read {tmp_path}/m.yaml" in "\n".join(made().notes)


def test_a_users_unit_has_what_works_without_root() -> None:
    found = made(by_user=True)
    assert not [line for line in found.text.splitlines() if line.startswith(("User=", "Protect", "DevicePolicy"))]
    assert "WantedBy=default.target" in found.text
    assert "it uses /dev/ttyACM0: you have to be in the group of each" in found.notes
    with pytest.raises(UsageError, match="--run-as goes with --system"):
        made(by_user=True, run_as="daemon")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"restart": "sometimes"}, "--restart sometimes: say no, on-failure or always"),
        ({"device": ["ttyUSB0"]}, "--device ttyUSB0: name a device, /dev/ttyUSB0, or all of a kind, char-ttyUSB"),
        ({"device": ["/dev/../etc/passwd"]}, "name a device"),
        ({"run_as": "no-such-user"}, "there is no user no-such-user on this machine; `--run-as dynamic`"),
    ],
)
def test_what_makes_no_sense_is_told(changes: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        made(**changes)  # type: ignore[arg-type]


def test_who_it_runs_as_where_nobody_says_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "in_a_home", lambda _: False)
    monkeypatch.setenv("SUDO_USER", "daemon")
    assert made(run_as=None).service.run_as == "daemon"
    monkeypatch.delenv("SUDO_USER")
    monkeypatch.setattr("getpass.getuser", lambda: "root")
    assert made(run_as=None).service.run_as is None
    monkeypatch.setattr(access, "in_a_home", lambda _: True)
    assert made(run_as=None).service.run_as == "root"
    assert "ProtectHome=read-only" in made(run_as=None).text
    assert made(run_as="dynamic").service.run_as is None


def test_words_stand_for_themselves() -> None:
    assert words.command(["a b", "$HOME", "50%", 'say "no"', "", "x:=1"]) == '"a b" $$HOME 50%% "say \\"no\\"" "" x:=1'
    assert words.quoted("a\nb\\") == '"a\\nb\\\\"'


def test_devices_are_granted_by_their_kind_or_their_path() -> None:
    found = {
        "/dev/ttyUSB3": Found("/dev/ttyUSB3", "dialout"),
        "/dev/lidar": Found("/dev/ttyACM1", "plugdev"),
        "/dev/strange": Found("/dev/strange", "root"),
    }
    named = ["/dev/ttyUSB3", "/dev/lidar", "/dev/strange", "/dev/video0", "char-input"]
    granted = devices(named, found, {"dialout", "plugdev", "video"})
    assert granted.rules == (
        "char-ttyUSB rw",
        "char-ttyACM rw",
        "/dev/strange rw",
        "char-video4linux rw",
        "char-input rw",
    )
    assert granted.groups == ("dialout", "plugdev", "video"), "this machine has no group input"
    assert granted.alone == ("/dev/strange",)


def test_devices_that_a_manifest_names_are_found() -> None:
    texts = ["/dev/ttyUSB0", "/dev/null", "/dev/shm/x", "see /dev/x", "/dev/serial/by-id/usb-a_b"]
    assert named_in(texts) == ["/dev/ttyUSB0", "/dev/serial/by-id/usb-a_b"]


def test_who_may_read_what(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    file = tmp_path / "file"
    file.touch()
    own = Reader(file.stat().st_uid or 1000, frozenset())
    file.chmod(0o640)
    assert access.hindered(file, Reader(4711, frozenset({file.stat().st_gid}))) in (None, *file.parents)
    assert access.hindered(file, access.STRANGER) in (file, *file.parents)
    assert access.hindered(tmp_path / "none", own) in (tmp_path / "none", *tmp_path.parents)
    assert access.hindered(Path("/etc/passwd"), access.STRANGER) is None
    assert access.reader(pwd.getpwuid(0).pw_name).uid == 0


def test_a_unit_that_was_changed_is_known() -> None:
    text = stamp.stamped("[Unit]\n")
    assert stamp.is_own(text)
    assert stamp.is_unchanged(text)
    changed = text + "Wants=x\n"
    assert stamp.is_own(changed)
    assert not stamp.is_unchanged(changed)
    assert not stamp.is_own("[Unit]\n")


def test_names_of_units() -> None:
    assert unit.unit_name("r1") == "robo-r1.service"
    assert unit.unit_name("site/r1") == "robo-site-r1.service"
    assert unit.environment_file("site/r1") == "robo/site-r1.env"


# -- robo service ------------------------------------------------------------------------------------------------------


class PlayedSystemd(Systemd):
    """A service manager that does all that it is asked to."""

    asked: list[str]

    def __init__(self, *, by_user: bool) -> None:
        self.shown = "systemctl --user" if by_user else "systemctl"
        self.asked = []
        played.append(self)

    def _do(self, *words: str) -> str:
        self.asked.append(" ".join(words))
        return "ActiveState=active\nSubState=running\nStatusText=well\nNRestarts=2\nMainPID=7\nResult=success\n"


played: list[PlayedSystemd] = []


@pytest.fixture
def _played(monkeypatch: pytest.MonkeyPatch) -> None:
    played.clear()
    monkeypatch.setattr(service, "Systemd", PlayedSystemd)


def install(*, force: bool = False, dry_run: bool = False) -> None:
    service.install(ServiceRequest(["m.yaml"], "r1", user=True), force=force, dry_run=dry_run)


@pytest.mark.usefixtures("_played")
def test_what_is_installed_is_told_and_done_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "config" / "systemd" / "user" / "robo-r1.service"
    install(dry_run=True)
    assert not file.exists()
    assert f"{file} would be written; nothing is done" in capsys.readouterr().out
    install()
    said = capsys.readouterr().out
    assert f"wrote {file}" in said
    assert "systemctl --user restart robo-r1.service" in said
    variables = tmp_path / "config" / "robo" / "r1.env"
    assert stat.S_IMODE(variables.stat().st_mode) == 0o600
    assert played[0].asked[:2] == ["daemon-reload", "enable robo-r1.service"]
    variables.write_text("NAP=1\n")
    before = file.stat()
    install()
    assert "is there already, as it should be" in capsys.readouterr().out
    assert file.stat().st_mtime_ns == before.st_mtime_ns
    assert variables.read_text() == "NAP=1\n"


@pytest.mark.usefixtures("_played")
def test_what_somebody_has_changed_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install()
    file = tmp_path / "config" / "systemd" / "user" / "robo-r1.service"
    file.write_text(file.read_text() + "# mine\n")
    service.status("r1", by_user=True, json=False)
    assert "robo-r1.service (changed)" in capsys.readouterr().out
    with pytest.raises(UsageError, match="was changed since robo has written it; --force drops the changes"):
        install()
    with pytest.raises(UsageError, match="was changed since robo has written it; --force drops the changes"):
        service.remove("r1", by_user=True, force=False, dry_run=False)
    install(force=True)
    assert "# mine" not in file.read_text()
    file.write_text("[Unit]\n")
    with pytest.raises(UsageError, match="is not robo's: somebody else has written it"):
        install()


@pytest.mark.usefixtures("_played")
def test_what_is_removed_is_gone_and_its_variables_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install()
    service.remove("r1", by_user=True, force=False, dry_run=True)
    file = tmp_path / "config" / "systemd" / "user" / "robo-r1.service"
    assert file.exists()
    service.remove("r1", by_user=True, force=False, dry_run=False)
    assert not file.exists()
    assert (tmp_path / "config" / "robo" / "r1.env").exists()
    assert played[-1].asked == ["disable --now robo-r1.service", "daemon-reload"]
    capsys.readouterr()
    service.remove("r1", by_user=True, force=False, dry_run=False)
    assert "nothing is to be done" in capsys.readouterr().out
    service.status(None, by_user=True, json=True)
    assert capsys.readouterr().out.strip() == "[]"
    with pytest.raises(UsageError, match="systemd runs no robot r1 here"):
        service.status("r1", by_user=True, json=False)


def test_where_there_is_no_systemd_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(SystemdError, match="systemd does not run this machine"):
        service.status(None, by_user=None, json=False)


def test_which_service_manager_is_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    assert chosen_by_user(user=False, system=False)
    assert not chosen_by_user(user=False, system=True)
    monkeypatch.setattr("os.geteuid", lambda: 0)
    assert not chosen_by_user(user=False, system=False)
    assert chosen_by_user(user=True, system=False)
    with pytest.raises(UsageError, match="exclude each other"):
        chosen_by_user(user=True, system=True)
