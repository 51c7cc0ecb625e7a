"""Sends a goal to the action `fibonacci` of a robot, prints its feedback and its result. Knows nothing of robo.

    python fibonacci_client.py [ROBOT] [ORDER] [ENDPOINT]

Needs `pip install eclipse-zenoh msgpack`.
"""

import os
import sys
import uuid

import msgpack
import zenoh

mine = f"unixsock-stream//tmp/robo-{os.getuid()}/router.sock"  # where your robots meet
robot, order, endpoint = (*sys.argv[1:], *("r1", "5", mine)[len(sys.argv) - 1 :])
action = f"{robot}/fibonacci/_action"
goal_id = {"uuid": uuid.uuid4().bytes}


def ask(session: zenoh.Session, part: str, request: dict[str, object], timeout: float) -> dict[str, object]:
    """The answer to a question; the timeout is in s."""
    for reply in session.get(f"{action}/{part}", payload=msgpack.packb(request), timeout=timeout):
        if reply.ok is not None:
            return msgpack.unpackb(reply.ok.payload.to_bytes())
        raise SystemExit(f"{part}: {reply.err.payload.to_bytes()!r}")
    raise SystemExit(f"{part}: nobody answers on {action}")


def on_feedback(sample: zenoh.Sample) -> None:
    """Print how far our goal is."""
    message = msgpack.unpackb(sample.payload.to_bytes())
    if message["goal_id"] == goal_id:
        print("so far", message["feedback"]["sequence"])


config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{endpoint}"]')
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber(f"{action}/feedback", on_feedback)
    answer = ask(session, "send_goal", {"goal_id": goal_id, "goal": {"order": int(order)}}, timeout=5)
    if not answer["accepted"]:
        raise SystemExit(f"refused: {answer['message']}")
    try:
        answer = ask(session, "get_result", {"goal_id": goal_id}, timeout=3600)
    except KeyboardInterrupt:
        ask(session, "cancel_goal", {"goal_info": {"goal_id": goal_id}}, timeout=5)
        answer = ask(session, "get_result", {"goal_id": goal_id}, timeout=10)
    print({4: "succeeded", 5: "canceled", 6: "aborted"}.get(answer["status"], "lost"), answer["result"]["sequence"])
