"""World files and dimensions of robots as MJCF: text alone, without MuJoCo."""

import math
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_services import mjcf, world
from robo_services.mjcf import HALF_WALL, WALL_HEIGHT, Robot, robot_mjcf, world_mjcf
from robo_services.world import Box, Circle, World

CONFIG = Path(__file__).parents[2] / "config"
coordinates = st.floats(-1e3, 1e3)
sizes = st.floats(1e-3, 1e3)
worlds = st.builds(
    World,
    walls=st.lists(st.tuples(coordinates, coordinates, coordinates, coordinates), max_size=4).map(tuple),
    boxes=st.lists(
        st.builds(Box, st.tuples(coordinates, coordinates), st.tuples(sizes, sizes), st.floats(-10, 10)), max_size=4
    ).map(tuple),
    circles=st.lists(st.builds(Circle, st.tuples(coordinates, coordinates), sizes), max_size=4).map(tuple),
)


def numbers(element: ElementTree.Element, name: str) -> list[float]:
    return [float(word) for word in element.attrib[name].split()]


def geoms(text: str) -> dict[str, ElementTree.Element]:
    return {geom.attrib["name"]: geom for geom in ElementTree.fromstring(text).iter("geom")}


@given(worlds, st.floats(0, 10), st.floats(0.01, 100))
def test_all_that_stands_around_stands_in_it_to_the_last_digit(around: World, friction: float, height: float) -> None:
    found = geoms(world_mjcf(around, friction=friction, height=height))
    assert len(found) == 1 + len(around.walls) + len(around.boxes) + len(around.circles)
    assert numbers(found.pop("floor"), "friction")[0] == friction
    for geom in found.values():
        assert numbers(geom, "pos")[2] == numbers(geom, "size")[-1] == height / 2, "it stands on the floor"
        assert all(size > 0 for size in numbers(geom, "size"))
    for number, circle in enumerate(around.circles):
        geom = found[f"circle_{number}"]
        assert (*numbers(geom, "pos")[:2],) == circle.center
        assert numbers(geom, "size")[0] == circle.radius
    for number, (x1, y1, x2, y2) in enumerate(around.walls):
        geom = found[f"wall_{number}"]
        (x, y, _), (half, thick, _), (w, _, _, z) = (numbers(geom, name) for name in ("pos", "size", "quat"))
        assert thick == HALF_WALL
        yaw = 2 * math.atan2(z, w)
        ahead = half - HALF_WALL
        ends = (
            x - ahead * math.cos(yaw),
            y - ahead * math.sin(yaw),
            x + ahead * math.cos(yaw),
            y + ahead * math.sin(yaw),
        )
        assert ends == pytest.approx((x1, y1, x2, y2), abs=1e-6)
    for number, box in enumerate(around.boxes):
        geom = found[f"box_{number}"]
        w, _, _, z = numbers(geom, "quat")
        assert math.remainder(2 * math.atan2(z, w) - box.yaw, math.tau) == pytest.approx(0, abs=1e-9)
        assert (*(2 * half for half in numbers(geom, "size")[:2]),) == box.size


@given(st.floats(0.01, 10), st.floats(0.01, 10), st.floats(0.01, 10), st.floats(0.1, 1000))
def test_a_robot_has_its_mass_and_stands_on_its_wheels(
    radius: float, wheel_radius: float, separation: float, mass: float
) -> None:
    robot = Robot(radius=radius, wheel_radius=wheel_radius, wheel_separation=separation, mass=mass)
    tree = ElementTree.fromstring(robot_mjcf(robot))
    masses = [float(one.attrib["mass"]) for one in tree.iter("inertial")]
    assert sum(masses) == pytest.approx(mass)
    for one in tree.iter("inertial"):
        a, b, c = sorted(numbers(one, "diaginertia"))
        assert a > 0
        assert a + b >= c * (1 - 1e-9), "what has mass has no such inertia"
    bodies = {body.attrib["name"]: body for body in tree.iter("body")}
    for side, y in (("left", separation / 2), ("right", -separation / 2)):
        assert numbers(bodies[f"{side}_wheel"], "pos") == [0, y, wheel_radius]
    motors = {motor.attrib["joint"]: motor for motor in tree.iter("velocity")}
    assert {*motors} == {mjcf.LEFT, mjcf.RIGHT}
    assert all(float(motor.attrib["kv"]) > 0 for motor in motors.values())
    parts = {geom.attrib["name"]: geom for geom in tree.iter("geom")}
    caster, skid = parts["caster"], parts["skid"]
    assert numbers(caster, "pos")[2] == numbers(caster, "size")[0], "it touches the ground"
    assert numbers(skid, "pos")[2] > numbers(skid, "size")[0], "it does not"


def test_the_hall_is_higher_than_the_laser_looks() -> None:
    hall = world.load(str(CONFIG / "hall.yaml"))
    found = geoms(world_mjcf(hall, friction=1.0))
    robot = Robot(radius=0.2, wheel_radius=0.05, wheel_separation=0.3)
    assert len(found) == 10
    assert WALL_HEIGHT == 2 * numbers(found["wall_0"], "size")[2] > robot.laser_height
