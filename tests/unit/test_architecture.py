"""The floors of the house, and what each process may carry."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[2]
HEAVY = {"typer", "click", "rich", "numpy", "yaml", "asyncio", "argparse", "psutil", "pytest"}


def test_nothing_imports_what_stands_above_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("logging.config.dictConfig", lambda _: None)  # it would silence the loggers of other tests
    code = lint_imports(config_filename=str(ROOT / "pyproject.toml"), cache_dir=None)
    assert code == 0, capsys.readouterr().out


def modules_after(code: str) -> set[str]:
    script = f"{code}\nimport sys; print(*sorted(sys.modules))"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in result.stdout.split()}


@pytest.mark.parametrize(
    "code",
    [
        "import robo",
        "import robo_services.velocity_controller, robo.process.node",
        "import robo_services.position_tracker, robo.process.node",
        "import robo_services.safety_monitor, robo.process.node",
        "import robo_services.twist_mux, robo.process.node",
        "import robo_services.velocity_smoother, robo.process.node",
        "import robo_services.waypoint_follower, robo.process.node",
        "import robo_services.calibrate_base, robo.process.node",
        "import robo_services.bag_player, robo.process.node",
        "import robo_services.carmen_player, robo.process.node",
        "import robo_services.diagnostic_aggregator, robo.process.node",
        "import robo_services.diff_drive_controller, robo.process.node",
        "import robo_services.ekf_filter, robo.process.node",
        "import robo_services.robot_state_publisher, robo.process.node",
        "import robo_services.static_transform_publisher, robo.process.node",
        "import robo_services.emulated_board, robo.process.node",
        "import robo_services.serial_base, robo.process.node",
        "import robo_services.teleop_keyboard, robo.process.node",
        "import robo_services.teleop_joy, robo.process.node",
        "import robo_services.joy, robo.process.node",
        "import robo_services.camera, robo.process.node",
        "import robo_services.ld_lidar, robo.process.node",
        "import robo_services.nmea_gps, robo.process.node",
        "import robo_services.mujoco_sim, robo.process.node",
        "import robo_services.recorder, robo.process.node",
        "import robo_services.dashboard, robo.process.node",
        "import robo_services.ros2_bridge, robo.process.node",
        "import robo.process.router",
    ],
)
def test_a_node_carries_nothing_heavy(code: str) -> None:
    openssl = "_hashlib"  # 4 MB, which `secrets` and `random` bring along
    assert not modules_after(code) & {*HEAVY, openssl}


def test_a_plain_node_imports_nothing_of_managed_ones() -> None:
    script = (
        "import robo_services.velocity_controller, robo.process.node, robo.process.runner, sys; print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    kept_out = {f"robo.node.{name}" for name in ("lifecycle", "managed", "managed_life", "gate")}
    assert "robo.node.node" in loaded
    assert not {*loaded} & {*kept_out, "robo_messages.lifecycle"}


def test_a_node_without_large_messages_imports_nothing_of_them() -> None:
    script = (
        "import robo_services.velocity_controller, robo.process.node, robo.process.runner, sys; print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not {*loaded} & {"robo.node.large", "robo.wire.shared_buffers", "robo_messages.arrays"}


def test_a_node_without_transforms_imports_nothing_of_them() -> None:
    script = "import robo_services.safety_monitor, robo.process.node, robo.process.runner, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not [name for name in loaded if name.startswith("robo.tf") or name == "robo_messages.tf2"]


def test_a_node_imports_nothing_of_what_other_systems_read() -> None:
    script = "import robo_services.safety_monitor, robo.process.node, robo.process.runner, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not [name for name in loaded if name.startswith(("robo.interfaces.cdr", "robo.interfaces.ros_"))]
    assert "robo_messages.system_more" not in loaded


def test_a_plain_node_does_without_paths_and_versions() -> None:
    loaded = modules_after("import robo_services.velocity_controller, robo.process.node, robo.process.runner")
    assert not loaded & {"pathlib", "urllib", "ipaddress", "email"}, "0.7 MB"


def test_transforms_need_neither_network_nor_node() -> None:
    script = "import sys; from robo.tf import Buffer, Transform3, transform_point, scan_points; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert "robo.tf.apply" in loaded
    assert not {name.partition(".")[0] for name in loaded} & {*HEAVY, "zenoh", "difflib"}
    rooms = {name.split(".")[1] for name in loaded if name.startswith("robo.")}
    assert rooms == {"errors", "text", "tf"}


def test_help_needs_no_zenoh() -> None:
    loaded = modules_after("import robo.cli.app")
    assert not loaded & {"zenoh", "rich", "yaml", "psutil", "numpy", "asyncio"}


def test_pytest_loads_the_plugin_alone() -> None:
    loaded = modules_after("import robo.testing.plugin")
    assert not loaded & {"zenoh", "msgspec", "robo_messages", "yaml", "psutil", "typer", "rich", "numpy"}
    script = "import sys, robo.testing.plugin; print(*(name for name in sys.modules if name.startswith('robo')))"
    own = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert own == ["robo", "robo.testing", "robo.testing.plugin"]


ALWAYS_HEAVY = {"numpy", "asyncio", "pytest"}


MAY_LOAD = {
    "batch": {"yaml"},
    "dashboard": {"asyncio", "yaml"},
    "node": {"yaml"},
    "bridge_ros2": {"yaml"},
    "param": {"yaml"},
    "service": {"yaml"},
    "create": {"yaml"},
    "interface": {"yaml"},
    "plot": {"rich"},
    "bag_record": {"rich"},
    "screen": {"rich"},
    "security": {"yaml"},
    "top": {"rich", "psutil"},
    "doctor": {"psutil"},
}
VIEWS = sorted(file.stem for file in (ROOT / "robo" / "cli" / "views").glob("[a-z]*.py"))


@pytest.mark.parametrize("view", VIEWS)
def test_a_verb_imports_what_it_needs_and_no_more(view: str) -> None:
    loaded = modules_after(f"import robo.cli.views.{view}")
    assert loaded & (HEAVY | ALWAYS_HEAVY) - {"typer", "click"} <= MAY_LOAD.get(view, set())
    assert "typer" not in loaded, "what a verb does is apart from how it is called"


MAY_FIND_OUT = {
    "robo/text/readable.py": "it takes the lock",
    "messages/robo_messages/_registry.py": "it takes the lock",
    "robo/interfaces/ros_values.py": "of fields of messages, which have been found out with the message",
}
PLAIN = {"str", "int", "float", "bool", "bytes", "object", "Any", "None", "list", "dict", "tuple"}


def test_msgspec_finds_out_no_type_in_two_threads_at_a_time() -> None:
    found = []
    for file in [*ROOT.glob("robo/**/*.py"), *ROOT.glob("services/**/*.py"), *ROOT.glob("messages/**/*.py")]:
        name = file.relative_to(ROOT).as_posix()
        if name in MAY_FIND_OUT or "/_sample/" in name:
            continue
        functions = (part for part in ast.walk(ast.parse(file.read_text())) if isinstance(part, FUNCTIONS))
        for call in (part for function in functions for part in ast.walk(function) if isinstance(part, ast.Call)):
            if (type_ := _type_that_is_read(call)) is not None and not _is_found_out(type_):
                found.append(f"{name}:{call.lineno}: {ast.unparse(type_)}")
    assert found == [], "write readable(…) around it"


FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


def _type_that_is_read(call: ast.Call) -> ast.expr | None:
    """The type that a call has msgspec read, None where it names none."""
    module, _, function = ast.unparse(call.func).rpartition(".")
    if module.partition(".")[0] != "msgspec" or function not in ("convert", "decode", "Decoder"):
        return None
    named = [keyword.value for keyword in call.keywords if keyword.arg == "type"]
    place = {"convert": 1, "Decoder": 0}.get(function, len(call.args))
    return next(iter([*named, *call.args[place : place + 1]]), None)


def _is_found_out(type_: ast.expr) -> bool:
    if isinstance(type_, ast.Call):
        return ast.unparse(type_.func) == "readable"
    return {name.id for name in ast.walk(type_) if isinstance(name, ast.Name)} <= PLAIN
