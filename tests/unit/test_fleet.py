"""Robots as a whole: what is told of each, and of those that have gone."""

from pathlib import Path

import msgspec
import pytest

from robo.supervisor.about import digest_of
from robo.tools.fleet import Difference, Fleet, Robot, Told, differences, robot_of, robots_of
from robo.wire.keys import SupervisorToken
from robo.wire.reports import ProcessStatus, RunReport
from tests.reports import process

S = 1_000_000_000


def of_run(run: str, node: str, **more: object) -> ProcessStatus:
    return msgspec.structs.replace(process(run, node), run=f"id-{run}", host="pi", **more)


def made(robot: str, version: str = "1.0", digest: str = "aa", manifest: str = "robot.yaml") -> RunReport:
    return RunReport(
        robot=robot, run=f"id-{robot}", host="pi", user="ann", version=version, manifest=manifest, digest=digest,
        since=100 * S,
    )  # fmt: skip


def told(
    *supervised: ProcessStatus,
    runs: tuple[RunReport, ...] = (),
    alone: tuple[ProcessStatus, ...] = (),
    there: tuple[str, ...] = (),
    time: int = 160 * S,
) -> Told:
    tokens = [SupervisorToken(robot, 7, "pi") for robot in there]
    return Told(time, list(supervised), list(alone), list(runs), tokens)


def test_a_robot_is_told_with_its_nodes_its_run_and_its_worst_check() -> None:
    (robot,) = robots_of(
        told(
            of_run("r1", "/r1/base", health="ok"),
            of_run("r1", "/r1/tracker", health="warn", trouble="odometry: none"),
            of_run("r1", "/r1/camera", state="standby"),
            runs=(made("r1"),),
            there=("r1",),
        )
    )
    assert robot == Robot(
        robot="r1", state="ready", hosts=["pi"], run="id-r1", version="1.0", manifest="robot.yaml", digest="aa",
        ready=3, nodes=3, health="warn", trouble="/r1/tracker: odometry: none", uptime=60.0, last_seen=160 * S,
    )  # fmt: skip


def test_a_node_that_is_not_ready_is_told_before_checks() -> None:
    (robot,) = robots_of(
        told(
            of_run("r1", "/r1/base", health="error", trouble="battery: empty"),
            of_run("r1", "/r1/arm", state="failed", reason="exit code 1"),
        )
    )
    assert (robot.state, robot.ready, robot.nodes, robot.health) == ("not ready", 1, 2, "error")
    assert robot.trouble == "/r1/arm is failed: exit code 1"


@pytest.mark.parametrize(
    ("run", "node", "robot"),
    [
        ("r1", "/r1/base", "r1"),
        ("r1", "/r1/arm/driver", "r1"),
        ("fleet", "/r7/base", "r7"),
        ("fleet", "/r7/arm/driver", "r7"),
        ("fleet", "/fleet/meeting", "fleet"),
        ("fleet", "/meeting", "fleet"),
        ("north/r1", "/north/r1/base", "north/r1"),
        ("", "/meeting", ""),
    ],
)
def test_robots_of_one_run_go_by_their_own_names(run: str, node: str, robot: str) -> None:
    assert robot_of(process(run, node)) == robot


def test_robots_without_a_supervisor_are_there_too() -> None:
    alone = msgspec.structs.replace(process("r5", "/r5/base"), uptime=9.0)
    (robot,) = robots_of(told(alone=(alone,)))
    assert (robot.robot, robot.state, robot.version, robot.uptime) == ("r5", "ready", "", 9.0)


def test_a_supervisor_that_does_not_answer_makes_its_robot_silent() -> None:
    lonely = msgspec.structs.replace(process("r1", "/r1/base"), run="id-r1")
    robots = robots_of(told(alone=(lonely,), there=("r1", "r2")))
    assert [(robot.robot, robot.state, robot.nodes) for robot in robots] == [("r1", "silent", 1), ("r2", "silent", 0)]
    assert {robot.trouble for robot in robots} == {"its supervisor does not answer"}


def test_a_supervisor_of_an_older_robo_answers_without_telling_its_version() -> None:
    (robot,) = robots_of(told(of_run("r1", "/r1/base"), there=("r1",)))
    assert (robot.state, robot.version) == ("ready", "")


def test_who_has_gone_is_offline_since_it_was_seen_last_and_comes_back() -> None:
    fleet = Fleet()
    both = of_run("r1", "/r1/base"), of_run("r2", "/r2/base")
    assert [robot.state for robot in fleet.look(told(*both, time=10 * S))] == ["ready", "ready"]
    for time in (11 * S, 12 * S):
        gone = fleet.look(told(both[0], time=time))[1]
        assert (gone.robot, gone.state, gone.last_seen, gone.uptime) == ("r2", "offline", 10 * S, None)
    back = fleet.look(told(*both, time=13 * S))[1]
    assert (back.state, back.last_seen) == ("ready", 13 * S)


def test_a_silent_robot_was_seen_last_when_it_answered() -> None:
    fleet = Fleet()
    fleet.look(told(of_run("r1", "/r1/base"), time=10 * S))
    for time in (11 * S, 12 * S):
        (robot,) = fleet.look(told(there=("r1",), time=time))
        assert (robot.state, robot.last_seen) == ("silent", 10 * S)


def test_robots_are_in_the_order_of_their_numbers() -> None:
    found = Fleet().look(told(*(of_run(name, f"/{name}/base") for name in ("r10", "r9", "arm", "r1"))))
    assert [robot.robot for robot in found] == ["arm", "r1", "r9", "r10"]


def test_versions_and_manifests_that_differ_are_told() -> None:
    runs = made("r1"), made("r2", version="1.1"), made("r3", digest="bb"), made("r4", manifest="arm.yaml", digest="cc")
    robots = robots_of(told(*(of_run(run.robot, f"/{run.robot}/base") for run in runs), runs=runs))
    version, manifest = differences(robots)
    assert version == Difference("robo", {"1.0": ["r1", "r3", "r4"], "1.1": ["r2"]})
    assert str(version) == "robo is not the same everywhere: 1.0 (r1, r3, r4), 1.1 (r2)"
    assert str(manifest) == "robot.yaml is not the same everywhere: aa (r1, r2), bb (r3)"
    assert differences([robot for robot in robots if robot.robot in ("r1", "r4")]) == []


def test_only_some_robots_of_many_are_listed() -> None:
    many = Difference("robo", {"1.0": [f"r{i}" for i in range(1, 9)], "": ["r9"]})
    assert str(many) == "robo is not the same everywhere: unknown (r9), 1.0 (r1, r2, r3, r4, r5 and 3 more)"


def test_a_digest_is_of_names_and_contents_wherever_the_files_are(tmp_path: Path) -> None:
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "robot.yaml").write_text("groups: {}\n")
        (tmp_path / folder / "params.yaml").write_text("{}\n")

    def digest(folder: str) -> str:
        return digest_of([str(tmp_path / folder / name) for name in ("robot.yaml", "params.yaml")])

    assert digest("here") == digest("there")
    assert len(digest("here")) == 12
    (tmp_path / "there" / "params.yaml").write_text("{a: 1}\n")
    assert digest("here") != digest("there")
    assert digest("nowhere") == ""
