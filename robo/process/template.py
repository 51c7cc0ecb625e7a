"""`python -m robo.process.template FD …`: a process that has imported all that a node needs, and forks nodes.

Importing costs a node more than all the rest of its start. A supervisor starts one template, asks it for
nodes over a socket, and is told of their ends. The template has a single thread and does nothing else; it
ends with its supervisor. See `robo.machine.forks` for the other end.
"""

import fcntl
import gc
import importlib
import os
import select
import signal
import socket
import sys
from collections.abc import Callable
from contextlib import suppress

from robo.process import lean

PADDING = "-" * 400
"""The template's last argument: room for the command line that a node shows."""

LARGEST = 100_000
"""The largest request, bytes."""


def main() -> None:
    """Serve until the supervisor is gone; in a forked process, run the node."""
    # What is told to stop at once, this or what is forked, ends without a traceback of half an import.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.disable()  # there is nothing to collect while modules are imported
    lean.import_msgspec()
    importlib.import_module("robo.process.runner")  # for the nodes to be
    gc.freeze()  # what is here is never freed, and need not be copied by a collection
    gc.enable()
    node = serve(socket.socket(fileno=int(sys.argv[1])))
    if node is not None:
        node()


def serve(server: socket.socket) -> Callable[[], None] | None:
    """Fork what is asked for, and tell of ends.

    Returns:
        In a forked process, what it is to do; None in the template, once its supervisor is gone.
    """
    from msgspec.msgpack import encode

    woken, waker = os.pipe()
    for end in (woken, waker):
        os.set_blocking(end, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(waker)
    while True:
        ready, _, _ = select.select([server.fileno(), woken], [], [])
        if woken in ready:
            os.read(woken, 4096)
            while (ended := _ended()) is not None:
                server.send(encode(ended))
        if server.fileno() not in ready:
            continue
        data, descriptors, _, _ = socket.recv_fds(server, LARGEST, 3)
        if not data:
            return None
        pid = os.fork()
        if pid:
            with suppress(OSError):  # it has done so itself, and become another program or ended
                os.setpgid(pid, pid)
            for descriptor in descriptors:
                os.close(descriptor)
            server.send(encode((pid, None)))
            continue
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        server.close()
        os.close(woken)
        os.close(waker)
        _take_place(descriptors)
        return _prepared(data)


def _ended() -> tuple[int, int] | None:
    """A child that has ended, and its exit code, negative for a signal."""
    try:
        pid, status = os.waitpid(-1, os.WNOHANG)
    except ChildProcessError:
        return None
    return (pid, os.waitstatus_to_exitcode(status)) if pid else None


def _take_place(descriptors: list[int]) -> None:
    """Become a process group of its own, with the output and the heartbeat socket that were sent."""
    os.setpgid(0, 0)
    # Out of the way first: where one is to go, another may be.
    held = [fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 10) for descriptor in descriptors]
    for descriptor in descriptors:
        os.close(descriptor)
    for descriptor, place in zip(held, (1, 2, HEART), strict=False):
        os.dup2(descriptor, place)
        os.close(descriptor)


HEART = 3
"""Where a forked node finds its heartbeat socket."""


def _prepared(data: bytes) -> Callable[[], None]:
    from msgspec.msgpack import decode

    words, environment = decode(data, type=tuple[list[str], dict[str, str]])
    os.environ.clear()
    os.environ.update(environment)
    show_command_line(" ".join([sys.executable, "-m", *words]))
    module, *arguments = words
    sys.argv = [sys.argv[0], *arguments]
    run: Callable[[], None] = importlib.import_module(module).main
    return run


def show_command_line(text: str) -> None:
    """Let tools that list processes show another command line: this process is not what it was started as."""
    try:
        with open("/proc/self/stat", "rb") as stat:
            # After the name in parentheses, which may hold anything; see proc(5) for the fields.
            fields = stat.read().rpartition(b")")[2].split()
        begin, end = int(fields[45]), int(fields[46])
        room = end - begin
        with open("/proc/self/mem", "r+b", buffering=0) as memory:
            memory.seek(begin)
            # The kernel takes a last byte that is not zero for the sign of a changed command line.
            memory.write(text.encode()[: room - 2].ljust(room - 1, b"\0") + b" ")
    except (OSError, ValueError, IndexError):
        return  # then it shows the template's


if __name__ == "__main__":
    main()
