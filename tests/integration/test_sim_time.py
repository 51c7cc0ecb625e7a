"""Simulated time: everybody follows it, however fast it runs."""

import bisect
import math

import msgspec
import pytest
import zenoh

from robo import Node, Publisher, timer
from robo.testing.heard import Heard
from robo_messages import Clock, String, Time, Twist, Vector3
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.safety_monitor import SafetyMonitor
from robo_services.velocity_controller import VelocityController
from tests.support import PATIENCE, eventually, is_heard


class Ticker(Node):
    """Says when it ticks."""

    out = Publisher(String, "ticks")

    @timer(rate=10.0)
    def tick(self) -> None:
        self.logger.warning("tick", throttle=1.0)
        self.out.publish(String(f"{self.now().to_nanoseconds() / 1e9:.1f}"))


def test_a_node_follows_the_clock_topic(session: zenoh.Session, other: zenoh.Session) -> None:
    with Ticker(namespace="r1", parameters={"use_sim_time": True}, session=session):
        heard = Heard(other, "r1/*")
        clock = other.declare_publisher("clock")
        eventually(lambda: is_heard(clock), "it listens to /clock")
        for i in range(1, 31):
            clock.put(msgspec.msgpack.encode(Clock(Time.from_seconds(100 + i / 10))))
            heard.wait_for_count("r1/ticks", i, PATIENCE)
        assert [tick.data for tick in heard.messages("r1/ticks")] == [f"{100 + i / 10:.1f}" for i in range(1, 31)]
        heard.wait_for_count("r1/log", 3, PATIENCE)
        assert {record.stamp.sec for record in heard.messages("r1/log")} <= {100, 101, 102, 103}
        heard.close()


def drive(
    session: zenoh.Session, other: zenoh.Session, factor: float, seconds: float
) -> list[tuple[float, float, float]]:
    """Where the robot was at each time: s, m, m."""
    name = f"x{factor:g}".replace(".", "_")
    simulator = DiffDriveSim(
        namespace=name,
        parameters={"publish_clock": True, "real_time_factor": factor, "laser": False},
        remappings={"/clock": f"/{name}/clock"},
        session=session,
    )
    controller = VelocityController(
        namespace=name,
        parameters={"use_sim_time": True, "linear_velocity": 0.2, "publish_rate": 50.0},
        remappings={"/clock": f"/{name}/clock"},
        session=session,
    )
    heard = Heard(other, f"{name}/odom")
    with controller, simulator:
        heard.wait_for(f"{name}/odom", lambda odometry: odometry.header.stamp.sec >= seconds, PATIENCE)
    heard.close()
    return [
        (one.header.stamp.to_nanoseconds() * 1e-9, one.pose.pose.position.x, one.pose.pose.position.y)
        for one in heard.messages(f"{name}/odom")
    ]


def test_ten_times_as_fast_is_the_same_drive(session: zenoh.Session, other: zenoh.Session) -> None:
    slow = drive(session, other, 2.0, 6)
    fast = drive(session, other, 10.0, 6)
    assert [round(t, 3) for t, _, _ in fast[1:50]] == [round(fast[0][0] + i * 0.02, 3) for i in range(1, 50)]
    times = [t for t, _, _ in slow]
    for t, x, y in fast:
        if 0.5 < t < 6:
            _, other_x, other_y = slow[min(bisect.bisect_left(times, t - 1e-6), len(slow) - 1)]
            # At ten times the speed a thread that waits 150 ms for a busy processor is 1.5 s late, at 0.2 m/s.
            assert math.hypot(x - other_x, y - other_y) < 0.3, t
    assert fast[-1][1] ** 2 + fast[-1][2] ** 2 == pytest.approx(slow[-1][1] ** 2 + slow[-1][2] ** 2, rel=0.5)


def test_a_command_from_before_the_time_stepped_back_moves_nothing(
    session: zenoh.Session, other: zenoh.Session
) -> None:
    """The simulator was started again, or a log begins anew."""
    parameters = {"use_sim_time": True, "laser": False}
    with SafetyMonitor(namespace="r1", parameters=parameters, session=session):
        heard = Heard(other, "r1/*")
        clock = other.declare_publisher("clock")
        eventually(lambda: is_heard(clock), "it listens to /clock")
        time = 100.0

        def reaches(wanted: float, *, commanded: bool) -> None:
            heard.clear()

            def there() -> bool:
                nonlocal time
                time += 0.02
                clock.put(msgspec.msgpack.encode(Clock(Time.from_seconds(time))))
                if commanded:
                    other.put("r1/cmd_vel_raw", msgspec.msgpack.encode(Twist(Vector3(x=0.4))))
                commands = heard.messages("r1/cmd_vel")
                return bool(commands) and commands[-1].linear.x == wanted

            eventually(there, f"{wanted} m/s")

        reaches(0.4, commanded=True)
        time = 1.0
        reaches(0.0, commanded=False)
        assert time < 99.0
        heard.wait_for("r1/safety_state", lambda state: state.values[1].value == "stale_command", PATIENCE)
        reaches(0.4, commanded=True)
        heard.close()
