"""`robo topic pub`: publishing from a command line or from lines of JSON."""

import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

import zenoh

import robo_messages
from robo.cli.connection import connect_to_robot, see_that_it_obeys
from robo.cli.printing import amount, hint, note
from robo.cli.reach import Reach
from robo.errors import ContractError, MessageError, UsageError
from robo.interfaces import catalogue
from robo.interfaces.message_input import message_of
from robo.samples.publishing import Line, Sender, flush, line_of
from robo.samples.stream import SIGNALS
from robo.text.terminal import own
from robo.text.unreadable import UNREADABLE
from robo.tools import topics
from robo.wire.qos import QoS, check_priority, said
from robo_messages import Message

_LONGEST_LINE = 100_000_000
"""A longer line of the input is refused, bytes."""

_PROGRESS_PERIOD = 0.2
"""How often the number of messages is told, s."""


class PubOptions(NamedTuple):
    """How messages are published."""

    rate: float | None = None
    """Messages a second; None for as they come, and for one a second where there is only one to repeat."""
    times: int | None = None
    """How many; None for one, with a rate and for lines for no end."""
    once: bool = False
    """A single one."""
    wait: bool = False
    """Nothing before somebody subscribes."""
    force: bool = False
    """Also where nodes know the topic as another type."""
    beside: bool = False
    """Also where somebody publishes the topic already."""
    latched: bool = False
    """Whoever comes later gets the last one, until Ctrl-C."""
    priority: str | None = None
    """What goes first where a link has more to carry than it can."""

    @property
    def qos(self) -> QoS:
        """What it promises of the topic.

        Raises:
            UsageError: there is no such priority.
        """
        try:
            priority = check_priority(self.priority) if self.priority is not None else None
        except ContractError as error:
            raise UsageError(f"--priority {self.priority}: {error}") from None
        return said(latched=self.latched or None, priority=priority)

    def sender(self, session: zenoh.Session, key: str, type_name: str, reach: Reach) -> Sender:
        """A sender on a topic, once all that was asked for is so.

        Raises:
            MessageError: it is not the topic's type.
            TopicTaken: somebody publishes it already.
        """
        if type_name and not self.force:
            topics.check_type(session, key, type_name, reach.timeout)
        if not self.beside:
            topics.check_unpublished(session, key, reach.timeout)
        sender = Sender(session, key, type_name, self.qos)
        if self.wait:
            hint(f"waiting for a subscriber of {key} …")
            sender.wait_for_subscriber()
        return sender

    def stay(self, count: "_Count") -> None:
        """Let those who come later have what is latched, until Ctrl-C."""
        if self.latched:
            count.end()
            note("what was published last is there for whoever comes later; Ctrl-C ends")
            while True:
                time.sleep(SIGNALS)


def publish(key: str, type_name: str | None, data: str | None, reach: Reach, options: PubOptions) -> int:
    """Publish what the words of a command line say: one message, or with `-` among them the lines of standard input.

    Returns:
        1 where a line could not be published; the others are.

    Raises:
        UsageError: the words do not go together.
        MessageError: the type is unknown or not the topic's, or the data are no message of it; nothing is published.
        TopicTaken: somebody publishes a topic already; of lines, what came before is published.
        RoboError: the name makes no sense, or nothing runs.
    """
    if options.once and options.latched:
        raise UsageError(
            "what is latched is there as long as the command runs: leave --once out, and end it with Ctrl-C"
        )
    if "-" in (key, type_name, data):
        if data not in (None, "-") or options.once:
            raise UsageError("with - the messages come from standard input: leave DATA and --once out")
        return _publish_lines(None if key == "-" else key, None if type_name == "-" else type_name, reach, options)
    if type_name is None:
        raise UsageError(
            f"say which type: robo topic pub {key} TYPE DATA, for example geometry/Twist '{{linear: {{x: 0.2}}}}'"
        )
    if options.once and (options.times is not None or options.rate is not None):
        raise UsageError("--once goes without --times and -r")
    if options.times is None and options.rate is None:
        options = options._replace(times=1)
    _publish_one(key, type_name, data or "{}", reach, options)
    return 0


def _publish_one(key: str, type_name: str, text: str, reach: Reach, options: PubOptions) -> None:
    """Publish a message so many times, or until Ctrl-C."""
    message = _message(type_name, text)
    stamped = "now" in text or "auto" in text
    expression = reach.one_key(key, "publish on")
    with connect_to_robot(reach) as session:
        see_that_it_obeys(session, reach, expression)
        sender = options.sender(session, expression, type_name, reach)
        count = _Count(f" on {expression}")
        due = time.monotonic()
        try:
            while options.times is None or count.sent < options.times:
                time.sleep(max(0.0, due - time.monotonic()))
                due += 1.0 / (options.rate or 1.0)
                # Anew where it may be stamped `now`, so that it tells the time of now.
                sender.send(robo_messages.encode(_message(type_name, text) if stamped else message))
                count.add()
            options.stay(count)
        finally:
            flush(session)
            sender.close()
            count.end()


def _publish_lines(key: str | None, type_name: str | None, reach: Reach, options: PubOptions) -> int:
    """Publish what standard input says, line by line, as it comes or at a rate."""
    if type_name is not None:
        _type(type_name)  # a mistake in it is told before anything is read
    target = reach.one_key(key, "publish on") if key is not None else None
    with connect_to_robot(reach) as session:
        see_that_it_obeys(session, reach, target or "")
        lines = _Lines(session, reach, options)
        mistakes = 0
        try:
            for number, text in _input():
                try:
                    lines.publish(line_of(text, target, type_name))
                except MessageError as error:
                    mistakes += 1
                    note(f"<stdin>:{number}: {error}")
                if options.times is not None and lines.count.sent >= options.times:
                    break
            options.stay(lines.count)
        finally:
            flush(session)
            lines.close()
    return 1 if mistakes else 0


class _Lines:
    def __init__(self, session: zenoh.Session, reach: Reach, options: PubOptions) -> None:
        self._session = session
        self._reach = reach
        self._options = options
        self._senders: dict[str, Sender] = {}
        self._due = time.monotonic()
        self._circling = False
        self.count = _Count()

    def publish(self, line: Line) -> None:
        sender = self._senders.get(line.key)
        if sender is None:
            sender = self._options.sender(self._session, line.key, line.type, self._reach)
            self._senders[line.key] = sender
        if line.origin is not None and sender.has_sent(line.origin):
            # `echo KEY --json | pub -` on one network: what goes out comes in again.
            if not self._circling:
                self._circling = True
                note(f"{line.key}: what comes in is what went out; such lines are left out. Name another KEY")
            return
        if self._options.rate is not None:
            time.sleep(max(0.0, self._due - time.monotonic()))
            self._due = max(self._due + 1.0 / self._options.rate, time.monotonic())
        sender.send(line.payload, line.encoding)
        self.count.add()

    def close(self) -> None:
        for sender in self._senders.values():
            sender.close()
        self.count.end()


class _Count:
    """How many messages were published, on a line of the terminal that is written anew while it goes on."""

    def __init__(self, where: str = "") -> None:
        self.sent = 0
        self._where = where
        self._live = sys.stderr.isatty()
        self._due = 0.0

    def add(self) -> None:
        """Another one was published."""
        self.sent += 1
        if self._live and (now := time.monotonic()) >= self._due:
            self._due = now + _PROGRESS_PERIOD
            self._tell("; Ctrl-C ends")

    def end(self) -> None:
        """No more will be."""
        if self._live:
            self._live = False
            self._tell("\n")

    def _tell(self, ending: str) -> None:
        begin = own("\r\x1b[K")
        sys.stderr.write(f"{begin}published {amount(self.sent, 'message')}{self._where}{ending}")
        sys.stderr.flush()


def _input() -> Iterator[tuple[int, str]]:
    """The lines of standard input that hold anything, with their numbers."""
    if sys.stdin.isatty():
        hint("one message a line, as JSON; Ctrl-D ends")
    for number, raw in enumerate(iter(lambda: sys.stdin.buffer.readline(_LONGEST_LINE + 1), b""), start=1):
        if len(raw) > _LONGEST_LINE:
            raise MessageError(f"line {number} of the input has more than {_LONGEST_LINE:,} bytes; one message a line")
        text = raw.decode(errors="replace").strip()
        if text:
            yield number, text


def _message(type_name: str, text: str) -> Message:
    import yaml

    type_ = _type(type_name)
    try:
        # JSON is YAML, but for numbers such as 1e-3, which YAML takes for text.
        data = _as_json(text) if text.lstrip()[:1] == "{" else None
        if data is None:
            data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"column {mark.column + 1}: " if mark is not None else ""
        raise MessageError(f"the message is neither YAML nor JSON: {where}{getattr(error, 'problem', error)}") from None
    if data is None:
        data = {}
    return message_of(type_, data)


def _as_json(text: str) -> object | None:
    import msgspec

    try:
        found: object = msgspec.json.decode(text)
    except UNREADABLE:
        return None
    return found


def _type(name: str) -> type[Message]:
    try:
        return catalogue.find(name)
    except robo_messages.UnknownType as error:
        raise MessageError(error.args[0]) from None
