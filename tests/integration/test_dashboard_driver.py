"""What drives robots for pages, without any page."""

from collections.abc import Iterator
from contextlib import closing

import pytest
import zenoh

from robo.dashboard.driver import NEW_GRIP, Driver
from tests.support import eventually

pytestmark = pytest.mark.timeout(30)


@pytest.fixture
def driver(session: zenoh.Session) -> Iterator[Driver]:
    with closing(Driver(session)) as found:
        yield found


def test_a_stop_of_one_robot_ends_no_grip_on_another_one(driver: Driver) -> None:
    grip = driver.drivers().grip
    driver.end("r2")
    assert driver.command("r1", "browser 1", 0.1, 0.0, grip) == "", "though it is its first command"
    assert driver.command("r2", "browser 1", 0.1, 0.0, grip) == NEW_GRIP
    assert driver.command("r2", "browser 1", 0.1, 0.0, driver.drivers().grip) == ""


def test_a_robot_that_is_forgotten_is_not_driven_by_an_old_grip(driver: Driver) -> None:
    grip = driver.drivers().grip
    driver.end("r1")
    for number in range(200):
        driver.end(f"made_up_{number}")
    assert len(driver.drivers().ended) <= 100
    assert driver.command("r1", "browser 1", 0.1, 0.0, grip) == NEW_GRIP


@pytest.mark.parametrize("robot", ["r*", "a" * 60_000, "no robot"])
def test_what_is_no_name_of_a_robot_is_told_to_no_page(driver: Driver, other: zenoh.Session, robot: str) -> None:
    before = driver.drivers()
    driver.end(robot)
    if "*" not in robot:
        other.put(f"{robot}/cmd_vel_dashboard", b"")
    # The first may fill what waits to be sent: then Zenoh drops the next one, unless it is told to wait.
    other.put("r1/cmd_vel_dashboard", b"", congestion_control=zenoh.CongestionControl.BLOCK)
    eventually(lambda: "r1" in driver.drivers().drivers, "who else drives is known")
    found = driver.drivers()
    assert (found.grip, found.ended) == (before.grip, before.ended)
    assert list(found.drivers) == ["r1"]
