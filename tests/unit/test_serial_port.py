"""Which serial port is meant, and why one cannot be had."""

import os
import tty
from pathlib import Path

import pytest

from robo_services.serial_port import FoundPort, Port, PortGone, choose
from robo_services.waiting import is_readable

UNO = FoundPort("/dev/ttyACM0", "2341:0043:ABC1", "Arduino Uno")
NANO = FoundPort("/dev/ttyUSB0", "1a86:7523", "USB Serial")
OTHER = FoundPort("/dev/ttyUSB1", "1a86:7523", "USB Serial")


@pytest.mark.parametrize(
    ("there", "usb_id", "meant"),
    [
        ([NANO], "", NANO),
        ([UNO, NANO], "1A86:7523", NANO),
        ([UNO, NANO], "2341:0043", UNO),
        ([UNO, NANO], "2341:0043:ABC1", UNO),
    ],
)
def test_which_one_is_meant(there: list[FoundPort], usb_id: str, meant: FoundPort) -> None:
    assert choose(there, usb_id) == meant


@pytest.mark.parametrize(
    ("there", "usb_id", "why"),
    [
        ([], "", "there is no serial port on USB; there is none"),
        ([UNO, NANO], "", "several ports may be meant.*ttyACM0.*ttyUSB0"),
        ([UNO, NANO, OTHER], "1a86:7523", "several ports may be meant.*ttyUSB0.*ttyUSB1"),
        ([NANO], "2341:0043", "no serial port with the id 2341:0043; there is /dev/ttyUSB0"),
        ([UNO], "2341:0043:ABC", "no serial port with the id"),
    ],
)
def test_why_none_is(there: list[FoundPort], usb_id: str, why: str) -> None:
    with pytest.raises(PortGone, match=why):
        choose(there, usb_id)


def test_a_port_is_read_until_it_is_unplugged(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = Port(os.ttyname(theirs), 57_600)
    os.close(theirs)
    port.write(b"e\r")
    assert is_readable(ours, 5.0)
    assert os.read(ours, 10) == b"e\r"
    os.write(ours, b"1 2\r\n")
    assert is_readable(port.fd, 5.0)
    assert port.read() == b"1 2\r\n"
    with pytest.raises(PortGone, match="is open elsewhere"):
        Port(port.path, 57_600)
    os.close(ours)
    assert is_readable(port.fd, 5.0)
    with pytest.raises(PortGone, match="was unplugged"):
        port.read()
    with pytest.raises(PortGone, match="was unplugged"):
        port.write(b"e\r")
    port.close()
    with pytest.raises(PortGone, match="is not there"):
        Port(str(tmp_path / "ttyUSB9"), 57_600)
    (tmp_path / "file").touch()
    with pytest.raises(PortGone, match="is no serial port"):
        Port(str(tmp_path / "file"), 57_600)
