"""What is asked of recordings by their names, with the types that robo knows."""

from pathlib import Path

from robo.bag.look import comparison, inspection, summary
from robo.bag.look.comparison import Diff
from robo.bag.look.inspection import Report
from robo.bag.look.summary import Info
from robo.bag.progress import Tell, silent
from robo.bag.read.files import Files, files_of
from robo.bag.read.reader import Bag
from robo.bag.types import Find, of_robo
from robo.errors import DamagedBag


def open_bag(path: str | Path, find: Find = of_robo, *, scan: bool = False) -> Bag:
    """Open a recording: a file, or a folder of files that follow one another.

    One that is cut opens as well, as far as it can be read: `faults` say what is wrong.

    Args:
        path: of the file or folder.
        find: types by their names in ROS.
        scan: look at every byte first, so that parts that are damaged are left out and among the `faults`; else they
            are an error once messages in them are read.

    Raises:
        BagError: it cannot be read, or is no recording.
    """
    return Bag(str(path), Files(files_of(path), scan=scan), find)


def info(path: str | Path, *, quick: bool = False, find: Find = of_robo, tell: Tell = silent) -> Info:
    """What is in a recording, in figures; `quick` looks at no message. Parts that are damaged are left out, and told.

    `tell` is told how far it is, here and below.

    Raises:
        BagError: it cannot be read.
        DamagedBag: it is no recording at all.
    """
    try:
        with open_bag(path, find) as bag:
            return summary.info(bag, quick=quick, tell=tell)
    except DamagedBag:
        with open_bag(path, find, scan=True) as bag:
            return summary.info(bag, quick=quick, tell=tell)


def check(path: str | Path, find: Find = of_robo, tell: Tell = silent) -> Report:
    """What is wrong with a recording: every byte of it is looked at.

    Raises:
        BagError: it cannot be read.
        DamagedBag: it is no recording at all.
    """
    return inspection.check(path, find, tell)


def diff(first: str | Path, second: str | Path, find: Find = of_robo, tell: Tell = silent) -> Diff:
    """How two recordings differ.

    Raises:
        BagError: one of them cannot be read.
        DamagedBag: a part of one is damaged.
    """
    with open_bag(first, find) as one, open_bag(second, find) as other:
        return comparison.diff(one, other, tell)
