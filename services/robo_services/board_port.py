"""Where the board of a base is: at the port that was named, with the USB id that was, or at the only one there is."""

import importlib
from collections.abc import Sequence
from typing import Any

from robo_services.serial_port import PortGone, import_serial


def place_of_board(port: str, usb_id: str) -> str:
    """What to open, as `SerialPort` takes it.

    Args:
        port: a path, such as /dev/ttyUSB0; "" for the USB id.
        usb_id: maker and product, such as 2341:0043; "" for the only port on USB.

    Raises:
        PortGone: nothing was named, and there is no port on USB, or there are several; says which.
        RunError: pyserial is not installed.
    """
    if port or usb_id:
        return port or usb_id
    import_serial()
    return only_one(importlib.import_module("serial.tools.list_ports").comports())


def only_one(there: Sequence[Any]) -> str:
    """The path of the only port on USB, of those that pyserial lists.

    Raises:
        PortGone: it is not the only one.
    """
    on_usb = sorted((one for one in there if one.vid is not None), key=lambda one: str(one.device))
    if len(on_usb) == 1:
        return str(on_usb[0].device)
    if not on_usb:
        raise PortGone("there is no serial port on USB")
    named = ", ".join(f"{one.device} ({one.vid:04x}:{one.pid:04x})" for one in on_usb)
    raise PortGone(f"several ports may be the board's, say port or usb_id: {named}")
