"""Which port a board is at, where nobody says."""

import os
import tty
from types import SimpleNamespace
from typing import Any

import pytest

from robo_services.board_port import only_one, place_of_board
from robo_services.serial_port import PortGone, SerialPort
from robo_services.waiting import is_readable


def port(device: str, vid: int | None = 0x1A86) -> Any:
    return SimpleNamespace(device=device, vid=vid, pid=0x7523)


def test_what_was_named_is_taken() -> None:
    assert place_of_board("/dev/ttyUSB3", "1a86:7523") == "/dev/ttyUSB3"
    assert place_of_board("", "1a86:7523") == "1a86:7523"


def test_the_only_port_on_usb_is_taken() -> None:
    assert only_one([port("/dev/ttyS0", None), port("/dev/ttyUSB0")]) == "/dev/ttyUSB0"


def test_of_several_none_is_guessed() -> None:
    with pytest.raises(PortGone, match="there is no serial port on USB"):
        only_one([port("/dev/ttyS0", None)])
    with pytest.raises(PortGone, match=r"say port or usb_id: /dev/ttyACM0 \(1a86:7523\), /dev/ttyUSB0"):
        only_one([port("/dev/ttyUSB0"), port("/dev/ttyACM0")])


def test_a_port_is_read_until_it_is_unplugged() -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = SerialPort(place_of_board(os.ttyname(theirs), ""), 57_600)
    os.close(theirs)
    port.write(b"e\r")
    assert is_readable(ours, 5.0)
    assert os.read(ours, 10) == b"e\r"
    os.write(ours, b"1 2\r\n")
    assert is_readable(port.fd, 5.0)
    assert port.read() == b"1 2\r\n"
    os.close(ours)
    assert is_readable(port.fd, 5.0)
    with pytest.raises(PortGone):
        port.read()
    port.close()
