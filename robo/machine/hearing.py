"""What is heard of a process, or of a node within one: lines and heartbeats, each on a channel that it is given."""

import asyncio
import fcntl
import os
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import IO, Literal

from robo.machine.output import BUFFER, Budget, pump

_LAST_LINES = 30
"""Lines of the end of its stderr that are kept."""
_DRAIN = 0.3
"""How long the output may pause once it has ended before it is taken for complete, s."""
_LONGEST_BEAT = 1_000_000
"""How much of a heartbeat is read, bytes."""
_HEART_BUFFER = 200_000
"""How much a heartbeat's socket is to hold, bytes."""

Stream = Literal["stdout", "stderr"]


class Hearing:
    """The channels of one process or node: opened, listened to, and closed when all has been heard."""

    def __init__(
        self,
        on_line: Callable[[str, str], None],
        on_beat: Callable[[bytes], None] | None,
        streams: Sequence[Stream] = ("stdout", "stderr"),
    ) -> None:
        """
        Args:
            on_line: takes the name of the stream and a line.
            on_beat: takes heartbeats, and whatever else is said there; None where nothing is.
            streams: those on which it prints.
        """
        self.last_lines: deque[str] = deque(maxlen=_LAST_LINES)
        """The end of its stderr, for the summary of a failure."""
        self._on_line = on_line
        self._on_beat = on_beat
        self._streams = streams
        self._lines = 0
        self._pipes: list[IO[bytes]] = []
        self._heart: socket.socket | None = None
        self._pumps: list[asyncio.Task[None]] = []
        self._ours = ExitStack()
        """What is to be closed at the end."""

    def open(self, theirs: ExitStack) -> tuple[int, ...]:
        """Make the channels.

        Args:
            theirs: closes the other ends here, once the process or the node has them.

        Returns:
            The descriptors of the other ends: one for each stream, and one for heartbeats if these are heard.
        """
        self._pipes, self._pumps = [], []  # those of a process before are closed
        # Pipes of our own: asyncio's would not tell of the end of a process whose children keep them open.
        others = []
        for _ in self._streams:
            pipe, other = _pipe(self._ours, theirs)
            self._pipes.append(pipe)
            others.append(other)
        if self._on_beat is not None:
            others.append(self._make_heart(theirs))
        return tuple(others)

    async def begin(self) -> None:
        """Begin to listen."""
        budget = Budget(time.monotonic())
        for stream, pipe in zip(self._streams, self._pipes, strict=True):
            reader = await _reader(pipe, self._ours)
            self._pumps.append(asyncio.create_task(pump(reader, self._taker(stream), budget)))
        if self._heart is not None:
            asyncio.get_running_loop().add_reader(self._heart, self._read_beats)

    def say(self, data: bytes, descriptors: Sequence[int] = ()) -> None:
        """Say something on the socket of the heartbeats, and hand down descriptors.

        Raises:
            OSError: it is gone, or has not read for a while.
        """
        if self._heart is None:
            raise ConnectionError("it is gone")
        socket.send_fds(self._heart, [data], list(descriptors))

    async def finish(self) -> None:
        """Hear the rest of what it has to say, now that it has ended."""
        # A grandchild may hold the pipes open: what it has to say is not waited for.
        seen = -1
        while self._pumps and seen != self._lines:
            seen = self._lines
            _, unfinished = await asyncio.wait(self._pumps, timeout=_DRAIN)
            if not unfinished:
                break
        for task in self._pumps:
            task.cancel()
        if self._heart is not None:
            self._read_beats()
        self.close()

    def close(self) -> None:
        """Close what is ours."""
        self._ours.close()

    def _taker(self, stream: Stream) -> Callable[[str], None]:
        def take(text: str) -> None:
            self._lines += 1
            if stream == "stderr":
                self.last_lines.append(text)
            self._on_line(stream, text)

        return take

    def _make_heart(self, theirs: ExitStack) -> int:
        self._heart, heart = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._heart.setblocking(False)
        # macOS grants 2 kB by default, less than what a node with some topics says.
        for ours, other in ((socket.SO_RCVBUF, socket.SO_SNDBUF), (socket.SO_SNDBUF, socket.SO_RCVBUF)):
            self._heart.setsockopt(socket.SOL_SOCKET, ours, _HEART_BUFFER)
            heart.setsockopt(socket.SOL_SOCKET, other, _HEART_BUFFER)
        self._ours.callback(self._close_heart)
        theirs.enter_context(heart)
        return heart.fileno()

    def _read_beats(self) -> None:
        assert self._heart is not None
        assert self._on_beat is not None
        with suppress(BlockingIOError, ConnectionError):
            while self._heart is not None and (beat := self._heart.recv(_LONGEST_BEAT)):
                self._on_beat(beat)

    def _close_heart(self) -> None:
        if self._heart is not None:
            with suppress(ValueError):
                asyncio.get_running_loop().remove_reader(self._heart)
            self._heart.close()
            self._heart = None


def _pipe(ours: ExitStack, theirs: ExitStack) -> tuple[IO[bytes], int]:
    """A pipe: our end to read, and the descriptor of the other end."""
    reader, writer = os.pipe()
    theirs.callback(os.close, writer)
    if hasattr(fcntl, "F_SETPIPE_SZ"):
        with suppress(OSError):  # a user may have only so much of it
            fcntl.fcntl(reader, fcntl.F_SETPIPE_SZ, BUFFER)
    return ours.enter_context(os.fdopen(reader, "rb", buffering=0)), writer


async def _reader(pipe: IO[bytes], ours: ExitStack) -> asyncio.StreamReader:
    reader = asyncio.StreamReader(limit=BUFFER)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), pipe)
    ours.callback(transport.close)
    return reader
