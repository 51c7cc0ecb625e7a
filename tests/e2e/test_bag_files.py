"""`robo bag` on files: each verb as it is typed, what it prints, how it ends, and what it leaves."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from robo import bag
from tests import bags
from tests.bags import MS, START
from tests.support import run_robo

pytestmark = pytest.mark.timeout(180)

SMALL = bag.Options(compression="none", sync=False, chunk_size=2_000)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With a short drive, in one file and in parts, and one that is cut."""
    bags.drive(tmp_path / "drive.mcap", SMALL)
    bags.drive(tmp_path / "parts", bag.Options(compression="none", sync=False, split_duration=0.4))
    (tmp_path / "cut.mcap").write_bytes((tmp_path / "drive.mcap").read_bytes()[:12_000])
    return tmp_path


def run(folder: Path, *words: str) -> tuple[int, str, str]:
    """The exit code, what is printed, and what is said beside it."""
    result = run_robo("bag", *words, cwd=str(folder))
    assert "Traceback" not in result.stderr
    return result.returncode, result.stdout, result.stderr


def made(folder: Path, *words: str) -> str:
    """What a verb prints that does what it should."""
    code, out, said = run(folder, *words)
    assert code == 0, said
    return out


def test_info(folder: Path) -> None:
    lines = made(folder, "info", "drive.mcap").splitlines()
    assert lines[0].startswith("drive.mcap: 39.")
    assert lines[1].startswith("from        2023-11-1")
    assert lines[2].endswith(", 0.991 s")
    assert lines[3] == "messages    122 on 4 topics, 0 lost"
    assert lines[6].split() == ["TOPIC", "COUNT", "RATE", "GAP", "AT", "LOST", "DELAY", "SIZE", "TYPE"]
    row = "r1/cmd_vel    100    100 Hz  0.01 s  0.0 s  0     1 ms   5.2 kB   geometry/Twist"
    assert lines[7] == row
    assert lines[10].endswith("tf2/TFMessage, latched")
    assert lines[-2:] == ["attachment  manifest.yaml, 10 B", "metadata    robo: version: 1, robot: r1"]
    both = made(folder, "info", "parts", "drive.mcap", "--json").splitlines()
    first, second = map(json.loads, both)
    assert (len(first["files"]), first["count"], second["count"]) == (3, 122, 122)
    assert second["topics"][0]["gap"] == pytest.approx(0.01)
    quick = made(folder, "info", "drive.mcap", "--quick")
    assert "TOPIC         COUNT  TYPE\n" in quick


def test_info_tells_of_a_file_that_is_cut_and_of_types_that_are_not_known(folder: Path) -> None:
    code, out, said = run(folder, "info", "cut.mcap")
    assert (code, "messages    15 on 4 topics" in out) == (0, True)
    assert "cut.mcap, byte 11,613: the file is cut: " in said
    assert "`robo bag check cut.mcap` tells more, and `robo bag recover` makes a whole file" in said
    with bag.Recording(folder / "strange.mcap", SMALL) as recording:
        recording.write(recording.topic(bag.TopicInFile("arm", "arm_msgs/msg/J", "float64 a\n")), b"x", START, START)
    assert "arm stays bytes: robo has no type 'arm_msgs/msg/J'\n" in run(folder, "info", "strange.mcap")[2]
    code, _, said = run(folder, "info", "nothing.mcap")
    assert (code, said) == (1, "error: nothing.mcap: No such file or directory\n")
    (folder / "text.mcap").write_text("a text that is no recording")
    assert run(folder, "info", "text.mcap")[2] == "error: text.mcap, byte 0: it is no MCAP file\n"


def test_info_of_several_goes_on_where_one_cannot_be_read(folder: Path) -> None:
    code, out, said = run(folder, "info", "nothing.mcap", "drive.mcap", "--json")
    assert (code, said) == (1, "error: nothing.mcap: No such file or directory\n")
    assert json.loads(out)["count"] == 122


def test_a_name_that_is_no_text_is_shown(folder: Path) -> None:
    name = os.fsdecode(b"dr\xffve.mcap")
    (folder / "drive.mcap").rename(folder / name)
    assert json.loads(made(folder, "info", name, "--json"))["path"] == "dr\\udcffve.mcap"
    assert json.loads(made(folder, "check", name, "--json"))["path"] == "dr\\udcffve.mcap"


def test_check(folder: Path) -> None:
    assert made(folder, "check", "drive.mcap") == "drive.mcap: 122 messages, nothing is wrong\n"
    code, out, _ = run(folder, "check", "cut.mcap")
    assert code == 1
    assert out.startswith("cut.mcap: 15 messages; the recording is damaged\n")
    assert "cut   -      1      -     cut.mcap, byte 11,613: the file is cut: " in out
    bags.drive(folder / "lossy.mcap", SMALL, missing=[4, 5])
    out = made(folder, "check", "lossy.mcap")
    assert "the recording is whole" in out
    assert "lost  r1/cmd_vel  2      2023-11-1" in out
    assert run(folder, "check", "lossy.mcap", "--strict")[0] == 1
    code, out, _ = run(folder, "check", "cut.mcap", "--json")
    found = json.loads(out)
    assert (code, found["whole"], found["findings"][0]["kind"]) == (1, False, "cut")


def test_cut(folder: Path) -> None:
    words = ("cut", "drive.mcap", "-o", "part.mcap", "--compression", "none")
    out = made(folder, *words, "--start", "0.5", "--end", "-0.291")
    assert out == "part.mcap: 26 messages on 4 topics, 2 of them what latched topics had said before\n"
    with bag.open(folder / "part.mcap") as part:
        assert (part.begin, part.end) == (START + 500 * MS, START + 691 * MS)
    before = (folder / "part.mcap").read_bytes()
    code, _, said = run(folder, *words, "--start", "0.6")
    assert code == 1
    assert said == "error: part.mcap: it is there already; name another one, or say --force to write over it\n"
    assert (folder / "part.mcap").read_bytes() == before
    assert made(folder, *words, "--start", str(START + 600 * MS), "--force").startswith("part.mcap: 50 messages")
    assert run(folder, *words, "--force")[::2] == (2, "error: say from when or up to when: --start, --end or both\n")
    code, _, said = run(folder, *words, "--start", "soon", "--force")
    assert (code, said[:32]) == (2, "error: --start 'soon' is no time")
    for times in (("--start", "2000-01-01", "--end", "2001-01-01"), ("--start", "1.5")):
        code, _, said = run(folder, "cut", "drive.mcap", "-o", "none.mcap", *times)
        assert (code, "nothing is there at that time: it begins 2023-11-1" in said) == (1, True)
        assert said.endswith(" and lasts 0.991 s\n")
    code, _, said = run(folder, "cut", "drive.mcap", "-o", "none.mcap", "--start", "0.5", "--end", "0.2")
    assert (code, said) == (2, "error: --end 0.2 is not after --start 0.5\n")
    assert not (folder / "none.mcap").exists()


def test_a_recording_may_take_its_own_place(folder: Path) -> None:
    made(folder, "cut", "drive.mcap", "-o", "drive.mcap", "--start", "0.9", "--force", "--compression", "none")
    assert bag.info(folder / "drive.mcap").count == 14
    assert sorted(file.name for file in folder.iterdir()) == ["cut.mcap", "drive.mcap", "parts"]


def test_filter(folder: Path) -> None:
    out = made(folder, "filter", "drive.mcap", "r1/*", "-o", "some.mcap", "--exclude", "**/scan", "--exclude", "*/od*")
    assert out == "some.mcap: 102 messages on 2 topics\n"
    with bag.open(folder / "some.mcap") as some:
        assert [*some.topics] == ["r1/cmd_vel", "r1/tf_static"]
    code, _, said = run(folder, "filter", "drive.mcap", "r1/odm", "-o", "none.mcap")
    assert (code, said) == (2, "error: drive.mcap: it has no topic r1/odm; did you mean r1/odom?\n")
    assert made(folder, "filter", "drive.mcap", "odom", "-o", "odom.mcap") == "odom.mcap: 10 messages on 1 topic\n"
    code, _, said = run(folder, "filter", "drive.mcap", "--exclude", "r1/odm", "-o", "none.mcap")
    assert (code, said) == (2, "error: drive.mcap: --exclude r1/odm: no topic matches; did you mean r1/odom?\n")
    assert run(folder, "filter", "drive.mcap", "-o", "none.mcap")[0] == 2


def test_merge_and_diff(folder: Path) -> None:
    assert made(folder, "merge", "drive.mcap", "parts", "-o", "both.mcap") == "both.mcap: 244 messages on 4 topics\n"
    assert run(folder, "merge", "drive.mcap", "-o", "one.mcap")[::2] == (2, "error: name two recordings or more\n")
    out = made(folder, "diff", "drive.mcap", "parts")
    assert out.endswith("4 topics, all the same\n")
    code, out, _ = run(folder, "diff", "drive.mcap", "both.mcap")
    assert code == 1
    assert out.endswith("4 of 4 topics differ\n")
    assert "≠  r1/cmd_vel    100, 200  " in out
    assert "message 1: linear.x: 0.1, then 0.0" in out
    code, out, _ = run(folder, "diff", "drive.mcap", "both.mcap", "--json")
    found = json.loads(out)
    assert (code, found["same"], found["topics"][0]["first"]["field"]) == (1, False, "linear.x")


@pytest.mark.parametrize(
    "words",
    [
        ("cut", "cut.mcap", "-o", "new", "--start", "0"),
        ("filter", "cut.mcap", "r1/*", "-o", "new"),
        ("merge", "cut.mcap", "drive.mcap", "-o", "new"),
        ("cut", "cut.mcap", "-o", "new", "--start", "0.8"),
    ],
)
def test_recover_is_named_where_a_file_is_cut(words: tuple[str, ...], folder: Path) -> None:
    code, _, said = run(folder, *words)
    assert code == 1
    assert "error: cut.mcap, byte 11,613: the file is cut: " in said
    assert "`robo bag recover" in said
    assert not (folder / "new").exists()


def test_recover(folder: Path) -> None:
    code, out, said = run(folder, "recover", "cut.mcap", "-o", "whole.mcap")
    assert (code, out) == (0, "whole.mcap: 15 messages, 387 B at its end left out\n")
    assert said.startswith("cut.mcap, byte 11,613: the file is cut: ")
    assert made(folder, "check", "whole.mcap") == "whole.mcap: 15 messages, nothing is wrong\n"
    assert run(folder, "recover", "drive.mcap", "-o", "again.mcap")[2] == "nothing was wrong with drive.mcap\n"
    (folder / "parts" / "parts_2.mcap").write_bytes(b"")
    code, out, said = run(folder, "recover", "parts", "-o", "mended")
    assert (code, said) == (0, "parts/parts_2.mcap, byte 0: it is empty\n")
    assert out.startswith("mended: ")
    assert made(folder, "check", "mended").endswith("nothing is wrong\n")
    data = bytearray((folder / "drive.mcap").read_bytes())
    data[10_000] ^= 1
    (folder / "bad.mcap").write_bytes(data)
    said = run(folder, "diff", "bad.mcap", "drive.mcap")[2]
    assert "another checksum than it says; `robo bag recover bad.mcap -o WHOLE` makes a whole file" in said


def test_convert_there_and_back(folder: Path) -> None:
    code, out, said = run(folder, "convert", "drive.mcap", "-o", "drive.jsonl")
    assert (code, out) == (0, "drive.jsonl: 122 messages on 4 topics\n")
    assert "metadata stay behind, JSON Lines has no place for them: robo\n" in said
    assert made(folder, "convert", "drive.jsonl", "-o", "a.mcap", "--compression", "none")
    assert made(folder, "diff", "drive.mcap", "a.mcap").endswith("all the same\n")
    made(folder, "convert", "drive.mcap", "-o", "csv", "--to", "csv")
    made(folder, "convert", "csv", "-o", "b.mcap", "--compression", "none")
    assert made(folder, "diff", "drive.mcap", "b.mcap").endswith("all the same\n")
    made(folder, "convert", "drive.mcap", "r1/odom", "-o", "odom.csv")
    assert len((folder / "odom.csv").read_text().splitlines()) == 11
    out = made(folder, "convert", "drive.mcap", "r1/scan", "-o", "-")
    assert [json.loads(line)["key"] for line in out.splitlines()] == ["r1/scan"] * 10
    (folder / "run.log").write_text("ODOM 1 0 0.5 0.3 0.1 0 20.5 host 10.5\n")
    made(folder, "convert", "run.log", "-o", "run.mcap", "--robot-name", "r1", "--compression", "none")
    made(folder, "convert", "run.log", "odom", "-o", "odom.mcap", "--robot-name", "r1", "--compression", "none")
    with bag.open(folder / "odom.mcap") as odom:
        assert [*odom.topics] == ["r1/odom"]
    code, _, said = run(folder, "convert", "run.log", "odm", "-o", "none.mcap", "--compression", "none")
    assert (code, "no topic of those that are there is wanted: odom, " in said) == (1, True)
    assert [topic.name for topic in bag.info(folder / "run.mcap").topics] == ["r1/odom", "r1/tf", "r1/tf_static"]


def test_json_lines_go_through_a_pipe(folder: Path) -> None:
    robo = f"{sys.executable} -m robo bag convert"
    line = f"{robo} drive.mcap r1/odom -o - | grep -v '\"x\":0.02' | {robo} - -o fewer.mcap --compression none"
    subprocess.run(["bash", "-o", "pipefail", "-c", line], cwd=folder, check=True, timeout=60)
    assert 0 < bag.info(folder / "fewer.mcap", quick=True).count < 11


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (("drive.mcap", "-o", "a.mcap"), 2, "both are .mcap: robo bag cut, filter and merge"),
        (("a.csv", "-o", "a.jsonl"), 2, "from csv to jsonl it takes two steps"),
        (("drive.mcap", "-o", "a.csv"), 1, "a file has one topic, and there are 4"),
        (("drive.mcap", "-o", "a.txt"), 1, "a.txt: what is it to be?"),
        (("drive.mcap", "-o", "a.jsonl", "--robot-name", "r1"), 2, "--robot-name is for logs of CARMEN"),
        (("drive.mcap", "-o", "parts", "--to", "csv"), 1, "parts: it is there already; name a folder that is not"),
        (("a.csv", "-o", "a.mcap"), 1, "a.csv: its first columns are not time, arrived, key"),
        (("a.log", "-o", "a.mcap"), 1, "a.log: it holds no message"),
        (("cut.mcap", "-o", "no/a.jsonl"), 1, "no/a.jsonl: it cannot be written: No such file or directory"),
    ],
)
def test_what_cannot_be_converted_is_told(words: tuple[str, ...], code: int, text: str, folder: Path) -> None:
    (folder / "a.csv").write_text("x,y\n1,2\n")
    (folder / "a.log").write_text("a text\n")
    before = sorted(folder.iterdir())
    found, _, said = run(folder, "convert", *words)
    assert (found, text in said) == (code, True), said
    assert sorted(folder.iterdir()) == before


def test_plot(folder: Path) -> None:
    told = made(folder, "plot", "drive.mcap", "cmd_vel", "odom", "--field", "linear.x", "-o", "speed.svg")
    assert told == "speed.svg: 1 curve of 100 values\n"
    assert "<svg" in (folder / "speed.svg").read_text()
    assert made(folder, "plot", "drive.mcap", "**", "-o", "-").startswith("<svg")
    told = json.loads(made(folder, "plot", "drive.mcap", "odom", "-o", "odom.svg", "--json"))
    curve = {"topic": "r1/odom", "field": "pose.pose.position.x", "unit": "m", "values": 10}
    assert told == {"file": "odom.svg", "curves": [curve]}
    for words, wanted in (
        (("drive.mcap", "scan", "-o", "drive.mcap"), "end its name in .svg"),
        (("drive.mcap", "scan", "-o", "no/such/place.svg"), "cannot be written: there is no folder no/such"),
        (("drive.mcap", "skan", "-o", "a.svg"), "it has no topic skan"),
        (("drive.mcap", "odom", "-o", "a.svg", "--field", "pose.pos"), "did you mean"),
        (("drive.mcap", "odom", "-o", "a.svg", "--start", "soon"), "is no time"),
    ):
        code, out, said = run(folder, "plot", *words)
        assert (code, out) == (2, "")
        assert wanted in said
    assert run(folder, "plot", "cut.mcap", "cmd_vel", "-o", "a.svg")[0] == 0


def test_map(folder: Path) -> None:
    for name in ("way.svg", "way.png"):
        result = run_robo("map", "drive.mcap", "-o", name, cwd=str(folder))
        assert result.returncode == 0, result.stderr
        assert result.stdout == f"{name}: 10 scans, 20 points; 0.9 m driven, by the odometry r1/odom\n"
        assert (folder / name).stat().st_size > 500
    told = json.loads(run_robo("map", "drive.mcap", "-o", "way.svg", "--json", cwd=str(folder)).stdout)
    assert (told["scans"], told["points"], told["frame"], told["left_out"]) == (10, 20, "odom", 0)
    result = run_robo("map", "drive.mcap", "-o", "way.gif", cwd=str(folder))
    assert (result.returncode, result.stdout) == (2, "")
    assert "end its name in .svg or .png" in result.stderr
