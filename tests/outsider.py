"""A program of another user of a machine on which a robot and its router run: it has no certificate, and Zenoh alone.

`python outsider.py drives FOLDER ENDPOINT...` tries to read keys below a folder and to drive a robot by each
endpoint, and prints what came of it as a line of JSON. `python outsider.py holds ENDPOINT` has a place before a router,
and prints whether it has heard anything once it is interrupted.
"""

import json
import signal
import sys
import threading
from pathlib import Path

import zenoh


def session(mode: str, connect: list[str], listen: list[str]) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "connect/endpoints": connect,
        "listen/endpoints": listen,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def drives(endpoint: str) -> bool:
    """Whether one is let in; what is said then is the owner's to see."""
    try:
        opened = session("client", [endpoint], [])
    except zenoh.ZError:
        return False
    opened.put("r1/intruded", b"x")
    opened.close()
    return True


def reads(folder: str) -> bool:
    """Whether a key can be read."""
    try:
        return any("PRIVATE KEY" in file.read_text() for file in Path(folder).rglob("*.pem"))
    except OSError:
        return False


def main() -> None:
    """Do one or the other."""
    how, *words = sys.argv[1:]
    if how == "drives":
        print(json.dumps({"let in": list(map(drives, words[1:])), "read": reads(words[0])}), flush=True)
        return
    opened = session("router", [], words)
    heard = opened.declare_subscriber("**", zenoh.handlers.RingChannel(10))
    over = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: over.set())
    print("there", flush=True)
    over.wait()
    print(json.dumps({"heard": heard.try_recv() is not None}), flush=True)


if __name__ == "__main__":
    main()
