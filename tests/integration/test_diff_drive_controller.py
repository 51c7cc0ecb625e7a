"""The controller of a base that speaks wheels: what it tells them, and what it makes of what they did."""

import math

import pytest

from robo import MessageInfo, Node, ParameterError, Publisher, QoS, subscribe, timer
from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import Header, JointState, Odometry, Time, Twist, Vector3
from robo_services.diff_drive_controller import DiffDriveController
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.drives import DiffDrive, Wheels
from robo_services.kinematics import ORIGIN, advance
from robo_services.limits import ramp
from robo_services.planar import yaw_from_quaternion
from tests.unit.test_wheel_odometry import driven, legs_of_a_square

PERIOD = 0.02
LEFT, RIGHT = "left_wheel_joint", "right_wheel_joint"
GEOMETRY = DiffDrive(wheel_separation=0.3, wheel_radius=0.05)


class Motors(Node):
    """Two wheels that gain speed as they can, and know how far they have turned."""

    states = Publisher(JointState, "joint_states")

    def on_start(self) -> None:
        self.pose = ORIGIN
        self.wanted = Wheels(0.0, 0.0)
        self.rates = Wheels(0.0, 0.0)
        self.turned = Wheels(0.0, 0.0)
        self.ages: list[float] = []

    @subscribe("wheel_commands", qos=QoS.COMMAND)
    def on_command(self, state: JointState, info: MessageInfo) -> None:
        velocity = dict(zip(state.name, state.velocity, strict=True))
        self.wanted = Wheels(velocity[LEFT], velocity[RIGHT])
        self.ages.append(info.age)

    @timer(rate=100.0)
    def turn(self) -> None:
        dt = 0.01
        self.rates = Wheels(
            ramp(self.rates.left, self.wanted.left, dt, 30.0, 60.0),
            ramp(self.rates.right, self.wanted.right, dt, 30.0, 60.0),
        )
        self.pose = advance(self.pose, *GEOMETRY.twist(self.rates), dt)
        self.turned = Wheels(self.turned.left + self.rates.left * dt, self.turned.right + self.rates.right * dt)
        rates, turned = self.rates, self.turned
        self.states.publish(
            JointState(Header(self.now()), [RIGHT, LEFT], [turned.right, turned.left], [rates.right, rates.left])
        )


def twist(x: float = 0.0, turn: float = 0.0) -> Twist:
    return Twist(Vector3(x), Vector3(z=turn))


def joints(left: float, right: float, stamp: float = 0.0) -> JointState:
    return JointState(Header(Time.from_seconds(stamp)), [LEFT, RIGHT], [left, right])


def told(controller: NodeUnderTest[DiffDriveController]) -> list[tuple[float, ...]]:
    return [tuple(sent.velocity) for sent in controller.published(DiffDriveController.wheels)]


def last(controller: NodeUnderTest[DiffDriveController]) -> Odometry:
    return controller.published(DiffDriveController.odometry)[-1]


def place(odometry: Odometry) -> tuple[float, float, float]:
    pose = odometry.pose.pose
    return pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation)


def go(controller: NodeUnderTest[DiffDriveController], clock: Clock, command: Twist, seconds: float) -> None:
    for _ in range(round(seconds / PERIOD)):
        controller.send("cmd_vel", command)
        clock.advance(PERIOD)


def roll(controller: NodeUnderTest[DiffDriveController], clock: Clock, state: JointState, command: Twist) -> None:
    """Feedback and a command, and the tick after them."""
    controller.send("joint_states", state)
    controller.send("cmd_vel", command)
    clock.advance(PERIOD)


def test_the_wheels_do_what_is_commanded_and_odometry_says_where_that_leads(run_node: RunNode, clock: Clock) -> None:
    controller, motors = run_node(DiffDriveController), run_node(Motors)
    for command in (twist(0.5), twist(0.3, 1.0), twist(-0.2, 0.5), twist(0.0, -2.0)):
        go(controller, clock, command, 2.0)
        measured = last(controller).twist.twist
        assert (measured.linear.x, measured.angular.z) == pytest.approx((command.linear.x, command.angular.z))
    clock.advance(2.0)
    assert place(last(controller)) == pytest.approx(tuple(motors.node.pose), abs=1e-9)
    assert math.hypot(*motors.node.pose[:2]) > 1.0
    frame = controller.published("tf")[-1].transforms[0]
    assert (frame.header.frame_id, frame.child_frame_id) == ("odom", "base_link")
    assert frame.transform.translation.x == last(controller).pose.pose.position.x
    assert frame.header.stamp == last(controller).header.stamp


def test_a_square_closes(run_node: RunNode, clock: Clock) -> None:
    """4 sides of 10 m with round corners, at 50 readings a second."""
    controller = run_node(DiffDriveController)
    for time, wheels in driven(GEOMETRY, legs_of_a_square(10.0, 0.5, speed=2.0)):
        controller.send("joint_states", joints(wheels.left, wheels.right, 100.0 + time))
        clock.advance(PERIOD)
    places = [place(odometry) for odometry in controller.published(DiffDriveController.odometry)]
    assert max(math.hypot(x, y) for x, y, _ in places) > 14.0
    x, y, yaw = places[-1]
    assert math.hypot(x, y) < 1e-9
    assert abs(yaw) < 1e-9
    assert last(controller).header.stamp.to_seconds() == pytest.approx(100.0 + time), "when the wheels were measured"


def test_when_commands_end_the_wheels_stand(run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture) -> None:
    controller, motors = run_node(DiffDriveController), run_node(Motors)
    go(controller, clock, twist(0.5), 1.0)
    assert told(controller)[-1] == pytest.approx((10.0, 10.0))
    assert motors.node.ages[-1] <= PERIOD, "a command that is passed on stays as old as it is"
    controller.clear()
    clock.advance(1.0)
    sent = [left for left, _ in told(controller)]
    assert sent[:24] == pytest.approx(24 * [10.0])
    assert sent[26:] == 24 * [0.0]
    assert max(motors.node.ages) == pytest.approx(0.5, abs=0.03)
    assert motors.node.ages[-1] < 0.01, "to stand is its own word"
    assert "the wheels stand: no command on cmd_vel" in caplog.text
    go(controller, clock, twist(0.5), 0.1)
    assert told(controller)[-1] == pytest.approx((10.0, 10.0))


@pytest.mark.parametrize("age", [0.6, 5.0, 1e9])
def test_what_is_old_is_no_command(run_node: RunNode, clock: Clock, age: float) -> None:
    controller = run_node(DiffDriveController)
    run_node(Motors)
    for _ in range(50):
        controller.send("cmd_vel", twist(0.4), age=age)
        clock.advance(PERIOD)
    assert {*told(controller)} == {(0.0, 0.0)}


def test_commands_of_one_source_alone_move_it(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(DiffDriveController, command_source="safety_monitor")
    run_node(Motors)
    go(controller, clock, twist(0.4), 0.5)
    assert {*told(controller)} == {(0.0, 0.0)}
    for _ in range(10):
        controller.send("cmd_vel", twist(0.4), source="safety_monitor")
        clock.advance(PERIOD)
    assert told(controller)[-1] == pytest.approx((8.0, 8.0))


def test_what_is_not_finite_counts_as_silence(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    controller = run_node(DiffDriveController)
    run_node(Motors)
    go(controller, clock, twist(0.5), 0.5)
    go(controller, clock, twist(math.nan), 0.7)
    assert told(controller)[-1] == (0.0, 0.0)
    assert sum("NaN or an infinity" in text for text in caplog.messages) == 1


def test_who_does_not_know_what_its_wheels_do_lets_them_stand(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    controller = run_node(DiffDriveController)
    go(controller, clock, twist(0.5), 0.5)
    assert "wheels stand" not in caplog.text, "others may be about to start"
    go(controller, clock, twist(0.5), 1.0)
    assert {*told(controller)} == {(0.0, 0.0)}
    assert f"the wheels stand: nothing new on joint_states of {LEFT}, {RIGHT}" in caplog.text
    assert controller.published("odom") == controller.published("tf") == []

    roll(controller, clock, joints(0.0, 0.0, 1.0), twist(0.5))
    assert told(controller)[-1] == pytest.approx((10.0, 10.0))
    go(controller, clock, twist(0.5), 0.6)
    assert told(controller)[-1] == (0.0, 0.0), "feedback has ended"
    assert len(controller.published("odom")) == 1, "nothing is told twice"


def test_feedback_that_makes_no_sense_is_none(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    controller = run_node(DiffDriveController)
    for i in range(50):
        roll(controller, clock, joints(i * 0.1, i * 0.1, 1 + i * PERIOD), twist(0.25))
    assert told(controller)[-1] == pytest.approx((5.0, 5.0))
    before = place(last(controller))
    for i in range(50, 100):
        roll(controller, clock, joints(math.nan, i * 0.1, 1 + i * PERIOD), twist(0.25))
    assert told(controller)[-1] == (0.0, 0.0)
    assert place(last(controller)) == before
    assert "left out what /test says of the wheels, which they cannot have done; 1 times so far" in caplog.text

    roll(controller, clock, joints(7.0, 7.0, 3.0), twist(0.25))
    assert told(controller)[-1] == pytest.approx((5.0, 5.0))
    assert place(last(controller))[0] == pytest.approx(0.35), "what was driven meanwhile is not lost"


def test_encoders_that_begin_anew_move_nothing(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(DiffDriveController, max_wheel_velocity=20.0)
    for i in range(51):
        roll(controller, clock, joints(i * 0.2, i * 0.2, 1 + i * PERIOD), twist(0.5))
    assert place(last(controller))[0] == pytest.approx(0.5)
    for i in range(51):
        roll(controller, clock, joints(i * 0.2, i * 0.2, 1 + (51 + i) * PERIOD), twist(0.5))
    assert place(last(controller))[0] == pytest.approx(1.0)


def test_a_driver_that_was_started_again_counts_from_somewhere_else(run_node: RunNode, clock: Clock) -> None:
    """Also where a wheel could have turned so far meanwhile."""
    controller = run_node(DiffDriveController)
    for i in range(51):
        roll(controller, clock, joints(i * 0.2, i * 0.2, 1 + i * PERIOD), twist(0.5))
    go(controller, clock, twist(0.5), 0.6)
    for i in range(51):
        controller.send("joint_states", joints(i * 0.2, i * 0.2, 2.6 + i * PERIOD), source="wheels")
        controller.send("cmd_vel", twist(0.5))
        clock.advance(PERIOD)
    assert place(last(controller))[0] == pytest.approx(1.0)
    assert told(controller)[-1] == pytest.approx((10.0, 10.0))


def test_of_two_that_say_what_the_wheels_do_the_first_one_counts(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    controller = run_node(DiffDriveController)
    for i in range(51):
        controller.send("joint_states", joints(i * 0.2, i * 0.2, 1 + i * PERIOD))
        controller.send("joint_states", joints(9.0 - i * 0.2, 0.0, 1 + i * PERIOD), source="stranger")
        clock.advance(PERIOD)
    assert place(last(controller)) == pytest.approx((0.5, 0.0, 0.0))
    assert sum("/stranger says too what the wheels do: left out" in text for text in caplog.messages) == 1


def test_it_reads_its_own_joints_and_says_which_are_missing(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    controller = run_node(DiffDriveController)
    roll(controller, clock, JointState(name=["gripper"], position=[1.0]), twist(0.5))
    assert "joint" not in caplog.text, "arms have joints too"
    roll(controller, clock, JointState(name=[LEFT, "gripper"], position=[1.0, 1.0]), twist(0.5))
    assert f"/test says no position of {RIGHT}" in caplog.text
    caplog.clear()
    clock.advance(6.0)
    roll(controller, clock, JointState(name=[LEFT, RIGHT], velocity=[1.0, 1.0]), twist(0.5))
    assert f"/test says no position of {LEFT}, {RIGHT}" in caplog.text
    roll(controller, clock, JointState(), twist(0.5))
    assert {*told(controller)} == {(0.0, 0.0)}


def test_velocities_as_feedback(run_node: RunNode, clock: Clock) -> None:
    controller, motors = run_node(DiffDriveController, position_feedback=False), run_node(Motors)
    for command in (twist(0.5), twist(0.3, 1.0)):
        go(controller, clock, command, 2.0)
    clock.advance(2.0)
    assert place(last(controller)) == pytest.approx(tuple(motors.node.pose), abs=1e-6)


def test_without_feedback_odometry_is_what_was_commanded(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(DiffDriveController, open_loop=True)
    go(controller, clock, twist(0.5, 0.25), 2.0)
    clock.advance(1.0)
    x, y, yaw = place(last(controller))
    assert yaw == pytest.approx(0.25 * 2.5, abs=0.02), "and half a second until the command is too old"
    assert (x, y) == pytest.approx((2 * math.sin(yaw), 2 - 2 * math.cos(yaw)), abs=1e-9)
    assert told(controller)[-1] == (0.0, 0.0)


def test_limits_keep_the_curve_and_all_wheels_of_a_side_are_told(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(
        DiffDriveController,
        left_wheel_names=["fl", "rl"],
        right_wheel_names=["fr", "rr"],
        max_wheel_velocity=10.0,
        wheel_separation_multiplier=1.5,
        open_loop=True,
    )
    go(controller, clock, twist(1.0, 2.0), 0.1)
    command = controller.published(DiffDriveController.wheels)[-1]
    assert command.name == ["fl", "rl", "fr", "rr"]
    left, also_left, right, also_right = command.velocity
    assert (left, right) == (also_left, also_right)
    assert right == pytest.approx(10.0)
    driven_twist = DiffDrive(wheel_separation=0.45, wheel_radius=0.05).twist(Wheels(left, right))
    assert driven_twist.angular / driven_twist.linear == pytest.approx(2.0)


def test_how_it_errs_may_be_set_while_it_drives(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(DiffDriveController)
    run_node(Motors)
    go(controller, clock, twist(0.5), 2.0)
    first = last(controller).pose.covariance[0]
    assert first == pytest.approx(0.02**2 * place(last(controller))[0], rel=0.01)
    controller.set(**{"noise.way_by_way": 1.0})
    go(controller, clock, twist(0.5), 2.0)
    assert last(controller).pose.covariance[0] == pytest.approx(1.0, rel=0.02)


def test_it_leaves_standing_wheels(run_node: RunNode, clock: Clock) -> None:
    controller = run_node(DiffDriveController)
    run_node(Motors)
    go(controller, clock, twist(0.4), 0.5)
    controller.close()
    assert told(controller)[-1] == (0.0, 0.0)


def test_a_base_without_wheels_is_refused(run_node: RunNode) -> None:
    with pytest.raises(ParameterError, match="left_wheel_names"):
        run_node(DiffDriveController, left_wheel_names=[])
    with pytest.raises(ParameterError, match="wheel_radius"):
        run_node(DiffDriveController, wheel_radius=0.0)
    with pytest.raises(ParameterError, match="a joint is on one side, not on both: wheel"):
        run_node(DiffDriveController, left_wheel_names=["wheel"], right_wheel_names=["wheel"])


# -- the simulated base tells its wheels -------------------------------------------------------------------------------


@pytest.mark.parametrize(("drive", "multiplier"), [("diff", 1.0), ("skid", 1.5)])
def test_by_the_wheels_of_the_simulated_base_it_knows_where_that_is(
    run_node: RunNode, clock: Clock, drive: str, multiplier: float
) -> None:
    base = run_node(DiffDriveSim, drive=drive, joint_states=True)
    clock.advance(0.1)
    names: list[str] = base.published("joint_states")[-1].name
    controller = run_node(
        DiffDriveController,
        remap={"odom": "odom_by_wheels", "tf": "tf_by_wheels"},
        left_wheel_names=[name for name in names if "left" in name],
        right_wheel_names=[name for name in names if "right" in name],
        wheel_separation_multiplier=multiplier,
    )
    clock.advance(0.1)
    for command in (twist(0.5, 0.3), twist(-0.2, -1.0), twist(0.0, 2.0)):
        for _ in range(50):
            base.send("cmd_vel", command)
            clock.advance(PERIOD)
    clock.advance(1.0)
    truth, found = base.published("odom")[-1], controller.published("odom_by_wheels")[-1]
    assert place(found) == pytest.approx(place(truth), abs=1e-9)
    assert found.pose.covariance == pytest.approx(truth.pose.covariance, rel=1e-6)
    assert truth.pose.covariance[35] > 0.009, "it has turned"


def test_the_simulated_car_steers_and_does_not_turn_on_the_spot(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    base = run_node(DiffDriveSim, drive="ackermann", joint_states=True, wheelbase=0.3, max_steering_angle=0.5)
    for _ in range(50):
        base.send("cmd_vel", twist(0.0, 1.0))
        clock.advance(PERIOD)
    assert place(base.published("odom")[-1]) == (0.0, 0.0, 0.0)
    assert sum("a car cannot turn on the spot" in text for text in caplog.messages) == 1
    for _ in range(100):
        base.send("cmd_vel", twist(0.3, 9.0))
        clock.advance(PERIOD)
    moved = base.published("odom")[-1].twist.twist
    assert moved.linear.x == pytest.approx(0.3)
    assert moved.angular.z == pytest.approx(0.3 * math.tan(0.5) / 0.3), "as tight as it can"
    state = dict(zip((s := base.published("joint_states")[-1]).name, s.position, strict=True))
    assert state["front_left_steering_joint"] > 0.5 > state["front_right_steering_joint"] > 0.3
    rates = dict(zip(s.name, s.velocity, strict=True))
    assert 0.05 * (rates["rear_left_wheel_joint"] + rates["rear_right_wheel_joint"]) / 2 == pytest.approx(0.3)


def test_the_simulated_base_says_nothing_of_its_wheels_unless_asked(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim)
    clock.advance(0.5)
    with pytest.raises(AssertionError):
        base.published("joint_states")
