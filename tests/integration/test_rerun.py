"""`robo view rerun` where Rerun is installed: what it writes is read back with Rerun's own reader."""

import math
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from os import urandom
from pathlib import Path
from typing import Any

import psutil
import pytest
import zenoh

import robo_messages
from robo import bag
from robo.bag.progress import silent
from robo.bridges.rerun.feed import Feed
from robo.bridges.rerun.pace import Pace
from robo.bridges.rerun.scene import Scene
from robo.bridges.rerun.sink import Sink
from robo.bridges.rerun.viewer import Viewer
from robo.errors import NetworkError
from robo.samples.publishing import Sender
from robo.wire.qos import QoS
from robo_messages import Header, LaserScan, Log, MapMetaData, OccupancyGrid, Point, Pose, PoseStamped, Twist
from robo_messages import Path as Path_
from robo_messages.sensor import Image
from robo_messages.visualization import Marker, MarkerArray
from tests import bags
from tests.conftest import free_port
from tests.room_log import LOG
from tests.support import eventually, run_robo

chunk = pytest.importorskip("rerun.chunk", reason="Rerun is not installed: pip install 'robo-zenoh[rerun]'")

pytestmark = pytest.mark.timeout(60)


def rows_of(file: Path) -> Counter[str]:
    """How many rows of data each entity of a file has."""
    found: Counter[str] = Counter()
    for one in chunk.RrdReader(file).stream():
        found[one.entity_path] += one.num_rows
    return found


def test_a_recording_is_written_whole(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    sink = Sink("drive")
    sink.save(tmp_path / "drive.rrd")
    feed = Feed(sink, Pace(0.0))
    with bag.open(tmp_path / "drive.mcap") as recording:
        feed.recorded(recording, list(recording.topics), lambda: True, silent)
    sink.close()
    assert feed.drawn == 122
    rows = rows_of(tmp_path / "drive.rrd")
    assert rows["/plots/speed/r1/cmd_vel"] == 101  # and what its curves are called
    assert rows["/r1/scan"] >= 10
    assert rows["/r1/tf/base_link"] >= 10
    assert rows["/r1/trail"] > 0
    times = [
        one.to_record_batch().column("time")[0].value
        for one in chunk.RrdReader(tmp_path / "drive.rrd").stream()
        if one.entity_path == "/plots/speed/r1/cmd_vel" and not one.is_static
    ]
    assert min(times) == bags.START  # on the timeline of publishing, ns


def test_pictures_maps_and_logs_are_drawn(tmp_path: Path) -> None:
    np = pytest.importorskip("numpy")
    sink = Sink("")
    sink.save(tmp_path / "all.rrd")
    scene = Scene()
    pictures: list[tuple[str, Any]] = [
        ("r1/rgb", Image.from_array(np.zeros((4, 5, 3), np.uint8), "rgb8")),
        ("r1/bgr", Image.from_array(np.zeros((4, 5, 3), np.uint8), "bgr8")),
        ("r1/mono", Image.from_array(np.zeros((4, 5), np.uint8), "mono8")),
        ("r1/depth", Image.from_array(np.ones((4, 5), np.uint16), "16UC1")),
        ("r1/map", OccupancyGrid(info=MapMetaData(resolution=0.1, width=3, height=2), data=memoryview(bytes(6)))),
        ("r1/log", Log(level=Log.ERROR, name="/r1/a", msg="no")),
    ]
    for key, message in pictures:
        sink.draw(scene.take(key, message), 10**18)
    sink.draw(scene.take("r1/odd", Image(width=9, height=9, encoding="nobody8")), 10**18)
    sink.lay_out(scene.pictures, ["r1/trail"])
    sink.close()
    rows = rows_of(tmp_path / "all.rrd")
    assert {"/r1/rgb", "/r1/bgr", "/r1/mono", "/r1/depth", "/r1/map", "/log/r1/a"} <= rows.keys()
    assert "/r1/odd" not in rows


def test_names_have_any_letters_and_what_is_deleted_is_cleared(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    sink = Sink("")
    sink.save(tmp_path / "odd.rrd")
    scene = Scene()
    cube = Marker(Header(frame_id="base_link"), ns="a b/é//x:! [3]", type=Marker.CUBE)
    for number, action in enumerate((Marker.ADD, Marker.DELETE, Marker.ADD)):
        cube.action = action
        sink.draw(scene.take("r1/zones", MarkerArray([cube])), 10**18 + number)
    sink.draw(scene.take("r1/log", Log(name="/r1/a b//c", msg="x")), 10**18)
    far = Path_(Header(frame_id="odom"), [PoseStamped(), PoseStamped(pose=Pose(Point(1e308, math.nan)))])
    sink.draw(scene.take("r1/path", far), 10**18)
    sink.close()
    rows = rows_of(tmp_path / "odd.rrd")
    assert rows[r"/r1/zones/a\ b/é/x\:\!\ \[3\]/0"] == 5  # its frame and it, twice, and that it was gone
    assert rows[r"/log/r1/a\ b/c"] == 1
    assert capfd.readouterr().err == ""


def test_what_comes_live_is_drawn_until_it_is_enough(tmp_path: Path, session: zenoh.Session) -> None:
    sink = Sink("r1")
    sink.save(tmp_path / "live.rrd")
    feed = Feed(sink, Pace(0.0))
    enough = threading.Event()
    thread = threading.Thread(
        target=feed.live, args=(session, ["r1/**"], lambda: not enough.is_set(), time.monotonic() + 40)
    )
    thread.start()
    with_scan = Sender(session, "r1/scan", "sensor/LaserScan", QoS.DEFAULT)
    with_speed = Sender(session, "r1/cmd_vel", "geometry/Twist", QoS.DEFAULT)

    def say() -> bool:
        with_scan.send(robo_messages.encode(LaserScan(ranges=[1.0], range_max=2.0)))
        with_speed.send(robo_messages.encode(Twist()))
        return feed.drawn >= 6

    eventually(say, "messages that are drawn")
    session.put("r1/scan", b"\xc1", encoding=zenoh.Encoding("application/msgpack;sensor/LaserScan"))
    eventually(lambda: feed.unreadable == 1, "what makes no sense, counted")
    enough.set()
    thread.join(20)
    assert not thread.is_alive()
    sink.close()
    assert rows_of(tmp_path / "live.rrd")["/r1/scan"] >= 3


def test_the_viewer_hears_this_machine_alone_and_ends_with_us() -> None:
    port, web_port = free_port(), free_port()
    viewer = Viewer(port, "100MiB", web_port)
    try:
        (child,) = [one for one in psutil.Process().children() if "rerun" in one.name()]
        eventually(lambda: len(_heard(child)) == 2, "both ports")
        assert {*_heard(child)} == {("127.0.0.1", port), ("127.0.0.1", web_port)}
        sink = Sink("r1")
        sink.connect(port)
        feed = Feed(sink, Pace())
        assert sink.flush()
        sink.close()
        assert feed.drawn == 0
        with pytest.raises(NetworkError, match=f"port {port} of 127.0.0.1 cannot be had"):
            Viewer(port, "100MiB", None)
    finally:
        viewer.close()
    assert not viewer.is_open
    assert not child.is_running()


def test_a_viewer_ends_with_a_tool_that_is_killed(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    ports = [str(free_port()), str(free_port())]
    words = ["view", "rerun", "drive.mcap", "--web", "--port", ports[0], "--web-port", ports[1]]
    process = subprocess.Popen(
        [sys.executable, "-m", "robo", *words], stdout=subprocess.PIPE, text=True, cwd=str(tmp_path)
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("Rerun is at http://127.0.0.1:")
        (viewer,) = [one for one in psutil.Process(process.pid).children() if "rerun" in one.name()]
    finally:
        process.kill()
        process.communicate()
    eventually(lambda: not viewer.is_running() or viewer.status() == psutil.STATUS_ZOMBIE, "the end of the viewer")


def test_a_viewer_that_stalls_is_waited_for() -> None:
    port = free_port()
    viewer = Viewer(port, "100MiB", free_port())
    try:
        (child,) = [one for one in psutil.Process().children() if "rerun" in one.name()]
        sink = Sink("r1")
        sink.connect(port)
        sink.draw(Scene().take("r1/cmd_vel", Twist()), 10**18)
        eventually(sink.flush, "what was drawn, in the viewer")
        feed, over = Feed(sink, Pace(0.0)), threading.Event()
        child.suspend()
        large = Image(width=2_000, height=2_000, encoding="mono8", step=2_000, data=memoryview(urandom(4_000_000)))
        for number in range(10):  # more than waits between two programs
            sink.draw(Scene().take("r1/camera", large), 10**18 + number)
        thread = threading.Thread(target=feed.flush, args=(lambda: not over.is_set(),))
        thread.start()
        thread.join(1.5)  # longer than it waits at a time
        assert thread.is_alive()
        child.resume()
        thread.join(20)
        assert not thread.is_alive()
        assert sink.flush()
    finally:
        viewer.close()
        sink.close()


def test_words_that_make_no_sense_are_told_before_anything_starts(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    for words, wanted in (
        (("drive.mcap", "--web", "--port", "9911", "--web-port", "9911"), "are both 9911"),
        (("drive.mcap", "--memory", "lots"), "write a size such as 1GiB"),
        ((str(LOG), "--save", "a.rrd"), "make a recording of it first: robo bag convert"),
    ):
        result = run_robo("view", "rerun", *words, cwd=str(tmp_path))
        assert result.returncode == 2, result.stderr
        assert wanted in result.stderr


def test_a_file_with_nothing_in_it_is_not_left(tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "none.mcap", bag.Options(compression="none", sync=False)):
        pass
    result = run_robo("view", "rerun", "none.mcap", "--save", "none.rrd", cwd=str(tmp_path))
    assert result.returncode == 1, result.stderr
    assert not (tmp_path / "none.rrd").exists()


def _heard(process: psutil.Process) -> list[tuple[str, int]]:
    ends = process.net_connections("tcp")
    return [(end.laddr.ip, end.laddr.port) for end in ends if end.status == psutil.CONN_LISTEN]


def test_a_verb_ends_by_signals_with_a_whole_file(tmp_path: Path, session: zenoh.Session, endpoint: str) -> None:
    speed = Sender(session, "r1/cmd_vel", "geometry/Twist", QoS.DEFAULT, "/r1/base")
    for number in (signal.SIGINT, signal.SIGTERM):
        file = tmp_path / f"{number}.rrd"
        words = ["view", "rerun", "--connect", endpoint, "--save", str(file)]
        process = subprocess.Popen([sys.executable, "-m", "robo", *words], stdout=subprocess.PIPE, text=True)
        try:
            speed.wait_for_subscriber(40)
            before = file.stat().st_size
            sent: list[int] = []

            def say(file: Path = file, before: int = before, sent: list[int] = sent) -> bool:
                speed.send(robo_messages.encode(Twist()))
                sent.append(file.stat().st_size)
                # What is drawn of itself comes first, and is no message.
                return len(sent) > 100 and sent[-1] > max(before, sent[20]) + 2_000

            eventually(say, "messages in the file")
            process.send_signal(number)
            told, _ = process.communicate(timeout=20)
        finally:
            process.kill()
            process.wait()
        assert process.returncode == 0
        assert told.startswith(f"{file}: ")
        assert rows_of(file)["/plots/speed/r1/cmd_vel"] > 1


def test_words_that_make_no_sense_write_nothing(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    (tmp_path / "there.rrd").write_text("mine")
    for words, code, wanted in (
        (("drive.mcap", "--save", "a.txt"), 2, "end its name in .rrd"),
        (("drive.mcap", "--save", "there.rrd"), 2, "is there already"),
        (("none.mcap", "--save", "a.rrd"), 1, "No such file"),
        (("drive.mcap", "--topic", "skan", "--save", "a.rrd"), 2, "it has no topic skan"),
        (("drive.mcap", "--robot-name", "r2", "--save", "a.rrd"), 2, "no topics of r2"),
    ):
        result = run_robo("view", "rerun", *words, cwd=str(tmp_path))
        assert result.returncode == code, result.stderr
        assert wanted in result.stderr
        assert "Traceback" not in result.stderr
    assert {file.name for file in tmp_path.iterdir()} == {"drive.mcap", "there.rrd"}
    assert (tmp_path / "there.rrd").read_text() == "mine"
    result = run_robo("view", "rerun", "drive.mcap", "--topic", "cmd_vel", "--save", "a.rrd", cwd=str(tmp_path))
    assert result.stdout == "a.rrd: 100 messages\n"
