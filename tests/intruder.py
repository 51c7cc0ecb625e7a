"""A program of another user of this machine, with Zenoh alone: it tries what it is told, and prints what came of it.

`python intruder.py client|peer|router` dials the port where others look at robots, tries everything once, and prints
a line of JSON. `python intruder.py first` has that port before a robot, and prints what it was told and obeyed in once
it is interrupted. `python intruder.py idle` connects often and says nothing.
"""

import json
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable

import zenoh

DOOR = "tcp/127.0.0.1:7447"
IDLE = 400
"""Connections on which nothing is said; Zenoh by itself lets nobody else in beside a hundred."""
_ANSWERS_WITHIN = 2.0
_LINKS_WITHIN = 3.0
"""How long others get to link to this one, which tells them where it listens, s."""
_HEARS_WITHIN = 20.0

_NOTHING = b"\x80"
_SLOW = b"\x81\xa5speed\xcb\x3f\xb0\0\0\0\0\0\0"
_FOLLOWER = b"\x81\xa5names\x91\xb1waypoint_follower"
"""Requests in MessagePack: an empty map, {speed: 0.0625}, {names: [waypoint_follower]}."""


def session(mode: str, *, dial: bool) -> zenoh.Session:
    """A session with Zenoh's own settings, but for multicast."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("adminspace/enabled", "true")
    config.insert_json5("connect/endpoints", json.dumps([DOOR] if dial else []))
    if mode != "client":
        # Gossip tells of both; whoever may enter this folder may dial the second one.
        own = ["tcp/127.0.0.1:0", f"unixsock-stream/{os.getcwd()}/intruder.sock"]
        config.insert_json5("listen/endpoints", json.dumps(own if dial else [DOOR]))
    return zenoh.open(config)


def attempts(intruder: zenoh.Session) -> dict[str, object]:
    """Whether each thing that was tried has come to something."""

    def answers(key: str, request: bytes = _NOTHING) -> int:
        replies = intruder.get(key, payload=request, timeout=_ANSWERS_WITHIN, accept_replies=zenoh.ReplyKeyExpr.ANY)
        return sum(reply.ok is not None for reply in replies)

    def hears(key: str) -> bool:
        heard = intruder.declare_subscriber(key)
        end = time.monotonic() + _HEARS_WITHIN
        while time.monotonic() < end:
            if heard.try_recv() is not None:
                return True
            time.sleep(0.01)
        return False

    def publishes() -> None:
        for key in ("r1/cmd_vel_key", "r1/cmd_vel", "*/cmd_vel_key", "@robo/r1/output"):
            intruder.put(key, json.dumps({"linear": {"x": 9.0}}), encoding="application/json;geometry/Twist")
        intruder.delete("r1/cmd_vel_key")
        declared = intruder.declare_publisher("r1/cmd_vel_key")
        declared.put(json.dumps({"linear": {"x": 9.0}}), encoding="application/json;geometry/Twist")

    def seen(key: str) -> int:
        return sum(reply.ok is not None for reply in intruder.liveliness().get(key, timeout=_ANSWERS_WITHIN))

    def configures() -> int:
        (zid,) = [str(one) for one in intruder.info.routers_zid()][:1] or ["*"]
        intruder.put(f"@/{zid}/router/config/access_control/enabled", "false")
        return answers(f"@/{zid}/router/config/**")

    tried: dict[str, Callable[[], object]] = {
        "looks: a topic": lambda: hears("r1/odom"),
        "looks: all topics": lambda: hears("**"),
        "looks: nodes": lambda: seen("@robo/**/node/**") > 0,
        "looks: processes": lambda: answers("@robo/**/supervisor/ps") > 0,
        "looks: parameters": lambda: answers("r1/waypoint_follower/parameters/get") > 0,
        "looks: what is latched": lambda: answers("r1/safety_state/@adv/**") > 0,
        "calls": lambda: answers("r1/emergency_stop") > 0,
        "calls with wildcards": lambda: answers("*/emergency_stop") > 0,
        "sets a parameter": lambda: answers("r1/waypoint_follower/parameters/set", _SLOW) > 0,
        "sets by wildcard": lambda: answers("*/waypoint_follower/parameters/set", _SLOW) > 0,
        "stops a node": lambda: answers("@robo/r1/supervisor/stop", _FOLLOWER) > 0,
        "reads settings": lambda: configures() > 0,
    }
    found = {what: attempt() for what, attempt in tried.items()}
    publishes()
    return found


def main() -> None:
    """Try, tell, and stay until Ctrl-C."""
    how = sys.argv[1]
    over = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: over.set())
    if how == "idle":
        idle = [socket.create_connection(("127.0.0.1", 7447)) for _ in range(IDLE)]
        print("there", flush=True)
        over.wait()
        del idle
        return
    if how == "first":
        first = session("router", dial=False)
        heard = first.declare_subscriber("**", zenoh.handlers.RingChannel(10))
        tokens = first.liveliness().declare_subscriber("**", zenoh.handlers.RingChannel(10), history=True)
        print("there", flush=True)
        over.wait()
        replies = first.get("@robo/r1/supervisor/down", payload="{}", timeout=_ANSWERS_WITHIN)
        obeyed = sum(reply.ok is not None for reply in replies)
        links = len(first.info.peers_zid()) + len(first.info.routers_zid())
        told = heard.try_recv() is not None or tokens.try_recv() is not None
        print(json.dumps({"obeyed": obeyed, "links": links, "told": told}), flush=True)
        return
    intruder = session(how, dial=True)
    asked = 0

    def answer(query: zenoh.Query) -> None:
        nonlocal asked
        asked += 1
        query.reply(str(query.key_expr), "{}")

    serving = intruder.declare_queryable("r1/reset_distance", answer, complete=True)
    token = intruder.liveliness().declare_token("@robo/r1/node/evil/a:B/1/host")
    found = attempts(intruder)
    end = time.monotonic() + _LINKS_WITHIN
    while how == "peer" and time.monotonic() < end and not intruder.info.peers_zid():
        time.sleep(0.05)
    found["is linked by nodes"] = bool(intruder.info.peers_zid())
    intruder.put("r1/cmd_vel_key", json.dumps({"linear": {"x": 9.0}}), encoding="application/json;geometry/Twist")
    print(json.dumps(found), flush=True)
    over.wait()
    print(json.dumps({"asked": asked}), flush=True)
    del serving, token


if __name__ == "__main__":
    main()
