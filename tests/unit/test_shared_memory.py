"""Whether large messages may go through shared memory, and what happens where there is none."""

import logging
import os
import resource
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
import zenoh
import zenoh.shm

from robo.wire import shared_buffers, shared_memory
from robo.wire.network import Network, settings_of
from robo.wire.shared_buffers import FIRST, SharedMemory, fill, is_torn
from robo.wire.shared_memory import hindrance

ENABLED = "transport/shared_memory/enabled"
MEGABYTE = 2**20


class Room(NamedTuple):
    """What `statvfs` says, as far as it is asked."""

    f_bavail: int
    f_frsize: int = MEGABYTE
    f_blocks: int = 1000


@pytest.fixture(autouse=True)
def _on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBO_SHM", raising=False)
    free(monkeypatch, 1000)
    monkeypatch.setattr(shared_memory, "_lockable", lambda: 2**62)


def free(monkeypatch: pytest.MonkeyPatch, megabytes: int) -> None:
    monkeypatch.setattr(os, "statvfs", lambda _: Room(megabytes))


def refuse(*_: object) -> bool:
    return False


def full(monkeypatch: pytest.MonkeyPatch) -> None:
    free(monkeypatch, 0)


def read_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", refuse)


def of_a_plain_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_memory, "_lockable", lambda: 8 * MEGABYTE)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (full, "/dev/shm has 0 MB free"),
        (read_only, "/dev/shm cannot be written"),
        (of_a_plain_user, "this user may lock 8 MB of memory (ulimit -l), not 256"),
    ],
)
@pytest.mark.skipif(not os.path.isdir("/dev/shm"), reason="this system has no /dev/shm")
def test_where_there_is_none_a_session_does_without(
    make: Callable[[pytest.MonkeyPatch], None],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert ENABLED not in settings_of(Network())
    assert hindrance() == ""
    make(monkeypatch)
    assert hindrance() == said
    assert settings_of(Network())[ENABLED] is False
    memory = SharedMemory(hindrance())
    with caplog.at_level(logging.WARNING):
        assert [memory.buffer(100_000, wait=False) for _ in range(5)] == [None] * 5
    assert caplog.messages == [f"large messages go through sockets, which is slower: {said}"], "told once"


def test_zenohs_own_way_is_off() -> None:
    assert settings_of(Network())["transport/shared_memory/transport_optimization/enabled"] is False


def test_what_this_user_may_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.setattr(resource, "getrlimit", lambda _: (5, 5))
    assert shared_memory._lockable() in (5, 2**62), "the limit, unless this user is above it"
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert shared_memory._lockable() == 2**62


class Memory:
    """In the place of a `ShmProvider`: so many bytes, given back by hand."""

    made: list["Memory"] = []  # noqa: RUF012
    panics = False

    def __init__(self, size: int) -> None:
        self.size, self.used = size, 0
        self.dead = 0
        self.made.append(self)

    @classmethod
    def default_backend(cls, size: int) -> "Memory":
        if cls.panics:
            raise BaseException("Unable to create POSIX shm segment")
        return cls(size)

    def alloc(self, size: int) -> object:
        if size == 1:
            return b""
        if self.used + size > self.size:
            raise zenoh.ZError("out of memory")
        self.used += size
        return (self, size)

    def garbage_collect(self) -> int:
        return 0

    def garbage_collect_unsafe(self) -> int:
        self.used -= self.dead
        self.dead = 0
        return 0


@pytest.fixture
def memories(monkeypatch: pytest.MonkeyPatch) -> list[Memory]:
    monkeypatch.setattr(zenoh.shm, "ShmProvider", Memory)
    monkeypatch.setattr(shared_buffers, "LONGEST_WAIT", 0.01)
    monkeypatch.setattr(Memory, "made", [])
    monkeypatch.setattr(Memory, "panics", False)
    return Memory.made


def test_memory_is_taken_when_it_is_needed_and_twice_as_much_each_time(memories: list[Memory]) -> None:
    memory = SharedMemory(most=4 * FIRST)
    assert memories == []
    while memory.buffer(MEGABYTE, wait=False) is not None:
        pass
    assert [one.size for one in memories] == [FIRST, FIRST, 2 * FIRST]
    assert memory.carried == 64
    assert memory.problem == "all of it is in use: readers are too slow for it"
    memories[1].used -= MEGABYTE
    assert memory.buffer(MEGABYTE, wait=False) is not None
    assert memory.problem == ""


def test_eight_messages_fit_whatever_their_size(memories: list[Memory]) -> None:
    assert SharedMemory().buffer(6_000_000, wait=True) is not None
    assert memories[0].size == 46 * MEGABYTE
    assert SharedMemory().buffer(129 * MEGABYTE, wait=False) is None


def test_who_waits_for_readers_takes_no_more_and_gives_up_in_time(memories: list[Memory]) -> None:
    memory = SharedMemory()
    taken = [memory.buffer(MEGABYTE, wait=True) for _ in range(20)]
    assert len(memories) == 1
    assert taken.count(None) == 4


def test_what_a_dead_reader_holds_is_taken_again(memories: list[Memory]) -> None:
    memory = SharedMemory(most=FIRST)
    while memory.buffer(MEGABYTE, wait=False) is not None:
        pass
    memories[0].dead = MEGABYTE
    assert memory.buffer(MEGABYTE, wait=False) is not None


def test_more_than_is_free_is_not_asked_for(memories: list[Memory], monkeypatch: pytest.MonkeyPatch) -> None:
    memory = SharedMemory()
    free(monkeypatch, 19)
    assert memory.buffer(MEGABYTE, wait=True) is None
    assert memories == []
    assert memory.problem == "/dev/shm has 19 MB free"
    free(monkeypatch, 20)
    assert memory.buffer(MEGABYTE, wait=True) is not None


def test_a_panic_is_a_fallback_and_not_tried_again(
    memories: list[Memory], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Memory, "panics", True)
    memory = SharedMemory()
    assert memory.buffer(MEGABYTE, wait=True) is None
    monkeypatch.setattr(Memory, "panics", False)
    assert memory.buffer(MEGABYTE, wait=True) is None
    assert memories == []
    assert len(caplog.messages) == 1


@pytest.mark.parametrize("size", [0, 1, 2**17 - 1, 2**17, 2**18 + 5])
@pytest.mark.parametrize("kind", ["bytes", "bytearray", "part", "array"])
def test_a_message_is_written_whole(size: int, kind: str) -> None:
    import array

    data = bytes(i % 251 for i in range(size))
    views: dict[str, Any] = {
        "bytes": memoryview(data),
        "bytearray": memoryview(bytearray(data)),
        "part": memoryview(b"_" + data)[1:],
        "array": memoryview(array.array("B", data)),
    }
    buffer = bytearray(4 + size)
    fill(buffer, b"head", views[kind])
    assert buffer == b"head" + data


def test_a_payload_of_its_own_memory_is_not_torn() -> None:
    assert not is_torn(zenoh.ZBytes(b"abc"))
