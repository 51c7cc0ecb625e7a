"""What a buffer of transforms does not know or does not take, each with its text."""

import itertools
import math

import pytest

from robo.errors import (
    ExtrapolationError,
    FrameLoop,
    FramesNotConnected,
    InTheFuture,
    InvalidTransform,
    NoTransformData,
    TooOld,
    TransformError,
    UnknownFrame,
)
from robo.tf import IDENTITY, Buffer, Transform3
from robo.tf import intake as intake_module
from robo.tf import tree as tree_module
from robo.tf.notes import MOST
from robo_messages import Header, Quaternion, Time, Transform, TransformStamped, Vector3
from tests.transforms import at_x, ns, pose, robot, said

# What is not found


def errors() -> list[tuple[str, str, float | None, type[TransformError], str]]:
    return [
        ("odom", "lasr", None, UnknownFrame, "there is no frame lasr; did you mean laser?"),
        ("gripper", "odom", 101.0, UnknownFrame,
         "there is no frame gripper; there is base_link, camera, laser, map, odom, world"),
        ("", "odom", None, InvalidTransform, "the target frame has an empty name; it takes one such as base_link"),
        ("odom", "", None, InvalidTransform, "the source frame has an empty name; it takes one such as base_link"),
        ("/map", "odom", None, InvalidTransform, "the target frame /map begins with a slash; write map"),
        ("map", "/odom", None, InvalidTransform, "the source frame /odom begins with a slash; write odom"),
        ("map", "camera", None, FramesNotConnected,
         "nothing leads from camera to map: camera stands in the tree of world, and map stands in no other frame; "
         "a transform is missing that has world or map as its child"),
        ("world", "laser", 102.0, FramesNotConnected,
         "nothing leads from laser to world: laser stands in the tree of map, and world stands in no other frame; "
         "a transform is missing that has map or world as its child"),
        ("map", "laser", 99.0, TooOld,
         "99.000 s is too old for odom → base_link: its history begins at 100.000 s, 1.000 s after"),
        ("laser", "map", 99.5, TooOld,
         "99.500 s is too old for odom → base_link: its history begins at 100.000 s, 0.500 s after"),
        ("map", "laser", 0.0, TooOld,
         "0.000 s is too old for odom → base_link: its history begins at 100.000 s, 100.000 s after; "
         "for the newest leave the time out, 0 is a time as any other"),
        ("map", "laser", 104.012345678, InTheFuture,
         "104.012345678 s is in the future of odom → base_link: its newest is of 104.000 s, 0.012345678 s before; "
         "wait for it, or leave the time out"),
        ("map", "odom", 104.1, InTheFuture,
         "104.100 s is in the future of map → odom: its newest is of 104.000 s, 0.100 s before; "
         "wait for it, or leave the time out"),
        ("camera", "world", -3.5, TooOld,
         "-3.500 s is too old for world → camera: its history begins at 7.000 s, 10.500 s after"),
    ]  # fmt: skip


@pytest.mark.parametrize(("target", "source", "time", "kind", "text"), errors())
def test_what_is_not_known_is_told(
    target: str, source: str, time: float | None, kind: type[TransformError], text: str
) -> None:
    buffer = robot()
    buffer.insert(said("world", "camera", 7.0))
    when = None if time is None else ns(time)
    for _ in range(2):
        with pytest.raises(kind) as caught:
            buffer.lookup(target, source, when)
        assert str(caught.value) == text
        error = buffer.why_not(target, source, when)
        assert (type(error), str(error)) == (kind, text)
        assert not buffer.can_transform(target, source, when)
        for frame in ("map", "odom", "base_link"):
            buffer.lookup(frame, "laser")  # now chains are known


def test_a_buffer_without_transforms_says_so() -> None:
    for error in (Buffer().why_not("map", "odom"), Buffer().why_not("odom", "odom")):
        assert isinstance(error, NoTransformData)
    assert str(error) == "there is no frame odom: no transform has come yet of any frame"
    with pytest.raises(NoTransformData, match="no transform has come yet"):
        Buffer().newest("map", "odom")
    assert not Buffer().can_transform("map", "odom")


def test_newest_tells_what_is_wrong_too() -> None:
    buffer = robot()
    buffer.insert(said("world", "camera", 7.0))
    with pytest.raises(FramesNotConnected):
        buffer.newest("map", "camera")
    with pytest.raises(UnknownFrame):
        buffer.newest("map", "nowhere")


def test_an_error_of_time_says_where_and_when() -> None:
    error = robot().why_not("map", "laser", ns(104.5))
    assert isinstance(error, InTheFuture)
    assert (error.parent, error.child, error.wanted, error.limit) == ("odom", "base_link", ns(104.5), ns(104.0))
    old = robot().why_not("map", "laser", ns(99.5))
    assert isinstance(old, ExtrapolationError)
    assert (old.parent, old.child, old.wanted, old.limit) == ("odom", "base_link", ns(99.5), ns(100.0))


def test_a_link_that_has_fallen_silent_is_named() -> None:
    buffer = robot()
    for i in range(200):
        buffer.insert(at_x("odom", "base_link", 104.0 + i / 5, float(i)), source="/odometry")
    assert str(buffer.why_not("map", "base_link")) == (
        "there is no time at which all links are known: the newest of map → odom is of 104.000 s, and odom → base_link "
        "is known from 133.800 s on, 29.800 s after; does anybody still publish map → odom?"
    )


def test_a_silent_link_is_named_also_where_a_frame_has_changed_its_parent() -> None:
    buffer = Buffer()
    buffer.insert(said("map", "odom", 50.0))
    for parent, time in (("odom", 100.0), ("map", 103.0)):
        buffer.insert(said(parent, "base_link", time))
    assert str(buffer.why_not("odom", "base_link")) == (
        "there is no time at which all links are known: the newest of map → odom is of 50.000 s, and map → base_link "
        "is known from 100.000 s on, 50.000 s after; does anybody still publish map → odom?"
    )


def test_of_a_full_history_the_way_to_more_is_told() -> None:
    buffer = Buffer(2.0)
    for i in range(100):
        buffer.insert(at_x("odom", "base_link", i / 10, float(i)))
    error = str(buffer.why_not("odom", "base_link", ns(1.0)))
    assert error.startswith("1.000 s is too old for odom → base_link: its history begins at ")
    assert error.endswith("; this buffer keeps 2.000 s, Buffer(duration=…) more")


def test_one_sample_is_known_at_its_time_alone() -> None:
    buffer = Buffer()
    buffer.insert(at_x("odom", "base_link", 3.0, 1.0))
    assert buffer.lookup("odom", "base_link") == buffer.lookup("odom", "base_link", ns(3.0)) == Transform3(x=1.0)
    assert isinstance(buffer.why_not("odom", "base_link", ns(3.0) - 1), TooOld)
    assert isinstance(buffer.why_not("odom", "base_link", ns(3.0) + 1), InTheFuture)


def test_names_of_strangers_show_their_control_characters() -> None:
    buffer = robot()
    buffer.insert(said("map", "odd\x1b[31m", 1.0))
    error = str(buffer.why_not("map", "odd\x1b[31m", ns(5.0)))
    assert error.startswith(r"5.000 s is in the future of map → odd\x1b[31m: ")
    assert len(str(buffer.why_not("map", "long" * 10_000))) < 400


# What is refused


REFUSED = [
    ("", "base_link", {}, InvalidTransform,
     "'' → base_link is refused: header.frame_id is empty, and names the parent frame"),
    ("odom", "", {}, InvalidTransform, "odom → '' is refused: child_frame_id is empty, and names the child frame"),
    ("/", "base_link", {}, InvalidTransform,
     "'' → base_link is refused: header.frame_id is empty, and names the parent frame"),
    ("odom", "odom", {}, InvalidTransform,
     "odom → odom is refused: a frame cannot stand in itself; header.frame_id names its parent"),
    ("odom", "/odom", {}, InvalidTransform,
     "odom → odom is refused: a frame cannot stand in itself; header.frame_id names its parent"),
    ("odom", "base_link", {"x": math.nan}, InvalidTransform,
     "odom → base_link is refused: translation (nan, 0.0, 0.0) and rotation (0.0, 0.0, 0.0, 1.0) are not all finite"),
    ("odom", "base_link", {"w": math.inf}, InvalidTransform,
     "odom → base_link is refused: translation (0.0, 0.0, 0.0) and rotation (0.0, 0.0, 0.0, inf) are not all finite"),
    ("odom", "base_link", {"w": 0.0}, InvalidTransform,
     "odom → base_link is refused: (0.0, 0.0, 0.0, 0.0) is no rotation: a unit quaternion x, y, z, w has norm 1, and "
     "this one 0; no turn at all is (0, 0, 0, 1)"),
    ("odom", "base_link", {"w": 2.0}, InvalidTransform,
     "odom → base_link is refused: (0.0, 0.0, 0.0, 2.0) is no rotation: a unit quaternion x, y, z, w has norm 1, and "
     "this one 2"),
    ("laser", "map", {}, FrameLoop,
     "laser → map is refused: map cannot stand in laser: laser stands in base_link in odom in map already, and no "
     "frame can be its own ancestor"),
    ("odom", "map", {}, FrameLoop,
     "odom → map is refused: map cannot stand in odom: odom stands in map already, and no frame can be its own "
     "ancestor"),
]  # fmt: skip


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize(("parent", "child", "numbers", "kind", "text"), REFUSED)
def test_what_is_no_transform_is_refused_and_changes_nothing(
    parent: str, child: str, numbers: dict[str, float], kind: type[TransformError], text: str, static: bool
) -> None:
    buffer = robot()
    before = [repr(frame) for frame in buffer.frames(0)]
    message = said(parent, child, 104.02)
    message.transform = Transform(Vector3(numbers.get("x", 0.0)), Quaternion(w=numbers.get("w", 1.0)))
    with pytest.raises(kind) as caught:
        buffer.insert(message, static)
    assert str(caught.value) == text
    assert [repr(frame) for frame in buffer.frames(0)] == before
    assert buffer.warning_count == 0

    buffer.insert_all([message, said("odom", "base_link", 104.04, pose(4.04)), message], static=False, source="/odd")
    assert buffer.newest("odom", "base_link") == ns(104.04)
    (warning,) = buffer.warnings()
    assert (warning.kind, warning.child, warning.count) == ("refused", child, 2)
    assert warning.text == text.replace(" is refused", " from /odd is refused")
    assert buffer.warning_count == 2


def test_a_number_beside_a_good_one_does_not_hide() -> None:
    buffer = robot()
    message = said("odom", "base_link", 104.02)
    message.transform.translation = Vector3(math.inf, -math.inf, 0.0)
    with pytest.raises(InvalidTransform, match="not all finite"):
        buffer.insert(message, source="/odometry")
    message.transform.translation = Vector3(1e308, 1e308, 0.0)
    buffer.insert(message, source="/odometry")
    assert buffer.lookup("odom", "base_link")[:2] == (1e308, 1e308)


def test_a_stamp_beyond_reason_is_refused() -> None:
    buffer = Buffer()
    with pytest.raises(InvalidTransform, match="is further from 1970 than 146 years"):
        buffer.insert(TransformStamped(Header(Time(10**10), "odom"), "base_link"))


def test_a_leading_slash_is_left_out_of_what_comes() -> None:
    buffer = Buffer()
    for i in range(3):
        buffer.insert(at_x("/odom", "/base_link", 1.0 + i, float(i)))
    buffer.insert(at_x("odom", "base_link", 4.0, 3.0))
    assert buffer.lookup("odom", "base_link", ns(3.5)).x == pytest.approx(2.5)
    assert [frame.child for frame in buffer.frames()] == ["base_link"]


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan, math.inf, 1e6])
def test_a_duration_that_is_none_is_refused(duration: float) -> None:
    with pytest.raises(ValueError, match="keeps more than 0 s, and at most a day"):
        Buffer(duration)


def test_made_up_names_do_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(intake_module, "MOST_FRAMES", 50)
    monkeypatch.setattr(tree_module, "MOST_CHAINS", 20)
    buffer = Buffer()
    buffer.insert_all([said("map", f"f{i}", 1.0) for i in range(400)])
    buffer.insert_all([said(f"p{i}", "f0", 2.0) for i in range(400)])
    assert len(buffer._tree.frames) == 50
    assert len(buffer.frames()) == 49
    assert len(buffer.warnings()) == MOST
    assert buffer.warnings()[-1].text == "p399 → f0 is refused: there are 50 frames, and a buffer takes no more"
    for i, j in itertools.product(range(49), repeat=2):
        assert buffer.lookup(f"f{i}", f"f{j}") == IDENTITY
        assert len(buffer._tree.chains) <= 20
