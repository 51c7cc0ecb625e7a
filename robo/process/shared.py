"""`python -m robo.process.shared NAME`: a process that several nodes share.

Its supervisor tells it over the socket of its heartbeats which nodes are to begin and to end there, and hears of their
ends. It ends with the first signal, or when its supervisor is gone, once its nodes have.
"""

import faulthandler
import math
import os
import select
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from robo.process import lean
from robo.text.readable import readable

if TYPE_CHECKING:
    from robo.process.lodging import Lodgings

LARGEST = 1_000_000
"""The largest order, bytes."""
_LOOK = 1.0
"""How often it is looked whether the supervisor is still there, s."""
_LAST = 2.0
"""How long nodes have to end when it is not, s."""


def main() -> None:
    """Run nodes until told to end."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until it is handled: no traceback of half a start
    faulthandler.enable()  # a supervisor that ends it because a node hangs asks it first where its threads are
    lean.import_msgspec()
    from msgspec.msgpack import encode

    from robo.environment import HEARTBEAT_VARIABLE, WATCH_VARIABLE
    from robo.node import log
    from robo.process import signals, threads
    from robo.process.endings import end_process
    from robo.process.lodging import Lodgings
    from robo.process.runner import SWITCH_INTERVAL
    from robo.process.spec import Ended
    from robo.wire.qos import from_word

    from_word("1")  # a Struct that several threads read: msgspec may not come to know it in two at once
    log.setup()
    sys.setswitchinterval(SWITCH_INTERVAL)
    threads.follow()
    control = socket.socket(fileno=int(os.environ.pop(HEARTBEAT_VARIABLE).partition(":")[0]))
    os.set_inheritable(control.fileno(), False)
    watched = os.environ.pop(WATCH_VARIABLE, None) is not None
    woken, waker = os.pipe()
    os.set_blocking(waker, False)

    def ended(number: int, code: int) -> None:
        control.send(encode(Ended(number, code, lodgings.closing)))

    def wake() -> None:
        with suppress(BlockingIOError):  # then it is awake
            os.write(waker, b".")

    lodgings = Lodgings(sys.argv[1], ended, wake)
    signals.on_end(lodgings.end_all)
    threading.excepthook = lodgings.thread_died
    parent, until = os.getppid(), math.inf
    while not (lodgings.closing and lodgings.empty) and time.monotonic() < until:
        ready, _, _ = select.select([control.fileno(), woken], [], [], _LOOK)
        if parent != (parent := os.getppid()) and _is_gone(control):
            until = time.monotonic() + _LAST
            lodgings.end_all(1)
        if woken in ready:
            os.read(woken, 4096)
        if control.fileno() in ready:
            _obey(control, lodgings, watched=watched)
    lodgings.session.close()
    end_process(0)  # threads of nodes and of Zenoh may be anywhere


def _is_gone(control: socket.socket) -> bool:
    """Whether the supervisor is: a parent that has changed may have been the template of which this was forked."""
    try:
        control.send(b"", socket.MSG_DONTWAIT)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return False


def _obey(control: socket.socket, lodgings: "Lodgings", *, watched: bool) -> None:
    """Do what the supervisor says next."""
    import msgspec

    from robo.process.lodging import Channels
    from robo.process.spec import NodeSpec, Order

    data, descriptors, _, _ = socket.recv_fds(control, LARGEST, 2)
    order = msgspec.msgpack.decode(data, type=readable(Order))
    if not order.spec:
        (lodgings.tell_where if order.where else lodgings.end)(order.number)
        return
    for descriptor in descriptors:
        os.set_inheritable(descriptor, False)  # not for what nodes start
    output, heart = descriptors
    spec = msgspec.json.decode(order.spec, type=readable(NodeSpec))
    lodgings.begin(order.number, spec, Channels(output, heart, order.level, order.period, watched))


if __name__ == "__main__":
    main()
