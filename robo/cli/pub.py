"""`robo topic pub`: publishing from a command line or from lines of JSON."""

import sys
import time
from collections.abc import Iterator

import zenoh

import robo_messages
from robo.cli.connection import amount, connect_to_robot, hint, note
from robo.cli.reach import Reach
from robo.errors import MessageError
from robo.tools import interfaces, topics
from robo.tools.message_input import message_of
from robo.tools.publishing import Line, Sender, flush, line_of
from robo_messages import Message


def publish(
    key: str, type_name: str, text: str, reach: Reach, *, rate: float, times: int | None, wait: bool, force: bool
) -> None:
    """Publish a message so many times, or until Ctrl-C.

    Raises:
        MessageError: the type is unknown or not the topic's, or the data are no message of it; nothing is published.
        RoboError: the name makes no sense, or nothing runs.
    """
    message = _message(type_name, text)
    stamped = "now" in text or "auto" in text
    expression = reach.one_key(key, "publish on")
    with connect_to_robot(reach) as session:
        if not force:
            topics.check_type(session, expression, type_name, reach.timeout)
        sender = Sender(session, expression, type_name)
        if wait:
            hint(f"waiting for a subscriber of {expression} …")
            sender.wait_for_subscriber()
        due = time.monotonic()
        sent = 0
        try:
            while times is None or sent < times:
                time.sleep(max(0.0, due - time.monotonic()))
                due += 1.0 / rate
                # Anew where it may be stamped `now`, so that it tells the time of now.
                sender.send(robo_messages.encode(_message(type_name, text) if stamped else message))
                sent += 1
        finally:
            flush(session)
            sender.close()
            hint(f"published {amount(sent, 'message')} on {expression}")


def publish_lines(
    key: str | None,
    type_name: str | None,
    reach: Reach,
    *,
    rate: float | None,
    times: int | None,
    wait: bool,
    force: bool,
) -> int:
    """Publish what standard input says, line by line, as it comes or at a rate.

    Returns:
        1 where a line could not be published; the others are.

    Raises:
        RoboError: a name makes no sense, or nothing runs.
    """
    if type_name is not None:
        _type(type_name)  # a mistake in it is told before anything is read
    target = reach.one_key(key, "publish on") if key is not None else None
    with connect_to_robot(reach) as session:
        lines = _Lines(session, wait=wait, check_timeout=None if force else reach.timeout)
        mistakes = 0
        try:
            for number, text in _input():
                try:
                    lines.publish(line_of(text, target, type_name), rate)
                except MessageError as error:
                    mistakes += 1
                    note(f"<stdin>:{number}: {error}")
                if times is not None and lines.sent >= times:
                    break
        finally:
            flush(session)
            lines.close()
            hint(f"published {amount(lines.sent, 'message')}")
    return 1 if mistakes else 0


class _Lines:
    def __init__(self, session: zenoh.Session, *, wait: bool, check_timeout: float | None) -> None:
        self._session = session
        self._check_timeout = check_timeout
        self._wait = wait
        self._senders: dict[str, Sender] = {}
        self._due = time.monotonic()
        self._circling = False
        self.sent = 0

    def publish(self, line: Line, rate: float | None) -> None:
        sender = self._senders.get(line.key)
        if sender is None:
            if self._check_timeout is not None and line.type:
                topics.check_type(self._session, line.key, line.type, self._check_timeout)
            sender = self._senders[line.key] = Sender(self._session, line.key, line.type)
            if self._wait:
                hint(f"waiting for a subscriber of {line.key} …")
                sender.wait_for_subscriber()
        if line.origin is not None and sender.has_sent(line.origin):
            # `echo KEY --json | pub -` on one network: what goes out comes in again.
            if not self._circling:
                self._circling = True
                note(f"{line.key}: what comes in is what went out; such lines are left out. Name another KEY")
            return
        if rate is not None:
            time.sleep(max(0.0, self._due - time.monotonic()))
            self._due = max(self._due + 1.0 / rate, time.monotonic())
        sender.send(line.payload, line.encoding)
        self.sent += 1

    def close(self) -> None:
        for sender in self._senders.values():
            sender.close()


def _input() -> Iterator[tuple[int, str]]:
    """The lines of standard input that hold anything, with their numbers."""
    if sys.stdin.isatty():
        hint("one message a line, as JSON; Ctrl-D ends")
    for number, raw in enumerate(sys.stdin.buffer, start=1):
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
    except (msgspec.DecodeError, RecursionError):
        return None
    return found


def _type(name: str) -> type[Message]:
    try:
        return interfaces.find(name)
    except robo_messages.UnknownType as error:
        raise MessageError(error.args[0]) from None
