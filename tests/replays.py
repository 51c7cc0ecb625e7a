"""Recordings for regression tests by replay, and nodes to replay them to."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from robo import bag
from robo.bag.types import topic_of
from robo.interfaces import cdr
from robo.text import graph
from robo.wire.qos import QoS
from robo_messages import Header, JointState, LaserScan, Message, Odometry, String, Time, Twist, Vector3
from tests.bags import MS, START

PLAIN = bag.Options(compression="none", sync=False)
LATE = 300_000
"""From when a message was published until it was recorded, ns."""


class Log:
    """Writes messages at their times."""

    def __init__(self, recording: bag.Recording) -> None:
        self._recording = recording
        self._numbers: dict[str, int] = {}

    def write(self, topic: str, message: Message, at: int, qos: QoS = QoS.DEFAULT, late: int = LATE) -> None:
        """One message, published at a time, ns after the beginning."""
        kind = type(message)
        number = self._recording.topic(topic_of(topic, kind, qos))
        self._numbers[topic] = self._numbers.get(topic, 0) + 1
        data = cdr.encoder(kind)(message)
        self._recording.write(number, data, START + at + late, START + at, self._numbers[topic], topic)


def attach_graph(recording: bag.Recording, publishers: Mapping[str, Sequence[str]]) -> None:
    """Let a recording say who published what.

    Args:
        recording: the recording.
        publishers: full names of nodes by topic.
    """
    nodes = {name for names in publishers.values() for name in names}
    ends = [graph.Edge(name, "pub", topic, "std/String") for topic, names in publishers.items() for name in names]
    built = graph.build([graph.GraphNode(name, None) for name in nodes], ends)
    recording.attach("graph.json", msgspec.json.encode(built), "application/json", START)


def odometry(path: Path, count: int = 100) -> Path:
    """A robot that drives a circle, and says 50 times a second where it is."""
    with bag.Recording(path, PLAIN) as recording:
        log = Log(recording)
        for number in range(count):
            at = number * 20 * MS
            angle = number / 50 * 0.2
            message = Odometry(Header(Time.from_nanoseconds(START + at), "odom"), "base_link")
            message.pose.pose.position.x, message.pose.pose.position.y = math.sin(angle), 1 - math.cos(angle)
            message.twist.twist.linear.x = 0.2
            log.write("r1/odom", message, at)
    return path


def wheels(path: Path, count: int = 100) -> Path:
    """Wheels of which the left one turns slower, 50 times a second, and what they were told."""
    with bag.Recording(path, PLAIN) as recording:
        log = Log(recording)
        for number in range(count):
            at = number * 20 * MS
            log.write("r1/cmd_vel", Twist(Vector3(x=0.3), Vector3(z=0.2)), at)
            header = Header(Time.from_nanoseconds(START + at))
            turned = number * 0.02
            state = JointState(header, ["left_wheel_joint", "right_wheel_joint"], position=[turned * 5, turned * 6])
            log.write("r1/joint_states", state, at + MS)
    return path


def words(path: Path, count: int = 20) -> Path:
    """A text ten times a second, and a scan beside it."""
    with bag.Recording(path, PLAIN) as recording:
        log = Log(recording)
        for number in range(count):
            log.write("r1/word", String(str(number)), number * 100 * MS)
            log.write("r1/scan", LaserScan(ranges=[1.0, 2.0]), number * 100 * MS + MS)
    return path


NODES = '''
import os, random, threading, time
from datetime import date, datetime
from typing import Annotated
import robo
from robo_messages import Float64, Message, String, Trigger, message


class Parrot(robo.Node):
    """Say what it hears."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.said.publish(String(word.data))


class WallClock(robo.Node):
    """Say what time it is on the wall."""

    said = robo.Publisher(Float64, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.said.publish(Float64(time.time()))


class Seldom(robo.Node):
    """Say what it hears, but only so often by the wall."""

    said = robo.Publisher(String, "said")

    def on_start(self) -> None:
        self._last = time.monotonic()

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        if time.monotonic() - self._last > 60.0:
            self._last = time.monotonic()
            self.said.publish(word)


class Hour(robo.Node):
    """Say which hour it is."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.said.publish(String(time.strftime("%H")))


class Night(robo.Node):
    """Say whether it is another day than the one before."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        now = datetime.now()
        assert type(now) is type(datetime(2020, 1, 1)) and isinstance(now, date)
        self.said.publish(String(f"{now.year} {date.today().weekday()}"))


class Dice(robo.Node):
    """Say a number, some time after the beginning."""

    said = robo.Publisher(Float64, "said")
    heard = robo.Publisher(String, "heard")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.heard.publish(word)
        self.said.publish(Float64(random.random() if int(word.data) >= 10 else 0.0))


class Set(robo.Node):
    """Say a set of words in the order of their hashes."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.said.publish(String(" ".join({"one", "two", "three", "four", "five", "six"})))


class Raises(robo.Node):
    """Stumble over a word."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        if word.data == "7":
            raise ValueError("seven is too much")
        self.said.publish(word)


class Dies(robo.Node):
    """Take its process along."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        print("goodbye", flush=True)
        os.abort()


class Hangs(robo.Node):
    """Never come back."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        threading.Event().wait()


class Asks(robo.Node):
    """Ask somebody who is not there."""

    said = robo.Publisher(String, "said")
    reset = robo.Client(Trigger.Request, Trigger.Response, "reset")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        try:
            self.reset(Trigger.Request())
        except robo.ServiceTimeout:
            self.said.publish(String("nobody"))


class Ticks(robo.Node):
    """Count, twenty times a second, and say what was heard last."""

    class Parameters(robo.Parameters):
        rate: float = 20.0

    parameters: Parameters
    said = robo.Publisher(String, "said")

    def on_start(self) -> None:
        self._last = ""

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self._last = word.data

    @robo.timer(rate="rate")
    def tick(self) -> None:
        self.said.publish(String(f"{self._last} {self.now().to_nanoseconds()}"))


class Ages(robo.Node):
    """Say how old what it hears is, and who has said it."""

    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String, info: robo.MessageInfo) -> None:
        self.said.publish(String(f"{info.age:.6f} {info.source} {info.sequence_number} {info.source_time}"))


class Late(robo.Node):
    """Say things on a topic that it makes when it hears the first word."""

    class Parameters(robo.Parameters):
        text: str = "a"

    parameters: Parameters

    def on_start(self) -> None:
        self._more = None

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        if self._more is None:
            self._more = self.create_publisher(String, "more")
        self._more.publish(String(self.parameters.text))


class Choir(robo.Node):
    """Sing what it hears of others, and count what comes on its own topic too."""

    song = robo.Publisher(String, "song")
    heard = robo.Publisher(String, "heard")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.song.publish(String(f"choir {word.data}"))

    @robo.subscribe("song")
    def listen(self, word: String) -> None:
        self.heard.publish(word)


@message("birds/Odd")
class Odd(Message):
    """ROS's names are of ASCII."""

    café: float = 0.0


class Oddity(robo.Node):
    """Say what no recording can have."""

    said = robo.Publisher(String, "said")
    odd = robo.Publisher(Odd, "odd")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.said.publish(word)
        self.odd.publish(Odd())


class Limits(robo.Node):
    """Say its limits."""

    class Parameters(robo.Parameters):
        most: Annotated[float, robo.NON_FINITE] = 1.0
        least: Annotated[float, robo.NON_FINITE] = 1.0

    parameters: Parameters
    said = robo.Publisher(String, "said")

    @robo.subscribe("word")
    def hear(self, word: String) -> None:
        self.said.publish(String(f"{self.parameters.least} {self.parameters.most}"))


class Relay(robo.Node):
    """Pass on what Parrot says."""

    passed = robo.Publisher(String, "passed")

    @robo.subscribe("said")
    def hear(self, word: String) -> None:
        self.passed.publish(String(word.data.upper()))
'''
"""Nodes of a module `birds`."""


def nodes(folder: Path) -> Path:
    """The folder of a project with these nodes, and a manifest."""
    (folder / "birds.py").write_text(NODES)
    (folder / "birds.yaml").write_text(
        "args:\n  robot_name: {default: r1}\ngroups:\n  cage:\n    namespace: ${robot_name}\n    nodes:\n"
        "      parrot: {service: birds:Parrot}\n      relay: {service: birds:Relay}\n"
    )
    return folder
