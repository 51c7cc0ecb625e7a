"""What the doctor finds on a machine that is made up."""

import errno
import fcntl
import os
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from robo.machine import orphans, serial_ports
from robo.tools import doctor
from robo.wire import listeners, tcp


def looks(monkeypatch: pytest.MonkeyPatch, *found: list[int]) -> None:
    """Let the doctor find other leftovers at each look, the last ones again and again."""

    def later() -> Iterator[list[int]]:
        yield from found
        while True:
            yield found[-1]

    looks = later()
    monkeypatch.setattr(orphans, "leftovers", lambda: next(looks))


def test_what_a_watchdog_is_just_ending_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    looks(monkeypatch, [7, 8], [8], [])
    assert doctor.leftovers().verdict == "ok"


def test_what_stays_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_ENDED_WITHIN", 0.0)
    looks(monkeypatch, [7, 8])
    found = doctor.leftovers()
    assert found.verdict == "fault"
    assert "7, 8" in found.message
    assert found.fix == "the next robo up ends them"


@contextmanager
def port(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, Path]]:
    """A pseudo-terminal in the place of /dev/ttyUSB0: our end, and where it is."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    path = folder / "ttyUSB0"
    path.symlink_to(os.ttyname(theirs))
    monkeypatch.setattr(serial_ports, "PATTERNS", (f"{folder}/ttyUSB*",))
    monkeypatch.setattr(serial_ports, "holders", lambda _: [])  # we are
    monkeypatch.setattr(serial_ports, "STARTING", 0.5)
    try:
        yield ours, path
    finally:
        os.close(ours)
        os.close(theirs)


def test_serial_ports_are_listed_and_asked_only_when_told_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_ports, "PATTERNS", (f"{tmp_path}/ttyUSB*",))
    assert [one.message for one in doctor.ports(ask=True)] == ["no serial port is there"]
    with port(tmp_path, monkeypatch) as (ours, path):
        (found,) = doctor.ports(ask=False)
        assert (found.verdict, found.message) == ("ok", f"{path} can be opened")
        assert "--ask-ports" in found.fix
        assert not is_readable(ours), "nothing was said to it"
        monkeypatch.setattr(serial_ports, "holders", lambda _: [7])
        (found,) = doctor.ports(ask=True)
        assert found.message == f"{path} is open in process 7"
        assert not is_readable(ours)
        monkeypatch.setattr(serial_ports, "holders", lambda _: [])
        monkeypatch.setattr(serial_ports, "may_open", lambda _: False)
        (found,) = doctor.ports(ask=True)
        assert (found.verdict, found.fix.partition(" $")[0].rpartition(" ")[0]) == ("note", "sudo usermod -aG")


@pytest.mark.parametrize(
    ("says", "told"),
    [
        (b"Invalid Command\r\n12 -7\r\n", "answers as the board of a base, its encoders are at 12 -7, 57600 bits"),
        (b"$GPGGA,092750.000,5321.6802,N\r\n", "does not answer as the board of a base: b'$GPGGA"),
        (b"", "says nothing"),
    ],
)
def test_who_is_at_a_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says: bytes, told: str) -> None:
    with port(tmp_path, monkeypatch) as (ours, path):

        def answer() -> None:
            while not over.is_set():
                if is_readable(ours):
                    os.read(ours, 100)
                    os.write(ours, says)

        over = threading.Event()
        board = threading.Thread(target=answer)
        board.start()
        try:
            (one,) = serial_ports.found()
            monkeypatch.setattr(serial_ports, "ask", partial(serial_ports.ask, starting=0.6))
            (found,) = doctor.ports(ask=True)
        finally:
            over.set()
            board.join()
        assert found.message.startswith(f"{path} {told}")
        assert one == serial_ports.FoundPort(str(path))


def test_a_port_that_somebody_has_locked_is_not_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with port(tmp_path, monkeypatch) as (ours, path), path.open("rb", buffering=0) as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        (found,) = doctor.ports(ask=True)
        assert found.message == f"{path} is open elsewhere"
        assert not is_readable(ours)


def is_readable(fd: int) -> bool:
    return bool(select.select([fd], [], [], 0.05)[0])


@pytest.mark.parametrize(("baud", "options"), [(57_600, ""), (115_200, " -p serial_base.baud:=115200")])
def test_what_is_to_be_said_of_a_board_that_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, baud: int, options: str
) -> None:
    with port(tmp_path, monkeypatch) as (_, path):
        monkeypatch.setattr(serial_ports, "ask", lambda _: serial_ports.Answer(baud, "1 2"))
        (found,) = doctor.ports(ask=True)
        assert found.fix == f"robo up real_robot.yaml port:={path}{options}"


def test_a_port_that_has_two_names_is_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with port(tmp_path, monkeypatch) as (_, path):
        (tmp_path / "serial0").symlink_to(path)
        monkeypatch.setattr(serial_ports, "PATTERNS", (f"{tmp_path}/tty*", f"{tmp_path}/serial[0-9]*"))
        assert [one.path for one in serial_ports.found()] == [str(path)]


def test_a_port_that_another_has_for_itself_is_not_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def busy(*_: object) -> int:
        raise OSError(errno.EBUSY, "Device or resource busy")

    with port(tmp_path, monkeypatch) as (_, path):
        monkeypatch.setattr(os, "open", busy)
        (found,) = doctor.ports(ask=True)
        monkeypatch.undo()
        assert found.message == f"{path} is open elsewhere"


def test_who_has_the_port_at_which_others_look_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBO_CONNECT", raising=False)
    monkeypatch.setattr(listeners, "holder", lambda _: listeners.Holder(7447, "127.0.0.1", 4242))
    found = doctor.port(())
    assert found.verdict == "note"
    assert "by user 4242: your robots do not dial it, and others do not see them there" in found.message
    monkeypatch.setattr(listeners, "holder", lambda _: listeners.Holder(7447, "127.0.0.1", os.geteuid()))
    monkeypatch.setattr(tcp, "speaks_zenoh", lambda *_: True)
    assert doctor.port(()).verdict == "ok"
    monkeypatch.setattr(tcp, "speaks_zenoh", lambda *_: False)
    found = doctor.port(())
    assert found.verdict == "note"
    assert "and no Zenoh answers there: your robots do not dial it, and others do not see them there" in found.message
    monkeypatch.setattr(listeners, "holder", lambda _: None)
    assert doctor.port(()).verdict == "ok"


def test_a_meeting_place_that_is_open_to_others_is_a_fault(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROBO_MEETING", str(tmp_path / "m"))
    assert doctor.meeting_place().verdict == "ok"
    (tmp_path / "m").chmod(0o777)
    found = doctor.meeting_place()
    assert (found.verdict, "is open to others (mode 777" in found.message) == ("fault", True)
