"""The filter as a node: what it makes of what comes, late or not at all, and what it says of it."""

import math
import re
from collections.abc import Callable
from typing import Any

import pytest

from robo import ContractError, ParameterError
from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import (
    Header,
    Imu,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Time,
    Trigger,
    Twist,
    TwistWithCovariance,
    TwistWithCovarianceStamped,
    Vector3,
)
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.ekf import Measurement
from robo_services.ekf_filter import EkfFilter
from robo_services.planar import quaternion_from_yaw, yaw_from_quaternion

PERIOD = 0.02
OK, WARN, ERROR = 0, 1, 2
SOURCES: dict[str, Any] = {
    "wheels": {"topic": "odom", "use": ["vx", "vyaw"]},
    "imu": {"topic": "imu", "type": "imu", "use": ["vyaw"]},
}
SURE = tuple(1e-4 if i % 7 == 0 else 0.0 for i in range(36))

Filter = NodeUnderTest[EkfFilter]


def stamp(clock: Clock, ago: float = 0.0) -> Time:
    return Time.from_nanoseconds(clock.now().to_nanoseconds() - round(ago * 1e9))


def odometry(
    clock: Clock, vx: float = 0.5, vyaw: float = 0.0, *, ago: float = 0.0, child: str = "base_link"
) -> Odometry:
    twist = TwistWithCovariance(Twist(Vector3(vx), Vector3(z=vyaw)), SURE)
    return Odometry(Header(stamp(clock, ago), "odom"), child, twist=twist)


def imu(clock: Clock, vyaw: float = 0.0, *, ago: float = 0.0) -> Imu:
    said = Imu(Header(stamp(clock, ago), "base_link"), angular_velocity=Vector3(z=vyaw))
    said.orientation_covariance = (-1.0, *(0.0,) * 8)
    said.angular_velocity_covariance = tuple(1e-6 if i % 4 == 0 else 0.0 for i in range(9))
    return said


def pose_at(clock: Clock, x: float, y: float, yaw: float, frame: str = "odom") -> PoseWithCovarianceStamped:
    pose = PoseWithCovariance(Pose(Point(x, y), quaternion_from_yaw(yaw)), SURE)
    return PoseWithCovarianceStamped(Header(clock.now(), frame), pose)


def drive(
    node: Filter, clock: Clock, seconds: float, vx: float = 0.5, vyaw: float = 0.0, *, delay: float = 0.0
) -> None:
    """Wheels at 50 Hz, a gyro at 100 Hz; what wheels say takes `delay` s more."""
    for _ in range(round(seconds / PERIOD)):
        clock.advance(PERIOD / 2)
        node.send("imu", imu(clock, vyaw))
        clock.advance(PERIOD / 2)
        node.send("imu", imu(clock, vyaw))
        node.send("odom", odometry(clock, vx, vyaw, ago=delay))


def told(node: Filter) -> list[Odometry]:
    return node.published(EkfFilter.filtered)


def place(said: Odometry) -> tuple[float, float, float]:
    pose = said.pose.pose
    return pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation)


def health(node: Filter) -> tuple[int, str]:
    report = node.published("diagnostics")[-1]
    return next((one.level, one.message) for one in report.status if one.name.endswith(": sources"))


def test_wheels_and_a_gyro_become_one_odometry(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    drive(node, clock, 4.0, 0.5, 0.2)
    clock.advance(0.05)
    last = told(node)[-1]
    radius, turned = 0.5 / 0.2, 0.2 * (4.0 - PERIOD / 2)
    x, y, yaw = place(last)
    assert (x, y) == pytest.approx((radius * math.sin(turned), radius * (1 - math.cos(turned))), abs=0.02)
    assert yaw == pytest.approx(turned, abs=0.005)
    assert (last.header.frame_id, last.child_frame_id) == ("odom", "base_link")
    assert 28 <= len(told(node)) / 4.0 <= 31
    frame = node.published("tf")[-1].transforms[0]
    assert (frame.header, frame.child_frame_id) == (last.header, "base_link")
    assert frame.transform.translation.x == pytest.approx(x)
    assert health(node) == (OK, "")


def test_wheels_that_slip_are_outvoted_by_the_gyro(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    for _ in range(100):
        clock.advance(PERIOD)
        node.send("imu", imu(clock, 0.1))
        node.send("odom", odometry(clock, 0.5, 0.9))
    clock.advance(0.05)
    assert place(told(node)[-1])[2] == pytest.approx(0.2, abs=0.05)


def test_what_comes_late_is_put_where_it_belongs(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    drive(node, clock, 1.0, 0.5)
    drive(node, clock, 1.0, 0.5, delay=0.1)
    clock.advance(0.05)
    assert place(told(node)[-1])[0] == pytest.approx(1.0, abs=0.03)
    stamps = [one.header.stamp.to_nanoseconds() for one in told(node)]
    assert stamps == sorted({*stamps})
    assert node.node._ekf.replayed > 50
    assert not node.node._ekf.late
    drive(node, clock, 0.2, 5.0, delay=0.6)
    clock.advance(0.05)
    assert node.node._ekf.late["wheels"] > 0
    assert told(node)[-1].twist.twist.linear.x == pytest.approx(0.5, abs=0.1)


def test_without_wheels_it_is_silent_and_goes_on_where_it_was(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    drive(node, clock, 1.0, 0.5)
    before = told(node)[-1]
    node.clear()
    for _ in range(200):
        clock.advance(PERIOD)
        node.send("imu", imu(clock, 0.0))
    assert len(told(node)) <= 9, "for sensor_timeout it goes on"
    assert health(node) == (ERROR, "silent: nothing new of how far it drives on odom")
    assert "silent: nothing new of how far it drives on odom" in caplog.text
    node.clear()
    drive(node, clock, 0.5, 0.0)
    after = told(node)[-1]
    assert place(after)[0] == pytest.approx(place(before)[0], abs=0.2)
    assert after.pose.covariance[0] > 1.0, "it may have driven on for 4 s"
    assert "goes on" in caplog.text
    clock.advance(1.0)


def unmeasured(clock: Clock) -> Odometry:
    said = odometry(clock, 0.0)
    said.twist.covariance = (1e6, *said.twist.covariance[1:])
    return said


def too_alike(clock: Clock) -> Odometry:
    said = odometry(clock, 0.0)
    said.twist.covariance = tuple(1e-4 if i % 7 == 0 else 2e-4 for i in range(36))
    return said


UNUSABLE: dict[str, tuple[Callable[[Clock], Odometry], str]] = {
    "not finite": (lambda clock: odometry(clock, math.nan), r"nothing new of .* \(wheels: vx = nan\)"),
    "infinite": (lambda clock: odometry(clock, math.inf), r"nothing new of .* \(wheels: vx = inf\)"),
    "long ago": (lambda clock: odometry(clock, 0.0, ago=2.0), r"wheels: its stamp is 2 s behind the clock here"),
    "late": (
        lambda clock: odometry(clock, 0.0, ago=1.0),
        r"how far it drives is not believed \(wheels: 0\.98 s late\)",
    ),
    "a bit late": (lambda clock: odometry(clock, 0.0, ago=0.5), r"is not believed \(wheels: 0\.48 s late\)"),
    "not measured": (unmeasured, r"nothing new of how far it drives on odom"),
    "no covariance": (too_alike, r"nothing new of .* \(wheels: its covariance is none"),
    "too far away": (
        lambda clock: odometry(clock, 500.0),
        r"is not believed \(wheels: vx, vyaw: .* standard deviations",
    ),
}


@pytest.mark.parametrize("kind", UNUSABLE)
def test_where_wheels_say_nothing_usable_it_is_silent(run_node: RunNode, clock: Clock, kind: str) -> None:
    """A live gyro and wheels that say something is not enough: it must be taken."""
    says, why = UNUSABLE[kind]
    wheels = {**SOURCES["wheels"], "rejection_threshold": 5.0}
    node = run_node(EkfFilter, sources={**SOURCES, "wheels": wheels})
    drive(node, clock, 1.0, 0.5)
    node.clear()
    for _ in range(250):
        clock.advance(PERIOD)
        node.send("imu", imu(clock, 0.0))
        node.send("odom", says(clock))
    assert len(told(node)) <= 10, "for sensor_timeout it goes on"
    assert place(told(node)[-1])[0] < 0.65
    level, text = health(node)
    assert level == ERROR
    assert re.search(f"^silent: .*{why}", text), text
    node.clear()
    drive(node, clock, 0.5, 0.0)
    assert told(node)[-1].twist.twist.linear.x == pytest.approx(0.0, abs=0.05)
    clock.advance(1.1)
    drive(node, clock, 1.5, 0.0)
    assert health(node) == (OK, "")


def test_wheels_that_stand_suddenly_are_believed_again(run_node: RunNode, clock: Clock) -> None:
    """What is rejected for as long as `sensor_timeout` is not outvoted by a filter that is sure of itself."""
    wheels = {**SOURCES["wheels"], "rejection_threshold": 5.0}
    node = run_node(
        EkfFilter, sources={**SOURCES, "wheels": wheels}, process_noise_covariance=[0, 0, 0, 1e-3, 1e-3, 4, 10, 10]
    )
    drive(node, clock, 1.0, 0.5)
    before = place(told(node)[-1])[0]
    drive(node, clock, 1.0, 0.0)
    assert node.node._ekf.rejected["wheels"] > 5
    assert told(node)[-1].twist.twist.linear.x == pytest.approx(0.0, abs=0.05)
    assert place(told(node)[-1])[0] - before < 0.25


def test_without_a_gyro_wheels_are_enough_and_it_is_said(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    for _ in range(60):
        clock.advance(PERIOD)
        node.send("odom", odometry(clock, 0.5))
    assert place(told(node)[-1])[0] == pytest.approx(0.57, abs=0.05)
    assert health(node) == (WARN, "nothing new of imu")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_what_is_not_finite_is_left_out_and_counted(run_node: RunNode, clock: Clock, bad: float) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    drive(node, clock, 1.0)
    for _ in range(5):
        node.send("odom", odometry(clock, bad))
        node.send("imu", imu(clock, bad))
        clock.advance(PERIOD)
        node.send("odom", odometry(clock, 0.5))
        node.send("imu", imu(clock, 0.0))
    clock.advance(0.05)
    assert all(math.isfinite(one) for one in place(told(node)[-1]))
    assert place(told(node)[-1])[0] == pytest.approx(0.55, abs=0.03)
    assert node.node._ekf.refused == {"wheels": 5, "imu": 5}


def test_a_stamp_of_a_clock_that_is_not_set_costs_nothing(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    said = odometry(clock, 0.5)
    said.header.stamp = Time(1, 0)
    node.send("odom", said)
    drive(node, clock, 1.0, 0.5)
    assert math.sqrt(told(node)[-1].pose.covariance[0]) < 0.1
    assert node.node._ekf.complaints["wheels"] == "its stamp is 1e+09 s behind the clock here"


def test_another_frame_and_a_clock_that_is_ahead_are_refused(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    node.send("odom", odometry(clock, child="other"))
    assert "it is in the frame other, not in base_link" in caplog.text
    caplog.clear()
    clock.advance(6.0)
    node.send("odom", odometry(clock, ago=-10.0))
    assert "its stamp is 10 s ahead of the clock here" in caplog.text


def test_without_a_stamp_a_message_counts_from_when_it_was_sent(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources={"wheels": SOURCES["wheels"]})
    for _ in range(50):
        clock.advance(PERIOD)
        said = odometry(clock, 0.5)
        said.header.stamp = Time()
        node.send("odom", said)
    clock.advance(0.05)
    assert place(told(node)[-1])[0] == pytest.approx(0.49, abs=0.02)
    assert told(node)[-1].header.stamp.to_seconds() == pytest.approx(clock.now().to_seconds(), abs=0.1)


def test_it_is_put_somewhere_and_reset(run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    drive(node, clock, 0.5)
    node.send("set_pose", pose_at(clock, 5.0, -2.0, 1.0))
    drive(node, clock, 0.1, 0.0)
    assert place(told(node)[-1]) == pytest.approx((5.0, -2.0, 1.0), abs=0.05)
    node.send("set_pose", pose_at(clock, 0.0, 0.0, 0.0, "map"))
    assert "the pose is not taken: it is in the frame map, not in odom" in caplog.text
    assert node.call("reset", Trigger.Request()).success
    drive(node, clock, 0.1, 0.0)
    assert place(told(node)[-1]) == pytest.approx((0.0, 0.0, 0.0), abs=0.05)


@pytest.mark.parametrize("frame", ["odom", "visual_odom"])
def test_relative_poses_count_from_where_it_was_put(run_node: RunNode, clock: Clock, frame: str) -> None:
    """They begin at the origin wherever they begin, in a frame of their own too; and after that at what is said."""
    sources = {"camera": {"topic": "vo", "type": "pose", "use": ["x", "y", "yaw"], "relative": True}}
    node = run_node(EkfFilter, sources=sources)

    def see(x: float, count: int = 50) -> tuple[float, float, float]:
        for _ in range(count):
            clock.advance(PERIOD)
            node.send("vo", pose_at(clock, x, 3.0, 0.0, frame))
        clock.advance(0.05)
        return place(told(node)[-1])

    assert see(7.0) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    node.send("set_pose", pose_at(clock, 5.0, -2.0, math.pi / 2))
    assert see(7.0) == pytest.approx((5.0, -2.0, math.pi / 2), abs=0.01)
    assert see(7.5) == pytest.approx((5.0, -1.5, math.pi / 2), abs=0.01)
    node.call("reset", Trigger.Request())
    assert see(7.5) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_a_pose_may_be_far_away_and_sure_of_itself(run_node: RunNode, clock: Clock) -> None:
    place_said = {"topic": "place", "type": "pose", "use": ["x", "y", "yaw"], "rejection_threshold": 5.0}
    node = run_node(EkfFilter, sources={"wheels": SOURCES["wheels"], "place": place_said})
    for _ in range(20):
        clock.advance(PERIOD)
        node.send("odom", odometry(clock, 0.0))
        node.send("place", pose_at(clock, 800.0, -300.0, 3.0))
    clock.advance(0.05)
    assert place(told(node)[-1]) == pytest.approx((800.0, -300.0, 3.0), abs=0.02)
    assert not node.node._ekf.rejected


def test_where_it_is_put_it_is_as_unsure_of_its_motion_as_it_was_told(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES, initial_estimate_covariance=[1e-6] * 3 + [7.0] * 5)
    drive(node, clock, 0.1)
    node.send("set_pose", pose_at(clock, 5.0, -2.0, 1.0))
    assert [node.node._ekf.now.variance(i) for i in (3, 4, 5)] == pytest.approx([7.0] * 3)


def test_a_camera_whose_velocities_are_zeros_teaches_no_bias(run_node: RunNode, clock: Clock) -> None:
    """It drives a curve all the time, and only poses say so."""
    node = run_node(EkfFilter, sources={"camera": {"topic": "vo", "use": ["x", "y"]}, "imu": SOURCES["imu"]})
    x = y = yaw = 0.0
    for _ in range(150):
        clock.advance(PERIOD)
        yaw += 0.04 * PERIOD
        x, y = x + 0.5 * PERIOD * math.cos(yaw), y + 0.5 * PERIOD * math.sin(yaw)
        said = odometry(clock)
        said.pose, said.twist = PoseWithCovariance(Pose(Point(x, y)), SURE), TwistWithCovariance()
        node.send("vo", said)
        node.send("imu", imu(clock, 0.04))
    clock.advance(0.05)
    assert place(told(node)[-1])[2] == pytest.approx(yaw, abs=0.01)
    assert node.node._readers["imu"].bias.bias == 0.0


@pytest.mark.parametrize("bias", [0.03, 0.1])
def test_a_bias_is_found_by_any_wheels_and_said_where_it_is_too_large(
    run_node: RunNode, clock: Clock, bias: float
) -> None:
    node = run_node(
        EkfFilter, sources={"wheels": {"topic": "w", "type": "twist", "use": ["vx"]}, "imu": SOURCES["imu"]}
    )
    for _ in range(150):
        clock.advance(PERIOD)
        still = TwistWithCovariance(Twist(), SURE)
        node.send("w", TwistWithCovarianceStamped(Header(clock.now(), "base_link"), still))
        node.send("imu", imu(clock, bias))
    if bias > 0.05:
        assert health(node) == (WARN, "imu says 0.1 rad/s while the wheels stand: more than rest_bias")
    else:
        assert node.node._readers["imu"].bias.bias == pytest.approx(bias)
        assert health(node) == (OK, "")


def test_why_something_is_left_out_is_said(run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    wheels = {**SOURCES["wheels"], "rejection_threshold": 5.0}
    node = run_node(EkfFilter, sources={**SOURCES, "wheels": wheels})
    for step in range(100):
        drive(node, clock, PERIOD)
        if step % 10 == 0:
            node.send("odom", odometry(clock, 50.0))
    text = r"vx, vyaw: [\d.e+]+ standard deviations from what was expected"
    assert re.search(f"left out what wheels says: {text}; 1 times so far", caplog.text)
    level, said = health(node)
    assert level == WARN
    assert re.fullmatch(f"left out: wheels: {text}", said)


def test_a_tick_that_took_too_long_is_not_followed_by_a_longer_one(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taking again what came since is what costs most: the next tick does without."""
    node = run_node(EkfFilter, sources=SOURCES, history_length=2.0)
    drive(node, clock, 1.0)
    take, passed = node.node._ekf.take, 0.0
    replays: list[bool] = []

    class Wall:
        def monotonic(self) -> float:
            return clock.monotonic() + passed

    def slow(waiting: list[Measurement], *, replay: bool) -> set[int]:
        nonlocal passed
        replays.append(replay)
        passed += 0.05 if replay else 0.0
        return take(waiting, replay=replay)

    monkeypatch.setattr(node.node._ekf, "take", slow)
    monkeypatch.setattr(node.node, "_wall", Wall())
    drive(node, clock, 1.0, delay=0.1)
    assert replays[:4] == [True, False, True, False]
    assert "a tick took 0.05 s, longer than its period" in caplog.text
    assert node.node._ekf.late["wheels"] > 0


def test_poses_and_velocities_with_covariance_are_sources_too(run_node: RunNode, clock: Clock) -> None:
    sources = {
        "speed": {"topic": "speed", "type": "twist", "use": ["vx", "vyaw"]},
        "place": {"topic": "place", "type": "pose", "use": ["x", "y", "yaw"], "rejection_threshold": 5.0},
    }
    node = run_node(EkfFilter, sources=sources)
    for step in range(100):
        clock.advance(PERIOD)
        twist = TwistWithCovariance(Twist(Vector3(0.5)), SURE)
        node.send("speed", TwistWithCovarianceStamped(Header(clock.now(), "base_link"), twist))
        wrong = 50.0 if step == 90 else 0.0
        node.send("place", pose_at(clock, 10.0 + wrong, 3.0 + 0.5 * PERIOD * step, math.pi / 2))
    clock.advance(0.05)
    assert place(told(node)[-1]) == pytest.approx((10.0, 3.99, math.pi / 2), abs=0.03), "it begins where it is seen"
    assert node.node._ekf.rejected == {"place": 1}


def test_it_may_leave_tf_to_others_and_follows_its_parameters(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES, publish_tf=False, odom_frame="world", frequency=10.0)
    drive(node, clock, 1.0)
    assert node.published("tf") == []
    assert told(node)[-1].header.frame_id == "world"
    assert 9 <= len(told(node)) <= 10


def test_parameters_that_make_no_sense_are_refused(run_node: RunNode) -> None:
    for wrong in (
        {"sources": {"imu": {"topic": "imu", "type": "imu", "use": ["vx"]}}},
        {"sources": {"wheels": {"topic": "odom"}}},
        {"process_noise_covariance": [1.0, 2.0]},
        {"process_noise_covariance": [-1.0] * 8},
        {"initial_estimate_covariance": [math.nan] * 8},
    ):
        with pytest.raises(ParameterError):
            run_node(EkfFilter, **wrong)


def test_it_does_not_hear_itself(run_node: RunNode) -> None:
    with pytest.raises(ContractError, match=r"sources\.wheels\.topic is what it publishes itself: odom"):
        run_node(EkfFilter, sources=SOURCES, remap={"odometry/filtered": "odom"})


def test_with_the_simulated_base_it_is_nearer_to_the_truth(run_node: RunNode, clock: Clock) -> None:
    """Wheels of different sizes, which it turns away from its way by, and an IMU with a bias."""
    base = run_node(
        DiffDriveSim,
        imu=True,
        ground_truth=True,
        enable_odom_tf=False,
        laser=False,
        errors={"left_wheel_radius": 0.01, "right_wheel_radius": -0.01, "slip": 0.01},
        imu_noise={"gyro_bias": 0.02},
    )
    node = run_node(EkfFilter, sources=SOURCES)
    clock.advance(2.0)
    for step in range(300):
        base.send("cmd_vel", Twist(Vector3(0.4), Vector3(z=0.4 if step % 100 < 50 else -0.4)))
        clock.advance(0.05)
    clock.advance(1.0)
    truth, wheels, fused = (
        place(one[-1]) for one in (base.published("ground_truth"), base.published("odom"), told(node))
    )
    gaps = [math.hypot(one[0] - truth[0], one[1] - truth[1]) for one in (wheels, fused)]
    assert gaps[0] > 0.5
    assert gaps[1] < 0.3 * gaps[0], gaps
    assert {one.child_frame_id for sent in base.published("tf") for one in sent.transforms} == set()
    assert place(base.published("odom")[-1]) != truth


def test_a_simulated_base_that_is_reset_begins_anew_with_its_errors(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim, ground_truth=True, laser=False, errors={"left_wheel_radius": 0.1}, x=1.0)
    for _ in range(2):
        for _ in range(10):
            base.send("cmd_vel", Twist(Vector3(0.5)))
            clock.advance(0.1)
        truth, wheels = place(base.published("ground_truth")[-1]), place(base.published("odom")[-1])
        assert truth[1:] == (0.0, 0.0)
        assert wheels[2] > 0.05, "the left wheel says less than it drives"
        base.call("reset", Trigger.Request())
        clock.advance(PERIOD)
        assert place(base.published("odom")[-1]) == pytest.approx((1.0, 0.0, 0.0), abs=0.01)
    with pytest.raises(ParameterError, match="not of ackermann"):
        run_node(DiffDriveSim, drive="ackermann", errors={"slip": 0.1})


def test_what_is_said_of_a_source_holds_at_once(run_node: RunNode, clock: Clock) -> None:
    node = run_node(EkfFilter, sources=SOURCES)
    drive(node, clock, 1.0)
    node.set(**{"sources.wheels.rejection_threshold": 5.0})
    node.send("odom", odometry(clock, 50.0))
    clock.advance(0.05)
    assert node.node._ekf.rejected == {"wheels": 1}
    clock.advance(1.0)


@pytest.mark.parametrize(("reset", "where"), [(False, 0.5), (True, 0.0)])
def test_where_time_steps_back_it_begins_anew(
    run_node: RunNode,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    reset: bool,
    where: float,
) -> None:
    """As where a simulator that says the time is started again."""
    node = run_node(EkfFilter, sources=SOURCES, reset_on_time_jump=reset)
    drive(node, clock, 1.0, 0.5)
    assert place(told(node)[-1])[0] == pytest.approx(0.48, abs=0.03)
    node.clear()
    monkeypatch.setattr(node.node, "now", lambda: stamp(clock, 90.0))
    for _ in range(50):
        clock.advance(PERIOD)
        node.send("odom", odometry(clock, 0.0, ago=90.0))
        node.send("imu", imu(clock, ago=90.0))
    assert "time has stepped back" in caplog.text
    assert place(told(node)[-1])[0] == pytest.approx(where, abs=0.05)
    assert told(node)[-1].header.stamp.to_seconds() == pytest.approx(clock.now().to_seconds() - 90.0, abs=0.1)


@pytest.mark.parametrize(
    ("said", "reset", "where"), [("relative", False, 0.5), ("relative", True, 0.0), ("", True, 0.5)]
)
def test_where_time_steps_back_poses_go_on(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch, said: str, reset: bool, where: float
) -> None:
    """Relative ones from where it begins anew, others are believed as they are."""
    camera = {"topic": "vo", "type": "pose", "use": ["x", "y", "yaw"], "relative": said == "relative"}
    node = run_node(EkfFilter, sources={"camera": camera}, reset_on_time_jump=reset)
    for step in range(51):
        clock.advance(PERIOD)
        node.send("vo", pose_at(clock, 0.01 * step, 0.0, 0.0))
    clock.advance(0.05)
    assert place(told(node)[-1])[0] == pytest.approx(0.5, abs=0.01)
    node.clear()
    monkeypatch.setattr(node.node, "now", lambda: stamp(clock, 90.0))
    for _ in range(50):
        clock.advance(PERIOD)
        pose = pose_at(clock, 0.5, 0.0, 0.0)
        pose.header.stamp = stamp(clock, 90.0)
        node.send("vo", pose)
    assert place(told(node)[-1])[0] == pytest.approx(where, abs=0.01)
