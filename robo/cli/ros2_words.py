"""What somebody types who comes from ROS 2, and what robo has in its place. Pure."""

from collections.abc import Sequence

VERBS: dict[str, str] = {
    "component": "nodes share a process where their manifest names one, process: NAME, with nothing to load; robo ps"
    " shows nodes under their process",
    "daemon": "robo needs no daemon: each tool asks the running system itself",
    "launch": "robo up MANIFEST starts what a manifest says; manifests are YAML, see docs/from_ros2_launch.md",
    "msg": "robo interface list shows all types, robo interface show TYPE one; robo interface import PATH makes types"
    " of .msg files",
    "multicast": "robo uses no multicast; robo doctor checks this machine's network, robo net shows who is linked",
    "rosidl": "robo interface import PATH makes Python classes of .msg, .srv and .action files; there is no build step",
    "rqt": "robo has no windows: robo top, robo graph, robo topic plot, robo logs -f and robo param set do that",
    "rqt_console": "robo logs -f --level warn",
    "rqt_graph": "robo graph draws what runs; --svg FILE as a picture, --format mermaid or dot for other programs",
    "rqt_plot": "robo topic plot KEY --field PATH; robo bag plot BAG TOPIC --field PATH of a recording",
    "rqt_reconfigure": "robo param list, describe and set",
    "rviz": "robo view rerun shows frames, scans, paths, maps, pictures, live or of a recording; see docs/viewing.md",
    "srv": "robo interface list shows all types, robo interface show TYPE one; robo interface import PATH makes types"
    " of .srv files",
    "teleop": "robo run robo_services teleop_keyboard --robot-name r1 -r cmd_vel:=cmd_vel_key drives by keys,"
    " teleop_joy with a game pad; see docs/driving.md",
    "tf2": "robo tf tree, robo tf echo TARGET SOURCE and robo tf monitor",
    "wtf": "robo doctor checks this machine, robo why NODE tells why a node is as it is",
}
"""Commands of `ros2`, and programs beside it, that robo calls otherwise or has not."""

GROUP_VERBS: dict[tuple[str, str], str] = {
    ("action", "send_goal"): "robo action send-goal ACTION GOAL, with --feedback for what is told meanwhile",
    ("action", "find"): "robo action list shows the type of each",
    ("bag", "reindex"): "robo bag recover CUT -o WHOLE writes index and summary anew",
    ("interface", "package"): "robo interface list shows the types of all packages",
    ("interface", "packages"): "robo interface list shows the types of all packages",
    ("interface", "proto"): "robo interface show TYPE --json shows the defaults",
    ("pkg", "create"): "robo create NAME makes a package",
    ("pkg", "xml"): "robo pkg show PACKAGE",
    ("param", "delete"): "a node's class declares its parameters: they can be set, and not deleted",
    ("security", "create_enclave"): "robo security add NAME --as ROLE, for a machine or a person; nodes have no keys",
    ("security", "create_key"): "robo security add NAME --as ROLE, for a machine or a person; nodes have no keys",
    ("security", "create_keystore"): "robo security init",
    ("security", "create_permission"): "robo security allow and deny; routers take it over by themselves",
    ("security", "generate_artifacts"): "robo security add NAME --as ROLE, and bundle NAME -o FILE for its machine",
    ("security", "generate_policy"): "robo security allow ROBOT --from MANIFEST, from the contracts of its nodes",
    ("security", "list_enclaves"): "robo security list",
    ("security", "list_keys"): "robo security list",
    ("service", "echo"): "robo has no record of calls; robo node info NODE counts them",
    ("service", "find"): "robo service list shows the type of each",
    ("topic", "kill"): "robo stop NODE ends who publishes it",
}
"""Verbs of `ros2`'s groups that robo's groups of the same name have not."""

_QUALITY = "nodes say it of their topics, and robo topic info shows it; echo begins with what is latched"
OPTIONS: dict[tuple[str, str], dict[str, str]] = {
    ("bag", "play"): {
        "-i": "write the file alone: robo bag play FILE",
        "--input": "write the file alone: robo bag play FILE",
        "-s": "a recording is MCAP; nothing is to be said",
        "--storage": "a recording is MCAP; nothing is to be said",
        "-e": "write --topics with * and **",
        "--regex": "write --topics with * and **",
        "-x": "write --exclude with * and **",
        "--exclude-regex": "write --exclude with * and **",
        "--playback-until-sec": "write --end TIME",
        "--playback-until-nsec": "write --end TIME",
        "--wait-for-all-acked": "nothing is lost where receivers want all; it ends once they have it",
        "--read-ahead-queue-size": "it reads ahead as far as is needed",
        "--qos-profile-overrides-path": "topics are latched as they were; a launch may say more of its subscriptions",
    },
    ("topic", "list"): {"-t": "types are always shown", "--show-types": "types are always shown"},
    ("topic", "info"): {"-v": "everything is always shown", "--verbose": "everything is always shown"},
    ("topic", "echo"): {
        "--no-arr": "write --truncate",
        "--no-str": "write --truncate",
        "-f": "nothing is cut short unless --truncate is said",
        "--full-length": "nothing is cut short unless --truncate is said",
        "--flow-style": "write --json",
        "--qos": _QUALITY,
    },
    ("topic", "pub"): {
        "-1": "write --once; it is what it does without -r",
        "-t": "write --times N",
        "-w": "write --wait-for-subscriber",
        "--wait-matching-subscriptions": "write --wait-for-subscriber",
        "--qos": _QUALITY,
    },
    ("topic", "hz"): {"-w": "write --window S, in seconds"},
    ("topic", "bw"): {"-w": "write --window S, in seconds"},
    ("topic", "delay"): {"-w": "write --window S, in seconds"},
    ("bag", "record"): {
        "-e": "write patterns as topics: 'r1/*', '**/scan'",
        "--regex": "write patterns as topics: 'r1/*', '**/scan'",
        "-x": "write --exclude 'r1/*'",
        "--exclude-regex": "write --exclude 'r1/*'",
        "--exclude-topics": "write --exclude KEY",
        "--topics": "write the topics without an option before them",
        "-b": "write --split-size SIZE",
        "--max-bag-size": "write --split-size SIZE",
        "-d": "write --split-duration S",
        "--max-bag-duration": "write --split-duration S",
        "--max-bag-files": "write --keep N",
        "--max-cache-size": "nothing is to be said: up to 256 MB wait for the disk",
        "-s": "it is always mcap",
        "--storage": "it is always mcap",
        "--compression-mode": "write --compression zstd or none",
        "--compression-format": "write --compression zstd or none",
        "--qos-profile-overrides-path": "no quality of service has to match: everything is received",
    },
    ("node", "list"): {"-a": "all nodes are always shown", "--all": "all nodes are always shown"},
    ("bag", "info"): {"-v": "everything is always shown", "--verbose": "everything is always shown"},
    ("bag", "convert"): {
        "-i": "write robo bag convert FROM -o TO",
        "--input": "write robo bag convert FROM -o TO",
        "--output-options": "write robo bag convert FROM -o TO; robo bag cut, filter and merge make parts",
    },
    ("param", "dump"): {"--output-dir": "write -o FILE", "--print": "it is printed unless -o FILE is said"},
}
"""Options of `ros2` that robo's verbs of the same name have not."""


def about_verb(word: str) -> str | None:
    """What robo has in place of a command of ROS 2; None for what is no such command."""
    family = next((family for family in _FAMILIES if word.startswith(family)), word)
    return VERBS.get(word, VERBS.get(family))


_FAMILIES = ("rviz", "rqt", "teleop", "tf2")
"""Programs with names of their own that begin alike: `rqt_bag`, `teleop_twist_keyboard`, `tf2_echo`."""


def about_group_verb(group: str, word: str) -> str | None:
    """The same of a verb in a group of robo's."""
    return GROUP_VERBS.get((group, word))


def about_option(group: str, verb: str, words: Sequence[str]) -> str | None:
    """What to write in place of the first option of ROS 2 in a command line; None where there is none."""
    known = OPTIONS.get((group, verb), {})
    for word in words:
        name = word.partition("=")[0]
        about = known.get(name) or (known.get("--qos") if name.startswith("--qos-") else None)
        if about is not None:
            return f"{name}: {about}"
    return None
