"""The buffer of transforms: what is found, beside a naive one with matrices too, and by several threads."""

import bisect
import itertools
import math
import random
import threading
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from robo.errors import ExtrapolationError, FramesNotConnected, InTheFuture, NoTransformData, TooOld
from robo.tf import IDENTITY, Buffer, FrameInfo, Transform3
from robo_messages import Header, Quaternion, TFMessage, Time, Transform, TransformStamped, Vector3, decode, encode
from tests.transforms import SECOND, apart, at_x, ns, pose, robot, said

# What is found


def test_a_lookup_takes_coordinates_of_the_source_into_the_target() -> None:
    buffer = robot()
    found = buffer.lookup("odom", "laser", ns(101.037))
    assert apart(found, pose(1.037) @ Transform3(x=0.2, z=0.3)) < 1e-12
    assert found.apply(0.0, 0.0, 0.0) == pytest.approx(pose(1.037).apply(0.2, 0.0, 0.3))
    assert apart(buffer.lookup("laser", "odom", ns(101.037)), found.inverse()) < 1e-12


@given(st.integers(0, 4 * SECOND))
def test_between_samples_a_body_on_a_circle_is_where_it_was(offset: int) -> None:
    found = ON_CIRCLE.lookup("odom", "base_link", 100 * SECOND + offset)
    assert apart(found, pose(offset / SECOND)) < 1e-12


ON_CIRCLE = robot()


def test_a_time_may_be_a_message_or_ns_and_without_it_the_newest_counts_that_all_have() -> None:
    buffer = robot()
    buffer.insert(said("odom", "base_link", 104.5, pose(4.5)), source="/odometry")
    assert buffer.lookup("map", "laser", Time(101, 500_000_000)) == buffer.lookup("map", "laser", ns(101.5))
    assert buffer.newest("map", "laser") == ns(104.0)
    assert buffer.newest("laser", "odom") == ns(104.5)
    assert buffer.lookup("map", "laser") == buffer.lookup("map", "laser", ns(104.0))
    assert buffer.lookup("odom", "laser") == buffer.lookup("odom", "laser", ns(104.5))


@pytest.mark.parametrize("time", [1.5, "now", Time])
def test_what_is_no_time_is_told(time: object) -> None:
    for _ in range(2):  # before and after the chain is known
        with pytest.raises(
            TypeError, match=r"^a time is a Time or a whole number of ns, not .*; see Time.from_seconds$"
        ):
            ON_CIRCLE.lookup("odom", "laser", time)  # type: ignore[arg-type]
        ON_CIRCLE.lookup("odom", "laser")
    assert ON_CIRCLE.lookup("odom", "laser", np.int64(101 * SECOND)) == ON_CIRCLE.lookup("odom", "laser", Time(101))  # type: ignore[arg-type]


def test_at_a_sample_it_is_that_sample_to_the_last_bit() -> None:
    for _ in range(2):
        assert ON_CIRCLE.lookup("odom", "base_link", ns(102.02)) == pose(2.02)
        assert ON_CIRCLE.lookup("odom", "base_link") == pose(4.0)
        assert ON_CIRCLE.lookup("odom", "base_link", ns(100)) == pose(0.0)


def test_a_frame_in_itself_is_the_identity_at_any_time() -> None:
    for frame in ("map", "base_link", "laser"):
        assert ON_CIRCLE.lookup(frame, frame) == ON_CIRCLE.lookup(frame, frame, 0) == IDENTITY
        assert ON_CIRCLE.newest(frame, frame) is None


def test_static_transforms_hold_at_all_times() -> None:
    buffer = Buffer()
    a, b, c = Transform3.planar(1.0, 0.0, 0.5), Transform3(z=0.7), Transform3.from_rpy(0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    for parent, child, where in (("base_link", "mast", a), ("mast", "camera", b), ("camera", "lens", c)):
        buffer.insert(said(parent, child, 5.0, where), static=True)
    for time in (None, -(1 << 61), 0, 5 * SECOND, (1 << 62)):
        assert apart(buffer.lookup("base_link", "lens", time), a @ b @ c) < 1e-12
        assert apart(buffer.lookup("lens", "mast", time), (b @ c).inverse()) < 1e-12
    assert buffer.newest("base_link", "lens") is None


def test_a_static_transform_that_is_said_anew_counts_at_once() -> None:
    buffer = robot()
    assert buffer.lookup("base_link", "laser").x == 0.2
    buffer.insert(at_x("base_link", "laser", 0.0, 0.7), static=True)
    assert buffer.lookup("base_link", "laser").x == 0.7
    assert buffer.lookup("laser", "base_link").x == -0.7
    assert buffer.warnings() == ()


def test_time_travel_compares_two_times_by_a_fixed_frame() -> None:
    found = ON_CIRCLE.lookup_full("base_link", ns(103), "base_link", ns(101), "odom")
    assert apart(found, pose(3.0).inverse() @ pose(1.0)) < 1e-12
    assert ON_CIRCLE.lookup_full("map", None, "laser", None, "odom") == ON_CIRCLE.lookup(
        "map", "odom"
    ) @ ON_CIRCLE.lookup("odom", "laser")
    with pytest.raises(InTheFuture):
        ON_CIRCLE.lookup_full("base_link", ns(103), "base_link", ns(105), "odom")


def test_messages_as_they_come_over_the_network() -> None:
    buffer = Buffer()
    message = TFMessage([at_x("odom", "base_link", 1.0, 1.0), at_x("map", "odom", 1.0, 2.0)])
    buffer.insert_all(decode(encode(message), TFMessage).transforms, source="/odometry")
    assert buffer.lookup("map", "base_link").x == 3.0


def test_what_was_inserted_is_a_copy() -> None:
    buffer, message = Buffer(), at_x("odom", "base_link", 1.0, 1.0)
    buffer.insert(message)
    message.transform.translation.x = 7.0
    message.header.stamp.sec = 2
    buffer.insert(message)
    assert buffer.lookup("odom", "base_link", ns(1.0)).x == 1.0
    assert buffer.lookup("odom", "base_link", ns(1.5)).x == pytest.approx(4.0)


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_a_quaternion_in_float32_is_normalized(static: bool, first: bool) -> None:
    buffer = Buffer()
    if not first:
        buffer.insert(said("odom", "base_link", 0.5))
    rough = Quaternion(*(float(np.float32(part)) for part in (0.1, 0.2, 0.3, math.sqrt(1 - 0.14))))
    buffer.insert(TransformStamped(Header(Time(1), "odom"), "base_link", Transform(Vector3(), rough)), static)
    found = buffer.lookup("odom", "base_link")
    assert math.hypot(*found[3:]) == pytest.approx(1.0, abs=1e-15)
    assert found[3:] == pytest.approx((0.1, 0.2, 0.3, math.sqrt(1 - 0.14)), abs=1e-7)


def test_what_yields_transforms_may_look_something_up() -> None:
    buffer = robot()
    where = (
        buffer.lookup("map", "laser", ns(100 + i)).to_stamped(Header(Time(100 + i), "map"), "hit") for i in range(3)
    )
    buffer.insert_all(where)
    assert buffer.lookup("laser", "hit", ns(101)) == pytest.approx(IDENTITY, abs=1e-12)


def test_an_answer_that_was_given_is_given_again_until_something_changes() -> None:
    buffer = Buffer()
    for time in (1.0, 3.0):
        buffer.insert(at_x("odom", "base_link", time, time))
    buffer.insert(at_x("base_link", "laser", 0.0, 10.0), static=True)
    chain = ("odom", "laser", ns(2.0))
    assert buffer.lookup(*chain) == buffer.lookup(*chain) == Transform3(x=12.0)
    assert buffer.lookup(*chain) is buffer.lookup(*chain)
    buffer.insert(at_x("odom", "base_link", 4.0, 4.0))  # at the end: what was is not touched
    known = buffer.lookup(*chain)
    buffer.insert(at_x("odom", "base_link", 3.0, 3.0))  # nor by what is known already
    assert buffer.lookup(*chain) is known
    assert known == Transform3(x=12.0)
    buffer.insert(at_x("odom", "base_link", 2.5, 1.0))
    assert buffer.lookup(*chain) == Transform3(x=11.0)
    buffer.insert(at_x("odom", "base_link", 2.5, 4.0))
    assert buffer.lookup(*chain) == Transform3(x=13.0)
    buffer.insert(at_x("base_link", "laser", 0.0, 20.0), static=True)
    assert buffer.lookup(*chain) == Transform3(x=23.0)
    buffer.clear()
    assert isinstance(buffer.why_not(*chain), NoTransformData)


# Beside a naive one


Matrix = NDArray[np.float64]


def moved(a: Matrix, b: Matrix, f: float) -> Matrix:
    """a exp(f log(a⁻¹ b)) with matrices (Lynch and Park 2017, §3.3.3)."""
    way = np.linalg.inv(a) @ b
    angle = math.acos(max(-1.0, min(1.0, (np.trace(way[:3, :3]) - 1.0) / 2.0)))
    if angle < 1e-6:
        return np.asarray(a + f * (b - a))
    turning = (way[:3, :3] - way[:3, :3].T) / (2.0 * math.sin(angle))

    def exponential(theta: float) -> tuple[Matrix, Matrix]:
        s, c = math.sin(theta), math.cos(theta)
        rotation = np.eye(3) + s * turning + (1.0 - c) * turning @ turning
        return rotation, np.eye(3) * theta + (1.0 - c) * turning + (theta - s) * turning @ turning

    step = np.eye(4)
    velocity = np.linalg.solve(exponential(angle)[1], way[:3, 3])
    step[:3, :3], carried = exponential(f * angle)
    step[:3, 3] = carried @ velocity
    return np.asarray(a @ step)


class Naive:
    """Every transform as a matrix in a list; each lookup from the beginning."""

    def __init__(self) -> None:
        self.links: dict[str, dict[int, tuple[str, Matrix]]] = {}

    def insert(self, message: TransformStamped) -> None:
        there = self.links.setdefault(message.child_frame_id, {})
        matrix = np.array(Transform3.from_message(message).matrix())
        there[message.header.stamp.to_nanoseconds()] = (message.header.frame_id, matrix)

    def step(self, child: str, time: int) -> tuple[str, Matrix] | None:
        """The parent of a frame and where it stands in it."""
        samples = sorted(self.links.get(child, {}).items())
        i = bisect.bisect_right([stamp for stamp, _ in samples], time) - 1
        if i < 0:
            return None
        begin, (parent, matrix) = samples[i]
        if begin == time:
            return parent, matrix
        if i + 1 == len(samples):
            return None
        end, (next_parent, next_matrix) = samples[i + 1]
        return parent, moved(matrix, next_matrix, (time - begin) / (end - begin)) if parent == next_parent else matrix

    def above(self, frame: str, time: int) -> dict[str, Matrix]:
        """All frames that one stands in, and where it does."""
        found, at = {frame: np.eye(4)}, np.eye(4)
        while (step := self.step(frame, time)) is not None and step[0] not in found:
            frame = step[0]
            at = step[1] @ at
            found[frame] = at
        return found

    def lookup(self, target: str, source: str, time: int) -> Matrix | None:
        up, down = self.above(source, time), self.above(target, time)
        for frame, matrix in up.items():
            if frame in down:
                return np.asarray(np.linalg.inv(down[frame]) @ matrix)
        return None


@st.composite
def trees(draw: st.DrawFn) -> list[TransformStamped]:
    """Transforms of a random tree, some with another parent for a while, in any order; stamps collide."""
    seed = draw(st.integers(0, 2**32))
    rng = random.Random(seed)
    count = draw(st.integers(2, 12))
    messages = []
    for i in range(1, count):
        parent = f"f{rng.randrange(i)}"
        other = f"f{rng.randrange(i)}" if rng.random() < 0.3 else parent
        for _ in range(rng.randrange(1, 12)):
            time = rng.randrange(20) / 4
            where = Transform3.from_rpy(
                *(rng.uniform(-5, 5) for _ in range(3)), *(rng.uniform(-1, 1) for _ in range(3))
            )
            messages.append(said(parent if time < 3 else other, f"f{i}", time, where))
    rng.shuffle(messages)
    return messages


def matrix_of(transform: Transform3) -> Matrix:
    return np.array(transform.matrix())


@settings(max_examples=60)
@given(trees(), st.lists(st.integers(0, 500), min_size=1, max_size=4))
def test_random_trees_are_those_of_a_naive_buffer(messages: list[TransformStamped], hundredths: list[int]) -> None:
    buffer, naive = Buffer(), Naive()
    for message in messages:
        buffer.insert(message)
        naive.insert(message)
    frames = sorted({"f0", *naive.links})
    for hundredth, target, source in itertools.product(hundredths, frames, frames):
        time = hundredth * SECOND // 100
        expected = naive.lookup(target, source, time)
        if expected is None:
            assert isinstance(buffer.why_not(target, source, time), (ExtrapolationError, FramesNotConnected))
        else:
            found = buffer.lookup(target, source, time)
            assert np.abs(matrix_of(found) - expected).max() < 1e-7  # an arc cosine knows no better
            assert buffer.lookup(target, source, time) == found
            assert buffer.can_transform(target, source, time)


@settings(max_examples=60)
@given(trees(), st.integers(0, 500))
def test_lookups_are_consistent(messages: list[TransformStamped], hundredth: int) -> None:
    buffer = Buffer()
    buffer.insert_all(messages)
    time = hundredth * SECOND // 100
    frames = sorted({message.child_frame_id for message in messages} | {"f0"})
    for a, b, c in itertools.product(frames, frames, frames):
        if buffer.can_transform(a, b, time) and buffer.can_transform(b, c, time):
            whole = buffer.lookup(a, b, time) @ buffer.lookup(b, c, time)
            assert apart(buffer.lookup(a, c, time), whole) < 1e-11


@settings(max_examples=60)
@given(st.permutations(range(12)), st.integers(0, 1100))
def test_the_order_in_which_samples_come_does_not_matter(order: Sequence[int], hundredth: int) -> None:
    in_order, shuffled = Buffer(20.0), Buffer(20.0)
    for i in range(12):
        in_order.insert(said("odom", "base_link", 1.0 + i, pose(0.1 * i * i)))
    for i in order:
        shuffled.insert(said("odom", "base_link", 1.0 + i, pose(0.1 * i * i)))
    time = SECOND + hundredth * SECOND // 100
    assert shuffled.lookup("odom", "base_link", time) == in_order.lookup("odom", "base_link", time)


# The tree


def test_frames_are_listed_as_a_tree() -> None:
    buffer = robot()
    buffer.insert(said("odom", "ball", 103.0), source="/camera")
    buffer.insert(said("another", "tree", 99.0))
    assert buffer.frames(Time(104, 500_000_000)) == [
        FrameInfo("tree", "another", False, None, ns(99.0), 5.5, "", 1),
        FrameInfo("odom", "map", False, 10.0, ns(104.0), 0.5, "/amcl", 1),
        FrameInfo("ball", "odom", False, None, ns(103.0), 1.5, "/camera", 2),
        FrameInfo("base_link", "odom", False, 50.0, ns(104.0), 0.5, "/odometry", 2),
        FrameInfo("laser", "base_link", True, None, 0, None, "/description", 3),
    ]
    assert Buffer().frames() == []


def test_ages_count_from_now_unless_somebody_says_so() -> None:
    buffer = Buffer()
    buffer.insert(TransformStamped(Header.now("odom"), "base_link"))
    age = buffer.frames()[0].age
    assert age is not None
    assert 0.0 <= age < 60.0


# Threads


def test_lookups_beside_a_thread_that_inserts_see_what_was_true() -> None:
    """A body that drives a circle, with frames that change parents, clocks and more meanwhile."""
    buffer = Buffer(20.0)
    buffer.insert(at_x("base_link", "laser", 0.0, 0.2), static=True)
    for i in range(100):
        buffer.insert(said("odom", "base_link", i / 100, pose(i / 100)))
    over = threading.Event()
    failures: list[BaseException] = []
    found = [0, 0]

    def compare(rng: random.Random) -> None:
        newest = buffer.newest("odom", "base_link")
        assert newest is not None
        time = newest - rng.randrange(SECOND // 2)
        expected = pose(time / SECOND) @ Transform3(x=0.2)
        with suppress(TooOld):  # twenty seconds here are a fraction of one
            assert apart(buffer.lookup("odom", "laser", time), expected) < 1e-9
            assert apart(buffer.lookup("laser", "odom", time), expected.inverse()) < 1e-9
            buffer.lookup("odom", "laser")
        buffer.why_not("odom", "cup")

    def look(index: int) -> None:
        rng = random.Random(index)
        try:
            while not over.is_set():
                compare(rng)
                found[index] += 1
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=look, args=(index,)) for index in range(2)]
    for thread in threads:
        thread.start()
    for i in itertools.count(100):
        order = (i + 1, i) if i % 7 == 0 else (i,)
        for k in order:
            buffer.insert(said("odom", "base_link", k / 100, pose(k / 100)))
        if i % 50 == 0:
            buffer.insert_all([said("base_link" if i % 100 else "laser", "cup", i / 100)])
        if failures or (i > 5_000 and min(found) > 100):
            break
    over.set()
    for thread in threads:
        thread.join()
    assert failures == []


def test_several_threads_may_insert() -> None:
    buffer = Buffer(100.0)

    def insert(first: int) -> None:
        for i in range(first, 4_000, 4):
            buffer.insert_all(
                [at_x("odom", "base_link", i / 100, i / 100), at_x("odom", f"f{i % 20}", i / 100, i / 100)]
            )

    threads = [threading.Thread(target=insert, args=(first,)) for first in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(buffer._tree.links["base_link"].history.stamps) == 4_000
    for i in range(0, 399_900, 1_237):
        assert buffer.lookup("odom", "base_link", i * SECOND // 10_000).x == pytest.approx(i / 10_000)
