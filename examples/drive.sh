#!/bin/sh
# Drive a robot with JSON from a shell: drive.sh [ROBOT] [SPEED in m/s]
#
# It comes before what the robot does by itself, which goes on when no command has come for half a second.
#
# With a router that has Zenoh's REST plugin (zenohd, the eclipse/zenoh image), ZENOH_REST=http://HOST:8000 is enough:
# curl alone does it. Without one, python3 with eclipse-zenoh puts the same bytes.
set -eu
key="${1:-r1}/cmd_vel_key"
command="{\"linear\": {\"x\": ${2:-0.2}}}"
if [ -n "${ZENOH_REST:-}" ]; then
  exec curl --fail --silent --show-error -X PUT -H 'content-type: application/json' -d "$command" "$ZENOH_REST/$key"
fi
exec "${PYTHON:-python3}" - "$key" "$command" "${ROBO_CONNECT:-unixsock-stream//tmp/robo-$(id -u)/router.sock}" <<'PYTHON'
import json, sys, zenoh
key, command, endpoint = sys.argv[1:]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
with zenoh.open(config) as session:
    session.put(key, command, encoding="application/json")
    print(f"{key}: {command}")
PYTHON
