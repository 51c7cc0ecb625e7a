"""The hashes that ROS 2 itself gives types, as others have published them; tests/published_hashes.txt says who."""

import re
from pathlib import Path

import pytest

import robo_messages
from robo.cli.views.interface import print_type
from robo.errors import UsageError
from robo.interfaces import catalogue
from robo.interfaces.ros_names import full_name, made_of
from robo.interfaces.type_hash import type_hash
from robo_messages import Header, Message, message
from tests.random_messages import SHIPPED

MADE = {
    "service": ("", "_Request", "_Response", "_Event"),
    "action": (
        "", "_Goal", "_Result", "_Feedback", "_FeedbackMessage",
        "_SendGoal", "_SendGoal_Request", "_SendGoal_Response", "_SendGoal_Event",
        "_GetResult", "_GetResult_Request", "_GetResult_Response", "_GetResult_Event",
    ),
}  # fmt: skip
"""What ROS makes of a service and of an action, as the names end."""


def published() -> dict[str, tuple[str, str]]:
    """Hash and source by name in ROS."""
    found: dict[str, tuple[str, str]] = {}
    source = ""
    for line in (Path(__file__).parents[1] / "published_hashes.txt").read_text().splitlines():
        if line.startswith("# source: "):
            source = line.rpartition(" ")[2]
        elif line and not line.startswith("#"):
            name, digits = line.split()
            found[name] = digits, source
    return found


def names() -> dict[str, tuple[str, catalogue.Kind | None]]:
    """What robo calls each type that ships, and those that ROS makes of them, by name in ROS."""
    found: dict[str, tuple[str, catalogue.Kind | None]] = {full_name("std/Empty", "service"): ("std/Empty", "service")}
    for name in SHIPPED:
        whole, kind = catalogue.whole_of(name)
        for made in (f"{whole}{ending}" for ending in MADE.get(kind, ("",))):
            found[full_name(made, kind if made == whole else None)] = made, None
    return found


PUBLISHED, NAMES = published(), names()


@pytest.mark.parametrize("ros_name", PUBLISHED)
def test_a_type_has_the_hash_that_ros_gives_it(ros_name: str) -> None:
    digits, source = PUBLISHED[ros_name]
    assert source.startswith("https://")
    assert type_hash(*NAMES[ros_name]) == f"RIHS01_{digits}"


def test_most_of_what_ships_is_published() -> None:
    whole = {name for name, _ in (NAMES[one] for one in PUBLISHED)} & {catalogue.whole_of(name)[0] for name in SHIPPED}
    assert len(whole) >= 100
    assert len({source for _, source in PUBLISHED.values()}) == 3


@pytest.mark.parametrize("ros_name", NAMES)
def test_all_that_ros_makes_of_a_type_has_a_hash(ros_name: str) -> None:
    assert re.fullmatch("RIHS01_[0-9a-f]{64}", type_hash(*NAMES[ros_name]))


def test_what_is_made_of_what() -> None:
    assert made_of("example/Fibonacci_SendGoal_Request") == ("example/Fibonacci", "action")
    assert made_of("example/Fibonacci_FeedbackMessage") == ("example/Fibonacci", "action")
    assert made_of("std/Trigger_Event") == ("std/Trigger", "service")
    assert made_of("std/Trigger_Request") is None
    assert made_of("nav/Odometry_Event") is None
    assert full_name("std/Trigger_Event") == "std_srvs/srv/Trigger_Event"
    assert full_name("example/Fibonacci_GetResult") == "example_interfaces/action/Fibonacci_GetResult"


def test_a_message_may_be_called_as_what_ros_makes() -> None:
    @message("test_hashes/Door_Event")
    class DoorEvent(Message):
        header: Header | None = None

    assert full_name("test_hashes/Door_Event") == "test_hashes/msg/Door_Event"
    assert type_hash("test_hashes/Door_Event") == type_hash(robo_messages.type_name(DoorEvent))


def test_its_hash_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    print_type("nav2/FollowWaypoints_SendGoal", "type_hash")
    assert capsys.readouterr().out == f"RIHS01_{PUBLISHED['nav2_msgs/action/FollowWaypoints_SendGoal'][0]}\n"
    with pytest.raises(UsageError, match="ROS makes std/Trigger_Event of std/Trigger: only its --type-hash is there"):
        print_type("std/Trigger_Event", "ros")
