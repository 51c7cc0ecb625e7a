"""A world file and the dimensions of a robot as MJCF, the language of MuJoCo's models.

    world_mjcf(world.load("hall.yaml"), friction=1.0)      # a floor, walls, boxes and round things that stand fast
    robot_mjcf(Robot(radius=0.2, wheel_radius=0.05, wheel_separation=0.3))       # two driven wheels and a caster

Pure text: MuJoCo itself is not needed. Whoever writes a robot by himself keeps to the names here.
"""

import math

import msgspec

from robo_services.world import Box, Circle, Segment, World

BASE = "base_link"
"""The body with a free joint: on the ground, in the middle between the wheels, x ahead."""
LEFT, RIGHT = "left_wheel_joint", "right_wheel_joint"
"""The joints of the wheels, which turn forward about y. Each has an actuator that takes a velocity, rad/s."""
LASER = "base_laser"
"""The site from which the laser looks, in its plane of x and y."""
IMU = "imu_link"
"""The site of the inertial measurement unit; where there is none, it is in the base's origin."""
CAMERA = "camera"
"""The camera; only needed where pictures are wanted."""

WALL_HEIGHT = 0.5
"""Of all that stands around, at the least, m."""
HALF_WALL = 0.001
"""A wall has no thickness in a world file; here it is twice this, m."""
CHASSIS_HEIGHT = 0.08
"""m."""
MOTOR_TIME = 0.02
"""In which a wheel's motor comes near to the speed that it is told, s, while its torque suffices."""
GEARED = 0.1
"""The inertia of a motor behind its gear, as a share of that which the base has for it. With it, and `MOTOR_TIME`, a
wheel in the air is stable at steps of up to 5 ms."""
WHEEL_SHARE = 0.04
"""Of the mass, in each wheel."""


class Robot(msgspec.Struct, frozen=True, kw_only=True):
    """A round base on two driven wheels and a caster behind."""

    radius: float
    """Of the base, m."""
    wheel_radius: float
    """m."""
    wheel_separation: float
    """Between the middles of the wheels, m."""
    mass: float = 5.0
    """All together, kg."""
    max_wheel_torque: float = 2.0
    """Of each motor, N·m."""

    @property
    def laser_height(self) -> float:
        """Above the ground, m."""
        return self._top + 0.03

    @property
    def _bottom(self) -> float:
        return 0.6 * self.wheel_radius

    @property
    def _top(self) -> float:
        return self._bottom + CHASSIS_HEIGHT


def world_mjcf(world: World, *, friction: float, height: float = WALL_HEIGHT) -> str:
    """A world that stands fast on an endless floor.

    Args:
        world: what stands around.
        friction: of the floor under a wheel: the force along it over the one that presses on it.
        height: of everything, m.

    Raises:
        ValueError: a number is not finite.
    """
    things = [_wall(number, wall, height) for number, wall in enumerate(world.walls)]
    things += [_box(number, box, height) for number, box in enumerate(world.boxes)]
    things += [_circle(number, circle, height) for number, circle in enumerate(world.circles)]
    lines = "\n    ".join(things)
    # The extent is what cameras see from 1 % of it to 50 times as far.
    # An elliptic cone with a high impratio, and stiff contacts, keep wheels from creeping while they grip. The implicit
    # integrators take the motors' damping into account only after the contacts: their wheels lag while they speed up.
    return f"""<mujoco model="world">
  <option cone="elliptic" impratio="10" integrator="Euler"/>
  <statistic extent="5"/>
  <visual><headlight ambient=".4 .4 .4" diffuse=".3 .3 .3"/></visual>
  <asset>
    <texture name="floor" type="2d" builtin="checker" rgb1=".75 .75 .75" rgb2=".6 .6 .6" width="256" height="256"/>
    <material name="floor" texture="floor" texrepeat="1 1" texuniform="true"/>
    <texture type="skybox" builtin="gradient" rgb1=".6 .75 .9" rgb2="1 1 1" width="64" height="384"/>
  </asset>
  <worldbody>
    <light directional="true" diffuse=".6 .6 .6" pos="0 0 5" dir=".3 .2 -1" castshadow="false"/>
    <geom name="floor" type="plane" size="0 0 1" material="floor" friction="{_n(friction)} 0.005 0.0001" {_STIFF}/>
    {lines}
  </worldbody>
</mujoco>
"""


def robot_mjcf(robot: Robot) -> str:
    """A robot whose wheels have motors: their actuators take velocities, rad/s.

    Each wheel touches the floor in one point, in its middle, so that the separation is exact. Its friction is the
    floor's. The weight is low and a little behind the axle, on the caster; a skid in front, which does not reach the
    ground, holds it when it brakes hard.
    """
    wheel, half = robot.wheel_radius, robot.wheel_separation / 2
    body = robot.mass * (1 - 2 * WHEEL_SHARE)
    flat, upright = _inertia(body, robot.radius)
    caster = min(0.02, wheel / 2, robot.radius / 4)
    behind = 0.75 * robot.radius
    gain = _moved(robot) / MOTOR_TIME
    middle = (robot._bottom + robot._top) / 2
    wheels = "\n      ".join(_wheel(side, y, robot) for side, y in (("left", half), ("right", -half)))
    motors = "\n    ".join(
        f'<velocity name="{joint}" joint="{joint}" kv="{_n(gain)}" '
        f'forcerange="{_n(-robot.max_wheel_torque)} {_n(robot.max_wheel_torque)}"/>'
        for joint in (LEFT, RIGHT)
    )
    return f"""<mujoco model="robot">
  <worldbody>
    <body name="{BASE}">
      <freejoint name="{BASE}"/>
      <inertial pos="{_n(-0.2 * robot.radius)} 0 {_n(wheel)}" mass="{_n(body)}"
                diaginertia="{_n(flat)} {_n(flat)} {_n(upright)}"/>
      <geom name="chassis" type="cylinder" size="{_n(robot.radius)} {_n(CHASSIS_HEIGHT / 2)}" pos="0 0 {_n(middle)}"
            rgba=".35 .4 .5 1" friction="0.3 0.005 0.0001"/>
      <geom name="caster" type="sphere" size="{_n(caster)}" pos="{_n(-behind)} 0 {_n(caster)}" rgba=".1 .1 .1 1"
            condim="1" priority="1" {_STIFF}/>
      <geom name="skid" type="sphere" size="{_n(caster)}" pos="{_n(behind)} 0 {_n(1.1 * caster)}" rgba=".1 .1 .1 1"
            condim="1" priority="1" {_STIFF}/>
      <geom name="laser" type="cylinder" size="{_n(min(0.04, robot.radius / 3))} 0.03" pos="0 0 {_n(robot._top + 0.03)}"
            rgba=".1 .1 .1 1" contype="0" conaffinity="0" mass="0"/>
      <site name="{LASER}" pos="0 0 {_n(robot.laser_height)}" rgba="0 0 0 0"/>
      <site name="{IMU}" pos="0 0 {_n(wheel)}" rgba="0 0 0 0"/>
      <camera name="{CAMERA}" pos="{_n(0.8 * robot.radius)} 0 {_n(robot._top + 0.05)}" xyaxes="0 -1 0 0 0 1" fovy="60"/>
      {wheels}
    </body>
  </worldbody>
  <actuator>
    {motors}
  </actuator>
</mujoco>
"""


_STIFF = 'solref="0.004 1" solimp="0.95 0.99 0.001"'
"""How contacts with the floor give way: by some hundredths of a millimetre."""


def _wheel(side: str, y: float, robot: Robot) -> str:
    radius = robot.wheel_radius
    width = min(0.015, radius / 2)
    mass = WHEEL_SHARE * robot.mass
    flat, round_ = mass * radius**2 / 4, mass * radius**2 / 2
    return f"""<body name="{side}_wheel" pos="0 {_n(y)} {_n(radius)}">
        <joint name="{side}_wheel_joint" type="hinge" axis="0 1 0" armature="{_n(GEARED * _moved(robot))}"/>
        <inertial pos="0 0 0" mass="{_n(mass)}" diaginertia="{_n(flat)} {_n(round_)} {_n(flat)}"/>
        <geom name="{side}_wheel" type="ellipsoid" size="{_n(radius)} {_n(width)} {_n(radius)}" rgba=".1 .1 .1 1"
              friction="0.001 0.005 0.0001" {_STIFF}/>
      </body>"""


def _moved(robot: Robot) -> float:
    """What each wheel moves of the base when it drives straight, as an inertia of the wheel, kg·m²."""
    return robot.mass * robot.wheel_radius**2 / 2


def _wall(number: int, wall: Segment, height: float) -> str:
    x1, y1, x2, y2 = wall
    half = math.hypot(x2 - x1, y2 - y1) / 2 + HALF_WALL
    yaw = math.atan2(y2 - y1, x2 - x1)
    return _upright(f"wall_{number}", (x1 + x2) / 2, (y1 + y2) / 2, yaw, (half, HALF_WALL), height, ".8 .8 .75 1")


def _box(number: int, box: Box, height: float) -> str:
    half = box.size[0] / 2, box.size[1] / 2
    return _upright(f"box_{number}", *box.center, box.yaw, half, height, ".7 .5 .3 1")


def _upright(name: str, x: float, y: float, yaw: float, half: tuple[float, float], height: float, rgba: str) -> str:
    quat = f"{_n(math.cos(yaw / 2))} 0 0 {_n(math.sin(yaw / 2))}"
    size = f"{_n(half[0])} {_n(half[1])} {_n(height / 2)}"
    place = f'pos="{_n(x)} {_n(y)} {_n(height / 2)}" quat="{quat}"'
    return f'<geom name="{name}" type="box" size="{size}" {place} rgba="{rgba}"/>'


def _circle(number: int, circle: Circle, height: float) -> str:
    x, y = circle.center
    return (
        f'<geom name="circle_{number}" type="cylinder" size="{_n(circle.radius)} {_n(height / 2)}" '
        f'pos="{_n(x)} {_n(y)} {_n(height / 2)}" rgba=".3 .5 .7 1"/>'
    )


def _inertia(mass: float, radius: float) -> tuple[float, float]:
    """Of a cylinder about its own middle, across and along its axis, kg·m²."""
    return mass * (3 * radius**2 + CHASSIS_HEIGHT**2) / 12, mass * radius**2 / 2


def _n(value: float) -> str:
    """A number to its last digit, so that the same world is the same text everywhere."""
    if not math.isfinite(value):
        raise ValueError(f"a number in it is {value}")
    return repr(float(value))
