"""`robo topic`: printing what the tools find."""

import sys
import time
from collections.abc import Sequence

from robo.cli.connection import connect_to_robot, hint, print_json, print_line, print_table
from robo.names import key_of
from robo.tools import topics
from robo.tools.topics import Rate, RateMeter, Received, Stream


def print_topics(*, json: bool, connect: Sequence[str]) -> None:
    """Print the table of topics."""
    with connect_to_robot(connect) as session:
        found = topics.list_topics(session)
    if json:
        for topic in found:
            print_json(topic)
        return
    if not found:
        print("no topics", file=sys.stderr)
        return
    rows = [("TOPIC", "TYPE", "PUBLISHERS", "SUBSCRIBERS")]
    rows += [(t.key, ", ".join(t.types), _count(t.publishers), _count(t.subscribers)) for t in found]
    print_table(rows)


def print_messages(key: str, *, once: bool, json: bool, connect: Sequence[str]) -> None:
    """Print messages until Ctrl-C, or one."""
    expression = key_of(key)
    with connect_to_robot(connect) as session:
        stream = Stream(session, expression)
        hint(f"waiting for {expression} …")
        for sample in stream.samples():
            received = topics.read(sample)
            if json:
                print_json(received)
            else:
                print_line(_message_text(received))
            if once:
                break


def print_rates(key: str, *, count: int | None, duration: float | None, json: bool, connect: Sequence[str]) -> None:
    """Print the rate of each topic once a second."""
    expression = key_of(key)
    with connect_to_robot(connect) as session:
        stream = Stream(session, expression)
        hint(f"waiting for {expression} …")
        meters: dict[str, RateMeter] = {}
        due = time.monotonic() + 1.0
        shown = 0
        for sample in stream.samples(duration):
            name = str(sample.key_expr)
            meters.setdefault(name, RateMeter(name)).add(sample)
            if time.monotonic() >= due:
                shown += _print_windows(meters, json=json)
                due += 1.0
                if count is not None and shown >= count:
                    return
        _print_windows(meters, json=json)


def _print_windows(meters: dict[str, RateMeter], *, json: bool) -> int:
    """Print what each meter has; returns 1 if there was anything, as one window."""
    found = [rate for meter in meters.values() if (rate := meter.window()) is not None]
    for rate in found:
        if json:
            print_json(rate)
        else:
            print_line(_rate_text(rate))
    return 1 if found else 0


def _rate_text(rate: Rate) -> str:
    lost = f"  lost {rate.lost}" if rate.lost else ""
    spread = f"min {rate.min * 1e3:.2f} max {rate.max * 1e3:.2f} std {rate.std * 1e3:.2f} ms"
    return f"{rate.key}  {rate.rate:.2f} Hz  {spread}  n {rate.count}{lost}"


def _message_text(received: Received) -> str:
    import yaml

    head = f"# {received.key}  {received.type or 'type not said'}"
    if received.error is not None:
        return f"{head}\n# cannot be read: {received.error}\n---"
    body = yaml.safe_dump(_short_bytes(received.message), sort_keys=False, default_flow_style=None, width=120)
    return f"{head}\n{body}---"


def _short_bytes(value: object) -> object:
    if isinstance(value, dict):
        return {key: _short_bytes(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_short_bytes(item) for item in value]
    return f"<{len(value)} bytes>" if isinstance(value, bytes) else value


def _count(names: list[str]) -> str:
    return ", ".join(names) or "-"
