"""Types that ship and types of users' packages."""

import subprocess
import sys
from pathlib import Path

import pytest

import robo_messages
from robo.interfaces import catalogue, ros_text
from robo_messages import LaserScan, UnknownType

GRIPPER = '''
from robo_messages import Message, message
@message("my_robot/Gripper")
class Gripper(Message):
    """A gripper's state."""
    OPEN = 1
    width: float = 0.0
    """m."""
'''


def in_folder(folder: Path, code: str, **environment: str) -> str:
    """What Python prints there."""
    script = f"from robo.interfaces import catalogue, ros_text\n{code}"
    result = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=True,
        env={"PATH": "", **environment},
    )  # fmt: skip
    return result.stdout.strip()


@pytest.mark.parametrize("place", ["gripper.py", "my_robot/__init__.py", "my_robot/deep/messages.py"])
def test_types_below_the_current_folder_are_known(tmp_path: Path, place: str) -> None:
    file = tmp_path / place
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(GRIPPER)
    assert in_folder(tmp_path, "print('my_robot/Gripper' in catalogue.known())") == "True"
    assert "width" in in_folder(tmp_path, "print(catalogue.describe(catalogue.find('my_robot/Gripper')))")


def test_modules_may_be_named(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "gripper_types.py").write_text(GRIPPER)
    here = tmp_path / "here"
    here.mkdir()
    code = "print(catalogue.find('my_robot/Gripper').__module__)"
    path = str(tmp_path / "elsewhere")
    assert in_folder(here, code, ROBO_MESSAGES="gripper_types", PYTHONPATH=path) == "gripper_types"


def test_installed_packages_announce_theirs(tmp_path: Path) -> None:
    (tmp_path / "gripper_types.py").write_text(GRIPPER)
    info = tmp_path / "gripper-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: gripper\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[robo.messages]\ngripper = gripper_types\n")
    here = tmp_path / "here"
    here.mkdir()
    code = "print([one for one in catalogue.listed() if one.name == 'my_robot/Gripper'][0].description)"
    assert in_folder(here, code, PYTHONPATH=str(tmp_path)) == "A gripper's state."


def test_a_file_that_cannot_be_imported_is_told(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text(f"{GRIPPER}\nraise RuntimeError('no hardware')")
    code = (
        "try: catalogue.find('my_robot/Gripper')\n"
        "except Exception as error: print(type(error).__name__, error)\n"
        "print(len(catalogue.listed()) > 30)"
    )
    told = in_folder(tmp_path, code)
    assert told.startswith("ContractError broken.py, which says it, cannot be imported: broken.py:")
    assert "RuntimeError: no hardware" in told
    assert told.endswith("True"), "the list does without it"


def test_a_package_that_cannot_be_imported_does_not_hide_the_others(tmp_path: Path) -> None:
    (tmp_path / "batt").mkdir()
    (tmp_path / "batt" / "messages.py").write_text("raise SystemExit('no battery')")
    (tmp_path / "good_types.py").write_text(GRIPPER)
    info = tmp_path / "batt-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: batt\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[robo.messages]\nbatt = batt.messages\n")
    here = tmp_path / "here"
    here.mkdir()

    def told(*words: str) -> tuple[int, str, str]:
        result = subprocess.run(
            [sys.executable, "-m", "robo", "interface", *words], cwd=here, capture_output=True, text=True, check=False,
            env={"PATH": "", "PYTHONPATH": str(tmp_path), "ROBO_MESSAGES": "absent, good_types"},
        )  # fmt: skip
        return result.returncode, result.stdout, result.stderr

    place = f"{tmp_path}/batt/messages.py:1: "
    batt = "module batt.messages, which the entry point group robo.messages of batt names, cannot be imported: "
    absent = "module absent, which ROBO_MESSAGES names, cannot be imported: No module named 'absent'"
    code, out, err = told("list")
    assert (code, err) == (0, f"left out: {batt}{place}SystemExit: no battery\nleft out: {absent}\n")
    assert "nav/Odometry" in out
    assert "my_robot/Gripper" in out
    assert told("show", "nav/Odometry")[::2] == (0, "")
    assert told("show", "my_robot/Gripper")[::2] == (0, "")
    assert told("show", "batt/Battery") == (1, "", f"error: {batt}{place}SystemExit: no battery\n")
    code, _, err = told("show", "nav/Odometri")
    assert (code, err.splitlines()[0]) == (
        1, "error: no message type is named 'nav/Odometri'; did you mean nav/Odometry?"
    )  # fmt: skip
    assert len(err.splitlines()) == 3, "the type may be in what is broken"


BAD = {
    "aborts": "import os\nos.abort()",
    "hangs": "import time\ntime.sleep(600)",
    "leaves": "import os\nos._exit(0)",
    "scribbles": "import os\nfor out in range(3, 20):\n    try: os.write(out, b'noise\\n')\n    except OSError: pass",
}
"""Modules that would take with them whoever imports them."""


def test_a_module_that_crashes_or_hangs_takes_nobody_with_it(tmp_path: Path) -> None:
    for name, text in BAD.items():
        (tmp_path / f"{name}.py").write_text(f"{GRIPPER.replace('my_robot', name)}\n{text}\n")
    (tmp_path / "my_types.py").write_text(GRIPPER)
    names = ",".join([*BAD, "my_types"])
    code = "from robo.interfaces import apart\nfound = apart.types(patience=3.0)\nprint(*found.broken, sep='\\n')\n"
    said = [
        "aborts, which ROBO_MESSAGES names, cannot be imported: it ends the process with SIGABRT",
        "hangs, which ROBO_MESSAGES names, cannot be imported: it has not come to its end within 3 s",
        "leaves, which ROBO_MESSAGES names, cannot be imported: it ends the process with exit code 0",
        "scribbles, which ROBO_MESSAGES names, cannot be imported: it writes into what this process reports",
    ]
    told = in_folder(tmp_path, f"{code}print(found.listed['my_robot/Gripper'].description)", ROBO_MESSAGES=names)
    assert told.splitlines() == [*(f"module {line}" for line in said), "A gripper's state."]
    shown = "from robo.interfaces import apart\nprint(apart.described('my_robot/Gripper').ros.text)"
    assert "float64 width" in in_folder(tmp_path, shown, ROBO_MESSAGES=names), "its own module comes first"
    ended = "from robo.interfaces import apart\ntry: apart.described('leaves/Gripper')\nexcept Exception as e: print(e)"
    assert in_folder(tmp_path, ended, ROBO_MESSAGES="leaves") == f"module {said[2]}"


def test_what_a_service_of_a_package_holds_is_shown(tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "__init__.py").write_text("")
    halves = [
        f"    @message('arm/Close_{half}')\n    class {half}(Message):\n        at: float = float('nan')\n"
        for half in ("Request", "Response")
    ]
    text = "from robo_messages import Message, message\nclass Close:\n    'Close it.'\n"
    (tmp_path / "arm" / "messages.py").write_text(text + "".join(halves))
    result = subprocess.run(
        [sys.executable, "-m", "robo", "interface", "show", "arm/Close"], cwd=tmp_path, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    assert [line.split() for line in result.stdout.splitlines()] == [
        ["arm/Close_Request"], ["at", "float", "=", "nan"], ["---"],
        ["arm/Close_Response"], ["at", "float", "=", "nan"],
    ]  # fmt: skip


def test_messages_of_a_type_that_cannot_be_imported_here_are_data_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "__init__.py").write_text("raise TypeError('torn')")
    assert in_folder(tmp_path, "print(catalogue.find_here('torn/Type'), catalogue.find_here(''))") == "None None"
    code = "try: catalogue.find('torn/Type')\nexcept Exception as error: print(type(error).__name__, error)"
    told = "ContractError module torn, where torn/… may be, cannot be imported: torn/__init__.py:1: TypeError: torn"
    assert in_folder(tmp_path, code, PYTHONUTF8="1") == told


def test_what_only_looks_like_a_type_is_none(tmp_path: Path) -> None:
    (tmp_path / "talks.py").write_text(f'"""As in `@message("group/Type")`."""\n# @message("group/Other")\n{GRIPPER}')
    (tmp_path / "torn.py").write_text('@message("torn/Type")\nclass (')
    code = "print([name for name in catalogue.known() if name.split('/')[0] in ('group', 'torn', 'my_robot')])"
    assert in_folder(tmp_path, code) == "['my_robot/Gripper', 'torn/Type']"


def test_what_is_no_code_of_the_user_is_passed_over(tmp_path: Path) -> None:
    for folder in (".venv", "build", "tests", "env"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "messages.py").write_text(GRIPPER)
    (tmp_path / "env" / "pyvenv.cfg").write_text("")
    assert in_folder(tmp_path, "print('my_robot/Gripper' in catalogue.known())") == "False"


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("nav/Odometri", "nav/Odometry"),
        ("Twist", "geometry/Twist"),
        ("twist", "geometry/Twist"),
        ("Odometri", "nav/Odometry"),
        ("geometry_msgs/msg/Twist", "geometry/Twist"),
        ("std_srvs/srv/Trigger", "std/Trigger"),
    ],
)
def test_an_unknown_type_is_told(name: str, meant: str) -> None:
    with pytest.raises(UnknownType, match=rf"did you mean {meant}\?"):
        catalogue.find(name)


def test_a_list_shows_whole_sentences() -> None:
    abouts = {one.name: one.description for one in catalogue.listed()}
    assert [about for about in abouts.values() if about and not about.endswith(".")] == []
    assert abouts["sensor/Imu"] == "Orientation, angular velocity and acceleration."
    kinds = {one.name: one.kind for one in catalogue.listed()}
    assert (kinds["sensor/Imu"], kinds["std/Trigger"], kinds["example/Fibonacci"]) == ("message", "service", "action")
    assert not [name for name in kinds if name.endswith(("_Request", "_Response", "_Goal", "_Result", "_Feedback"))]


def test_a_type_is_described_with_units_and_constants() -> None:
    scan = catalogue.describe(LaserScan)
    fields = {field.name: field for field in scan.fields}
    assert fields["angle_min"].description == "Angle of the first ray, rad."
    assert (fields["ranges"].type, fields["ranges"].default) == ("list of float", [])
    assert catalogue.describe(catalogue.find("system/Log")).constants["FATAL"] == 50
    assert catalogue.parts("std/Trigger") == ["std/Trigger_Request", "std/Trigger_Response"]
    assert catalogue.parts("example/Fibonacci") == [
        "example/Fibonacci_Goal", "example/Fibonacci_Result", "example/Fibonacci_Feedback"
    ]  # fmt: skip
    assert catalogue.parts("std/Empty") == ["std/Empty"]


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("geometry/Quaternion", ["# geometry_msgs/Quaternion", "float64 x", "float64 w 1.0"]),
        ("sensor/LaserScan", ["std_msgs/Header header", "float32 angle_min", "float32[] ranges"]),
        ("geometry/PoseWithCovariance", ["geometry_msgs/Pose pose", "float64[36] covariance"]),
        ("std/Header", ["builtin_interfaces/Time stamp", "string frame_id"]),
        ("std/Time", ["int32 sec", "uint32 nanosec"]),
        ("sensor/Image", ["uint32 height", "uint8 is_bigendian", "uint8[] data"]),
        ("nav/OccupancyGrid", ["nav_msgs/MapMetaData info", "int8[] data"]),
        ("diagnostic/DiagnosticStatus", ["byte level", "diagnostic_msgs/KeyValue[] values"]),
        ("sensor/NavSatStatus", ["int8 STATUS_NO_FIX=-1", "int8 status", "uint16 service"]),
        ("system/Clock", ["# rosgraph_msgs/Clock", "builtin_interfaces/Time clock"]),
        ("std/SetBool", ["# std_srvs/SetBool", "bool data", "---", "bool success true", "string message"]),
    ],
)
def test_types_as_ros_writes_them(name: str, lines: list[str]) -> None:
    text = ros_text.ros_text(name).splitlines()
    assert [line for line in lines if line not in text] == []


NUMBERS = {
    "Byte": "byte", "Char": "char", "Float32": "float32", "Float64": "float64", "Int8": "int8", "Int16": "int16",
    "Int32": "int32", "Int64": "int64", "UInt8": "uint8", "UInt16": "uint16", "UInt32": "uint32", "UInt64": "uint64",
}  # fmt: skip
HEADER = "std_msgs/Header header"
HOOKS = ("CONFIGURE", "CLEANUP", "ACTIVATE", "DEACTIVATE", "SHUTDOWN", "ERROR")
SHAPES = {
    **{f"std/{name}": [f"{kind} data"] for name, kind in NUMBERS.items()},
    **{
        f"std/{name}MultiArray": ["std_msgs/MultiArrayLayout layout", f"{kind}[] data"]
        for name, kind in NUMBERS.items()
        if name != "Char"
    },
    "std/Empty": [],
    "std/MultiArrayLayout": ["std_msgs/MultiArrayDimension[] dim", "uint32 data_offset"],
    "std/MultiArrayDimension": ["string label", "uint32 size", "uint32 stride"],
    "std/ColorRGBA": ["float32 r", "float32 g", "float32 b", "float32 a"],
    "geometry/Point32": ["float32 x", "float32 y", "float32 z"],
    "geometry/PointStamped": [HEADER, "geometry_msgs/Point point"],
    "geometry/Polygon": ["geometry_msgs/Point32[] points"],
    "geometry/PolygonStamped": [HEADER, "geometry_msgs/Polygon polygon"],
    "geometry/PoseArray": [HEADER, "geometry_msgs/Pose[] poses"],
    "geometry/PoseWithCovarianceStamped": [HEADER, "geometry_msgs/PoseWithCovariance pose"],
    "geometry/TwistWithCovarianceStamped": [HEADER, "geometry_msgs/TwistWithCovariance twist"],
    "geometry/Vector3Stamped": [HEADER, "geometry_msgs/Vector3 vector"],
    "geometry/QuaternionStamped": [HEADER, "geometry_msgs/Quaternion quaternion"],
    "geometry/Wrench": ["geometry_msgs/Vector3 force", "geometry_msgs/Vector3 torque"],
    "geometry/WrenchStamped": [HEADER, "geometry_msgs/Wrench wrench"],
    "geometry/Accel": ["geometry_msgs/Vector3 linear", "geometry_msgs/Vector3 angular"],
    "geometry/AccelStamped": [HEADER, "geometry_msgs/Accel accel"],
    "action/UUID": ["uint8[16] uuid"],
    "action/GoalInfo": ["unique_identifier_msgs/UUID goal_id", "builtin_interfaces/Time stamp"],
    "action/GoalStatus": [
        "int8 STATUS_UNKNOWN=0", "int8 STATUS_ACCEPTED=1", "int8 STATUS_EXECUTING=2", "int8 STATUS_CANCELING=3",
        "int8 STATUS_SUCCEEDED=4", "int8 STATUS_CANCELED=5", "int8 STATUS_ABORTED=6",
        "action_msgs/GoalInfo goal_info", "int8 status",
    ],
    "action/GoalStatusArray": ["action_msgs/GoalStatus[] status_list"],
    "action/CancelGoal_Request": ["action_msgs/GoalInfo goal_info"],
    "action/CancelGoal_Response": [
        "int8 ERROR_NONE=0", "int8 ERROR_REJECTED=1", "int8 ERROR_UNKNOWN_GOAL_ID=2", "int8 ERROR_GOAL_TERMINATED=3",
        "int8 return_code", "action_msgs/GoalInfo[] goals_canceling",
    ],
    "example/Fibonacci_Goal": ["int32 order"],
    "example/Fibonacci_Result": ["int32[] sequence"],
    "example/Fibonacci_Feedback": ["int32[] sequence"],
    "nav2/WaypointStatus": [
        "uint8 PENDING=0", "uint8 COMPLETED=1", "uint8 SKIPPED=2", "uint8 FAILED=3", "uint8 waypoint_status",
        "uint32 waypoint_index", "geometry_msgs/PoseStamped waypoint_pose", "uint16 error_code", "string error_msg",
    ],
    "nav2/FollowWaypoints_Goal": ["uint32 number_of_loops", "uint32 goal_index", "geometry_msgs/PoseStamped[] poses"],
    "nav2/FollowWaypoints_Result": [
        "uint16 NONE=0", "uint16 UNKNOWN=600", "uint16 TASK_EXECUTOR_FAILED=601", "uint16 NO_VALID_WAYPOINTS=602",
        "uint16 STOP_ON_MISSED_WAYPOINT=603", "nav2_msgs/WaypointStatus[] missed_waypoints", "uint16 error_code",
        "string error_msg",
    ],
    "nav2/FollowWaypoints_Feedback": ["uint32 current_waypoint"],
    "sensor/RegionOfInterest": [
        "uint32 x_offset", "uint32 y_offset", "uint32 height", "uint32 width", "bool do_rectify",
    ],
    "sensor/CameraInfo": [
        HEADER, "uint32 height", "uint32 width", "string distortion_model", "float64[] d", "float64[9] k",
        "float64[9] r", "float64[12] p", "uint32 binning_x", "uint32 binning_y", "sensor_msgs/RegionOfInterest roi",
    ],
    "sensor/TimeReference": [HEADER, "builtin_interfaces/Time time_ref", "string source"],
    "system/ParameterValue": [
        "uint8 type", "bool bool_value", "int64 integer_value", "float64 double_value", "string string_value",
        "byte[] byte_array_value", "bool[] bool_array_value", "int64[] integer_array_value",
        "float64[] double_array_value", "string[] string_array_value",
    ],
    "tf2/TFMessage": ["geometry_msgs/TransformStamped[] transforms"],
    "visualization/UVCoordinate": ["float32 u", "float32 v"],
    "visualization/MeshFile": ["string filename", "uint8[] data"],
    "visualization/MarkerArray": ["visualization_msgs/Marker[] markers"],
    "lifecycle/State": [
        "uint8 PRIMARY_STATE_UNKNOWN=0", "uint8 PRIMARY_STATE_UNCONFIGURED=1", "uint8 PRIMARY_STATE_INACTIVE=2",
        "uint8 PRIMARY_STATE_ACTIVE=3", "uint8 PRIMARY_STATE_FINALIZED=4", "uint8 TRANSITION_STATE_CONFIGURING=10",
        "uint8 TRANSITION_STATE_CLEANINGUP=11", "uint8 TRANSITION_STATE_SHUTTINGDOWN=12",
        "uint8 TRANSITION_STATE_ACTIVATING=13", "uint8 TRANSITION_STATE_DEACTIVATING=14",
        "uint8 TRANSITION_STATE_ERRORPROCESSING=15", "uint8 id", "string label",
    ],
    "lifecycle/Transition": [
        "uint8 TRANSITION_CREATE=0", "uint8 TRANSITION_CONFIGURE=1", "uint8 TRANSITION_CLEANUP=2",
        "uint8 TRANSITION_ACTIVATE=3", "uint8 TRANSITION_DEACTIVATE=4", "uint8 TRANSITION_UNCONFIGURED_SHUTDOWN=5",
        "uint8 TRANSITION_INACTIVE_SHUTDOWN=6", "uint8 TRANSITION_ACTIVE_SHUTDOWN=7", "uint8 TRANSITION_DESTROY=8",
        *(
            f"uint8 TRANSITION_ON_{hook}_{outcome}={10 * tens + ones}"
            for tens, hook in enumerate(HOOKS, start=1)
            for ones, outcome in enumerate(("SUCCESS", "FAILURE", "ERROR"))
        ),
        "uint8 TRANSITION_CALLBACK_SUCCESS=97", "uint8 TRANSITION_CALLBACK_FAILURE=98",
        "uint8 TRANSITION_CALLBACK_ERROR=99", "uint8 id", "string label",
    ],
    "lifecycle/TransitionDescription": [
        "lifecycle_msgs/Transition transition", "lifecycle_msgs/State start_state", "lifecycle_msgs/State goal_state",
    ],
    "lifecycle/TransitionEvent": [
        "uint64 timestamp", "lifecycle_msgs/Transition transition", "lifecycle_msgs/State start_state",
        "lifecycle_msgs/State goal_state",
    ],
    "lifecycle/ChangeState_Request": ["lifecycle_msgs/Transition transition"],
    "lifecycle/ChangeState_Response": ["bool success"],
    "lifecycle/GetState_Request": [],
    "lifecycle/GetState_Response": ["lifecycle_msgs/State current_state"],
    "lifecycle/GetAvailableStates_Request": [],
    "lifecycle/GetAvailableStates_Response": ["lifecycle_msgs/State[] available_states"],
    "lifecycle/GetAvailableTransitions_Request": [],
    "lifecycle/GetAvailableTransitions_Response": ["lifecycle_msgs/TransitionDescription[] available_transitions"],
    "visualization/Marker": [
        "int32 ARROW=0", "int32 CUBE=1", "int32 SPHERE=2", "int32 CYLINDER=3", "int32 LINE_STRIP=4",
        "int32 LINE_LIST=5", "int32 CUBE_LIST=6", "int32 SPHERE_LIST=7", "int32 POINTS=8",
        "int32 TEXT_VIEW_FACING=9", "int32 MESH_RESOURCE=10", "int32 TRIANGLE_LIST=11", "int32 ARROW_STRIP=12",
        "int32 ADD=0", "int32 MODIFY=0", "int32 DELETE=2", "int32 DELETEALL=3",
        HEADER, "string ns", "int32 id", "int32 type", "int32 action", "geometry_msgs/Pose pose",
        "geometry_msgs/Vector3 scale", "std_msgs/ColorRGBA color", "builtin_interfaces/Duration lifetime",
        "bool frame_locked", "geometry_msgs/Point[] points", "std_msgs/ColorRGBA[] colors",
        "string texture_resource", "sensor_msgs/CompressedImage texture",
        "visualization_msgs/UVCoordinate[] uv_coordinates", "string text", "string mesh_resource",
        "visualization_msgs/MeshFile mesh_file", "bool mesh_use_embedded_materials",
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
def test_the_fields_of_these_types_are_all_of_ros_in_its_order(name: str) -> None:
    lines = [line for line in ros_text.ros_text(name).splitlines() if line and not line.startswith("#")]
    assert lines == SHAPES[name]


def test_all_types_that_are_imported_later_are_compared_with_ros() -> None:
    later = {
        name for name in robo_messages.type_names() if robo_messages.find_type(name).__module__ in robo_messages._LATER
    }
    assert {name for name in later if not name.startswith("flight/")} <= set(SHAPES)  # ROS has no flight recorder
