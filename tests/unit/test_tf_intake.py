"""What does not come in order: late and repeated transforms, clocks, parents and sources that change."""

import pytest

from robo.errors import FrameLoop, FramesNotConnected, InTheFuture, NoTransformData, TooOld
from robo.tf import IDENTITY, Buffer, Transform3
from tests.transforms import apart, at_x, ns, pose, robot, said

# Order, age and clocks


def test_of_two_with_one_stamp_the_last_one_counts() -> None:
    buffer = Buffer()
    for x in (1.0, 2.0):
        for time in (1.0, 2.0, 3.0):
            buffer.insert(at_x("odom", "base_link", time, x * time))
    buffer.insert(at_x("odom", "base_link", 2.0, 10.0))
    assert [buffer.lookup("odom", "base_link", ns(time)).x for time in (1.0, 2.0, 3.0)] == [2.0, 10.0, 6.0]
    assert buffer.lookup("odom", "base_link", ns(2.5)).x == pytest.approx(8.0)
    assert buffer.frames()[0].rate == 1.0


def test_what_comes_late_counts_where_it_belongs() -> None:
    buffer = Buffer()
    for time in (1.0, 3.0, 2.0, 2.5, 0.5):
        buffer.insert(at_x("odom", "base_link", time, time * time))
        buffer.why_not("odom", "base_link", ns(2.2))  # what was found before does not stay
    assert buffer.lookup("odom", "base_link", ns(0.75)).x == pytest.approx((0.25 + 1.0) / 2)
    assert buffer.lookup("odom", "base_link", ns(2.25)).x == pytest.approx((4.0 + 6.25) / 2)
    assert buffer.warnings() == ()


@pytest.mark.parametrize("rate", [1.0, 7.0, 100.0])
def test_the_last_seconds_are_kept_and_not_much_more(rate: float) -> None:
    buffer = Buffer(4.0)
    for i in range(round(30 * rate)):
        buffer.insert(at_x("odom", "base_link", 100 + i / rate, i / rate))
    newest = buffer.newest("odom", "base_link")
    assert newest is not None
    assert buffer.lookup("odom", "base_link", newest - ns(4.0) + ns(1 / rate)).x > 0.0
    assert isinstance(buffer.why_not("odom", "base_link", newest - ns(5.0 + 1 / rate)), TooOld)
    assert len(buffer._tree.links["base_link"].history.stamps) <= 5 * rate + 2


def test_what_is_older_than_the_duration_is_left_out() -> None:
    buffer = Buffer(2.0)
    for time in (10.0, 11.0, 12.0):
        buffer.insert(at_x("odom", "base_link", time, time))
    buffer.insert(at_x("odom", "base_link", 9.9, 0.0))
    assert isinstance(buffer.why_not("odom", "base_link", ns(9.95)), TooOld)
    buffer.insert(at_x("odom", "base_link", 13.0, 13.0))
    buffer.insert(at_x("odom", "base_link", 10.9, 0.0))
    buffer.insert(at_x("odom", "base_link", 12.5, 12.5))
    assert buffer.lookup("odom", "base_link", ns(12.75)).x == pytest.approx(12.75)
    (warning,) = buffer.warnings()
    assert (warning.kind, warning.count, warning.stamp) == ("left_out", 2, ns(10.9))
    assert warning.text == (
        "odom → base_link of 10.900 s is left out: it is 2.100 s older than the newest, and 2.000 s are kept"
    )
    assert buffer.clocks_set_back == 0


def test_a_clock_that_is_set_back_clears_the_history_of_its_frames() -> None:
    buffer = robot()
    for i in range(20):
        buffer.insert(at_x("odom", "base_link", 5.0 + i / 50, float(i)), source="/odometry")
    assert buffer.clocks_set_back == 1
    assert buffer.newest("odom", "base_link") == ns(5.38)
    assert buffer.lookup("odom", "laser", ns(5.01)).x == pytest.approx(0.7)  # the first one counts, too
    assert isinstance(buffer.why_not("odom", "base_link", ns(103.0)), InTheFuture)
    warnings = {warning.kind: warning.text for warning in buffer.warnings()}
    assert warnings["set_back"] == (
        "the clock of odom → base_link from /odometry was set back by 98.980 s: its history was cleared"
    )
    assert buffer.newest("map", "odom") == ns(104.0)


def test_two_clocks_that_differ_do_not_clear_the_history_again_and_again() -> None:
    buffer = robot()
    for i in range(1, 20):
        buffer.insert(said("odom", "base_link", 104.0 + i / 50, pose(4.0 + i / 50)), source="/odometry")
        for k in range(4):
            buffer.insert(at_x("odom", "base_link", 5.0 + i / 50 + k / 200, float(i)), source="/behind")
    assert buffer.clocks_set_back == 0
    assert buffer.newest("odom", "base_link") == ns(104.38)
    assert {warning.kind: warning.count for warning in buffer.warnings()} == {"left_out": 76}


def test_another_source_whose_clock_is_behind_takes_over_after_a_second() -> None:
    buffer = robot()
    for i in range(60):
        buffer.insert(at_x("odom", "base_link", 5.0 + i / 50, float(i)), source="/restarted")
    assert buffer.clocks_set_back == 1
    assert buffer.lookup("odom", "base_link", ns(5.98)).x == 49.0
    assert isinstance(buffer.why_not("odom", "base_link", ns(5.97)), TooOld)
    assert buffer.lookup("odom", "base_link").x == 59.0


def test_one_old_message_that_comes_again_and_again_clears_nothing() -> None:
    buffer = robot()
    for _ in range(5):
        buffer.insert(at_x("odom", "base_link", 5.0, 1.0), source="/odometry")
    for time in (16.0, 7.0, 5.0, 40.0):  # nor do some that do not go on
        buffer.insert(at_x("odom", "base_link", time, 1.0), source="/odometry")
    assert buffer.clocks_set_back == 0
    assert buffer.lookup("odom", "base_link") == pose(4.0)
    (warning,) = buffer.warnings()
    assert (warning.kind, warning.count) == ("left_out", 9)


def test_a_stamp_of_the_far_future_is_outlived() -> None:
    buffer = robot()
    buffer.insert(at_x("odom", "base_link", 5000.0, 1.0), source="/odometry")
    for i in range(1, 5):
        buffer.insert(said("odom", "base_link", 104.0 + i / 50, pose(4.0 + i / 50)), source="/odometry")
    assert buffer.lookup("odom", "base_link") == pose(4.08)
    assert buffer.clocks_set_back == 1


def test_a_clock_that_is_set_back_may_come_with_another_parent() -> None:
    buffer = Buffer()
    for time in (100.0, 100.1):
        buffer.insert(at_x("odom", "base_link", time, 1.0))
    buffer.insert(at_x("base_link", "laser", 0.0, 0.1), static=True)
    buffer.insert(at_x("laser", "base_link", 2.0, 2.0))
    with pytest.raises(FrameLoop):
        buffer.insert(at_x("laser", "base_link", 2.1, 2.0))
    assert buffer.clocks_set_back == 0
    for time in (2.2, 2.3, 2.4):
        buffer.insert(at_x("map", "base_link", time, 2.0))
    assert buffer.clocks_set_back == 1
    assert buffer.lookup("map", "base_link", ns(2.25)).x == 2.0
    assert isinstance(buffer.why_not("map", "base_link", ns(2.15)), TooOld)
    assert isinstance(buffer.why_not("odom", "base_link"), FramesNotConnected)


def test_cleared_it_knows_the_frames_and_waits_for_data() -> None:
    buffer = robot()
    buffer.lookup("map", "laser")
    buffer.clear()
    assert str(buffer.why_not("map", "laser")) == (
        "nothing has come of odom → base_link since its history was cleared; wait for it"
    )
    assert isinstance(buffer.why_not("map", "odom", ns(102.0)), NoTransformData)
    assert buffer.lookup("base_link", "laser").x == 0.2
    assert [(frame.child, frame.newest, frame.age) for frame in buffer.frames(0)] == [
        ("odom", None, None), ("base_link", None, None), ("laser", 0, None),
    ]  # fmt: skip
    buffer.insert(at_x("odom", "base_link", 1.0, 3.0))
    buffer.insert(at_x("map", "odom", 1.0, 4.0))
    assert buffer.lookup("map", "base_link").x == 7.0
    assert buffer.lookup("map", "laser", ns(1.0)).x == 7.2


# Parents and sources


def test_a_new_parent_counts_from_its_stamp_on() -> None:
    buffer = Buffer()
    buffer.insert(at_x("map", "table", 0.0, 50.0), static=True)
    buffer.insert(at_x("map", "gripper", 0.0, 60.0), static=True)
    for time in (1.0, 2.0, 3.0):
        buffer.insert(at_x("table", "cup", time, time))
    before = buffer.lookup("table", "cup", ns(2.5))
    for time in (4.0, 5.0):
        buffer.insert(at_x("gripper", "cup", time, time))
    assert buffer.lookup("table", "cup", ns(2.5)) == before
    assert buffer.lookup("table", "cup").x == 15.0
    assert [buffer.lookup("map", "cup", ns(time)).x for time in (1.5, 3.0, 3.9, 4.0, 4.5)] == [
        51.5, 53.0, 53.0, 64.0, 64.5,  # what it was last in the old one holds until the new one begins
    ]  # fmt: skip
    assert buffer.lookup("map", "cup").x == 65.0
    assert buffer.lookup("gripper", "cup", ns(3.5)).x == -7.0
    assert isinstance(buffer.why_not("map", "cup", ns(0.5)), TooOld)
    assert isinstance(buffer.why_not("map", "cup", ns(5.5)), InTheFuture)
    assert [frame.parent for frame in buffer.frames() if frame.child == "cup"] == ["gripper"]
    for i in range(200):  # in the end all that is kept is of one parent
        buffer.insert(at_x("gripper", "cup", 5.1 + i / 10, 5.0))
    assert buffer.lookup("map", "cup").x == 65.0
    assert ("map", "cup") in buffer._tree.chains
    assert buffer.warnings() == ()


def test_a_parent_of_before_that_comes_late_counts_where_it_belongs() -> None:
    buffer = Buffer()
    for parent, time in (("odom", 1.0), ("map", 4.0), ("odom", 2.0)):
        buffer.insert(at_x(parent, "base_link", time, time))
    assert [frame.parent for frame in buffer.frames()] == ["map"]
    assert buffer.lookup("map", "base_link").x == 4.0
    buffer.insert(at_x("map", "base_link", 5.0, 5.0))
    assert buffer.lookup("odom", "base_link", ns(1.5)).x == 1.5
    assert buffer.lookup("map", "base_link", ns(4.5)).x == 4.5
    assert isinstance(buffer.why_not("map", "base_link", ns(1.5)), FramesNotConnected)
    assert isinstance(buffer.why_not("odom", "base_link"), FramesNotConnected)
    assert buffer.warnings() == ()


def test_trees_that_were_connected_once_still_are_at_that_time() -> None:
    buffer = robot()
    buffer.insert(said("truck", "base_link", 110.0), source="/odometry")
    assert apart(buffer.lookup("odom", "laser", ns(102.0)), pose(2.0) @ Transform3(x=0.2, z=0.3)) < 1e-12
    assert isinstance(buffer.why_not("odom", "laser"), FramesNotConnected)
    assert isinstance(buffer.why_not("odom", "laser", ns(110.0)), FramesNotConnected)
    assert buffer.lookup("truck", "laser").x == 0.2


def test_a_loop_among_parents_of_different_times_is_told_at_such_a_time() -> None:
    buffer = Buffer()
    for message in (
        at_x("b", "a", 1.0, 0.0),
        at_x("c", "a", 4.0, 0.0),
        at_x("a", "b", 5.0, 0.0),
        at_x("a", "b", 2.0, 0.0),
    ):
        buffer.insert(message)
    error = buffer.why_not("c", "b", ns(3.0))
    assert isinstance(error, FrameLoop)
    assert str(error) == "at 3.000 s the frames are a loop, b in a in b: their parents changed about that time"
    assert buffer.lookup("c", "b", ns(4.0)) == IDENTITY


def test_a_frame_with_two_parents_in_turn_is_told() -> None:
    buffer = Buffer()
    for i in range(10):
        buffer.insert(said("odom", "base_link", 1 + i / 10), source="/odometry")
        buffer.insert(said("map", "base_link", 1.05 + i / 10), source="/slam")
    (warning,) = buffer.warnings()
    assert (warning.kind, warning.child) == ("two_parents", "base_link")
    assert warning.text == "base_link has two parents in turn, map from /slam and odom from /odometry: a frame has one"
    assert warning.count > 10
    assert warning.stamp == ns(1.95)


def test_two_sources_of_one_frame_are_told() -> None:
    buffer = Buffer()
    for i in range(10):
        buffer.insert(said("odom", "base_link", 1 + i / 10), source="/wheels")
        buffer.insert(said("odom", "base_link", 0.5 + i / 10), source="/ekf")  # which is always behind
    (warning,) = buffer.warnings()
    assert (warning.kind, warning.child) == ("two_sources", "base_link")
    assert warning.text == "odom → base_link is published by /ekf and /wheels in turn: one of them has to stop"
    assert buffer.frames()[0].source == "/ekf"


def test_two_sources_of_a_static_frame_are_told() -> None:
    buffer = Buffer()
    for i in range(5):
        buffer.insert(at_x("base_link", "laser", 0.0, 0.2), static=True, source="/description")
        buffer.insert(at_x("base_link", "laser", 0.0, 0.3), static=True, source="/calibration")
        assert buffer.lookup("base_link", "laser").x == 0.3, i
    assert [warning.kind for warning in buffer.warnings()] == ["two_sources"]


def test_a_node_that_was_replaced_is_no_second_source() -> None:
    buffer = Buffer()
    for source in ("/old", "/new", "/newer", "/new"):
        for i in range(5):
            buffer.insert(said("odom", "base_link", len(buffer.frames()) + i), source=source)
    assert buffer.warnings() == ()


def test_a_frame_that_was_static_and_moves_is_told_and_counts() -> None:
    buffer = robot()
    assert buffer.lookup("base_link", "laser").x == 0.2
    for time in (103.0, 104.0):
        buffer.insert(at_x("base_link", "laser", time, time), source="/pan")
    assert buffer.lookup("base_link", "laser", ns(103.5)).x == pytest.approx(103.5)
    assert isinstance(buffer.why_not("base_link", "laser", ns(105.0)), InTheFuture)
    buffer.insert(at_x("base_link", "laser", 104.5, 0.5), static=True, source="/pan")
    assert buffer.lookup("base_link", "laser", ns(200.0)).x == 0.5
    assert [(warning.kind, warning.text) for warning in buffer.warnings()] == [
        ("now_moving",
         "base_link → laser was static, and moves now from /pan: publish a frame on tf or on tf_static, not on both"),
        ("now_static",
         "base_link → laser moved, and is static now from /pan: publish a frame on tf or on tf_static, not on both"),
    ]  # fmt: skip
