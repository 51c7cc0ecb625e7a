"""`Buffer`: the transforms of the last seconds, and from them where any frame stood in any other."""

import math
import operator
import threading
import time as wall
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

from robo.errors import TransformError
from robo.tf import faults
from robo.tf.frames import FrameInfo, frames_of
from robo.tf.history import Link, pack
from robo.tf.intake import Intake
from robo.tf.notes import Notes, TransformWarning
from robo.tf.transform import AS_UNIT, NEARLY_UNIT, Transform3
from robo.tf.tree import Tree
from robo_messages import Time, TransformStamped

When: TypeAlias = Time | int | None
"""A time as a message has it, or in ns; None is the newest at which all is known."""

LONGEST = 86_400.0
"""s."""


class Buffer:
    """Transforms as they come, for `duration` s, and lookups between any two frames at any time within that.

    A transform says where a child frame stands in its parent, at a time (`header.stamp`). Between two of them the frame
    moves as a screw does (`interpolate`), before the first and after the last one nothing is known: nothing is ever
    extrapolated. A static transform holds at all times. Of a frame that gets another parent the new one counts from its
    stamp on, and what it was last in the old one holds until then; so it is in ROS's tf2.

    Any number of threads may insert and look up. Inserting takes a lock. A lookup takes it only where something is new
    or wrong: where there was one between the two frames before, it follows the same links, which are only ever added
    to (`robo.tf.history` says why that holds).

    >>> buffer = Buffer()
    >>> buffer.insert(TransformStamped(Header(Time(1), "odom"), "base_link", Transform(Vector3(x=1.0))))
    >>> buffer.insert(TransformStamped(Header(Time(2), "odom"), "base_link", Transform(Vector3(x=3.0))))
    >>> buffer.lookup("odom", "base_link", Time(1, 500_000_000)).x
    2.0
    """

    def __init__(self, duration: float = 10.0) -> None:
        """`duration` is how long what has come is kept, s, counted from the newest of each frame: at least so long.

        Raises:
            ValueError: it is not more than 0, or more than a day.
        """
        if not 0.0 < duration <= LONGEST:
            raise ValueError(f"duration={duration!r}: a buffer keeps more than 0 s, and at most a day")
        self._duration = math.ceil(duration * 1e9)
        self._lock = threading.Lock()
        self._tree = Tree()
        self._notes = Notes()
        self._intake = Intake(self._tree, self._notes, self._duration)

    @property
    def duration(self) -> float:
        """How long what has come is kept, s."""
        return self._duration * 1e-9

    @property
    def clocks_set_back(self) -> int:
        """How often the stamps of a frame went back by more than the duration, and its history was cleared."""
        return self._intake.set_back

    @property
    def warning_count(self) -> int:
        """How often there was something to warn of: whether `warnings` has something new costs no more than this."""
        return self._notes.count

    def warnings(self) -> tuple[TransformWarning, ...]:
        """What is not right with the transforms that came, the last one at the end: one of each kind for each frame."""
        with self._lock:
            return self._notes.all()

    def insert(self, transform: TransformStamped, static: bool = False, source: str = "") -> None:
        """Take a transform. It is copied; the message may be changed afterwards.

        Of two with one stamp the one that came last counts. They may come out of order, but for one that is older than
        the newest of its frame by more than the duration: that is left out. A second one like that in a row, which goes
        on from the first, says that the clock was set back, and clears the frame's history; of another source than
        before it takes a second of them. A leading slash of a name is dropped, as in tf2.

        Args:
            transform: its header names the parent frame.
            static: whether it holds at all times; then its stamp says nothing.
            source: who says it, such as the name of a node.

        Raises:
            InvalidTransform: an empty name, a frame in itself, a number that is not finite, a rotation that is none.
            FrameLoop: the parent stands in the child.
        """
        for _, error in self._take((transform,), static, source):
            raise error

    def insert_all(self, transforms: Iterable[TransformStamped], static: bool = False, source: str = "") -> None:
        """Take all transforms of a message as `insert` does, and quicker. What is refused is told by `warnings`."""
        for transform, error in self._take(transforms, static, source):
            with self._lock:
                self._intake.note_refused(error, transform)

    def clear(self) -> None:
        """Forget all but static transforms, as after a jump of the clock. The frames and their parents stay known."""
        with self._lock:
            self._intake.clear()

    def lookup(self, target: str, source: str, time: When = None) -> Transform3:
        """Where `source` stands in `target`: the transform that takes coordinates in `source` to those in `target`.

        Args:
            target: the frame that coordinates are wanted in.
            source: the frame that they are in.
            time: when; None is the newest time at which all links between the two are known.

        Raises:
            UnknownFrame: nobody has said anything of one of the frames.
            FramesNotConnected: the two are in different trees.
            TooOld: the time is before the history of a link begins.
            InTheFuture: the time is after the newest of a link.
            NoTransformData: nothing has come at all, or since `clear`.
            InvalidTransform: a name is empty, or begins with a slash.
            TypeError: the time is none.
        """
        chain = self._tree.chains.get((target, source))
        if chain is not None:
            ns = chain.newest() if time is None else time if type(time) is int else _nanoseconds(time)
            found = chain.at(ns)
            if found is not None:
                return found
        return self._search(target, source, time)

    def lookup_full(self, target: str, target_time: When, source: str, source_time: When, fixed: str) -> Transform3:
        """The transform that takes coordinates in `source` at one time to coordinates in `target` at another one.

        Args:
            target: the frame that coordinates are wanted in.
            target_time: when; None is the newest time between `target` and `fixed`.
            source: the frame that they are in.
            source_time: when; None is the newest time between `source` and `fixed`.
            fixed: a frame that did not move in between, such as `odom` or `map`.

        Raises:
            TransformError: as `lookup`.
        """
        return self.lookup(target, fixed, target_time) @ self.lookup(fixed, source, source_time)

    def newest(self, target: str, source: str) -> int | None:
        """The newest time at which all links between two frames are known, ns; None where none of them moves.

        Raises:
            TransformError: as `lookup`.
        """
        self._check_names(target, source)
        with self._lock:
            return self._tree.newest(target, source)

    def can_transform(self, target: str, source: str, time: When = None) -> bool:
        """Whether `lookup` would find a transform."""
        frames = self._tree.frames
        if target not in frames or source not in frames:  # to say what else could be meant would take long
            return False
        return self.why_not(target, source, time) is None

    def why_not(self, target: str, source: str, time: When = None) -> TransformError | None:
        """The error that `lookup` would raise; None where it would find a transform."""
        try:
            self.lookup(target, source, time)
        except TransformError as error:
            return error
        return None

    def frames(self, now: Time | int | None = None) -> list[FrameInfo]:
        """All frames that stand in another, as a tree: each is followed by those that stand in it.

        Args:
            now: from when ages count; None is the wall clock's time.
        """
        with self._lock:
            return frames_of(self._tree.links.values(), wall.time_ns() if now is None else _nanoseconds(now))

    def _take(
        self, transforms: Iterable[TransformStamped], static: bool, source: str
    ) -> Sequence[tuple[TransformStamped, TransformError]]:
        """Insert transforms. Returns those that were refused."""
        refused = []
        moving: Mapping[str, Link] = {} if static else self._tree.links
        transforms = tuple(transforms)  # whatever yields them may look something up, which would wait for the lock
        with self._lock:
            for message in transforms:
                header = message.header
                stamp = header.stamp
                ns = stamp.sec * 1_000_000_000 + stamp.nanosec
                link = moving.get(message.child_frame_id)
                # Nearly all go this way, so it takes no calls, and no tuples.
                if (
                    link is not None
                    and link.low < ns < link.high
                    and header.frame_id == link.parent
                    and source == link.source
                ):
                    transform = message.transform
                    p, q = transform.translation, transform.rotation
                    x, y, z = p.x, p.y, p.z
                    qx, qy = q.x, q.y
                    qz, qw = q.z, q.w
                    off = qx * qx + qy * qy + qz * qz + qw * qw - 1.0
                    is_unit = -AS_UNIT < off < AS_UNIT
                    if not is_unit and -NEARLY_UNIT < off < NEARLY_UNIT:
                        is_unit, k = True, 1.0 / math.sqrt(1.0 + off)
                        qx, qy, qz, qw = k * qx, k * qy, k * qz, k * qw
                    if is_unit and (x + y + z) * 0.0 == 0.0:  # so all are finite
                        history = link.history
                        history.samples += pack(x, y, z, qx, qy, qz, qw)
                        history.stamps.append(ns)
                        link.low = ns
                        continue
                try:
                    self._intake.admit(message, static=static, source=source)
                except TransformError as error:
                    refused.append((message, error))
        return refused

    def _search(self, target: str, source: str, time: When) -> Transform3:
        """A lookup between frames whose chain is not known yet, or that finds nothing."""
        wanted = None if time is None else _nanoseconds(time)
        self._check_names(target, source)
        with self._lock:
            return self._tree.search(target, source, wanted, self._duration)

    def _check_names(self, target: str, source: str) -> None:
        for frame, role in ((target, "target"), (source, "source")):
            if (error := faults.bad_name(frame, role)) is not None:
                raise error
            if frame not in self._tree.frames:
                raise faults.unknown_frame(frame, list(self._tree.frames))


def _nanoseconds(time: Time | int) -> int:
    if isinstance(time, Time):
        return time.to_nanoseconds()
    try:
        return operator.index(time)
    except TypeError:
        raise TypeError(f"a time is a Time or a whole number of ns, not {time!r}; see Time.from_seconds") from None
