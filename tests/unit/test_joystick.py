"""What game pads say, and what becomes of it."""

import math
import struct
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo.errors import RunError
from robo_messages import Joy, Twist, Vector3
from robo_services import joystick_device
from robo_services.joy_driving import DeadMan, Mapping, Mode, Scales, missing, mode_of, twist_of
from robo_services.joystick import AXIS_END, AxisRange, Event, JsDecoder, Pad, button_numbers, without_deadzone
from robo_services.joystick_device import DeviceGone, EvdevDevice, JsDevice, open_device

few = settings(max_examples=200, derandomize=True)

BUTTON, AXIS, INIT = 0x01, 0x02, 0x80


def js(kind: int, number: int, value: int) -> bytes:
    return struct.pack("=IhBB", 1234, value, kind, number)


# -- the joystick API ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "event"),
    [
        (js(BUTTON, 3, 1), Event(True, 3, 1.0)),
        (js(BUTTON | INIT, 255, 0), Event(True, 255, 0.0)),
        (js(AXIS, 1, -AXIS_END), Event(False, 1, 1.0)),
        (js(AXIS, 1, AXIS_END), Event(False, 1, -1.0)),
        (js(AXIS, 1, -32768), Event(False, 1, 1.0)),
        (js(AXIS | INIT, 0, 0), Event(False, 0, 0.0)),
    ],
)
def test_events_of_the_joystick_api(data: bytes, event: Event) -> None:
    assert JsDecoder().feed(data) == [event]
    assert math.copysign(1.0, event.value) == 1.0 or event.value < 0.0, "no -0"


def test_an_event_of_an_unknown_kind_is_left_out() -> None:
    assert JsDecoder().feed(js(0x04, 0, 1) + js(0x03, 0, 1) + js(BUTTON, 0, 1)) == [Event(True, 0, 1.0)]


@few
@given(st.binary(max_size=100), st.integers(0, 100))
def test_it_does_not_matter_how_events_are_cut(data: bytes, cut: int) -> None:
    decoder = JsDecoder()
    events = decoder.feed(data[:cut]) + decoder.feed(data[cut:])
    assert events == JsDecoder().feed(data)
    assert all(-1.0 <= event.value <= 1.0 for event in events)


# -- a pad -----------------------------------------------------------------------------------------


@few
@given(st.floats(-1, 1), st.floats(0, 0.9))
def test_an_axis_grows_from_its_dead_zone_without_a_step(value: float, deadzone: float) -> None:
    found = without_deadzone(value, deadzone)
    assert -1.0 <= found <= 1.0
    assert found == 0.0 or math.copysign(1.0, found) == math.copysign(1.0, value)
    assert (abs(value) <= deadzone) == (found == 0.0)
    assert abs(without_deadzone(min(value + 1e-6, 1.0), deadzone) - found) < 1.1e-5
    assert without_deadzone(math.copysign(1.0, value), deadzone) == math.copysign(1.0, value)


def test_a_pad_is_as_large_as_it_says_and_grows() -> None:
    pad = Pad(2, 1)
    assert (pad.axes(0.0), pad.buttons) == ([0.0, 0.0], [0])
    assert not pad.take(Event(False, 3, 0.5))
    assert pad.take(Event(True, 2, 1.0))
    assert not pad.take(Event(True, 2, 1.0)), "nothing has changed"
    assert (pad.axes(0.0), pad.buttons) == ([0.0, 0.0, 0.0, 0.5], [0, 0, 1])


def test_sticky_buttons_change_when_they_are_pressed() -> None:
    pad = Pad(0, 1, sticky=True)
    said = []
    for value in (1.0, 1.0, 0.0, 1.0, 0.0):
        pad.take(Event(True, 0, value))
        said.append(pad.buttons[0])
    assert said == [1, 1, 1, 0, 0]


# -- evdev -----------------------------------------------------------------------------------------


def test_axes_of_evdev_go_from_end_to_end() -> None:
    assert [AxisRange(0, 255).normalized(value) for value in (0, 255, 300, -9)] == [1.0, -1.0, -1.0, 1.0]
    assert AxisRange(-100, 100).normalized(0) == 0.0
    assert AxisRange(5, 5).normalized(5) == 0.0


def test_buttons_of_evdev_have_the_numbers_of_the_joystick_api() -> None:
    assert button_numbers([0x130, 0x120, 0x100, 0x131, 30]) == {0x120: 0, 0x130: 1, 0x131: 2, 0x100: 3}


class PlayedDevice:
    """Says what python-evdev's InputDevice says of a pad, and what it is told to."""

    fd = -1
    name = "A pad"

    def __init__(self, path: str) -> None:
        if path == "/nowhere":
            raise FileNotFoundError(2, "No such file or directory")
        self.said: list[SimpleNamespace] = []
        self.at = {0: 128, 1: 0}
        self.down = [0x131]
        self.is_gone = False

    def capabilities(self, absinfo: bool) -> dict[int, list[object]]:
        assert absinfo
        return {1: [30, 0x130, 0x131], 3: [(0, self.absinfo(0)), (1, self.absinfo(1)), (0x50, self.absinfo(0))]}

    def absinfo(self, code: int) -> SimpleNamespace:
        return SimpleNamespace(value=self.at[code], min=0, max=256)

    def active_keys(self) -> list[int]:
        return self.down

    def read(self) -> list[SimpleNamespace]:
        if self.is_gone:
            raise OSError(19, "No such device")
        if not self.said:
            raise BlockingIOError
        said, self.said = self.said, []
        return said

    def close(self) -> None:
        pass


@pytest.fixture
def evdev(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("evdev")
    module.InputDevice = PlayedDevice  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "evdev", module)


@pytest.mark.usefixtures("evdev")
def test_a_pad_of_evdev() -> None:
    device = EvdevDevice(Path("/dev/input/event7"))
    assert (device.name, device.axes, device.buttons, device.is_pad) == ("A pad", 2, 2, True)
    first = [Event(True, 0, 0.0), Event(True, 1, 1.0), Event(False, 0, 0.0), Event(False, 1, 1.0)]
    assert device.read() == first
    assert device.read() == []
    played = device._device
    played.said = [SimpleNamespace(type=1, code=0x131, value=0), SimpleNamespace(type=1, code=30, value=1),
                   SimpleNamespace(type=3, code=0, value=256), SimpleNamespace(type=0, code=0, value=0)]  # fmt: skip
    assert device.read() == [Event(True, 1, 0.0), Event(False, 0, -1.0)]
    played.said, played.down = [SimpleNamespace(type=0, code=3, value=0)], []
    assert Event(True, 1, 0.0) in device.read(), "what was dropped is looked up"
    played.is_gone = True
    with pytest.raises(DeviceGone, match="No such device"):
        device.read()
    with pytest.raises(DeviceGone, match="No such file"):
        EvdevDevice(Path("/nowhere"))


def test_a_missing_evdev_is_an_error_that_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(RunError, match=r"pip install 'robo-zenoh\[joy\]'"):
        EvdevDevice(Path("/dev/input/event7"))


# -- devices ---------------------------------------------------------------------------------------


def test_a_pad_that_is_not_there_says_which_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joystick_device, "INPUTS", tmp_path)
    with pytest.raises(DeviceGone, match="there is no pad number 0; there is none"):
        open_device("js", "", 0, "")
    for name in ("js10", "js2", "jsx", "event0"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(DeviceGone, match=rf"no pad called 'x'; there is {tmp_path}/js2, {tmp_path}/js10$"):
        open_device("js", "", 0, "x")
    with pytest.raises(DeviceGone, match="No such file"):
        open_device("js", str(tmp_path / "absent"), 0, "")
    device = open_device("js", "", 1, "")
    assert isinstance(device, JsDevice)
    with pytest.raises(DeviceGone, match="says nothing any more"):
        device.read()
    device.close()


# -- what drives -----------------------------------------------------------------------------------

MAPPING = Mapping(
    enable_button=4, enable_turbo_button=5, axis_x=1, axis_y=-1, axis_yaw=0,
    normal=Scales(0.5, 0.0, 1.0), turbo=Scales(1.0, 0.0, 1.5),
)  # fmt: skip


def joy(*pressed: int, x: float = 0.0, yaw: float = 0.0) -> Joy:
    return Joy(axes=[yaw, x], buttons=[int(number in pressed) for number in range(6)])


@pytest.mark.parametrize(
    ("said", "mode"), [(joy(), "off"), (joy(4), "normal"), (joy(5), "turbo"), (joy(4, 5), "turbo"), (joy(0), "off")]
)
def test_a_button_lets_it_drive(said: Joy, mode: Mode) -> None:
    assert mode_of(said, MAPPING) == mode


def test_a_button_that_is_not_needed() -> None:
    free = Mapping(require_enable_button=False, enable_button=-1, enable_turbo_button=5, axis_x=1, axis_y=-1,
                   axis_yaw=0, normal=MAPPING.normal, turbo=MAPPING.turbo)  # fmt: skip
    assert [mode_of(one, free) for one in (joy(), joy(5))] == ["normal", "turbo"]


def test_axes_are_scaled() -> None:
    said = joy(x=0.5, yaw=-1.0)
    assert twist_of(said, MAPPING, "normal") == Twist(Vector3(x=0.25), Vector3(z=-1.0))
    assert twist_of(said, MAPPING, "turbo") == Twist(Vector3(x=0.5), Vector3(z=-1.5))
    assert twist_of(said, MAPPING, "off") == Twist()
    assert twist_of(joy(x=9.0), MAPPING, "normal") == Twist(Vector3(x=0.5)), "no more than the axis has"


def test_backward_it_may_turn_the_other_way() -> None:
    from msgspec.structs import replace

    mapping = replace(MAPPING, inverted_reverse=True)
    assert [twist_of(joy(x=x, yaw=0.5), mapping, "normal").angular.z for x in (1.0, 0.0, -1.0)] == [0.5, 0.5, -0.5]


def test_what_a_pad_lacks_is_named() -> None:
    assert missing(joy(), MAPPING) == []
    assert missing(Joy(axes=[0.0], buttons=[0, 0, 0, 0, 0]), MAPPING) == [
        "enable_turbo_button is 5, and it has 5 buttons",
        "axis_linear.x is 1, and it has 1 axes",
    ]
    assert mode_of(Joy(buttons=[1]), MAPPING) == "off"


numbers = st.floats(width=32) | st.floats(-1, 1, width=32)


@few
@given(st.lists(numbers, max_size=4), st.lists(st.integers(-(2**31), 2**31 - 1), max_size=8))
def test_whatever_a_pad_says_it_drives_no_faster_than_at_the_end_of_an_axis(
    axes: list[float], buttons: list[int]
) -> None:
    said = Joy(axes=axes, buttons=buttons)
    mode = mode_of(said, MAPPING)
    try:
        twist = twist_of(said, MAPPING, mode)
    except ValueError:
        assert not all(map(math.isfinite, axes[:2]))
        return
    scales = MAPPING.turbo if mode == "turbo" else MAPPING.normal
    assert abs(twist.linear.x) <= scales.x
    assert abs(twist.angular.z) <= scales.yaw
    assert mode != "off" or twist == Twist()


modes: st.SearchStrategy[Mode] = st.sampled_from(["off", "normal", "turbo"])


@few
@given(st.lists(modes | st.just("lost"), max_size=20))
def test_a_button_counts_once_it_was_let_go(story: list[Mode | str]) -> None:
    dead_man, was_let_go = DeadMan(), False
    for said in story:
        if said == "lost":
            dead_man.lose()
            was_let_go = False
        elif said in ("off", "normal", "turbo"):
            mode: Mode = said  # type: ignore[assignment]
            was_let_go = was_let_go or mode == "off"
            assert dead_man.hear(mode, needs_button=True) == (mode != "off" and was_let_go)
