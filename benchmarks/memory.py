"""A process that has joined a network and waits to be measured: `python -m benchmarks.memory VARIANT ENDPOINT`.

It imports nothing that its variant does not need.
"""

import sys
import time


def main() -> None:
    variant, endpoint = sys.argv[1:3]
    if variant == "raw":
        import zenoh

        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        session = zenoh.open(config)
        time.sleep(0.5)
        say_ready()
        session.close()
        return
    from robo.process.lean import import_msgspec

    import_msgspec()  # as in the process of a node
    from robo.node.loading import load_node_class
    from robo.wire.network import Network
    from robo.wire.session import open_session

    parameters = {"world": "config/room.yaml"} if variant.endswith("sim") else {}
    joined = open_session(Network(mode="peer", connect=(endpoint,)))
    with load_node_class(variant)(session=joined, parameters=parameters):
        time.sleep(0.5)  # its timers tick: what they allocate belongs to the node
        say_ready()
    joined.close()


def say_ready() -> None:
    print("ready", flush=True)
    sys.stdin.readline()


if __name__ == "__main__":
    main()
