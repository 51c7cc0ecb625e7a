#!/usr/bin/env bash
# The bridge beside ROS 2 itself: run on a machine with ROS 2 (Jazzy or later), ros-$ROS_DISTRO-rmw-zenoh-cpp and
# robo-zenoh[ros2]. Source ROS's setup before. Prints a line for each thing that was tried; ends with 1 where one failed.
set -u
export RMW_IMPLEMENTATION=rmw_zenoh_cpp ROS_DOMAIN_ID=0
folder=$(mktemp -d)
failed=0
started=()

cleanup() {
    robo down --robot-name r1 >/dev/null 2>&1
    kill "${started[@]}" 2>/dev/null
    rm -rf "$folder"
}
trap cleanup EXIT

# try WHAT PATTERN COMMAND...: what the command prints within 30 s holds the pattern.
try() {
    local what=$1 pattern=$2
    shift 2
    if timeout 30 "$@" 2>&1 | tee "$folder/said" | grep -m1 -E -q "$pattern"; then
        echo "ok     $what"
    else
        echo "FAILED $what: no /$pattern/ in what '$*' says:"
        head -20 "$folder/said"
        failed=1
    fi
}

cat >"$folder/bridged.yaml" <<'YAML'
include: {file: robot.yaml, args: {demo: none}}
bridges:
  ros2:
    topics:
      "**": {ros: /**}
      from_ros: {ros: /from_ros, direction: from_ros}
      latched_from_ros: {ros: /latched_from_ros, direction: from_ros}
      cmd_vel_key: {ros: /cmd_vel, direction: from_ros, depth: 1}
    services:
      "*": /*
YAML

ros2 run rmw_zenoh_cpp rmw_zenohd >"$folder/router" 2>&1 &
started+=($!)
(cd "$folder" && robo up bridged.yaml --robot-name r1 -d --wait) || exit 1

try "nodes are seen" "/r1/safety_monitor" ros2 node list
try "topics are seen" "/odom" ros2 topic list
try "a publisher has its node's name" "diff_drive_sim" ros2 topic info -v /odom
try "odometry is heard" "child_frame_id" ros2 topic echo --once /odom
try "a scan is heard" "angle_min" ros2 topic echo --once /scan
try "what is latched is heard later" "transforms" ros2 topic echo --once --qos-durability transient_local /tf_static
try "transforms are heard" "transforms" ros2 topic echo --once /tf
try "the log is heard" "/r1/" ros2 topic echo --once /rosout
try "a service is called" "success=True" ros2 service call /emergency_stop std_srvs/srv/Trigger
try "and its reset" "success=True" ros2 service call /reset_emergency_stop std_srvs/srv/Trigger
try "parameters are listed" "max_speed" ros2 param list /r1/safety_monitor
try "one is read" "Double value" ros2 param get /r1/safety_monitor max_speed
try "one is described" "Max value|Type: double" ros2 param describe /r1/safety_monitor max_speed
try "one is set" "successful" ros2 param set /r1/safety_monitor max_speed 0.4
try "and is so in robo" "0.4" robo param get /r1/safety_monitor max_speed

timeout 60 ros2 topic pub -r 10 /from_ros std_msgs/msg/String "{data: hello from ROS}" >/dev/null 2>&1 &
started+=($!)
try "a topic of ROS is heard in robo" "hello from ROS" robo topic echo --once r1/from_ros
try "ROS's nodes are seen in robo" "/ros2/" robo node list
timeout 60 ros2 topic pub -r 10 --qos-durability transient_local --qos-depth 1 /latched_from_ros \
    std_msgs/msg/String "{data: kept}" >/dev/null 2>&1 &
started+=($!)
try "a latched topic of ROS is heard in robo" "kept" robo topic echo --once r1/latched_from_ros
timeout 60 ros2 topic pub -r 10 /cmd_vel geometry_msgs/msg/Twist "{linear: {x: 0.2}}" >/dev/null 2>&1 &
started+=($!)
try "ROS drives the robot" "x: 0\.[12]" robo topic echo --once r1/cmd_vel
exit $failed
