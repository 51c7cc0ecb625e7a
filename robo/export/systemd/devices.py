"""Which devices a service may use: words of the command line as what systemd and the groups of users say. Pure."""

import re
from collections.abc import Collection
from typing import NamedTuple

from robo.errors import UsageError

_KINDS = (
    (r"ttyUSB\d*", "char-ttyUSB", "dialout"),
    (r"ttyACM\d*", "char-ttyACM", "dialout"),
    (r"ttyAMA\d*", "char-ttyAMA", "dialout"),
    (r"ttyTHS\d*", "char-ttyTHS", "dialout"),
    (r"ttyS\d*", "char-ttyS", "dialout"),
    (r"video\d*", "char-video4linux", "video"),
    (r"input(/.*)?", "char-input", "input"),
    (r"i2c-?\d*", "char-i2c", "i2c"),
    (r"spidev.*", "char-spi", "spi"),
    (r"gpiochip\d*", "char-gpiochip", "gpio"),
    (r"dri(/.*)?", "char-drm", "render"),
)
"""Below /dev: a pattern, systemd's word for all devices of the kind, and the group that Debian gives them.

A device of a kind may come and go, and come under another number; a device by its path has to be there at the start."""


class Devices(NamedTuple):
    """What a service may use."""

    rules: tuple[str, ...]
    """For `DeviceAllow=`."""
    groups: tuple[str, ...]
    """For `SupplementaryGroups=`."""
    alone: tuple[str, ...]
    """Paths that have to be there when the service starts."""


class Found(NamedTuple):
    """What this machine knows of a device."""

    target: str
    """Where its path leads, as udev makes links for it; the path itself where it is no link."""
    group: str | None
    """Whose it is; None where it is not there."""


def devices(words: Collection[str], found: dict[str, Found], groups: Collection[str]) -> Devices:
    """What is said of some devices.

    Args:
        words: as `--device` has them: a path below /dev, or systemd's word for a kind, such as `char-ttyUSB`.
        found: by path, what this machine knows.
        groups: that this machine has.

    Raises:
        UsageError: a word is neither.
    """
    rules, wanted, alone = dict[str, None](), dict[str, None](), list[str]()
    for word in words:
        if re.fullmatch(r"(char|block)-[A-Za-z0-9_.*/-]+", word):
            rules[word] = None
            wanted |= {group: None for _, kind, group in _KINDS if kind == word}
            continue
        if not word.startswith("/dev/") or ".." in word.split("/"):
            raise UsageError(f"--device {word}: name a device, /dev/ttyUSB0, or all of a kind, char-ttyUSB")
        here = found.get(word, Found(word, None))
        kind, usual = _kind(here.target.removeprefix("/dev/"))
        rules[kind or word] = None
        if kind is None:
            alone.append(word)
        if here.group not in (None, "root"):
            wanted[str(here.group)] = None
        elif here.group is None and usual is not None:
            wanted[usual] = None
    return Devices(tuple(f"{rule} rw" for rule in rules), tuple(g for g in wanted if g in groups), tuple(alone))


def named_in(texts: Collection[str]) -> list[str]:
    """The devices that some texts name, parameters of nodes and words of commands, that nobody may use by default."""
    found = {text: None for text in texts if re.fullmatch(r"/dev/[A-Za-z0-9_./-]+", text)}
    return [text for text in found if not re.match(r"/dev/(shm|null|zero|full|random|urandom|tty|ptmx|pts)(/|$)", text)]


def _kind(name: str) -> tuple[str | None, str | None]:
    return next(((kind, group) for pattern, kind, group in _KINDS if re.fullmatch(pattern, name)), (None, None))
