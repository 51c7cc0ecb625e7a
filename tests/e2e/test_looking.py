"""Looking at a running robot: topics, nodes, the graph, the network."""

import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from fcntl import ioctl
from typing import Any

import msgspec
import pytest
import zenoh

import robo_messages
from robo.testing import Launch, Robot
from robo.wire import codec
from robo.wire.keys import parameters_key
from robo_messages import String, Twist
from tests.conftest import free_port
from tests.plain import hear, samples, so_far
from tests.support import PATIENCE, eventually, robo, run_robo


@pytest.fixture(scope="module")
def running(module_launch: Launch) -> Robot:
    """The reference robot."""
    return module_launch("robot.yaml", demo="arc")


@pytest.fixture(scope="module")
def robot(running: Robot) -> str:
    """Its endpoint."""
    return running.endpoint


@pytest.fixture
def client(running: Robot) -> zenoh.Session:
    """A Zenoh client on the robot's network."""
    return running.session


def ask(robot: str, *words: str, code: int = 0) -> str:
    result = run_robo(*words, "--connect", robot)
    assert result.returncode == code, result.stderr
    return result.stdout


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


# -- topics ----------------------------------------------------------------------------------------


def test_rates_are_known_where_a_supervisor_is(robot: str) -> None:
    def rate() -> float:
        found = {topic["key"]: topic["rate"] for topic in lines(ask(robot, "topic", "list", "--json"))}
        return found.get("r1/odom") or 0.0  # nodes link anew where the router was held up

    eventually(lambda: 40 < rate() < 60, "odometry at 50 Hz")


def test_one_topic(robot: str) -> None:
    info = json.loads(ask(robot, "topic", "info", "odom", "--robot-name", "r1", "--json"))
    assert info["types"] == ["nav/Odometry"]
    assert [end["node"] for end in info["publishers"]] == ["/r1/diff_drive_sim"]
    assert {end["node"]: end["qos"]["depth"] for end in info["subscribers"]} == {
        "/r1/position_tracker": 0,
        "/r1/safety_monitor": 1,
        "/r1/velocity_smoother": 1,
    }
    assert ask(robot, "topic", "type", "/r1/odom") == "nav/Odometry\n"
    assert ask(robot, "topic", "find", "geometry/Twist").split() == [
        f"r1/cmd_vel{one}" for one in ("", "_dashboard", "_joy", "_key", "_mux", "_nav", "_raw")
    ]
    assert ask(robot, "topic", "find", "nav/Path", code=1) == ""
    assert "did you mean r1/odom?" in run_robo("topic", "info", "r1/odm", "--connect", robot).stderr


def test_topics_of_clients_that_are_no_nodes_are_listed(robot: str, client: zenoh.Session) -> None:
    publisher = client.declare_publisher("q1/foreign")
    found = {topic["key"]: topic for topic in lines(ask(robot, "topic", "list", "--json"))}
    assert found["q1/foreign"]["publishers"] == [f"zenoh:{client.zid()}"]
    assert found["q1/foreign"]["types"] == []
    publisher.undeclare()


def test_echo_selects_filters_and_ends(robot: str) -> None:
    values = ask(robot, "topic", "echo", "r1/odom", "--field", "twist.twist.linear.x", "--count", "3").split()
    assert len(values) == 3
    assert all(float(value) >= 0 for value in values)
    table = ask(
        robot, "topic", "echo", "r1/odom", "--csv", "--count", "2", "--field", "header.frame_id", "--field",
        "pose.covariance[0]",
    ).splitlines()  # fmt: skip
    assert table[0] == "time,key,sequence_number,header.frame_id,pose.covariance[0]"
    assert [row.split(",")[3] for row in table[1:]] == ["odom", "odom"]
    scans = lines(
        ask(robot, "topic", "echo", "r1/*", "--filter", "range_max > 1", "--count", "2", "--json", "--truncate")
    )
    assert {scan["key"] for scan in scans} == {"r1/scan"}
    assert scans[0]["message"]["ranges"][-1] == "… 344 more"
    mistake = run_robo("topic", "echo", "r1/odom", "--field", "pose.pos", "--connect", robot)
    assert mistake.returncode == 2
    assert "pose has no field 'pos'; did you mean pose?" in mistake.stderr


def test_a_star_stands_for_letters_too(robot: str) -> None:
    for pattern in ("r*/odom", "*1/o*m", "**/odom", "r$*/odom"):
        found = lines(ask(robot, "topic", "echo", pattern, "--once", "--json"))
        assert [one["key"] for one in found] == ["r1/odom"]
    assert lines(ask(robot, "topic", "hz", "r*/odom", "--count", "1", "--json"))[0]["key"] == "r1/odom"


def test_a_line_with_a_key_that_is_none_is_told(robot: str) -> None:
    record = '{{"key": "{}", "type": "{}", "time": 1, "sequence_number": 1, "message": {{"data": true}}}}\n'
    result = subprocess.run(
        [sys.executable, "-m", "robo", "topic", "pub", "-", "--connect", robot],
        input=record.format("a//b", "std/Bool") + record.format("q9/*", "std/Bool") + record.format("q9/x", "odd#?"),
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (result.returncode, result.stderr.splitlines()) == (
        1, ["<stdin>:1: 'a//b' is no key of a topic", "<stdin>:2: 'q9/*' is no key of a topic"]
    )  # fmt: skip


def test_what_did_not_come_in_time_is_told_by_the_exit_code(robot: str) -> None:
    for words, said in (
        (
            ("echo", "r1/odom", "--once", "--filter", "twist.twist.linear.x > 99"),
            "no message on r1/odom within 0.3 s; ",
        ),
        (("echo", "r1/odom", "--count", "9999"), "only "),
        (("echo", "q12/*"), "no message on q12/* within 0.3 s"),
        (("hz", "q12/x"), "no message on q12/x within 0.3 s"),
        (("loss", "r1/odom", "--count", "99"), "only "),
        (("plot", "q12/x"), "no message on q12/x within 0.3 s"),
    ):
        result = run_robo("topic", *words, "--duration", "0.3", "--connect", robot)
        assert (result.returncode, result.stderr.splitlines()[-1][: len(said)]) == (1, said)
    assert ask(robot, "topic", "echo", "r1/odom", "--once", "--duration", "20", "--field", "twist.twist.linear.y")


def test_a_topic_that_nobody_publishes_is_told_at_once(robot: str) -> None:
    for verb in ("echo", "hz", "bw", "delay", "loss", "plot"):
        with robo("topic", verb, "r1/odm", "--connect", robot) as waiting:
            waiting.wait_for("waiting for r1/odm: nobody publishes it so far; did you mean r1/odom?")
    with robo("topic", "echo", "r1/odm", "--once", "--timeout", "2", "--connect", robot) as waiting:
        waiting.wait_for("--duration S ends this wait")


def test_echo_of_everything_tells_every_message(robot: str, client: zenoh.Session) -> None:
    types = {name: robo_messages.find_type(name) for name in robo_messages.type_names()}
    # Without those that other tests have made in this process.
    shipped = [name for name, type_ in types.items() if type_.__module__.startswith("robo_messages")]
    with robo("topic", "echo", "**", "--json", "--connect", robot) as echo:
        echo.wait_for('"key":"r1/odom"')
        for number, name in enumerate(shipped, start=1):
            type_ = types[name]
            client.put(
                f"q2/{name}",
                robo_messages.encode(type_()),
                encoding=codec.encoding_of(type_),
                attachment=codec.pack_attachment(number, 10**18 + number),
            )
        echo.wait_for(f'"key":"q2/{shipped[-1]}"')
        echo.interrupt()
        echo.wait()
        found = [one for line in echo.output.splitlines() if (one := json.loads(line))["key"].startswith("q2/")]
    assert [(one["type"], one["sequence_number"], one["time"] - 10**18) for one in found] == [
        (name, number, number) for number, name in enumerate(shipped, start=1)
    ]


def test_echo_and_pub_reproduce_a_topic_byte_for_byte(robot: str, client: zenoh.Session) -> None:
    heard = hear(client, "q3/*")
    command = (
        f"{sys.executable} -m robo topic echo r1/scan --json --count 5 --connect {robot} | "
        f"{sys.executable} -m robo topic pub q3/scan sensor/LaserScan - --connect {robot}"
    )
    originals = hear(client, "r1/scan")
    result = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    came = samples(heard, 5) + so_far(heard)
    sent = [sample.payload.to_bytes() for sample in came]
    assert len(sent) == 5
    before = [sample.payload.to_bytes() for sample in so_far(originals)]
    begin = before.index(sent[0])
    assert sent == before[begin : begin + 5]
    assert {str(sample.encoding) for sample in came} == {"application/msgpack;sensor/LaserScan"}
    heard.undeclare()
    originals.undeclare()


def test_what_is_piped_back_into_its_own_topic_does_not_circle(
    robot: str, running: Robot, client: zenoh.Session
) -> None:
    publisher = client.declare_publisher("q4/x", encoding="application/msgpack;std/Bool")
    command = f"{sys.executable} -m robo topic echo q4/x --json | {sys.executable} -m robo topic pub - --beside"
    pipeline = subprocess.Popen(
        command,
        shell=True,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "ROBO_CONNECT": robot},
    )
    said = threading.Event()

    def listen() -> None:
        assert pipeline.stderr is not None
        for line in pipeline.stderr:
            if "what comes in is what went out" in line:
                said.set()

    listener = threading.Thread(target=listen)
    listener.start()
    sent = 0
    try:
        while not said.wait(0.05):
            sent += 1
            assert sent < 300, "nothing came back"
            publisher.put(robo_messages.encode(robo_messages.Bool(True)), attachment=codec.pack_attachment(sent, sent))
        assert len(running.messages("/q4/x")) <= 2 * sent
    finally:
        os.killpg(pipeline.pid, signal.SIGINT)
        pipeline.wait(40)
        listener.join()
        assert pipeline.stderr is not None
        pipeline.stderr.close()


def test_pub_tells_mistakes_and_publishes_nothing(robot: str, client: zenoh.Session) -> None:
    heard = hear(client, "q5/**")
    for type_name, data, message in (
        ("geometry/Twist", "{linear: {x: fast}}", "geometry/Twist.linear.x: expected float, got str 'fast'"),
        ("geometry/Twist", "{lin: {}}", "geometry/Twist has no field 'lin'; did you mean linear?"),
        ("geometry/Twst", "{}", "no message type is named 'geometry/Twst'; did you mean geometry/Twist?"),
        ("geometry/Twist", "{linear: ", "neither YAML nor JSON: column 10"),
    ):
        result = run_robo("topic", "pub", "q5/x", type_name, data, "--connect", robot)
        assert (result.returncode, result.stdout) == (1, "")
        assert message in result.stderr
    other = run_robo("topic", "pub", "r1/scan", "geometry/Twist", "{}", "--connect", robot)
    assert other.returncode == 1
    assert "r1/scan is no geometry/Twist: /r1/" in other.stderr
    good = run_robo("topic", "pub", "q5/end", "geometry/Twist", "{linear: {x: 1e-3}}", "--connect", robot)
    assert good.returncode == 0
    came = samples(heard) + so_far(heard)
    assert [str(sample.key_expr) for sample in came] == ["q5/end"]
    assert robo_messages.decode(came[0].payload.to_bytes(), Twist).linear.x == 0.001
    heard.undeclare()


def test_pub_waits_and_repeats(session: zenoh.Session, endpoint: str) -> None:
    words = ("topic", "pub", "q6/x", "std/String", "{data: hi}", "-r", "100", "--times", "4", "--wait-for-subscriber")
    with robo(*words, "--connect", endpoint) as pub:
        eventually(lambda: "q6/x" in ask(endpoint, "topic", "list"), "it announces itself")
        assert pub.process.poll() is None
        heard = hear(session, "q6/x")
        assert pub.wait() == 0
    came = samples(heard, 4) + so_far(heard)
    assert [robo_messages.decode(s.payload.to_bytes(), String) for s in came] == [String("hi")] * 4
    numbers = [codec.unpack_attachment(s.attachment.to_bytes()) for s in came if s.attachment is not None]
    assert [number[0] for number in numbers if number is not None] == [1, 2, 3, 4]


def test_pub_does_not_fight_with_a_publisher_unasked(robot: str, running: Robot, client: zenoh.Session) -> None:
    running.clear()
    words = ("topic", "pub", "r1/cmd_vel_nav", "geometry/Twist")
    record = '{"key": "r1/cmd_vel_nav", "type": "geometry/Twist", "time": 1, "sequence_number": 1, "message": {}}'
    for command, text in (
        ((*words, "{}", "-r", "10"), ""),
        ((*words, "{}"), ""),
        ((*words, "-"), "{}\n"),
        (("topic", "pub", "-"), record),
    ):
        result = subprocess.run(
            [sys.executable, "-m", "robo", *command, "--connect", robot],
            input=text, capture_output=True, text=True, timeout=60, check=False,
        )  # fmt: skip
        assert (result.returncode, result.stdout) == (1, "")
        assert result.stderr == (
            "error: /r1/velocity_controller publishes r1/cmd_vel_nav already, and receivers would get both in turns: "
            "stop it first (robo stop /r1/velocity_controller), or add --beside\n"
        )
    ask(robot, *words, "{linear: {z: 7}}", "--beside")
    running.wait_for("cmd_vel_nav", lambda twist: twist.linear.z == 7)  # beside the others
    assert [twist.linear.z for twist in running.messages("cmd_vel_nav")].count(7) == 1
    foreign = client.declare_publisher("q10/x")
    assert f"zenoh:{client.zid()} publishes q10/x already" in run_robo(
        "topic", "pub", "q10/x", "std/Empty", "--connect", robot
    ).stderr  # fmt: skip
    foreign.undeclare()


def test_pub_tells_in_a_terminal_how_far_it_is(robot: str) -> None:
    words = ("topic", "pub", "q11/x", "std/Bool", "{data: true}", "-r", "50", "--times", "50", "--connect", robot)
    with terminal(*words, columns=80) as screen:
        screen.wait_for("published 1 message on q11/x; Ctrl-C ends")
        screen.wait_for("messages on q11/x; Ctrl-C ends")
        screen.wait_for("published 50 messages on q11/x\r\n")


def test_a_line_that_is_wrong_is_told_with_its_number(robot: str) -> None:
    result = subprocess.run(
        [sys.executable, "-m", "robo", "topic", "pub", "q7/x", "std/Bool", "-", "--connect", robot],
        input='{"data": true}\n\n{"data": 3}\nnonsense\n{"data": false}\n',
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert result.returncode == 1
    told = result.stderr.splitlines()
    assert told[0] == "<stdin>:3: std/Bool.data: expected bool, got int 3"
    assert told[1].startswith("<stdin>:4: no JSON")
    assert len(told) == 2


def feed(session: zenoh.Session, key: str, numbers: list[int], stop: threading.Event) -> None:
    """Publish messages whose numbers and times say 1,000 Hz, again and again."""
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    payload = robo_messages.encode(robo_messages.Bool(True))
    offset = 0
    while not stop.is_set():
        for number in numbers:
            at = offset + number
            publisher.put(payload, attachment=codec.pack_attachment(at, 10**18 + at * 10**6))
        offset += numbers[-1]
        stop.wait(0.05)


def test_hz_and_loss_go_by_the_publishers_numbers(robot: str, client: zenoh.Session) -> None:
    stop = threading.Event()
    numbers = [n for n in range(1, 101) if n not in (10, 11, 12, 50)]
    feeder = threading.Thread(target=feed, args=(client, "q8/x", numbers, stop))
    feeder.start()
    try:
        rates = lines(ask(robot, "topic", "hz", "q8/x", "--count", "1", "--window", "0.5", "--json"))
        losses = lines(ask(robot, "topic", "loss", "q8/*", "--duration", "1", "--json"))
    finally:
        stop.set()
        feeder.join()
    assert rates[0]["rate"] == pytest.approx(1000.0)
    assert rates[0]["min"] == pytest.approx(0.001)
    assert rates[0]["max"] == pytest.approx(0.004)
    total = sum(window["lost"] for window in losses)
    assert total == losses[-1]["total_lost"]
    assert total / 4 == pytest.approx((losses[-1]["total_count"] + total) / 100, abs=1)


def test_bandwidth_and_delay(robot: str) -> None:
    sizes = lines(ask(robot, "topic", "bw", "r1/scan", "r1/odom", "--count", "1", "--json"))
    assert {one["key"] for one in sizes} == {"r1/odom", "r1/scan"}
    assert all({"key", "rate", "count", "min", "max", "std", "bandwidth"} <= set(one) for one in sizes)
    delays = lines(ask(robot, "topic", "delay", "r1/odom", "--count", "1", "--json"))
    assert 0 < delays[0]["min"] <= delays[0]["mean"] <= delays[0]["max"] < PATIENCE


def test_a_plot_shows_a_line(robot: str) -> None:
    picture = ask(robot, "topic", "plot", "r1/odom", "--field", "twist.twist.linear.x", "--duration", "1")
    assert "twist.twist.linear.x" in picture
    assert re.search("[⠁-⣿]", picture)
    wrong = run_robo("topic", "plot", "r1/odom", "--field", "header.frame_id", "--connect", robot)
    assert "header.frame_id is no number but str" in wrong.stderr


def test_health(robot: str, endpoint: str) -> None:
    assert run_robo("health", "--connect", robot).returncode == 0
    assert run_robo("health", "/r1/position_tracker", "--connect", robot).returncode == 0
    absent = run_robo("health", "/r1/nobody", "--connect", robot)
    assert (absent.returncode, absent.stderr) == (1, "/r1/nobody is not ready\n")
    nothing = run_robo("health", "--connect", endpoint, "--timeout", "0.3")
    assert nothing.returncode == 1
    assert "no connection at" in nothing.stderr
    assert run_robo("health", "a", "--robot-name", "r1").returncode == 2, "nodes, or a robot"


def test_health_of_several_nodes_and_of_a_robot(robot: str) -> None:
    assert run_robo("health", "/r1/position_tracker", "/r1/safety_monitor", "--connect", robot).returncode == 0
    one_absent = run_robo("health", "/r1/position_tracker", "/r1/nobody", "--connect", robot)
    assert (one_absent.returncode, one_absent.stderr) == (1, "/r1/nobody is not ready\n")
    whole = run_robo("health", "--robot-name", "r1", "--connect", robot)
    assert (whole.returncode, whole.stderr) == (0, "")
    other = run_robo("health", "--robot-name", "r7", "--connect", robot)
    assert (other.returncode, other.stderr) == (1, "no supervisor tells of a robot r7 within 2 s\n")
    assert "robot name" in run_robo("health", "--robot-name", "r 1", "--connect", robot).stderr


# -- nodes and the graph ---------------------------------------------------------------------------


def test_nodes(robot: str) -> None:
    found = {node["node"]: node for node in lines(ask(robot, "node", "list", "--json"))}
    assert set(found) == {
        *(f"/r1/{n}" for n in ("diff_drive_sim", "position_tracker", "safety_monitor", "velocity_controller")),
        *("/r1/twist_mux", "/r1/velocity_smoother"),
    }
    info = json.loads(ask(robot, "node", "info", "position_tracker", "--json"))
    assert info["pid"] == found["/r1/position_tracker"]["pid"]
    assert info["uptime"] > 0
    assert 0 <= info["load"] <= 1
    assert info["state"] == "ready"
    assert info["parameters"]["max_distance"] == 100.0
    odometry = next(one for one in info["subscriptions"] if one["topic"] == "r1/odom")
    assert odometry["rate"] > 0
    assert (odometry["dropped"], odometry["malformed"]) == (0, 0)
    assert [one["service"] for one in info["services"]] == ["r1/reset_distance"]
    text = ask(robot, "node", "info", "/r1/position_tracker")
    assert "received, 0 dropped, 0 malformed" in text
    assert "did you mean position_tracker?" in run_robo("node", "info", "position_traker", "--connect", robot).stderr


def test_a_node_may_take_as_long_to_tell_a_parameter_as_is_said(robot: str, client: zenoh.Session) -> None:
    late: list[threading.Thread] = []

    def tell(query: zenoh.Query) -> None:
        threading.Event().wait(0.9)
        query.reply(query.key_expr, msgspec.msgpack.encode({"speed": 0.3}))

    # A thread lets go of its query when it ends: an answer counts only then.
    def answer(query: zenoh.Query) -> None:
        late.append(threading.Thread(target=tell, args=(query,)))
        late[-1].start()

    token = client.liveliness().declare_token(f"@robo/r1/node/late/m:C/{os.getpid()}/here")
    end = client.declare_queryable(parameters_key("r1", "late", "get"), answer)
    assert ask(robot, "param", "get", "late", "speed", "--timeout", "30") == "0.3\n"
    result = run_robo("param", "get", "late", "speed", "--timeout", "0.3", "--connect", robot)
    assert result.returncode == 1
    assert "/r1/late did not answer within 0.3 s" in result.stderr
    for thread in late:
        thread.join()
    end.undeclare()
    token.undeclare()


def test_a_node_that_does_not_answer_is_told(robot: str, client: zenoh.Session) -> None:
    token = client.liveliness().declare_token(f"@robo/r1/node/ghost/m:C/{os.getpid()}/here")
    result = run_robo("node", "info", "ghost", "--timeout", "0.3", "--connect", robot)
    assert result.returncode == 1
    assert "/r1/ghost did not answer within" in result.stderr
    assert "Traceback" not in result.stderr
    token.undeclare()


def test_the_graph_is_what_check_computed(robot: str) -> None:
    running = json.loads(ask(robot, "graph", "--format", "json", "--robot-name", "r1"))
    planned = json.loads(run_robo("check", "robot.yaml", "demo:=arc", "--robot-name", "r1", "--graph", "json").stdout)
    # Nobody has to publish it, so that the monitor does not declare it.
    running["topics"] = [topic for topic in running["topics"] if topic["key"] != "r1/emergency_stop"]
    assert running == planned
    text = ask(robot, "graph")
    listed = lines(ask(robot, "topic", "list", "--json")) + lines(ask(robot, "service", "list", "--json"))
    for one in listed:
        assert one["key"] in text
    assert "! nobody subscribes it" in text
    assert "r1/log" not in ask(robot, "graph", "--hide-system", "--format", "dot")


def test_the_network(robot: str) -> None:
    seen = json.loads(ask(robot, "net", "--json"))
    assert [router["name"] for router in seen["routers"]] == ["r1"]
    assert robot in seen["routers"][0]["locators"]
    nodes = {node["node"]: node for node in seen["nodes"]}
    assert "/r1/safety_monitor" in nodes["/r1/position_tracker"]["links"]
    assert all(0 < node["latency"] < 30 and abs(node["clock"]) < 30 for node in nodes.values())
    assert seen["problems"] == []
    assert "router of r1" in ask(robot, "net")


@pytest.mark.parametrize(
    ("pair", "code", "words"),
    [
        (("diff_drive_sim", "position_tracker"), 0, ["linked directly", "r1/odom: /r1/diff_drive_sim publishes"]),
        (("velocity_controller", "diff_drive_sim"), 0, ["/r1/velocity_smoother, /r1/safety_monitor stand between"]),
        (("velocity_controller", "position_tracker"), 1, ["they have no topic and no service in common"]),
        (("diff_drive_sim", "position_traker"), 1, ["no node position_traker", "did you mean position_tracker?"]),
    ],
)  # fmt: skip
def test_why_two_nodes_do_not_see_each_other(robot: str, pair: tuple[str, str], code: int, words: list[str]) -> None:
    text = ask(robot, "net", *pair, code=code)
    assert [word for word in words if word not in text] == []


def test_a_call_may_name_the_type_as_ros_does(robot: str) -> None:
    for words in ((), ("{}",), ("std/Trigger",), ("std/Trigger", "{}")):
        answer = json.loads(ask(robot, "service", "call", "r1/reset_distance", *words, "--json"))
        assert answer["success"]
    wrong = run_robo("service", "call", "r1/reset_distance", "std/SetBool", "{}", "--connect", robot)
    assert (wrong.returncode, wrong.stderr) == (
        2, "error: r1/reset_distance is a std/Trigger, not a std/SetBool; its type need not be said\n"
    )  # fmt: skip


def test_help_by_a_verb_and_by_an_option_are_the_same() -> None:
    for words in ((), ("topic",), ("topic", "echo"), ("run",), ("health",)):
        assert run_robo("help", *words).stdout == run_robo(*words, "--help").stdout
    told = run_robo("run", "robo_services.position_tracker", "--ros-args", "-r", "odom:=x")
    assert (told.returncode, told.stderr.split(":")[1]) == (2, " leave --ros-args out")
    in_two_words = run_robo("run", "robo_services", "position_tracker", "--help")
    assert in_two_words.stdout == run_robo("run", "robo_services.position_tracker", "--help").stdout
    assert "publishes:" in in_two_words.stdout


def test_a_parameter_is_described_with_keys(robot: str) -> None:
    told = ask(robot, "param", "describe", "safety_monitor", "rate")
    assert re.search(r"^  description +\w", told, re.M), told


@pytest.mark.parametrize(
    "words", [("topic", "list"), ("node", "list"), ("service", "list"), ("graph",), ("param", "list")], ids=" ".join
)
def test_a_robot_that_is_not_there_is_told(robot: str, words: tuple[str, ...]) -> None:
    told = run_robo(*words, "--robot-name", "r7", "--connect", robot)
    assert (told.returncode, told.stdout) == (1, "")
    assert told.stderr == "error: no node of a robot r7 is on this network; there is r1\n"


# -- the link --------------------------------------------------------------------------------------


def test_what_goes_on_says_when_its_link_is_lost_and_back(endpoint: str) -> None:
    lost, back = f"the link to {endpoint} is lost; it is dialled until it answers", f"the link to {endpoint} is back, "
    with ExitStack() as stack:
        with robo("up", "--robot-name", "r1", "--listen", endpoint) as first:
            first.wait_for("is ready")
            waiting = {
                verb: stack.enter_context(robo(*verb.split(), "--connect", endpoint))
                for verb in (
                    "topic echo r1/odom",
                    "topic hz r1/odom",
                    "ps --watch --robot-name r1",
                    "events",
                    "logs -f",
                )
            }
            waiting["ps --watch --robot-name r1"].wait_for("/r1/diff_drive_sim")
            for verb in ("topic echo r1/odom", "topic hz r1/odom", "events", "logs -f"):
                waiting[verb].wait_for("r1")
        for command in waiting.values():
            command.wait_for(lost)
        with robo("up", "--robot-name", "r1", "--listen", endpoint) as again:
            again.wait_for("is ready")
            for command in waiting.values():
                command.wait_for(back)
            eventually(lambda: "ready" in waiting["ps --watch --robot-name r1"].output.rpartition(back)[2], "its table")
        assert [verb for verb, command in waiting.items() if "Traceback" in command.output] == []


def test_a_live_view_says_that_its_link_is_lost(endpoint: str) -> None:
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("is ready")
        with terminal("top", "--connect", endpoint, columns=140) as screen:
            screen.wait_for("/r1/safety_monitor")
            robot.interrupt()
            robot.wait()
            screen.wait_for(f"the link to {endpoint} is lost")


# -- live views ------------------------------------------------------------------------------------


def test_top_once(robot: str) -> None:
    seen: dict[str, Any] = {}

    def is_quick() -> bool:
        seen.update(json.loads(ask(robot, "top", "--once", "--json")))
        odometry = next(topic for topic in seen["topics"] if topic["key"] == "r1/odom")
        return 30 < odometry["rate"] < 70 and odometry["age"] < 1 and not odometry["stale"]

    eventually(is_quick, "50 Hz")  # a busy machine holds the base up now and then
    nodes = {node["node"]: node for node in seen["nodes"]}
    assert nodes["/r1/safety_monitor"]["memory"] > 1e6
    assert nodes["/r1/safety_monitor"]["restarts"] == 0
    topics = {topic["key"]: topic for topic in seen["topics"]}
    assert topics["r1/odom"]["bandwidth"] > 1000
    table = ask(robot, "top", "--once", "--robot-name", "r1")
    assert "/r1/safety_monitor" in table


@contextmanager
def terminal(*words: str, columns: int, rows: int = 24) -> Iterator["Screen"]:
    """A command in a terminal of its own."""
    leader, follower = pty.openpty()
    ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": str(columns), "LINES": str(rows)}
    process = subprocess.Popen(
        [sys.executable, "-m", "robo", *words], stdin=follower, stdout=follower, stderr=follower, env=environment
    )
    os.close(follower)
    try:
        yield Screen(leader, process)
    finally:
        process.kill()
        process.wait(40)
        os.close(leader)


class Screen:
    def __init__(self, descriptor: int, process: "subprocess.Popen[bytes]") -> None:
        self.descriptor = descriptor
        self.process = process
        self.text = ""

    def wait_for(self, text: str, timeout: float = 15.0) -> None:
        end = time.monotonic() + timeout
        while text not in self.text:
            assert time.monotonic() < end, f"{text!r} not in {self.text!r}"
            if select.select([self.descriptor], [], [], 0.1)[0]:
                self.text += os.read(self.descriptor, 65536).decode(errors="replace")

    def press(self, key: str) -> None:
        os.write(self.descriptor, key.encode())


@pytest.mark.parametrize("columns", [80, 200])
def test_top_lives_in_a_terminal_while_nodes_come_and_go(robot: str, columns: int) -> None:
    with terminal("top", "--connect", robot, columns=columns) as screen:
        screen.wait_for("/r1/safety_monitor")
        screen.wait_for("50")
        name = f"guest_{columns}"
        with robo("run", "robo_services.position_tracker", "--name", name, "--robot-name", "r1", "--connect", robot,
                  "--listen", f"tcp/127.0.0.1:{free_port()}"):  # fmt: skip
            screen.wait_for(f"/r1/{name}")
        screen.text = ""
        eventually(lambda: name not in ask(robot, "node", "list"), "it is gone")
        screen.wait_for("/r1/safety_monitor")
        assert "Traceback" not in screen.text
        screen.press("q")
        assert screen.process.wait(PATIENCE) == 0


def test_colours_are_for_terminals_and_not_where_no_color_is_said(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "\x1b" not in ask(robot, "topic", "list")
    with terminal("topic", "list", "--connect", robot, columns=80) as screen:
        screen.wait_for("\x1b[1mTOPIC")
    monkeypatch.setenv("NO_COLOR", "1")
    with terminal("topic", "list", "--connect", robot, columns=80) as screen:
        screen.wait_for("r1/scan")
        assert "\x1b" not in screen.text


def test_ps_has_straight_columns_and_fits(robot: str) -> None:
    with terminal("ps", "--connect", robot, columns=80) as screen:
        screen.wait_for("/r1/velocity_controller")
        assert screen.process.wait(15) == 0
        screen.wait_for("REASON")
        assert "\x1b[32mready\x1b[0m" in screen.text
        head, *rows = re.sub(r"\x1b\[\d*m", "", screen.text).splitlines()
        assert max(map(len, (head, *rows))) <= 80
        for row in filter(None, rows):
            assert re.match(r"\S+ +$", row[: head.index("STATE")])
            assert re.match(r"\S+ +$", row[head.index("STATE") : head.index("RESTARTS")])
    assert "ROBOT  GROUP" in ask(robot, "ps"), "elsewhere nothing is left out"


# -- completion ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("robo topic echo r1/od", {"r1/odom"}),
        ("robo node info pos", {"position_tracker"}),
        ("robo node info /r1/v", {"/r1/velocity_controller", "/r1/velocity_smoother"}),
        ("robo param get velocity_controller linear_v", {"linear_velocity"}),
        ("robo service call r1/reset_d", {"r1/reset_distance"}),
        ("robo topic pub r1/x geometry/TwistS", {"geometry/TwistStamped"}),
        ("robo topic list --robot-name ", {"r1"}),
        ("robo restart velo", {"velocity_controller", "velocity_smoother"}),
        ("robo up sim", {"simulation.yaml"}),
        ("robo up fl", {"fleet.yaml"}),
        ("robo export compose rep", {"replay.yaml"}),
    ],
)  # fmt: skip
def test_a_shell_completes_what_lives(robot: str, line: str, expected: set[str]) -> None:
    words = line.split(" ")
    environment = {
        **os.environ,
        "_ROBO_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
        "ROBO_CONNECT": robot,
    }
    result = subprocess.run(
        [sys.executable, "-m", "robo"], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert (set(result.stdout.split()), result.stderr) == (expected, "")


def test_where_nothing_runs_there_is_nothing_to_complete(endpoint: str) -> None:
    environment = {**os.environ, "_ROBO_COMPLETE": "complete_bash", "COMP_WORDS": "robo topic echo ",
                   "COMP_CWORD": "3", "ROBO_CONNECT": endpoint}  # fmt: skip
    result = subprocess.run(
        [sys.executable, "-m", "robo"], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert (result.stdout.strip(), result.stderr) == ("", "")
