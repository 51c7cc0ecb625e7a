"""How a recording is written, and what its topics are."""

from typing import Literal

import msgspec

from robo.bag.mcap.compression import COMPRESSIONS, Compression
from robo.bag.mcap.file_writer import CHUNK_SIZE
from robo.errors import BagError
from robo.wire.qos import QoS

CDR = "cdr"
"""The encoding of messages that all tools of the field read."""
ROS_TEXT = "ros2msg"
"""That of their definitions."""

_MOST_CHUNK = 2**26
"""Before it is compressed, bytes: 67 MB."""


_ABOVE_0 = ("chunk_size", "flush_period", "split_size", "split_duration", "keep", "keep_duration", "most_size")


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """How a recording is written."""

    compression: Compression = "zstd"
    chunk_size: int = CHUNK_SIZE
    """Of a chunk before it is compressed, bytes."""
    flush_period: float = 0.8
    """What has come is in the file after this time, s: with the time that writing takes, a second is lost at most."""
    sync: bool = True
    """Whether it is on the disk then, too: what a power cut leaves."""
    split_size: int | None = None
    """A new file begins where one has this size beyond what all files begin with, bytes; the chunk that reaches it is
    still in."""
    split_duration: float | None = None
    """A new file begins where one has messages of this time, s."""
    split_by_hand: bool = False
    """There are several files in a folder, though one only ends when `split` is called."""
    keep: int | None = None
    """Files that are kept, the newest; None for all."""
    keep_duration: float | None = None
    """A file goes whose last message came longer ago than this when another one begins, s; None for never."""
    most_size: int | None = None
    """What all files may take together, bytes: the oldest go before, so that the next one has room for `split_size`.
    What files begin with is apart: twice as much is granted to it."""
    least_free: int = 0
    """Room that is left to others on the disk, bytes."""
    when_full: Literal["stop", "drop_oldest"] = "stop"
    """What is done where there is less: the recording ends, or its oldest file is deleted."""

    def __post_init__(self) -> None:
        if self.compression not in COMPRESSIONS:
            raise BagError(f"compression {self.compression!r} is not known; use {' or '.join(COMPRESSIONS)}")
        for name in _ABOVE_0:
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise BagError(f"{name} {value}: use a number above 0")
        if self.chunk_size > _MOST_CHUNK:
            raise BagError(f"chunk_size {self.chunk_size:,}: use {_MOST_CHUNK:,} at most")
        if self.least_free < 0:
            raise BagError(f"least_free {self.least_free}: use a number of bytes, or 0 for no limit")
        deletes = [name for name in ("keep", "keep_duration", "most_size") if getattr(self, name) is not None]
        if self.when_full == "drop_oldest":
            deletes.append("when_full drop_oldest")
        if not self.splits and deletes:
            which = deletes[0]
            raise BagError(f"{which} deletes the oldest of several files: say what splits them, such as split_size")

    @property
    def splits(self) -> bool:
        """Whether there are to be several files, in a folder."""
        return self.split_by_hand or self.split_size is not None or self.split_duration is not None


class TopicInFile(msgspec.Struct, frozen=True):
    """A topic as it is written down."""

    name: str
    """Robo's."""
    schema: str
    """Its type in ROS: `geometry_msgs/msg/Twist`."""
    text: str
    """That type's definition, whole."""
    type_hash: str = ""
    """RIHS01; empty where it is not known."""
    qos: QoS = QoS.DEFAULT
    """What its publishers offer."""
    encoding: str = CDR
    schema_encoding: str = ROS_TEXT
