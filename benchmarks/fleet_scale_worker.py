"""Plays robots for `fleet_scale`: each a session of its own that declares what a real robot was seen to declare.

`python -m benchmarks.fleet_scale_worker` reads a `Part` from its first line, says `open` when all of its robots have
dialled the site, takes a line for each robot that is to come later, and ends when its input does.
"""

import os
import sys
from typing import Any

import msgspec
import zenoh

from robo.wire.ids import new_id
from robo.wire.keys import SupervisorToken, control_key
from robo.wire.network import Mode, Network, zenoh_config
from robo.wire.session import open_session  # noqa: F401 - sets how many threads Zenoh has
from robo.wire.zenoh_threads import use_those_of_a_router

NAME = "played"
"""The namespace that stands for the robot's own in what was seen."""


class Seen(msgspec.Struct, frozen=True):
    """What one real robot declares."""

    tokens: list[str]
    """Keys of its liveliness tokens but the supervisor's, with `NAME` for its namespace."""
    subscribers: list[str]
    queryables: list[str]
    ps: bytes
    """What its supervisor answers `ps`."""


class Part(msgspec.Struct, frozen=True):
    """Which robots one process plays."""

    site: str
    """Where they dial."""
    mode: Mode
    first: int
    """The number of the first one."""
    robots: int
    seen: Seen


class Robot:
    """A robot's session and what it has declared, which lasts as long as this does."""

    def __init__(self, name: str, part: Part) -> None:
        config = zenoh_config(Network(mode=part.mode, connect=(part.site,), timeout=120, shared_memory=False))
        config.insert_json5("id", f'"{new_id()}"')
        session = self.session = zenoh.open(config)
        seen = part.seen

        def own(key: str) -> str:
            return key.replace(NAME, name)

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(control_key(name, "ps"), seen.ps)

        at_once = zenoh.handlers.Callback(answer, indirect=False)
        ring: zenoh.handlers.RingChannel[Any] = zenoh.handlers.RingChannel(1)
        self.held: list[object] = [session.declare_queryable(control_key(name, "*"), at_once, complete=True)]
        self.held += [session.declare_queryable(own(key), ring) for key in seen.queryables]
        self.held += [session.declare_subscriber(own(key), ring) for key in seen.subscribers]
        self.held += [session.liveliness().declare_token(own(key)) for key in seen.tokens]
        token = SupervisorToken(name, os.getpid(), "played", "", str(session.zid()), "robo")
        self.held.append(session.liveliness().declare_token(token.key()))  # last, as a node does


def main() -> None:
    part = msgspec.json.decode(sys.stdin.readline(), type=Part)
    if part.mode == "router":
        use_those_of_a_router()
    robots = [Robot(f"r{part.first + i}", part) for i in range(part.robots)]
    print("open", flush=True)
    for line in sys.stdin:
        robots.append(Robot(line.strip(), part))
    os._exit(0)  # hundreds of sessions would take their leave one after the other


if __name__ == "__main__":
    main()
