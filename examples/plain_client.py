"""A robot from any Zenoh client: pip install eclipse-zenoh msgpack; python plain_client.py [ROBOT [ENDPOINT]].

Reads where the robot is, resets its odometer, and has it drive its course more slowly. To drive it yourself, publish on
cmd_vel_key, as drive.sh does: the robot's mux puts that first.
"""

import json
import os
import struct
import sys
import time
from typing import Any

import msgpack
import zenoh

MINE = f"unixsock-stream//tmp/robo-{os.getuid()}/router.sock"
"""Where the robots of whoever runs this meet."""


def ask(session: zenoh.Session, key: str, request: dict[str, Any]) -> Any:
    """Ask a service, or a node for its parameters: a query whose payload is the request, answered once."""
    for reply in session.get(key, payload=msgpack.packb(request), encoding="application/msgpack", timeout=2.0):
        answer = reply.ok if reply.ok is not None else reply.err
        return msgpack.unpackb(answer.payload.to_bytes()) if answer is not None else None
    return None


def main() -> None:
    """Talk to a robot."""
    given = dict(enumerate(sys.argv))
    robot, endpoint = given.get(1, "r1"), given.get(2, MINE)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session:
        odometry = session.declare_subscriber(f"{robot}/odom")
        sample = odometry.recv()
        message = msgpack.unpackb(sample.payload.to_bytes())
        print("encoding ", sample.encoding)  # application/msgpack;nav/Odometry
        print("position ", message["pose"]["pose"]["position"])
        if sample.attachment is not None:
            number, published = struct.unpack_from("<qq", sample.attachment.to_bytes())
            print("number   ", number, "published at", time.ctime(published / 1e9))

        print("reset    ", ask(session, f"{robot}/reset_distance", {}))
        print("set      ", ask(session, f"{robot}/waypoint_follower/parameters/set", {"speed": 0.3}))
        print("refused  ", ask(session, f"{robot}/waypoint_follower/parameters/set", {"speed": 999}))
        print("get      ", ask(session, f"{robot}/waypoint_follower/parameters/get", {"names": ["speed"]}))


if __name__ == "__main__":
    main()
