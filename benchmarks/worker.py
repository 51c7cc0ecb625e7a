"""One end of a measurement, in a process of its own: `python -m benchmarks.worker ROLE VARIANT …`.

A worker says `ready` when it is set up. It answers each line on its standard input with one line of
JSON, and ends with its input.
"""

import os
import sys
from typing import Any

import msgspec


def main() -> None:
    role, variant, kind, listen, connect, amount = sys.argv[1:7]
    from benchmarks import raw
    from benchmarks.workloads import message

    settings, _, variant = variant.partition(" ")
    if settings == "raw":  # as zenoh-python comes
        session = raw.open_plain(listen, connect)
    else:  # with robo's settings
        from robo.session import Network, open_session

        session = open_session(
            Network(mode="peer", listen=tuple(filter(None, [listen])), connect=tuple(filter(None, [connect])))
        )
    sample = message(kind)
    robo = settings.startswith("robo")
    if robo:
        from benchmarks import with_robo

        variant = settings
    if role == "echo":
        say("ready")
        if robo:
            with_robo.echo(session, sample)
        else:
            raw.echo(session, variant, sample)
    elif role == "ping":
        warm_up, count = 300, int(amount)
        times = (
            with_robo.round_trips(session, sample, warm_up + count)
            if robo
            else raw.round_trips(session, variant, sample, warm_up + count)
        )
        say(times[warm_up:])
    elif role == "sink":
        sink: Any = with_robo.Sink(session, variant, sample) if robo else raw.Sink(session, variant, sample)
        say("ready")
        for _ in sys.stdin:
            say(sink.count)
    elif role == "flood":
        flood = with_robo.flood if robo else raw.flood
        say(flood(session, variant, sample, float(amount)))
    leave()


def say(value: object) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(value) + b"\n")
    sys.stdout.buffer.flush()


def leave() -> None:
    """End at once: raw callbacks that still run would keep the process from exiting."""
    os._exit(0)


if __name__ == "__main__":
    main()
