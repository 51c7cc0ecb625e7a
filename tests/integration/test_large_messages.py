"""Large messages between sessions of one machine: as they were, whole, and readable by anybody."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
import zenoh

import robo_messages
from robo import KEEP_ALL, Node
from robo.wire import shared_memory
from robo.wire.network import Network, zenoh_config
from robo.wire.session import close_session, open_session
from robo_messages import CompressedImage, Image, Message, OccupancyGrid, PointCloud2, UInt8MultiArray, message
from tests.plain import hear, samples
from tests.support import PATIENCE, eventually

SIZE = 300_000
MEGABYTE = 1_000_000

pytestmark = pytest.mark.skipif(shared_memory.hindrance() != "", reason="no shared memory here")


@message("test_large/Pair")
class Pair(Message):
    left: Image = msgspec.field(default_factory=Image)
    right: Image = msgspec.field(default_factory=Image)


@message("test_large/Short")
class Short(Message, omit_defaults=True):
    name: str = ""
    data: bytes = b""


class Bare(Node):
    pass


class Link:
    """Two linked sessions, and a node on each."""

    def __init__(self, stack: contextlib.ExitStack, endpoint: str) -> None:
        self.sessions = [
            open_session(Network(mode="peer", listen=(endpoint,))),
            open_session(Network(mode="peer", connect=(endpoint,))),
        ]
        for session in self.sessions:
            stack.callback(close_session, session)
        self.sender, self.receiver = (
            stack.enter_context(Bare(name=name, session=session))
            for name, session in zip(("sender", "receiver"), self.sessions, strict=True)
        )

    def carried(self) -> int:
        memory = shared_memory.of_session(self.sessions[0])
        assert memory is not None
        return memory.carried


@pytest.fixture
def link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Link]:
    monkeypatch.delenv("ROBO_SHM", raising=False)
    with contextlib.ExitStack() as stack:
        yield Link(stack, f"unixsock-stream/{tmp_path}/link.sock")


def pixels(value: int = 0) -> memoryview:
    return memoryview(bytes([value]) * SIZE)


LARGE: list[Message] = [
    Image.from_array(np.arange(SIZE, dtype=np.uint8).reshape(500, 200, 3), "rgb8"),
    Image(data=pixels(7)[100:]),
    CompressedImage(format="jpeg", data=memoryview(bytearray(range(256)) * 1000)),
    PointCloud2.from_array(np.arange(SIZE, dtype=np.float32).reshape(-1, 3)),
    OccupancyGrid.from_array(np.full((500, 600), -1, np.int8), 0.05),
    UInt8MultiArray(data=pixels(3)),
    Pair(Image(data=pixels(1)), Image(data=pixels(2))),
    Short("a", bytes(pixels())),
    Short(data=bytes(pixels())),
]


@pytest.mark.parametrize("sent", LARGE, ids=lambda sent: type(sent).__name__)
def test_a_large_message_arrives_as_it_was_and_any_client_reads_it(sent: Message, link: Link) -> None:
    got: list[Message] = []
    link.receiver.create_subscription(type(sent), "large", got.append)
    heard = hear(link.sessions[1], "large")
    publisher = link.sender.create_publisher(type(sent), "large")
    eventually(lambda: publisher.has_subscribers, "a reader")
    before = link.carried()
    publisher.publish(sent)
    eventually(lambda: len(got) == 1, "the message")
    assert robo_messages.encode(got[0]) == robo_messages.encode(sent)
    assert link.carried() == before + 1
    (sample,) = samples(heard)
    assert str(sample.encoding) == f"application/msgpack;{robo_messages.type_name(type(sent))}"
    plain = msgpack.unpackb(sample.payload.to_bytes())
    assert plain == msgpack.unpackb(robo_messages.encode(sent))


def test_small_ones_and_latched_ones_take_the_socket(link: Link) -> None:
    got: list[Image] = []
    for topic, latched in (("plain", False), ("latched", True)):
        link.receiver.create_subscription(Image, topic, got.append, latched=latched)
        publisher = link.sender.create_publisher(Image, topic, latched=latched)
        eventually(lambda: publisher.has_subscribers, topic)  # noqa: B023 - asked at once
        before = link.carried()
        publisher.publish(Image(data=pixels() if latched else pixels()[:1000]))
        eventually(lambda: len(got) == 1, "the message")
        assert link.carried() == before
        got.clear()


@pytest.mark.parametrize("wrong", [Image(height="x", data=pixels()), Image(data="x" * SIZE)])  # type: ignore[arg-type]
def test_a_wrong_field_of_a_large_message_is_told(wrong: Image, link: Link) -> None:
    publisher = link.sender.create_publisher(Image, "wrong")
    with pytest.raises(TypeError, match=r"^wrong: (height|data) of sensor/Image: expected "):
        publisher.publish(wrong)


def whole(image: Image) -> bool:
    """Whether all its bytes are one number."""
    data = np.frombuffer(image.data, np.uint8)
    return bool((data == data[0]).all())


@pytest.mark.parametrize("depth", [2, KEEP_ALL])
def test_a_slow_reader_gets_whole_messages(depth: int, link: Link) -> None:
    got: list[tuple[int, bool]] = []
    kept: list[Image] = []
    gate = threading.Semaphore(0)

    def on_image(image: Image) -> None:
        gate.acquire(timeout=PATIENCE)
        got.append((image.height, whole(image)))
        kept[:] = [*kept[-9:], image]

    link.receiver.create_subscription(Image, "slow", on_image, depth=depth)
    publisher = link.sender.create_publisher(Image, "slow", depth=depth)
    eventually(lambda: publisher.has_subscribers, "a reader")
    count = 60
    releasing = threading.Timer(0.2, gate.release, (count,))
    releasing.start()
    for number in range(count):
        publisher.publish(Image(height=number, data=memoryview(bytes([number]) * MEGABYTE)))
    eventually(lambda: bool(got) and got[-1][0] == count - 1, "the last message")
    releasing.join()
    assert all(one for _, one in got)
    assert all(whole(image) for image in kept), "a message that is kept stays as it is"
    numbers = [number for number, _ in got]
    assert numbers == sorted(numbers)
    if depth == KEEP_ALL:
        assert numbers == list(range(count))


READER = """
import sys, time
import numpy as np
from robo import Node
from robo.wire.network import Network
from robo.wire.session import open_session
from robo_messages import Image

class Reader(Node):
    pass

def on_image(image):
    data = np.frombuffer(image.data, np.uint8)
    print(image.height, int(data.min() == data.max()), flush=True)

session = open_session(Network(mode="peer", connect=(sys.argv[1],)))
with Reader(name="reader", session=session) as node:
    node.create_subscription(Image, "stopped", on_image, depth=10)
    node.wait()
"""


def test_a_reader_that_was_stopped_drops_what_it_lost_and_goes_on(link: Link, tmp_path: Path) -> None:
    endpoint = f"unixsock-stream/{tmp_path}/link.sock"
    publisher = link.sender.create_publisher(Image, "stopped", depth=10)
    command = [sys.executable, "-c", READER, endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as reader:
        assert reader.stdout is not None
        lines: list[str] = []
        listening = threading.Thread(target=lambda: lines.extend(reader.stdout or ()), daemon=True)
        listening.start()
        try:
            eventually(lambda: publisher.has_subscribers, "a reader")
            number = 0

            def flood(seconds: float) -> None:
                nonlocal number
                end = threading.Event()
                timer = threading.Timer(seconds, end.set)
                timer.start()
                while not end.is_set():
                    number += 1
                    publisher.publish(Image(height=number, data=memoryview(bytes([number % 256]) * MEGABYTE)))

            flood(0.2)
            reader.send_signal(signal.SIGSTOP)
            flood(1.0)
            reader.send_signal(signal.SIGCONT)
            stopped_at = number

            def goes_on() -> bool:
                flood(0.05)
                return bool(lines) and int(lines[-1].split()[0]) > stopped_at

            eventually(goes_on, "messages after the stop")
        finally:
            reader.kill()
        listening.join(PATIENCE)
    whole = [line for line in lines if line.endswith("\n")]  # the kill may have cut the last one short
    assert [line for line in whole if line.split()[1] != "1"] == []


def plain_session(endpoint: str) -> Any:
    return zenoh.open(zenoh_config(Network(mode="peer", connect=(endpoint,), shared_memory=False)))


def test_who_takes_no_part_in_shared_memory_gets_the_same_bytes(link: Link, tmp_path: Path) -> None:
    with plain_session(f"unixsock-stream/{tmp_path}/link.sock") as session:
        heard = hear(session, "large")
        publisher = link.sender.create_publisher(Image, "large")
        eventually(lambda: publisher.has_subscribers, "a reader")
        sent = LARGE[0]
        publisher.publish(sent)  # type: ignore[arg-type]
        (sample,) = samples(heard)
        assert msgpack.unpackb(sample.payload.to_bytes()) == msgpack.unpackb(robo_messages.encode(sent))


ALONE = """
import logging, os, sys
logging.basicConfig(format="%(message)s")
import robo
from robo.wire import shared_memory
from robo.wire.network import Network
from robo.wire.session import open_session
from robo_messages import Image
from tests.support import eventually

class Bare(robo.Node):
    pass

listening = open_session(Network(mode="peer", listen=(sys.argv[1],)))
dialling = open_session(Network(mode="peer", connect=(sys.argv[1],)))
if sys.argv[2] == "filled":
    with open("/dev/shm/filled", "wb") as file, __import__("contextlib").suppress(OSError):
        while True:
            file.write(bytes(2**16))
            file.flush()
got = []
with Bare(name="a", session=listening) as a, Bare(name="b", session=dialling) as b:
    b.create_subscription(Image, "image", lambda image: got.append(image.height), depth=0)
    publisher = a.create_publisher(Image, "image", depth=0)
    eventually(lambda: publisher.has_subscribers, "a reader")
    for number in range(10):
        publisher.publish(Image(height=number, data=memoryview(bytes(300_000))))
    eventually(lambda: len(got) == 10, "ten messages")
    print(got == list(range(10)), shared_memory.way_of(listening))
"""


@pytest.mark.parametrize(
    ("options", "then", "way"),
    [
        ("ro,size=1m", "", "sockets: /dev/shm cannot be written"),
        ("size=4k", "", "sockets: /dev/shm has 0 MB free"),
        ("size=18m", "", "sockets: /dev/shm has 18 MB free"),
        ("size=40m", "filled", "sockets: /dev/shm has 0 MB free"),
        ("size=40m", "", "shared memory"),
    ],
)
@pytest.mark.skipif(
    os.getuid() != 0 or shutil.which("unshare") is None or not os.path.isdir("/dev/shm"),
    reason="a /dev/shm of its own needs root and unshare",
)
def test_without_room_messages_take_the_socket_and_one_line_says_so(
    options: str, then: str, way: str, tmp_path: Path
) -> None:
    script = f'mount -t tmpfs -o {options} none /dev/shm && exec "$@"'
    command = ["unshare", "-m", "sh", "-c", script, "sh", sys.executable, "-c", ALONE]
    environment = {name: value for name, value in os.environ.items() if name != "ROBO_SHM"}
    run = subprocess.run(
        [*command, f"unixsock-stream/{tmp_path}/link.sock", then],
        capture_output=True,
        text=True,
        check=False,
        timeout=2 * PATIENCE,
        env=environment,
        cwd=Path(__file__).parents[2],
    )
    if "mount:" in run.stderr:
        pytest.skip("this machine lets nobody mount")
    assert run.stdout == f"True {way}\n", run.stderr
    told = [line for line in run.stderr.splitlines() if line]
    wanted = way.removeprefix("sockets: ")
    assert told == ([] if way == wanted else [f"large messages go through sockets, which is slower: {wanted}"])
