"""A terminal whose keys come one by one, with a screen or a line that is drawn anew; always given back as it was."""

import os
import select
import signal
import sys
import termios
import threading
from contextlib import suppress
from types import FrameType
from typing import Any, NamedTuple

from robo.errors import RunError

_ENTER = "\x1b[?1049h\x1b[?25l\x1b[?7l"
"""The second screen, no cursor, no wrapping of long lines."""
_LEAVE = "\x1b[?7h\x1b[?25h\x1b[?1049l"

_SIGNALS = (signal.SIGTSTP, signal.SIGCONT, signal.SIGHUP)
_WOKEN = b"\0"

LONGEST_STOP = 1.0
"""How long it waits to be continued once it has stopped itself, s of the time in which it runs."""

_IFLAG, _LFLAG, _CC = 0, 3, 6
"""Of what `tcgetattr` returns."""


class NoTerminal(RunError):
    """There is no terminal to read keys from and to draw on."""


class Heard(NamedTuple):
    """What came while it waited."""

    data: bytes = b""
    """From the keyboard."""
    suspend: bool = False
    """Whether somebody wants it to stop: Ctrl-Z."""
    continued: bool = False
    """Whether it was stopped and goes on; the mode of the terminal is set again."""
    closed: bool = False
    """Whether the terminal has gone."""


class KeyboardTerminal:
    """Reads keys and draws. One thread does both; any thread, and signal handlers, may wake it.

    Ctrl-C and Ctrl-Z stay signals. All other keys come as bytes, also Ctrl-S, which would hold up the screen, and Ctrl
    with backslash, which would end the process without a word. It opens the terminal for itself, so that a terminal
    that takes nothing holds up nobody, and other programs keep it as it is.
    """

    def __init__(self, path: str = "", *, screen: bool = True) -> None:
        """Open it; it stays as it is until `enter`.

        Args:
            path: of its device; by default the one that this process was started in.
            screen: whether it has all of the screen; else it draws among lines of others, and in the background of a
                shell neither draws nor reads.

        Raises:
            NoTerminal: there is none.
        """
        try:
            self._fd = os.open(path or _own_path(), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise NoTerminal(f"{path or 'its own'} cannot be opened: {error.strerror}") from None
        try:
            self._before = termios.tcgetattr(self._fd)
        except termios.error:
            os.close(self._fd)
            raise NoTerminal(f"{path} is none") from None
        self._wake_reader, self._wake_writer = os.pipe()
        for end in (self._wake_reader, self._wake_writer):
            os.set_blocking(end, False)
        self._handlers: dict[int, Any] = {}
        self._former_wakeup = -1
        self._screen = screen
        self._entered = False
        self._closed = threading.Lock()

    @property
    def size(self) -> os.terminal_size:
        """Columns and lines; what a terminal that says none usually has."""
        with suppress(OSError):
            size = os.get_terminal_size(self._fd)
            if size.columns > 0 and size.lines > 0:
                return size
        return os.terminal_size((80, 24))

    @property
    def is_ours(self) -> bool:
        """Whether it may be drawn on and read from; not by what a shell runs in the background."""
        if self._screen:
            return True
        try:
            return os.tcgetpgrp(self._fd) == os.getpgrp()
        except OSError:  # it is not this process's own, but was named; or it has gone, which reading tells
            return True

    def enter(self) -> None:
        """Take the terminal: keys come at once, nothing is echoed, the second screen shows if there is to be one."""
        if not self.is_ours:
            return
        self._entered = True
        self._set_mode()
        if self._screen:
            self.write(_ENTER)

    def leave(self) -> None:
        """Give it back as it was; keys that nobody has read are dropped, so that no shell takes them as words."""
        if not self._entered:
            return
        self._entered = False
        select.select([], [self._fd], [], 0.2)  # where it has taken nothing for a while
        if self._screen:
            self.write(_LEAVE)
        elif not self.is_ours:
            return  # it is the shell's, which has set it as it wants it
        with suppress(termios.error, OSError):  # it has gone
            termios.tcflush(self._fd, termios.TCIFLUSH)
            termios.tcsetattr(self._fd, termios.TCSANOW, self._before)

    def close(self) -> None:
        """Give it back, and close it. Safe to call twice, by any thread."""
        if not self._closed.acquire(blocking=False):
            return
        self.leave()
        self._give_handlers_back()
        fds = self._fd, self._wake_reader, self._wake_writer
        self._wake_writer = -1  # whoever wakes it from now on writes to nobody
        for fd in fds:
            os.close(fd)

    def watch_signals(self) -> None:
        """From now on hear of Ctrl-Z, of being continued and of a terminal that is closed; in the main thread only."""
        if threading.current_thread() is not threading.main_thread():
            return
        for number in _SIGNALS:
            if signal.getsignal(number) is not signal.SIG_IGN:  # nohup wants it so
                self._handlers[number] = signal.signal(number, _ignore)
        # Whichever thread the system interrupts writes it there at once; a handler of Python's own waits until the main
        # thread comes back from where it waits.
        self._former_wakeup = signal.set_wakeup_fd(self._wake_writer, warn_on_full_buffer=False)

    def wake(self) -> None:
        """Let `wait` return."""
        with suppress(OSError):  # full: it is about to return; or closed
            os.write(self._wake_writer, _WOKEN)

    def wait(self, timeout: float) -> Heard:
        """Wait until a key is pressed or something else happens, for at most so long, s."""
        ends = [self._fd, self._wake_reader] if self.is_ours else [self._wake_reader]
        ready = select.select(ends, [], [], max(0.0, timeout))[0]
        told = self._drain() if self._wake_reader in ready else b""
        if signal.SIGCONT in told:
            self._resume()
        data = self._read() if self._fd in ready else b""
        closed = data is None or signal.SIGHUP in told
        return Heard(data or b"", signal.SIGTSTP in told, signal.SIGCONT in told, closed)

    def suspend(self) -> None:
        """Give the terminal back, stop this process as Ctrl-Z does, and take the terminal again once it goes on.

        Where no shell is there to let it go on, it does nothing, as the system does by itself.
        """
        if not _may_be_continued():
            return
        self.leave()
        self._drain()
        os.kill(os.getpid(), signal.SIGSTOP)
        # Another thread may take the signal, a moment later. What tells that it goes on comes after it.
        select.select([self._wake_reader], [], [], LONGEST_STOP)
        self._drain()
        self._resume()

    def flush(self) -> None:
        """Drop what was typed and not read."""
        with suppress(termios.error, OSError):
            termios.tcflush(self._fd, termios.TCIFLUSH)

    def write(self, text: str) -> None:
        """Show it. What a terminal that is held up does not take is lost: the next picture is a whole one again."""
        with suppress(OSError):
            os.write(self._fd, text.encode("utf-8", errors="replace"))

    def _resume(self) -> None:
        """Set the mode and the screen again, which a shell may have changed meanwhile, and drop what is old."""
        self.flush()
        self.enter()

    def _set_mode(self) -> None:
        with suppress(termios.error, OSError):  # it has gone, which reading tells; or this process is in the background
            self._set_mode_or_raise()

    def _set_mode_or_raise(self) -> None:
        mode = termios.tcgetattr(self._fd)
        mode[_IFLAG] &= ~termios.IXON
        mode[_LFLAG] &= ~(termios.ICANON | termios.ECHO | termios.IEXTEN)
        mode[_LFLAG] |= termios.ISIG
        mode[_CC][termios.VMIN], mode[_CC][termios.VTIME] = 1, 0
        mode[_CC][termios.VQUIT] = os.fpathconf(self._fd, "PC_VDISABLE").to_bytes(1, "little")
        termios.tcsetattr(self._fd, termios.TCSANOW, mode)

    def _read(self) -> bytes | None:
        """What was typed; None where the terminal has gone."""
        try:
            return os.read(self._fd, 4096) or None
        except BlockingIOError:
            return b""
        except OSError:  # EIO: the other end is closed
            return None

    def _drain(self) -> bytes:
        with suppress(BlockingIOError):
            return os.read(self._wake_reader, 4096)
        return b""

    def _give_handlers_back(self) -> None:
        if threading.current_thread() is threading.main_thread():
            if self._handlers:
                signal.set_wakeup_fd(self._former_wakeup)
            for number, handler in self._handlers.items():
                signal.signal(number, handler)
            self._handlers.clear()


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """A handler, so that the signal does not do what it does by itself."""


def _may_be_continued() -> bool:
    """Whether a shell with job control has started this process: it gives each job a process group of its own."""
    return os.getpgid(0) != os.getsid(0)


def _own_path() -> str:
    """The terminal that this process was started in.

    Raises:
        NoTerminal: its input or its output is none.
    """
    for name, stream in (("input", sys.__stdin__), ("output", sys.__stdout__)):
        if stream is None or not stream.isatty():
            raise NoTerminal(f"its {name} is none")
    try:
        return os.ttyname(0)
    except OSError:  # a container that was given a terminal of outside
        return "/dev/tty"
