#!/bin/sh
# A node in another language: any program that stays in the foreground and ends on SIGINT or SIGTERM.
# The supervisor gives it ROBO_NAMESPACE, ROBO_CONNECT and ROBO_NODE (its parameters and remappings, as JSON), keeps its
# output in the robot's log, and starts it again when it dies.
trap 'echo "INFO  lamp off"; exit 0' INT TERM
echo "INFO  lamp of $ROBO_NAMESPACE on, robot at $ROBO_CONNECT"
while :; do
  sleep 1 &
  wait $!
done
