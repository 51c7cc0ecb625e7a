"""A plain client may declare, answer and publish what it likes: supervisors and tools go on."""

from collections.abc import Iterator

import pytest
import zenoh

from robo.session import Network, close_session, open_session
from tests.support import Command, eventually, robo, run_robo

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
def robot(endpoint: str) -> Iterator[Command]:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as up:
        up.wait_for("r1 is ready")
        yield up


@pytest.fixture
def stranger(robot: Command, endpoint: str) -> Iterator[zenoh.Session]:
    del robot  # it has to be there first
    session = open_session(Network(mode="client", connect=(endpoint,)))
    yield session
    close_session(session)


def test_tokens_that_mean_nothing_are_told_once_and_left_out(
    robot: Command, stranger: zenoh.Session, endpoint: str
) -> None:
    tokens = [stranger.liveliness().declare_token(key) for key in NONSENSE]
    line = robot.wait_for("ignoring a liveliness token that means nothing here")
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
    assert robot.wait() == 0
    assert robot.output.count("ignoring a liveliness token") == 1
    assert "Traceback" not in robot.output


def test_answers_that_cannot_be_read_are_left_out_and_told_once(
    robot: Command, stranger: zenoh.Session, endpoint: str
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
