"""A plain client may ask, declare, answer and publish what it likes: the robot, supervisors and tools go on."""

import msgpack
import psutil
import pytest
import zenoh

from benchmarks.abuse import MOST_GROWTH, memory, processes, throw
from benchmarks.stranger import Stranger
from robo.testing import Launch, Robot
from tests.support import eventually, run_robo

NONSENSE = [
    "@robo/r1/pub/base/std%String/³/r1%odom",
    "@robo/r1/pub/base/std%String/10/\x1b]0;title\x07",
    "@robo/r1/node/ba se/a:B/1/host",
    "@robo/r1/run/³/a%b%c",
    "@robo/r1/run/1/none",
    "@robo/nothing",
    "@robo/" + "x" * 3000,
]
GARBAGE = [b"", b"\xc1", b"\x93\x01\x02\x03", b"\x81\xa4node\xa1\xff", b"\x91" * 5000]


@pytest.fixture
def robot(launch: Launch) -> Robot:
    return launch("robot.yaml", demo="arc")


@pytest.fixture
def stranger(robot: Robot) -> zenoh.Session:
    return robot.session


@pytest.fixture
def endpoint(robot: Robot) -> str:
    return robot.endpoint


def test_tokens_that_mean_nothing_are_told_once_and_left_out(
    robot: Robot, stranger: zenoh.Session, endpoint: str
) -> None:
    tokens = [stranger.liveliness().declare_token(key) for key in NONSENSE]
    line = robot.wait_for_line("ignoring a liveliness token that means nothing here")
    assert "\x1b" not in line
    for words in (
        ["node", "list"],
        ["topic", "list"],
        ["ps"],
        ["net"],
        ["top", "--once"],
        ["graph"],
        ["service", "list"],
    ):
        result = run_robo(*words, "--connect", endpoint)
        assert (result.returncode, "Traceback" in result.stderr) == (0, False), (words, result.stderr)
        assert "\x1b" not in result.stdout
    for token in tokens:
        token.undeclare()
    eventually(lambda: run_robo("down", "--connect", endpoint).returncode == 0, "it can be asked and ended as ever")
    assert robot.wait_until_over() == 0
    assert robot.output.count("ignoring a liveliness token") == 1
    assert "Traceback" not in robot.output


def test_a_thousand_tokens_of_strangers_are_no_trouble_for_tools(
    robot: Robot, stranger: zenoh.Session, endpoint: str
) -> None:
    del robot
    declared = []
    for number in range(250):
        name = f"q{number}"
        ends = [f"{kind}/{name}/std%String/1/q%{number}%{kind}" for kind in ("pub", "sub", "srv")]
        for token in (*ends, f"node/{name}/m:{name}/{number}/here"):
            declared.append(stranger.liveliness().declare_token(f"@robo/q/{token}"))
    for words in (
        ["topic", "list", "-v"],
        ["topic", "info", "q/7/pub"],
        ["node", "list"],
        ["service", "list"],
        ["graph"],
        ["top", "--once"],
        ["net", "safety_monitor", "diff_drive_sim"],
        ["param", "get", "safety_monitor", "rate"],
        ["ps"],
    ):
        result = run_robo(*words, "--connect", endpoint)
        assert result.returncode == 0, (words, result.stderr)
        assert len(result.stderr) < 2_000, (words, result.stderr)
    for one in declared:
        one.undeclare()


def test_answers_that_cannot_be_read_are_left_out_and_told_once(
    robot: Robot, stranger: zenoh.Session, endpoint: str
) -> None:
    del robot
    keys = ["@robo/r9/supervisor/ps", "@robo/r9/supervisor/events", "@robo/r1/status/base", "@/abc/router"]

    def answer(query: zenoh.Query) -> None:
        with query:
            for key in keys:
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    for payload in GARBAGE:
                        query.reply(key, payload)

    served = [stranger.declare_queryable(key, answer) for key in keys]
    for words in (["ps"], ["node", "list"], ["net"], ["top", "--once"], ["events", "--no-follow"], ["why"]):
        result = run_robo(*words, "--connect", endpoint)
        assert (result.returncode, "Traceback" in result.stderr) == (0, False), (words, result.stderr)
        assert result.stderr.count("left out what cannot be read") <= 2
    told = run_robo("ps", "--connect", endpoint)
    assert "safety_monitor" in told.stdout
    assert "left out what cannot be read on '@robo/r9/supervisor/ps'" in told.stderr
    for queryable in served:
        queryable.undeclare()


def test_queries_with_wildcards_run_nothing(robot: Robot, stranger: zenoh.Session) -> None:
    robot.wait_for("current_position", lambda position: position.z > 0.05)
    changes = len(robot.messages("parameter_events"))
    reset = msgpack.packb({"linear_velocity": 0.0})
    everything = ("**", "r1/**", "r1/emergency_$*", "**/$*stop", "r1/*/parameters/set", "@robo/**", "@robo/r1/**")
    for wide in (*everything, "@robo/*/supervisor/*", "@robo/r1/supervisor/d$*"):
        for payload in (None, reset):
            replies = list(stranger.get(wide, payload=payload, timeout=40))
            assert replies, wide
            answered = {str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok is not None}
            assert not answered & {"set", "stop", "start", "restart", "down", "emergency_stop", "reset"}, wide
    driven = robot.messages("current_position")[-1].z
    robot.wait_for("current_position", lambda position: position.z > driven + 0.05)  # it drives on
    served = {}
    for reply in stranger.get("@robo/r1/status/*", timeout=40, consolidation=zenoh.ConsolidationMode.NONE):
        assert reply.ok is not None
        served.update(msgpack.unpackb(reply.ok.payload.to_bytes())["served"])
    assert {"r1/emergency_stop", "r1/reset_emergency_stop", "r1/reset", "r1/reset_distance"} <= served.keys()
    assert set(served.values()) == {0}
    assert len(robot.messages("parameter_events")) == changes

    (reply,) = stranger.get("r1/emergency_stop", timeout=40)
    assert reply.ok is not None
    robot.wait_for("safety_state", lambda state: state.values[1].value == "emergency_stop")  # a full name calls
    (reply,) = stranger.get("@robo/r1/supervisor/down", timeout=40)
    assert reply.ok is not None
    assert robot.wait_until_over() == 0


def test_random_things_at_a_thousand_a_second_hurt_nobody(robot: Robot, stranger: zenoh.Session) -> None:
    # `python -m benchmarks.abuse` throws 100,000 and measures pauses too.
    *_, supervisor = (one for one in psutil.Process().children(recursive=True) if "up" in one.cmdline())
    before = processes(supervisor)
    sizes = memory(before)
    rogue = Stranger(stranger, "r1", seed=14)
    throw(rogue, 4_000, 1_000.0)
    assert set(rogue.thrown) == {"message", "token", "query", "parameter request", "command"}
    (reply,) = stranger.get("r1/emergency_stop", timeout=10)
    assert reply.ok is not None
    robot.wait_for_line("emergency stop, until reset_emergency_stop is called")
    assert processes(supervisor) == before
    assert {name: size for name, size in memory(before).items() if size > sizes[name] + 2 * MOST_GROWTH} == {}
    assert "Traceback" not in robot.output
    for kind in ("/cmd_vel (", "/cmd_vel_raw (", "/scan (", "ignoring a liveliness token", "left out odometry"):
        assert sum(kind in line for line in robot.output.splitlines()) <= 2, robot.output  # /scan: two nodes at most
