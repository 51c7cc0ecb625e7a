"""`robo topic echo`: printing messages as they come."""

import csv
import io
import sys
import time
from collections.abc import Sequence

from robo.cli.connection import connect_to_robot
from robo.cli.json_text import to_json
from robo.cli.link import watched
from robo.cli.printing import note
from robo.cli.reach import Reach
from robo.cli.views.waiting import complain_of_few, tell_who_is_waited_for
from robo.errors import UsageError
from robo.interfaces.parts import Field, Missing
from robo.samples.records import Received, read
from robo.samples.stream import Stream
from robo.text.terminal import visible
from robo.tools.fields import FieldFilter, cell, flattened, truncated


class EchoOptions:
    """What of messages is printed, and how."""

    def __init__(
        self, *, form: str = "text", fields: Sequence[str] = (), condition: str | None = None, truncate: bool = False
    ) -> None:
        """`form` is text, yaml, json or csv.

        Raises:
            UsageError: a field or the condition cannot be understood.
        """
        self.form = form
        self.fields = [Field(path) for path in fields]
        self.filter = FieldFilter(condition) if condition is not None else None
        self.truncate = truncate


def print_messages(
    names: Sequence[str], reach: Reach, options: EchoOptions, *, count: int | None, duration: float | None
) -> int:
    """Print messages until there were enough, the time is over, or Ctrl-C.

    Returns:
        1 where the time was over before as many were printed as were asked for, or any.

    Raises:
        RoboError: a name, a field or the condition makes no sense for what comes.
    """
    keys = [reach.key(name) for name in names]
    with connect_to_robot(reach) as session, watched(session, reach):
        stream = Stream(session, keys, latched=True)
        end = time.monotonic() + duration if duration is not None else None
        tell_who_is_waited_for(session, keys, reach, endless=duration is None)
        printer = Printer(options, one_topic=len(keys) == 1 and "*" not in keys[0])
        shown = came = 0
        try:
            for arrival in stream.until(end):
                came += 1
                if printer.show(read(arrival)):
                    shown += 1
                    if count is not None and shown >= count:
                        break
                if not stream.waiting:
                    sys.stdout.flush()
        finally:
            stream.close()
            if stream.left_out:
                note(f"{stream.left_out} messages were left out: they came faster than they could be printed")
        sys.stdout.flush()
    filtered = f"; {came} came that were not to be printed" if came > shown else ""
    return complain_of_few(keys, shown, count, duration, more=filtered)


class Printer:
    """Prints messages one after the other; `one_topic` where no other can come."""

    def __init__(self, options: EchoOptions, *, one_topic: bool) -> None:
        self._options = options
        self._one_topic = one_topic
        self._lacking: set[str] = set()
        self._columns: list[str] | None = None

    def show(self, received: Received) -> bool:
        """Print a message, unless it is filtered out; returns whether it was printed."""
        options = self._options
        try:
            if options.filter is not None and not options.filter.holds(received.message):
                return False
            chosen = self._chosen(received)
        except (Missing, UsageError) as error:
            if self._one_topic:
                raise UsageError(visible(f"{received.arrival.key} ({received.type or 'no type'}): {error}")) from None
            if received.arrival.key not in self._lacking:  # of many topics, some may have other fields
                self._lacking.add(received.arrival.key)
                note(visible(f"{received.arrival.key} ({received.type or 'no type'}) is left out: {error}"))
            return False
        write = sys.stdout.write
        if options.form == "json":
            whole = not options.fields and not options.truncate
            write(to_json(received.record() if whole else received.view(chosen)) + "\n")
        elif options.form == "csv":
            write(self._csv(received, chosen))
        else:
            write(self._text(received, chosen))
        return True

    def _chosen(self, received: Received) -> object:
        """The whole message, or its wanted fields by path."""
        message = received.message
        if self._options.fields:
            message = {field.path: field.of(message) for field in self._options.fields}
        return truncated(message) if self._options.truncate else message

    def _text(self, received: Received, chosen: object) -> str:
        """As YAML, with a head of comments; a single field alone on its line."""
        if isinstance(chosen, dict) and len(self._options.fields) == 1 and self._options.form == "text":
            return f"{visible(cell(next(iter(chosen.values()))))}\n"
        from robo.text.yaml_tree import as_yaml

        head = visible(f"# {received.arrival.key}  {received.type or 'type not said'}") + "\n"
        if received.error:
            return f"{head}# cannot be read: {visible(received.error)}\n---\n"
        plain = chosen if self._options.form == "yaml" else _short_bytes(chosen)
        return f"{head}{as_yaml(plain, default_flow_style=None)}---\n"

    def _csv(self, received: Received, chosen: object) -> str:
        values = dict(chosen.items() if self._options.fields and isinstance(chosen, dict) else flattened(chosen))
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        if self._columns is None:
            self._columns = list(values)
            rows.writerow(["time", "key", "sequence_number", *values])
        if list(values) != self._columns:
            raise UsageError(
                f"{received.arrival.key} ({received.type or 'no type'}) has other columns than the first message: "
                "with --csv name topics of one type, or --field"
            )
        number = received.sequence_number
        rows.writerow(
            [received.time, received.arrival.key, "" if number is None else number, *map(cell, values.values())]
        )
        return text.getvalue()


def _short_bytes(value: object) -> object:
    if isinstance(value, dict):
        return {key: _short_bytes(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_short_bytes(item) for item in value]
    return f"<{len(value)} bytes>" if isinstance(value, bytes) else value
