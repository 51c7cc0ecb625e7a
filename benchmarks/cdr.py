"""`python -m benchmarks.cdr`: what it costs to write and read messages as CDR; writes CDR.md.

CDR is what recordings hold and what other systems read; between nodes MessagePack travels. Both are measured on the
same messages, in one process, in turn and in an order that changes, and where it is installed (`pip install rosbags`)
rosbags beside them. Of rosbags, `writes` is with its own message ready, and `makes` is to make that of robo's, its
arrays of numpy included; it reads lists as such. `LaserScanArray` is a scan that was received with its ranges as they
travel, which are never numbers of Python's. `from the wire` is what a recorder does: MessagePack read, CDR written.
"""

import argparse
import importlib
import importlib.util
import math
import random
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import robo_messages
from benchmarks.__main__ import Spread, machine
from robo.interfaces.cdr import decoder, encoder
from robo.interfaces.ros_shape import Array, Kind, Part, Shape, Single, shape_of
from robo_messages import (
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    Image,
    JointState,
    KeyValue,
    LaserScan,
    Message,
    Odometry,
    PoseStamped,
    TFMessage,
    Time,
    TransformStamped,
    Twist,
    Vector3,
)
from robo_messages import (
    Path as PathMessage,
)
from robo_messages.scans import LaserScanArray

RESULTS = Path(__file__).parent / "CDR.md"
LONG = "LaserScan, 2,000 rays"
MOST_TWIST, MOST_SCAN = 1.0, 1.3
"""To write one: as much as MessagePack takes; of what `struct` takes for the ranges alone."""
BESIDE_MSGPACK = ("Twist", "Odometry", "LaserScan, 360 rays", LONG)
MOST_BESIDE_MSGPACK = 3.0
"""To write and to read one of these: of what MessagePack takes for both."""
ROSBAGS = importlib.util.find_spec("rosbags") is not None


def samples() -> dict[str, Message]:
    """Messages as robots send them."""
    rng = random.Random(0)
    header = Header(Time(1_700_000_000, 5), "base_link")

    def scan(rays: int) -> LaserScan:
        ranges = [math.inf if rng.random() < 0.1 else rng.uniform(0.1, 8.0) for _ in range(rays)]
        return LaserScan(header, -3.14, 3.14, 6.28 / rays, 0.0, 0.1, 0.1, 8.0, ranges, [])

    joints = [f"joint_{i}" for i in range(12)]
    status = DiagnosticStatus(0, "/r1/base: battery", "charged", "", [KeyValue("voltage", "12.5 V")] * 5)
    long = scan(2000)
    return {
        "Twist": Twist(Vector3(0.5), Vector3(z=0.1)),
        "Odometry": Odometry(header, "base_link"),
        "JointState, 12 joints": JointState(header, joints, [0.1] * 12, [0.2] * 12, []),
        "TFMessage, 10 frames": TFMessage([TransformStamped(header, "laser")] * 10),
        "DiagnosticArray, 8 of them": DiagnosticArray(header, [status] * 8),
        "Path, 100 poses": PathMessage(header, [PoseStamped(header)] * 100),
        "LaserScan, 360 rays": scan(360),
        LONG: long,
        "LaserScanArray, 2,000 rays": robo_messages.decode(robo_messages.encode(long), LaserScanArray),
        "Image, 640 x 480 rgb8": Image(header, 480, 640, "rgb8", 0, 1920, memoryview(rng.randbytes(640 * 480 * 3))),
    }


class Theirs:
    """The same messages as rosbags has them."""

    def __init__(self) -> None:
        typesys = importlib.import_module("rosbags.typesys")
        self._numpy = importlib.import_module("numpy")
        self.store: Any = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def make(self, shape: Shape, message: Message) -> Any:
        """A message of rosbags' with the fields of one of robo's."""
        values = {field.name: self._value(field.kind, getattr(message, field.attribute)) for field in shape.fields}
        return self.store.types[shape.ros_name](**values)

    def _value(self, kind: Kind, value: Any) -> Any:
        match kind:
            case Part(shape):
                return self.make(shape, value)
            case Array(Part(shape)):
                return [self.make(shape, one) for one in value]
            case Array(Single() as item) if item.ros != "string":
                numpy = self._numpy
                return (
                    numpy.frombuffer(value, item.ros) if isinstance(value, memoryview) else numpy.array(value, item.ros)
                )
        return value

    def _array(self, word: str, value: Any) -> Any:
        is_binary = isinstance(value, memoryview)
        return self._numpy.frombuffer(value, word) if is_binary else self._numpy.array(value, word)


def works(message: Message) -> dict[str, Callable[[], object]]:
    """What is done to a message, by what it is called."""
    type_ = type(message)
    write, read = encoder(type_), decoder(type_)
    data, travels = write(message), robo_messages.encode(message)
    decode = robo_messages.decoder_of(type_).decode
    found: dict[str, Callable[[], object]] = {
        "cdr writes": lambda: write(message),
        "cdr reads": lambda: read(data),
        "msgpack writes": lambda: robo_messages.encode(message),
        "msgpack reads": lambda: decode(travels),
        "from the wire": lambda: write(decode(travels)),
    }
    if isinstance(message, LaserScan):
        pack, ranges = struct.Struct(f"<{len(message.ranges)}f").pack, message.ranges
        found["struct"] = lambda: pack(*ranges)
    if ROSBAGS and type_ is not LaserScanArray:
        theirs, shape = Theirs(), shape_of(type_)
        ready = theirs.make(shape, message)
        store, name = theirs.store, shape.ros_name
        assert bytes(store.serialize_cdr(ready, name)) == data, f"the same bytes for {name}"
        found |= {
            "rosbags writes": lambda: store.serialize_cdr(ready, name),
            "rosbags makes": lambda: theirs.make(shape, message),
            "rosbags reads": lambda: store.deserialize_cdr(data, name),
        }
    return found


def timed(work: Callable[[], object], count: int) -> float:
    """µs of processor time for each."""
    begin = time.process_time_ns()
    for _ in range(count):
        work()
    return (time.process_time_ns() - begin) / count / 1e3


def measure(rounds: int) -> dict[str, dict[str, Spread]]:
    """All figures, µs, by message and work."""
    rng = random.Random()
    all_works = {name: works(message) for name, message in samples().items()}
    turns = [(name, what) for name, found in all_works.items() for what in found]
    counts = {(name, what): max(3, round(4000 / timed(all_works[name][what], 20))) for name, what in turns}
    found: dict[tuple[str, str], list[float]] = {turn: [] for turn in turns}
    for _ in range(rounds):
        for turn in rng.sample(turns, len(turns)):
            found[turn].append(timed(all_works[turn[0]][turn[1]], counts[turn]))
    return {name: {what: Spread.of(found[name, what]) for what in all_works[name]} for name in all_works}


COLUMNS = (
    "cdr writes", "msgpack writes", "rosbags writes", "rosbags makes", "cdr reads", "msgpack reads", "rosbags reads",
    "from the wire",
)  # fmt: skip


def table(figures: dict[str, dict[str, Spread]]) -> list[str]:
    """The figures, and whether what is promised holds."""
    columns = [column for column in COLUMNS if any(column in found for found in figures.values())]
    lines = [f"| µs | {' | '.join(columns)} | bytes CDR, msgpack |", f"|{'---|' * (len(columns) + 2)}"]
    for name, message in samples().items():
        cells = [figures[name][column].text(".3g") if column in figures[name] else "" for column in columns]
        sizes = f"{len(encoder(type(message))(message)):,}, {len(robo_messages.encode(message)):,}"
        lines.append(f"| {name} | {' | '.join(cells)} | {sizes} |")
    twist, scan = figures["Twist"], figures[LONG]
    return [
        *lines,
        "",
        _verdict("a Twist", twist["cdr writes"], "MessagePack takes", twist["msgpack writes"], MOST_TWIST),
        "",
        _verdict("a scan of 2,000 rays", scan["cdr writes"], "struct takes for its ranges", scan["struct"], MOST_SCAN),
        "",
        *(line for name in BESIDE_MSGPACK for line in (_both_ways(name, figures[name]), "")),
    ]


def _both_ways(name: str, found: dict[str, Spread]) -> str:
    """Whether writing and reading take as long as is promised, beside MessagePack."""
    ways = {way: (found[f"cdr {way}"].median, found[f"msgpack {way}"].median) for way in ("writes", "reads")}
    ratio = sum(ours for ours, _ in ways.values()) / sum(theirs for _, theirs in ways.values())
    verdict = "holds" if ratio <= MOST_BESIDE_MSGPACK else "DOES NOT HOLD"
    each = ", ".join(f"{way} {ours / theirs:.2f}" for way, (ours, theirs) in ways.items())
    most = f"at most {MOST_BESIDE_MSGPACK:g} of what MessagePack takes"
    return f"{name}: to write and to read one takes {most}: {verdict}, {ratio:.2f} ({each})."


def _verdict(what: str, written: Spread, beside: str, other: Spread, most: float) -> str:
    ratio = written.median / other.median
    verdict = "holds" if ratio <= most else "DOES NOT HOLD"
    return f"To write {what} takes at most {most:g} of what {beside}, {other.median:.3g} µs: {verdict}, {ratio:.2f}."


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cdr", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=30, help="rounds of each measurement (default 30)")
    parser.add_argument("--quick", action="store_true", help="a few rounds; writes no results")
    options = parser.parse_args()
    rounds = 3 if options.quick else options.rounds
    head = f"Written by `python -m benchmarks.cdr`: medians over {rounds} rounds (smallest-largest)."
    about = (__doc__ or "").split("\n\n", 1)[1].splitlines()
    text = "\n".join(["# Messages as CDR", "", head, "", *machine(), *about, "", *table(measure(rounds))])
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
