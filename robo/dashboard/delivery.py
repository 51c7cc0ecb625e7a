"""What pages get of topics: the newest message of each, and where the frames of robots stand."""

import asyncio
import itertools
from collections.abc import Collection

import zenoh

from robo.dashboard import protocol
from robo.dashboard.frames import Frames
from robo.dashboard.lease import Beats
from robo.dashboard.mailbox import Mailbox
from robo.dashboard.topics import TRANSFORMS, Message, Topics
from robo.errors import InvalidName
from robo.web.access import Right
from robo.wire import names

MOST_KEYS = 100
"""That one page may watch."""
_MOST_ENCODINGS = 4
"""Of one topic: more make no sense."""
_LONGEST_KEY, _LONGEST_ROBOT = 500, 100
_NUMBERS = 2**16
"""Of channels, that there can be."""


class Page:
    """One that is open."""

    def __init__(self, number: int, right: Right) -> None:
        self.name = f"browser {number}"
        """By which others know who drives."""
        self.right = right
        self.mailbox = Mailbox()
        self.wake = asyncio.Event()
        self.beats = Beats()
        self.watched: set[str] = set()
        self.frames: set[str] = set()
        """Robots of which it shows where their frames stand."""
        self.channels: set[int] = set()
        """Of which it has been told what they are."""
        self.asked = self.stops = 0
        """What it waits for, and how many emergency stops beside that."""

    def tell(self, kind: str, *, newest: str = "", urgent: bool = False, **what: object) -> None:
        """Tell it something; where it is the newest of something, in the place of what waits."""
        self.hand(protocol.news(kind, **what), newest=newest, urgent=urgent)

    def hand(self, data: str, *, newest: str = "", urgent: bool = False) -> None:
        """Tell it something that has been put into words."""
        if newest:
            self.mailbox.put(newest, data, urgent=urgent)
        else:
            self.mailbox.add(data)
        self.wake.set()


class Delivery:
    """Knows what each page watches. Used by one thread, that of the event loop."""

    def __init__(self, topics: Topics, pages: Collection[Page]) -> None:
        """
        Args:
            topics: what comes.
            pages: all that are open; they come and go.
        """
        self._topics, self._pages = topics, pages
        self._channels: dict[str, dict[str, int]] = {}
        """The numbers of channels by topic and encoding, of topics that somebody watches."""
        self._next_channel = itertools.cycle(range(_NUMBERS))
        self._frames = Frames()
        self._moved: set[str] = set()
        """Robots whose frames pages have not been told of."""
        self._last: dict[str, Message] = {}
        """What came last of each topic that somebody watches: whoever looks later gets it, too."""

    def messages(self, messages: list[Message]) -> None:
        """What has come on topics that pages watch."""
        for message in messages:
            if message.frames is not None:
                robot = message.key.rpartition("/")[0]
                self._frames.take(robot, message.frames)
                self._moved.add(robot)
                self._last[message.key] = message
            lookers = [page for page in self._pages if message.key in page.watched]
            if lookers:
                self._hand(lookers, message)

    def watch(self, page: Page, keys: list[str], robots: list[str]) -> None:
        """A page shows these topics, and where frames of these robots stand, and no others."""
        before, framed = page.watched, page.frames
        page.watched = {key for key in keys[:MOST_KEYS] if _is_key(key)}
        page.frames = {robot for robot in robots[:MOST_KEYS] if is_robot(robot)}
        for gone in before - page.watched:
            page.mailbox.drop(gone)
        self.forget()
        # Others may have looked at it before: what is latched does not come once more.
        for key in page.watched - before:
            if key in self._last:
                self._hand([page], self._last[key])
        for robot in page.frames - framed:
            self._tell_frames([page], robot)

    def forget(self) -> None:
        """Have what pages watch received, and forget what nobody does any more."""
        framed = {robot for page in self._pages for robot in page.frames}
        wanted = {key for page in self._pages for key in page.watched}
        received = wanted | {names.join(robot, topic) for robot in framed for topic in TRANSFORMS}
        self._topics.watch(received)
        self._frames.keep(framed)
        self._last = {key: message for key, message in self._last.items() if key in received}
        gone = {number for key in self._channels.keys() - wanted for number in self._channels.pop(key).values()}
        for page in self._pages:
            page.channels -= gone

    def tell_frames(self) -> None:
        """Tell where frames stand that have moved."""
        for robot in self._moved:
            self._tell_frames([page for page in self._pages if robot in page.frames], robot)
        self._moved.clear()

    def _hand(self, pages: list[Page], message: Message) -> None:
        """Give pages a message."""
        channel = self._channel(message)
        if channel is None:
            return
        if not message.each_counts:
            self._last[message.key] = message
        data = protocol.frame(channel, message.published, message.arrived, message.payload)
        for page in pages:
            if channel not in page.channels:
                page.channels.add(channel)
                about = {"number": channel, "key": message.key, "encoding": message.encoding}
                page.tell("channel", newest=f"channel {channel}", urgent=True, **about)
            if message.each_counts:
                page.mailbox.add(data)
            else:
                page.mailbox.put(message.key, data)
            page.wake.set()

    def _channel(self, message: Message) -> int | None:
        """The number of a message's channel; None where a stranger makes some up."""
        known = self._channels.setdefault(message.key, {})
        found = known.get(message.encoding)
        if found is None and len(known) < _MOST_ENCODINGS:
            taken = {number for channels in self._channels.values() for number in channels.values()}
            found = known[message.encoding] = next(number for number in self._next_channel if number not in taken)
        return found

    def _tell_frames(self, pages: list[Page], robot: str) -> None:
        if pages:
            data = protocol.news("frames", robot=robot, frames=self._frames.of(robot))
        for page in pages:
            page.hand(data, newest=f"frames of {robot}")


def is_robot(text: str) -> bool:
    """Whether a text can be a robot's name: no pattern that would move several."""
    try:
        return len(text) <= _LONGEST_ROBOT and names.normalize_namespace(text) == text
    except InvalidName:
        return False


def _is_key(text: str) -> bool:
    """Whether a text is the key of one topic."""
    try:
        return len(text) <= _LONGEST_KEY and not set(text) & set("*$") and bool(zenoh.KeyExpr(text))
    except zenoh.ZError:
        return False
