"""Recordings in MCAP's files, as ROS 2 has them, so that the whole field reads them.

from robo import bag

with bag.open("drive.mcap") as recording:
    for message in recording.messages("r1/odom"):
        print(message.published, message.value.pose.pose.position.x)
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robo.bag.edit.editing import Edited, cut, keep, merge
    from robo.bag.edit.recovery import Recovered, recover
    from robo.bag.look.comparison import Diff, Difference, TopicDifference
    from robo.bag.look.inspection import Finding, Kind, Report
    from robo.bag.look.summary import Info, TopicInfo
    from robo.bag.mcap.compression import Compression
    from robo.bag.opening import check, diff, info
    from robo.bag.opening import open_bag as open  # noqa: A004 - as gzip.open and its like
    from robo.bag.options import Options, TopicInFile
    from robo.bag.read.reader import Bag
    from robo.bag.read.topics import BagMessage, Topic
    from robo.bag.types import topic_of
    from robo.bag.write.counts import Counts
    from robo.bag.write.writer import Recording
    from robo.errors import BagError, DamagedBag, DiskFull

__all__ = [
    "Bag",
    "BagError",
    "BagMessage",
    "Compression",
    "Counts",
    "DamagedBag",
    "Diff",
    "Difference",
    "DiskFull",
    "Edited",
    "Finding",
    "Info",
    "Kind",
    "Options",
    "Recording",
    "Recovered",
    "Report",
    "Topic",
    "TopicDifference",
    "TopicInFile",
    "TopicInfo",
    "check",
    "cut",
    "diff",
    "info",
    "keep",
    "merge",
    "open",
    "recover",
    "topic_of",
]

_HOMES = {
    "bag.look.comparison": ("Diff", "Difference", "TopicDifference"),
    "bag.mcap.compression": ("Compression",),
    "bag.write.counts": ("Counts",),
    "bag.edit.editing": ("Edited", "cut", "keep", "merge"),
    "bag.look.inspection": ("Finding", "Kind", "Report"),
    "bag.opening": ("check", "diff", "info"),
    "bag.options": ("Options", "TopicInFile"),
    "bag.read.reader": ("Bag",),
    "bag.edit.recovery": ("Recovered", "recover"),
    "bag.look.summary": ("Info", "TopicInfo"),
    "bag.read.topics": ("BagMessage", "Topic"),
    "bag.types": ("topic_of",),
    "bag.write.writer": ("Recording",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import what is asked for: who writes recordings needs nothing that reads them."""
    if name not in __all__:
        raise AttributeError(f"module 'robo.bag' has no attribute {name!r}")
    module = importlib.import_module(f"robo.{_HOME.get(name, 'bag.opening' if name == 'open' else 'errors')}")
    value: object = getattr(module, "open_bag" if name == "open" else name)
    globals()[name] = value
    return value
