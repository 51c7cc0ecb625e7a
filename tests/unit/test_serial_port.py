"""Serial ports: what is said of those that cannot be opened, and how one is found on USB."""

import errno
import os
import sys
import termios
from pathlib import Path
from types import SimpleNamespace

import pytest

from robo.errors import RunError
from robo_services import serial_port
from robo_services.pseudo_terminal import PseudoTerminal
from robo_services.serial_feed import SerialFeed, shown
from robo_services.serial_port import PortGone, SerialPort, find_port

pytest.importorskip("serial", reason="the extra serial is not installed")


def on_usb(monkeypatch: pytest.MonkeyPatch, *ports: tuple[str, int, int, str]) -> None:
    found = [SimpleNamespace(device=d, vid=v, pid=p, serial_number=n) for d, v, p, n in ports]
    found.append(SimpleNamespace(device="/dev/ttyS0", vid=None, pid=None, serial_number=None))
    monkeypatch.setattr(serial_port, "_list_ports", lambda: SimpleNamespace(comports=lambda: found))


def test_a_path_is_itself() -> None:
    assert find_port("/dev/ttyUSB0") == "/dev/ttyUSB0"


def test_a_port_is_found_by_its_usb_id(monkeypatch: pytest.MonkeyPatch) -> None:
    on_usb(monkeypatch, ("/dev/ttyUSB0", 0x10C4, 0xEA60, "0001"), ("/dev/ttyACM0", 0x2341, 0x0043, "A1"))
    assert find_port("10c4:EA60") == "/dev/ttyUSB0"
    assert find_port("2341:0043:A1") == "/dev/ttyACM0"


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("1a86:7523", "no port has the USB id 1a86:7523; there is /dev/ttyUSB0 (10c4:ea60:1), /dev/ttyUSB1"),
        ("10c4:ea60", "several ports have the USB id 10c4:ea60; there is /dev/ttyUSB0 (10c4:ea60:1), /dev/ttyUSB1"),
        ("10c4:ea60:3", "no port has the USB id 10c4:ea60:3"),
    ],
)
def test_an_id_that_is_not_that_of_one_port_names_those_that_are_there(
    monkeypatch: pytest.MonkeyPatch, place: str, text: str
) -> None:
    on_usb(monkeypatch, ("/dev/ttyUSB0", 0x10C4, 0xEA60, "1"), ("/dev/ttyUSB1", 0x10C4, 0xEA60, "2"))
    with pytest.raises(PortGone) as error:
        find_port(place)
    assert str(error.value).startswith(text)


def test_what_cannot_be_opened_says_why(tmp_path: Path) -> None:
    with pytest.raises(PortGone, match="No such file or directory"):
        SerialPort(str(tmp_path / "none"), 9600)
    (tmp_path / "file").write_text("")
    with pytest.raises(PortGone):
        SerialPort(str(tmp_path / "file"), 9600)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (
            PermissionError(13, "Permission denied"),
            "Permission denied; sudo usermod -aG {group} $USER, and log in again",
        ),
        (OSError(errno.EBUSY, "Device or resource busy"), "another program has it open"),
        (BlockingIOError(errno.EAGAIN, "x"), "another program has it open"),
        (termios.error(errno.EIO, "x"), "Input/output error"),
        (ValueError("Not a valid baudrate: 7"), "Not a valid baudrate: 7"),
    ],
)
def test_why_it_is_not_there_and_what_to_do(error: Exception, text: str, tmp_path: Path) -> None:
    assert serial_port._reason(error, str(tmp_path)) == text.format(group=tmp_path.group())
    if isinstance(error, PermissionError):
        assert "give this user the right" in serial_port._reason(error, str(tmp_path / "none"))


@pytest.mark.parametrize("function", ["tcgetattr", "tcsetattr", "tcflush"])
def test_a_port_that_leaves_while_it_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, function: str) -> None:
    board = PseudoTerminal(tmp_path / "port")
    with monkeypatch.context() as patch:
        patch.setattr(termios, function, fails)
        with pytest.raises(PortGone, match="Input/output error"):
            SerialPort(str(tmp_path / "port"), 9600)
    SerialPort(str(tmp_path / "port"), 9600).close()  # it was given back
    board.unplug()


def fails(*_: object) -> None:
    raise termios.error(errno.EIO, "Input/output error")


def test_closing_it_leaves_the_line_as_it_is(tmp_path: Path) -> None:
    board = PseudoTerminal(tmp_path / "port")
    port = SerialPort(str(tmp_path / "port"), 9600)
    assert not termios.tcgetattr(port.fd)[2] & termios.HUPCL, "a board would begin anew when it is opened again"
    port.close()
    board.unplug()


def test_nothing_is_said_behind_what_has_not_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    board = PseudoTerminal(tmp_path / "port")
    port = SerialPort(str(tmp_path / "port"), 9600)
    thrown_away: list[int] = []
    monkeypatch.setattr(port, "unsent", lambda: 32)
    monkeypatch.setattr(termios, "tcflush", lambda _, what: thrown_away.append(what))
    port.write(b"m 1 1\r", backlog=32)
    assert (board.read(), thrown_away) == (b"m 1 1\r", [])
    monkeypatch.setattr(port, "unsent", lambda: 33)
    with pytest.raises(PortGone, match="it takes too little, 33 bytes have not left"):
        port.write(b"m 2 2\r", backlog=32)
    assert (board.read(), thrown_away) == (b"", [termios.TCOFLUSH])
    port.close()
    board.unplug()


def test_bytes_go_both_ways_and_an_unplug_is_told(tmp_path: Path) -> None:
    board = PseudoTerminal(tmp_path / "port")
    port = SerialPort(str(tmp_path / "port"), 115_200)
    every = bytes(range(256))
    assert port.read() == b""
    board.write(every)
    assert port.read() == every, "no byte means anything to a terminal"
    port.write(every)
    assert board.read() == every
    assert port.read() == b"", "nothing is echoed"
    with pytest.raises(PortGone, match="another program has it open"):
        SerialPort(str(tmp_path / "port"), 115_200)
    with pytest.raises(PortGone, match="takes nothing any more"):
        port.write(bytes(1_000_000))
    board.unplug()
    with pytest.raises(PortGone):
        port.read()
    port.close()
    port.close()
    with pytest.raises(PortGone):
        port.read()


def test_a_feed_says_what_comes_in_each_life_of_a_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo_services.serial_feed.RETRY", 0.01)
    said: list[str] = []
    feed = SerialFeed(str(tmp_path / "port"), 9600, said.append, lambda _path: said.append("opened"))
    chunks = feed.chunks(lambda: False)
    assert [next(chunks), next(chunks)] == [b"", b""]
    board = PseudoTerminal(tmp_path / "port")
    monkeypatch.setattr("robo_services.serial_feed.SILENCE", 0.01)
    assert next(chunks) == b""
    board.write(b"one")
    assert next(chunks) == b"one"
    board.unplug()
    assert next(chunks) == b""
    board = PseudoTerminal(tmp_path / "port")
    while feed.missed:
        assert next(chunks) == b""
    board.write(b"two")
    assert next(chunks) == b"two"
    chunks.close()
    feed.close()
    board.unplug()
    kinds = ["gone" if "the port is gone" in one else "none" if "no port" in one else one for one in said]
    assert [kind for kind in kinds if kind != "none"] == ["opened", "gone", "opened"]


def test_pyserial_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(RunError, match=r"needs pyserial, which is not installed: pip install 'robo-zenoh\[serial\]'"):
        SerialPort("/dev/null", 9600)


def test_bytes_are_shown_as_they_are() -> None:
    assert shown(b"\x54\x2c") == "54 2c"
    assert shown(bytes(20)) == "00 " * 16 + "… (20 bytes)"


def test_a_link_that_was_left_is_replaced_and_that_of_another_not_taken_away(tmp_path: Path) -> None:
    (tmp_path / "port").symlink_to("/dev/pts/99999")
    first = PseudoTerminal(tmp_path / "port")
    assert os.readlink(tmp_path / "port") == first.path
    second = PseudoTerminal(tmp_path / "port")
    first.unplug()
    assert os.readlink(tmp_path / "port") == second.path
    second.unplug()
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_link_to_a_pseudo_terminal_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("x")
    (tmp_path / "link").symlink_to(tmp_path / "precious")
    (tmp_path / "broken").symlink_to(tmp_path / "none")
    for name in ("precious", "link", "broken"):
        with pytest.raises(FileExistsError, match="something else is there"):
            PseudoTerminal(tmp_path / name)
    assert len(list(tmp_path.iterdir())) == 3
