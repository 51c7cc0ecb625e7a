"""One end of a measurement, in a process of its own: `python -m benchmarks.worker ROLE VARIANT …`.

A worker says `ready` when it is set up. It answers each line on its standard input, a number, with
one line of JSON, and ends with its input.
"""

import os
import sys
import threading
from collections.abc import Callable
from typing import Any

import msgspec


def main() -> None:
    role, variant, kind, listen, connect = sys.argv[1:6]
    from benchmarks import raw
    from benchmarks.workloads import message

    settings, _, variant = variant.partition(" ")
    if settings == "raw":  # as zenoh-python comes
        session = raw.open_plain(listen, connect)
    else:  # with robo's settings
        from robo.wire.network import Network
        from robo.wire.session import open_session

        session = open_session(
            Network(mode="peer", listen=tuple(filter(None, [listen])), connect=tuple(filter(None, [connect])))
        )
    way: Any = raw
    if settings.startswith("robo"):
        from benchmarks import with_robo

        way, variant = with_robo, settings
    sample = message(kind)
    if role == "echo":
        say("ready")
        way.echo(session, variant, sample)
    elif role == "both":  # two nodes of one process
        threading.Thread(target=way.echo, args=(session, variant, sample), daemon=True).start()
        answer(way.Pinger(session, variant, sample).round_trips)
    elif role == "ping":
        answer(way.Pinger(session, variant, sample).round_trips)
    elif role == "sink":
        sink = way.Sink(session, variant, sample)
        answer(lambda _: sink.count)
    elif role == "flood":
        source = way.Source(session, variant, sample)
        answer(lambda milliseconds: source.flood(milliseconds / 1e3))
    os._exit(0)  # raw callbacks that still run would keep the process from exiting


def answer(work: Callable[[int], object]) -> None:
    say("ready")
    for line in sys.stdin:
        say(work(int(line)))


def say(value: object) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(value) + b"\n")
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
