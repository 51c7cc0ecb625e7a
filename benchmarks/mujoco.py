"""`python -m benchmarks.mujoco`: how many times faster than real time a robot in MuJoCo is; writes MUJOCO.md.

The reference robot drives through the hall with 50 steps a second, of 10 steps of the physics each, without a screen.
**In one thread**: real time over the time that it takes, by the clock on the wall; the plain simulated base and its
laser beside it in the same rounds. `with sensors` is what the node does: odometry of the wheels, the inertial
measurement unit, and ten scans of 360 rays a second. **As a node, as a robot**: `/clock` against the wall, where
`real_time_factor` asks for as much as there is; the robot are the six processes of `simulation.yaml`, which all follow.
"""

import argparse
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path

import zenoh

from benchmarks.__main__ import Spread, machine
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Clock, Header, decode
from robo_services import mjcf, mujoco_pictures, world
from robo_services.kinematics import Pose2
from robo_services.mujoco_laser import MujocoLaser
from robo_services.mujoco_messages import imu_message
from robo_services.mujoco_physics import MujocoBase
from robo_services.simulated_base import DRIVE, BaseLimits, SimulatedBase
from robo_services.simulated_errors import ImuNoise
from robo_services.wheel_odometry import WheelOdometry

RESULTS = Path(__file__).parent / "MUJOCO.md"
PORT = 17449
STEP = 0.02
"""s."""
LIMITS = BaseLimits(
    radius=0.2, max_linear_velocity=1.5, max_angular_velocity=3.0, linear_acceleration=2.0, linear_deceleration=5.0,
    angular_acceleration=6.0,
)  # fmt: skip
HALL = world.load(str(Path(__file__).parents[1] / "config" / "hall.yaml"))
SPEED, TURNING = 0.4, 0.3
"""A circle that touches nothing, m/s and rad/s."""


def new_base() -> MujocoBase:
    """The reference robot in the hall."""
    robot = mjcf.Robot(radius=0.2, wheel_radius=DRIVE.wheel_radius, wheel_separation=DRIVE.wheel_separation)
    return MujocoBase(mjcf.world_mjcf(HALL, friction=1.0), mjcf.robot_mjcf(robot), LIMITS, DRIVE, Pose2())


def new_laser(base: MujocoBase) -> MujocoLaser:
    """What looks around from it."""
    return MujocoLaser(base, rays=360, range_min=0.05, range_max=12.0, noise=0.01, seed=1)


def faster(seconds: float, step: Callable[[int], object]) -> float:
    """How many times faster than real time so many simulated seconds are."""
    begin = time.perf_counter()
    for number in range(round(seconds / STEP)):
        step(number)
    return seconds / (time.perf_counter() - begin)


def with_sensors(base: MujocoBase) -> Callable[[int], None]:
    """A step as the node makes it."""
    laser, odometry, rng = new_laser(base), WheelOdometry(DRIVE), random.Random(1)

    def step(number: int) -> None:
        base.step(SPEED, TURNING, STEP)
        odometry.take_positions(base.wheels[:1], base.wheels[1:2], base.time)
        imu_message(Header(), base.imu, ImuNoise(), rng)
        if number % 5 == 0:
            laser.scan()

    return step


def plain_with_sensors() -> Callable[[int], None]:
    """A step of the plain simulated base."""
    base = SimulatedBase(HALL, LIMITS, Pose2())
    laser = world.Laser(HALL, rays=360, range_min=0.05, range_max=12.0, noise=0.01, seed=1)

    def step(number: int) -> None:
        base.step(SPEED, TURNING, STEP)
        if number % 5 == 0:
            laser.scan(base.pose)

    return step


def in_one_thread(rounds: int, seconds: float) -> Iterator[str]:
    """Rows of the table."""
    base = new_base()
    mujoco, ten = base.mujoco, 10
    ways: dict[str, Callable[[int], object]] = {
        "MuJoCo's physics alone, 500 steps a second": lambda _: mujoco.mj_step(base.model, base.data, ten),
        "the base: its controller, its motors and what it touches too": lambda _: base.step(SPEED, TURNING, STEP),
        "the base with sensors": with_sensors(new_base()),
        "the plain base with its laser": plain_with_sensors(),
    }
    found: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, step in ways.items():
            found[name].append(faster(seconds, step))
    yield from ("| in one thread | times real time |", "|---|---|")
    for name, values in found.items():
        yield f"| {name} | {Spread.of(values).text('.0f')} |"


def scans_and_pictures(rounds: int) -> Iterator[str]:
    """What a scan and a picture take."""
    base = new_base()
    laser = new_laser(base)
    yield from ("| each | ms |", "|---|---|")
    yield f"| scan of 360 rays | {Spread.of([_milliseconds(laser.scan) for _ in range(rounds)]).text('.2f')} |"
    camera = mujoco_pictures.Camera(base, 320, 240)
    positions = base.data.qpos.copy()
    try:
        camera.take(positions)
    except mujoco_pictures.CannotDraw as error:
        yield f"| picture of 320 x 240 | none here: {error} |"
        return
    taken = Spread.of([_milliseconds(lambda: camera.take(positions)) for _ in range(rounds)])
    yield f"| picture of 320 x 240 | {taken.text('.1f')} |"
    camera.close()


def _milliseconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    for _ in range(10):
        work()
    return (time.perf_counter() - begin) * 100


@contextmanager
def running(*words: str) -> Iterator[zenoh.Session]:
    """A robot or a node that listens, and a client of it."""
    command = [sys.executable, "-m", "robo", *words, "--listen", f"tcp/127.0.0.1:{PORT}"]
    with ExitStack() as ends, tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        ends.callback(process.wait, 30)
        ends.callback(process.terminate)
        mode = Network(mode="client", connect=(f"tcp/127.0.0.1:{PORT}",), timeout=60)
        session = open_session(mode)
        ends.callback(close_session, session)
        yield session


def clock_beside_the_wall(session: zenoh.Session, seconds: float) -> float:
    """How fast `/clock` goes, after some seconds in which all nodes begin."""
    newest = [0.0]

    def heard(sample: zenoh.Sample) -> None:
        newest[0] = decode(bytes(sample.payload), Clock).clock.to_seconds()

    subscriber = session.declare_subscriber("clock", heard)
    until = time.monotonic() + 60.0
    while newest[0] < 5.0 and time.monotonic() < until:
        time.sleep(0.1)
    begin, first = time.monotonic(), newest[0]
    time.sleep(seconds)
    found = (newest[0] - first) / (time.monotonic() - begin)
    subscriber.undeclare()
    return found


def as_processes(rounds: int, seconds: float) -> Iterator[str]:
    """What the processes come to."""
    factor = ("real_time_factor:=100.0",)
    node = ("run", "robo_services.mujoco_sim", "-p", "publish_clock:=true", "-p", *factor)
    robot = ("up", "simulation.yaml", "physics:=mujoco", "use_sim_time:=true", *factor)
    plain = ("up", "simulation.yaml", "use_sim_time:=true", *factor)
    yield from ("| as processes | times real time |", "|---|---|")
    for name, words in (
        ("the node alone", node), ("the robot, `physics:=mujoco`", robot), ("the robot, `physics:=plain`", plain)
    ):  # fmt: skip
        found = []
        for _ in range(rounds):
            with running(*words) as session:
                found.append(clock_beside_the_wall(session, seconds))
        yield f"| {name} | {Spread.of(found).text('.1f')} |"


def main() -> None:
    """Measure, print, and write it down."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mujoco", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each round, simulated or by the clock, s")
    asked = parser.parse_args()
    about = machine()
    about[0] = about[0].removesuffix(".") + f", mujoco {version('mujoco')}."
    lines = [
        "# A robot in MuJoCo", "",
        f"Written by `python -m benchmarks.mujoco`: medians over {asked.rounds} rounds (smallest-largest); of the",
        f"processes, over {max(1, asked.rounds // 3)}.", "", *about, *(__doc__ or "").strip().splitlines()[2:], "",
        *in_one_thread(asked.rounds, asked.seconds), "", *scans_and_pictures(asked.rounds), "",
        *as_processes(max(1, asked.rounds // 3), asked.seconds), "",
    ]  # fmt: skip
    RESULTS.write_text("\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
