"""What each key of a manifest becomes in a Compose file, and what Compose then makes of it."""

import json
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import ManifestError, UsageError
from robo.export.commands import MEMORY, as_word
from robo.export.compose import dockerfile
from robo.export.compose import file as compose
from robo.export.compose.services import SOCKET
from robo.export.names import slug, take
from robo.export.placeholders import Placeholders
from robo.export.profiles import Profiles, profiles_of
from robo.export.yaml_text import MERGE, Alias, Anchored, dumped
from robo.node.loading import load_node_class
from robo.parameters.model import Parameters
from robo.parameters.words import parse_assignment
from robo.process import options
from robo.process.spec import NodeSpec

TEXT_NODE = """
from robo import Node, Parameters


class MyParameters(Parameters):
    word: str = ""
    other: str | None = None
    names: list[str] = []
    open: str | None = None


class TextNode(Node):
    'Takes text.'

    Parameters = MyParameters
"""
LEFT_OUT = (
    "required: true",
    "priority: 5",
    "watchdog: 2",
    "publishes: {scan: sensor/LaserScan}",
    "log: screen",
    "ready: {log: up}",
    "restart: {policy: never, delay: 3, max: 2}",
    "stop: {timeout: 0.2}",
    "stop: {signal: SIGINT, timeout: 3}",
)
"""What Compose has no word for, or does anyway."""


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def written(groups: str, before: str = "") -> Path:
    """A manifest."""
    file = Path("mine.yaml")
    file.write_text(f"{before}\ngroups:\n{groups}")
    return file


def of_nodes(*nodes: str, before: str = "") -> Path:
    """A manifest with nodes, each a line, in the robot's namespace."""
    lines = "".join(f"      {node}\n" for node in nodes)
    return written(f"  all:\n    namespace: ${{robot_name}}\n    nodes:\n{lines}", before)


def tree_of(profiles: Profiles, **options: Any) -> dict[str, Any]:
    text = compose.export(profiles, folder=Path.cwd(), made_by="a test", **options)
    tree: dict[str, Any] = yaml.safe_load(text)
    return tree


def services(*nodes: str, robot: str | None = "r1", before: str = "", **given: object) -> dict[str, dict[str, Any]]:
    """The services that a manifest's nodes become."""
    found: dict[str, dict[str, Any]] = tree_of(profiles_of(of_nodes(*nodes, before=before), given, robot))["services"]
    return found


def command(settings: str = "", **of_export: Any) -> dict[str, Any]:
    """The service that a command becomes, of which the manifest says this."""
    return services(f"a: {{run: sleep inf{', ' if settings else ''}{settings}}}", **of_export)["a"]


def node(settings: str = "") -> dict[str, Any]:
    """The same of a node class."""
    return services(f"a: {{service: robo_services.position_tracker{', ' if settings else ''}{settings}}}")["a"]


# -- one key of the manifest -----------------------------------------------------------------------


@pytest.mark.parametrize("settings", LEFT_OUT)
def test_what_compose_has_no_word_for_changes_nothing(settings: str) -> None:
    assert command(settings) == command()


@pytest.mark.parametrize(
    ("settings", "key", "value"),
    [
        ("restart: never", "restart", "no"),  # a text: YAML's `no` would be false
        ("restart: on-failure", "restart", "on-failure"),
        ("restart: always", "restart", "always"),
        ("stop: TERM", "stop_signal", "SIGTERM"),
        ("stop: {signal: SIGHUP}", "stop_signal", "SIGHUP"),
        ("stop: {timeout: 4.5}", "stop_grace_period", "4.5s"),
        ("stop: {timeout: 10000000}", "stop_grace_period", "10000000s"),
        ("cpus: 0-2", "cpuset", "0,1,2"),
        ("limits: {memory: 1.5G}", "deploy", {"resources": {"limits": {"cpus": "1.0", "memory": "1536M"}}}),
        ("limits: {cpu: 0.5}", "deploy", {"resources": {"limits": {"cpus": "0.5", "memory": "256M"}}}),
        ("limits: {files: 100}", "ulimits", {"nofile": 100}),
        ("cwd: /tmp", "working_dir", "/tmp"),
        ("args: [-v]", "command", ["sleep", "inf", "-v"]),
        ("prefix: nice -n 5", "command", ["nice", "-n", "5", "sleep", "inf"]),
    ],
)
def test_a_key_that_compose_has(settings: str, key: str, value: object) -> None:
    assert command(settings)[key] == value


def test_who_is_granted_less_time_to_end_than_all_have_keeps_what_all_have() -> None:
    tree = tree_of(profiles_of(of_nodes("a: {run: x, stop: {timeout: 2.5}}"), {}, "r1"))
    assert tree["x-robo"]["stop_grace_period"] == "3s"
    assert tree["services"]["a"]["stop_grace_period"] == "3s"


@pytest.mark.parametrize(
    ("settings", "name", "value"),
    [
        ("env: {PORT: 8080}", "PORT", "8080"),
        ('env: {GREETING: "costs $5"}', "GREETING", "costs $$5"),
        ("env: {ROBO_CONNECT: tcp/elsewhere:1}", "ROBO_CONNECT", "tcp/elsewhere:1"),
        ("log: debug", "ROBO_LOG_LEVEL", "debug"),
        ("", "ROBO_CONNECT", "tcp/router:7447"),
        ("", "ROBO_NAMESPACE", "r1"),
    ],
)
def test_what_a_command_finds_in_its_environment(settings: str, name: str, value: str) -> None:
    assert command(settings)["environment"][name] == value


def test_a_command_is_told_all_of_its_node() -> None:
    said = command('params: {gain: 1.5, pins: [1, 2], limit: .inf, word: "on"}, remap: {scan: front/scan}')
    spec = msgspec.json.decode(said["environment"]["ROBO_NODE"], type=NodeSpec)
    assert (spec.name, spec.namespace, spec.mode, spec.connect) == ("a", "r1", "client", ("tcp/router:7447",))
    assert spec.parameters == {"gain": 1.5, "pins": [1, 2], "limit": "inf", "word": "on"}
    assert spec.remappings == {"scan": "front/scan"}
    assert str(Path.cwd()) not in str(said), "nothing tells where things are on this machine"


def test_a_node_is_told_by_its_command_line() -> None:
    said = node('params: {log_rate: 0.5}, remap: {odom: base/odom}, args: ["--listen", "tcp/[::]:7500"]')
    options = ["--name", "a", "--robot-name", "r1", "-p", "log_rate:=0.5", "-r", "odom:=base/odom"]
    assert said["command"] == ["run", "robo_services.position_tracker", *options, "--listen", "tcp/[::]:7500"]
    assert said["environment"] == {"ROBO_CONNECT": "tcp/router:7447", "ROBO_MODE": "client"}
    assert "entrypoint" not in said, "it is the image's own"


def test_a_managed_node_that_waits_is_well_while_it_runs() -> None:
    # The class is a plain one; that it could not wait is for `robo check` to say.
    said = node("autostart: false")
    assert said["command"][-1] == "--no-autostart"
    assert said["healthcheck"]["test"] == ["CMD", "true"]
    spec = msgspec.json.decode(command("autostart: false")["environment"]["ROBO_NODE"], type=NodeSpec)
    assert not spec.autostart


def test_what_a_parameter_file_says_is_not_said_again() -> None:
    Path("params.yaml").write_text("a: {ros__parameters: {log_rate: 0.5, max_linear_velocity: 1.0}}\n")
    said = node("params: [params.yaml, {max_linear_velocity: 2.0}]")
    assert said["command"][6:] == ["--params-file", "/etc/robo/params.yaml", "-p", "max_linear_velocity:=2.0"]
    assert said["configs"] == [{"source": "params_yaml", "target": "/etc/robo/params.yaml"}]


@given(
    st.one_of(
        st.booleans(),
        st.integers(-(2**53), 2**53),
        st.floats(allow_nan=False),
        st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=20),
        st.sampled_from(["true", "1", "1e3", "[1", "'a'", '"', "inf", "", "a: b", " x ", "{a}", "null"]),
        st.lists(st.integers(-5, 5), max_size=3),
        st.dictionaries(st.sampled_from("abc"), st.floats(allow_nan=False) | st.just("1.5"), max_size=2),
    )
)
def test_a_value_is_read_from_a_word_as_it_was(value: object) -> None:
    name, again = parse_assignment(f"x:={as_word(value, None)}")
    assert (name, again) == ("x", value)
    assert isinstance(again, bool) == isinstance(value, bool)
    if isinstance(value, str):
        assert parse_assignment(f"x:={as_word(value, 'str')}", _Words) == ("x", value)


class _Words(Parameters):
    x: str = ""


def test_text_that_looks_like_something_else_reaches_a_node_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("text_node.py").write_text(TEXT_NODE)
    monkeypatch.syspath_prepend(str(Path.cwd()))
    said = services('a: {service: text_node, params: {word: "1.5", other: "1.5", names: ["true"], open: "["}}')["a"]
    spec = options.parse(load_node_class("text_node"), said["command"][2:])
    assert spec.parameters == {"word": "1.5", "other": "1.5", "names": ["true"], "open": "["}


@pytest.mark.parametrize("policy", ["on-failure", "always"])
def test_a_node_that_may_come_back_has_a_place_for_what_it_keeps(policy: str) -> None:
    said = node(f"restart: {policy}")
    assert said["volumes"] == [MEMORY]
    assert said["environment"]["ROBO_MEMORY"] == MEMORY
    assert "volumes" not in node()
    assert "volumes" not in command(f"restart: {policy}"), "a command keeps nothing there"


# -- health and order ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "test"),
    [
        ("ready: {probe: test -e /tmp/x}", ["test", "-e", "/tmp/x"]),
        ("ready: {port: 8080}", ["python", "-c", "import socket; socket.create_connection(('127.0.0.1', 8080), 1)"]),
        ('ready: {port: "[::1]:80"}', ["python", "-c", "import socket; socket.create_connection(('::1', 80), 1)"]),
        ("ready: {log: up}", ["true"]),
        ("ready: node", ["true"]),
        ("", ["true"]),
    ],
)
def test_what_tells_that_a_command_is_well(settings: str, test: list[str]) -> None:
    assert command(settings)["healthcheck"]["test"] == ["CMD", *test]


def test_a_node_tells_by_itself_that_it_is_well() -> None:
    assert node()["healthcheck"]["test"] == ["CMD", "robo", "health", "/r1/a"]
    assert node("ready: started")["healthcheck"]["test"] == ["CMD", "true"]


def test_all_that_tells_of_readiness_has_to() -> None:
    (_, shell, option, line) = node("ready: {port: 8080, probe: [test, -e, a b]}")["healthcheck"]["test"]
    assert (shell, option) == ("sh", "-c")
    health, port, probe = (shlex.split(part) for part in line.split(" && "))
    assert health == ["robo", "health", "/r1/a"]
    assert port[:2] == ["python", "-c"]
    assert probe == ["test", "-e", "a b"]


def test_a_probe_that_is_a_file_of_the_project_comes_along() -> None:
    Path("check.sh").write_text("")
    said = command('ready: {probe: ["./check.sh", --fast]}')
    assert said["healthcheck"]["test"] == ["CMD", "/etc/robo/check.sh", "--fast"]
    assert said["configs"] == [{"source": "check_sh", "target": "/etc/robo/check.sh"}]


@pytest.mark.parametrize(("timeout", "period"), [("60", "10s"), ("120", "120s"), ("2.5", "2.5s"), ("0", "86400s")])
def test_who_may_take_long_to_be_ready_is_not_ill_before(timeout: str, period: str) -> None:
    assert node(f"ready: {{timeout: {timeout}}}")["healthcheck"]["start_period"] == period


@pytest.mark.parametrize(
    ("needed", "until", "condition"),
    [
        ("{run: x}", "started", "service_started"),
        ("{run: x}", "completed", "service_completed_successfully"),
        ("{run: x}", "ready", "service_started"),
        ("{run: x, ready: {port: 80}}", "ready", "service_healthy"),
        ("{run: x, ready: {probe: y}}", "ready", "service_healthy"),
        ("{service: robo_services.position_tracker}", "ready", "service_healthy"),
        ("{service: robo_services.position_tracker, ready: started}", "ready", "service_started"),
    ],
)
def test_what_is_waited_for(needed: str, until: str, condition: str) -> None:
    found = services(f"first: {needed}", f"then: {{run: y, needs: {{first: {until}}}}}")
    assert found["then"]["depends_on"] == {
        "router": {"condition": "service_healthy"},
        "first": {"condition": condition},
    }


def test_what_needs_a_process_that_says_so_is_started_again_with_it() -> None:
    found = services(
        "base: {run: x, restart: {policy: always, propagate: true}}",
        "lamp: {run: x}",
        "user: {run: y, needs: [base, lamp]}",
    )
    assert found["user"]["depends_on"]["base"]["restart"] is True
    assert "restart" not in found["user"]["depends_on"]["lamp"]
    assert "restart" not in found["user"]["depends_on"]["router"]


# -- robots and profiles ---------------------------------------------------------------------------

TWO_ROBOTS = """\
  first: {namespace: "${robot_name}", nodes: {a: {run: x}}}
  second: {namespace: "${robot_name}_b", if: "${second}", nodes: {a: {run: x}, c: {run: y, needs: [a]}}}
"""


def test_a_robot_of_a_profile_has_a_router_in_it() -> None:
    file = written(TWO_ROBOTS, "args: {second: {default: false}}")
    found = tree_of(profiles_of(file, {}, None))["services"]
    assert list(found) == ["router", "second_router", "a", "second_a", "second_c"]
    assert {name for name, service in found.items() if service.get("profiles") == ["second"]} == {
        *("second_router", "second_a", "second_c"),
    }
    assert found["second_router"]["command"][2] == "${ROBOT_NAME:-my_robot}_b"
    assert found["second_router"]["command"][-2:] == ["--connect", "tcp/router:7447"]
    assert list(found["second_c"]["depends_on"]) == ["second_router", "second_a"]
    assert found["second_c"]["environment"]["ROBO_CONNECT"] == "tcp/second_router:7447"


def test_with_keys_processes_meet_by_a_socket_and_others_come_by_tls(tmp_path: Path) -> None:
    keys = tmp_path / "security" / "names" / "r1"
    keys.mkdir(parents=True)
    profiles = profiles_of(of_nodes("a: {run: x}", "b: {service: robo_services.position_tracker}"), {}, "r1")
    tree = tree_of(profiles, keys=keys)
    router, *others = tree["services"].values()
    assert router["command"][3:] == ["--listen", SOCKET, "--listen", "tls/0.0.0.0:7447"]
    assert router["environment"] == {"ROBO_SECURITY": "/run/keys"}
    assert router["volumes"] == ["./security/names/r1:/run/keys:ro", "run:/run/robo"]
    for other in others:
        assert other["environment"]["ROBO_CONNECT"] == SOCKET
        assert "run:/run/robo" in other["volumes"]
        assert "ROBO_SECURITY" not in other["environment"], "nodes have no keys"
        assert "/run/keys" not in str(other)
    assert tree["volumes"]["run"]["driver_opts"]["type"] == "tmpfs"
    assert "tcp/" not in str(tree["services"])


def test_a_name_is_one_robots(tmp_path: Path) -> None:
    two = profiles_of(written(TWO_ROBOTS, "args: {second: {default: false}}"), {"second": True}, "r1")
    with pytest.raises(UsageError, match="each is exported by itself"):
        tree_of(two, keys=tmp_path)


def test_an_argument_that_is_given_is_no_profile() -> None:
    file = written(TWO_ROBOTS, "args: {second: {default: false}}")
    found = tree_of(profiles_of(file, {"second": True}, "r1"))["services"]
    assert not any("profiles" in service for service in found.values())
    assert list(found) == ["router", "r1_b_router", "a", "r1_b_a", "r1_b_c"]
    assert "r1_b_a" not in tree_of(profiles_of(file, {"second": False}, "r1"))["services"]


def test_an_argument_that_changes_what_runs_anyway_is_no_profile() -> None:
    changing = 'a: {run: "x ${fast}"}', "b: {run: y, if: '${fast}'}"
    assert set(services(*changing, before="args: {fast: {default: false}}")) == {"router", "a"}
    leaving_out = "a: {run: x, unless: '${bare}'}", "b: {run: y, if: '${bare}'}"
    assert set(services(*leaving_out, before="args: {bare: {default: false}}")) == {"router", "a"}


def test_an_argument_without_which_nothing_is_wrong_is_no_profile() -> None:
    nodes = "a: {run: x}", "b: {run: y, if: '${more}', needs: [nobody]}"
    assert set(services(*nodes, before="args: {more: {default: false}}")) == {"router", "a"}


def test_a_process_that_two_arguments_add_is_one_service_in_both_profiles() -> None:
    before = "args: {debug: {default: false}, verbose: {default: false}}"
    nodes = "a: {run: x}", "echo: {run: e, if: debug or verbose}", "gdb: {run: g, if: '${debug}', needs: [echo]}"
    found = services(*nodes, before=before)
    assert set(found) == {"router", "a", "echo", "gdb"}
    assert found["echo"]["profiles"] == ["debug", "verbose"]
    assert found["gdb"]["profiles"] == ["debug"]


def test_a_router_is_there_with_any_process_of_its_robot() -> None:
    file = written(
        '  first: {namespace: "${robot_name}", nodes: {a: {run: x}}}\n'
        '  arm: {namespace: "${robot_name}_b", if: "${arm}", nodes: {b: {run: x}}}\n'
        '  leg: {namespace: "${robot_name}_b", if: "${leg}", nodes: {c: {run: x}}}\n',
        "args: {arm: {default: false}, leg: {default: false}}",
    )
    found = tree_of(profiles_of(file, {}, "r1"))["services"]
    assert found["r1_b_router"]["profiles"] == ["arm", "leg"]
    assert (found["r1_b_b"]["profiles"], found["r1_b_c"]["profiles"]) == (["arm"], ["leg"])


def test_what_two_arguments_make_differently_is_the_firsts() -> None:
    before = "args: {slow: {default: false}, fast: {default: false}}"
    found = services("a: {run: x}", "b: {run: 'y ${fast}', if: slow or fast}", before=before)
    assert found["b"]["profiles"] == ["slow"]
    assert found["b"]["command"] == ["y", "false"]


def test_mistakes_are_told_and_nothing_is_exported() -> None:
    with pytest.raises(ManifestError, match="nobody"):
        profiles_of(of_nodes("a: {run: x, needs: [nobody]}"), {}, "r1")


def test_a_manifest_of_nothing_has_a_router() -> None:
    assert set(services("a: {run: x, if: '${all}'}", before="args: {all: {default: false}}")) == {"router", "a"}
    found = services("a: {run: x, if: false}")
    assert set(found) == {"router"}
    assert found["router"]["ports"] == ["127.0.0.1:${ROBO_PORT:-7447}:7447"]


# -- the text --------------------------------------------------------------------------------------

leaves = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8) | st.just("<<")
plain = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(max_size=5), plain, max_size=4))
def test_plain_data_are_read_as_they_were_written(tree: dict[str, Any]) -> None:
    assert yaml.safe_load(dumped({"all": tree})) == {"all": tree}


def test_what_is_alike_is_written_out_and_what_has_an_anchor_is_referred_to() -> None:
    alike = {"x": [1]}
    text = dumped({"one": alike, "two": alike, "three": Anchored("base", {"a": 1, "b": "*base"})})
    assert "&id" not in text
    text += dumped({"four": {MERGE: Alias("base"), "b": 2}, "five": "<<", "six": {"<<": "*base"}})
    assert yaml.safe_load(text.replace("'<<'", "'<'")) == {
        "one": alike, "two": alike, "three": {"a": 1, "b": "*base"}, "four": {"a": 1, "b": 2}, "five": "<",
        "six": {"<": "*base"},
    }  # fmt: skip


def test_each_service_takes_in_what_all_have() -> None:
    text = compose.export(
        profiles_of(of_nodes("a: {run: x}"), {}, "r1"), folder=Path.cwd(), made_by="me", keeper=True, image="mine:2"
    )
    assert text.startswith("# mine.yaml\n# Made by: me\n")
    assert text.count("    <<: *robo\n") == text.count("      <<: *health\n") == 3
    tree = yaml.safe_load(text)
    for service in tree["services"].values():
        assert service["image"] == "${ROBO_IMAGE:-mine:2}"
        assert service["read_only"] is True
        assert service["healthcheck"]["retries"] == tree["x-health"]["retries"]


# -- placeholders ----------------------------------------------------------------------------------


def interpolated(text: str, variables: Mapping[str, str]) -> str:
    """What Compose makes of a value."""

    def value(match: re.Match[str]) -> str:
        if match[0] == "$$":
            return "$"
        return variables.get(match[1], match[2] or "")

    return re.sub(r"\$\$|\$\{(\w+)(?::-(.*?))?\}", value, text)


@given(st.lists(st.sampled_from(["$", "{", "}", "a", "$$", "${HOME}", "/", "NAME", "HOST"]), max_size=8))
def test_a_text_comes_out_of_compose_as_it_went_in(parts: list[str]) -> None:
    names = Placeholders()
    standing_in = {"NAME": names.word("NAME", "r1"), "HOST": names.word("HOST", None)}
    shown = names.shown("".join(standing_in.get(part, part) for part in parts))
    values = {"NAME": "r7", "HOST": "h"}
    assert interpolated(shown, values) == "".join(values.get(part, part) for part in parts)
    assert interpolated(shown, {}) == "".join({"NAME": "r1", "HOST": ""}.get(part, part) for part in parts)


def test_a_variable_of_the_environment_is_read_where_the_file_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SERIAL", "/dev/mine")
    said = command('args: ["${env:SERIAL:-/dev/tty}", "${env:BAUD:-9600}", "${env:BARE}"]', robot=None)
    assert said["command"][2:] == ["${SERIAL:-/dev/tty}", "9600", "${BARE}"]
    assert json.loads(said["environment"]["ROBO_NODE"])["namespace"] == "${ROBOT_NAME:-my_robot}"


def test_a_file_that_a_variable_names_is_mounted() -> None:
    Path("a.log").write_text("")
    said = services("a: {service: robo_services.carmen_player, params: {log: '${dir}/${env:RUN_LOG:-a.log}'}}")["a"]
    assert said["volumes"] == ["${RUN_LOG:-a.log}:/etc/robo/run_log:ro"]
    assert "log:=/etc/robo/run_log" in said["command"]
    link = services(
        "a: {service: robo_services.emulated_board, params: {link: '/tmp/${robot_name}_board'}}", robot=None
    )
    assert "link:=/tmp/${ROBOT_NAME:-my_robot}_board" in link["a"]["command"]
    assert "volumes" not in link["a"], "it is the container's own"


# -- names and images ------------------------------------------------------------------------------


@given(st.lists(st.sampled_from(["a", "a_2", "b"]), max_size=6))
def test_no_two_have_one_name(wanted: list[str]) -> None:
    taken: set[str] = set()
    given_out = [take(name, taken) for name in wanted]
    assert len(set(given_out)) == len(given_out)
    assert taken == set(given_out)
    assert re.fullmatch(r"\w*", slug("a/b-c d.é"), re.ASCII)


@pytest.mark.parametrize(
    ("folder", "recipe", "image"),
    [
        ("Batt Robot", "FROM robo\n", "batt-robot:latest"),
        ("robo", "FROM robo:2 AS x\n", "my-robot:latest"),
        ("---", "from robo\n", "my-robot:latest"),
        ("mine", "FROM debian\n", "robo:latest"),
        ("mine", "FROM robot\n", "robo:latest"),
    ],
)
def test_an_image_is_not_called_as_what_it_is_built_on(folder: str, recipe: str, image: str) -> None:
    Path(folder).mkdir()
    file = Path(folder) / "Dockerfile"
    file.write_text(recipe)
    assert dockerfile.image_for(file) == image
