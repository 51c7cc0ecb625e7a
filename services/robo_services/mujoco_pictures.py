"""Pictures of what is in MuJoCo: those of the robot's camera, and a window for people."""

import importlib
import math
import os
import sys
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

from robo.errors import RunError
from robo_messages import CameraInfo, Header
from robo_services import mjcf
from robo_services.mujoco_drawing import VARIABLE
from robo_services.mujoco_physics import MujocoBase
from robo_services.mujoco_robot import PREFIX
from robo_services.mujoco_sensors import ModelError

NOTHING_DRAWS = "there is neither a screen nor EGL nor OSMesa (Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri)"

_SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")

CLOSING = 3.0
"""A window is closed within so many seconds, or left."""


class CannotDraw(RunError):
    """No picture can be made here; says why."""


def has_screen() -> bool:
    """Whether a window could be shown."""
    return sys.platform != "linux" or any(map(os.environ.get, _SCREENS))


class Camera:
    """The robot's camera. Its pictures are made beside the physics, for it has a state of its own.

    One thread makes them all and gives back what draws: a way of drawing belongs to a thread.
    """

    _broken: ClassVar[str] = ""
    """Why drawing has failed in this process. MuJoCo would end the process at a second attempt."""

    def __init__(self, base: MujocoBase, width: int, height: int) -> None:
        """`width` and `height` of a picture in pixels.

        Raises:
            ModelError: the robot has no camera.
        """
        self._mujoco, self._model = base.mujoco, base.model
        self._number = self._mujoco.mj_name2id(self._model, self._mujoco.mjtObj.mjOBJ_CAMERA, PREFIX + mjcf.CAMERA)
        if self._number < 0:
            raise ModelError(f"the robot has no camera {mjcf.CAMERA!r}")
        self._width, self._height = width, height
        self._model.vis.global_.offwidth = max(width, self._model.vis.global_.offwidth)
        self._model.vis.global_.offheight = max(height, self._model.vis.global_.offheight)
        self._data = self._mujoco.MjData(self._model)
        self._renderer: Any = None
        self._thread = ThreadPoolExecutor(1, "camera")

    def info(self, header: Header) -> CameraInfo:
        """How it sees: without distortion, the same along both axes, with its middle in the picture's middle."""
        focal = self._height / 2 / math.tan(math.radians(self._model.cam_fovy[self._number].item()) / 2)
        x, y = self._width / 2, self._height / 2
        return CameraInfo(
            header,
            self._height,
            self._width,
            distortion_model="plumb_bob",
            d=[0.0] * 5,
            k=(focal, 0.0, x, 0.0, focal, y, 0.0, 0.0, 1.0),
            r=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
            p=(focal, 0.0, x, 0.0, 0.0, focal, y, 0.0, 0.0, 0.0, 1.0, 0.0),
        )

    def take(self, positions: Any) -> Any:
        """A picture of where everything is.

        Args:
            positions: MuJoCo's `qpos`.

        Returns:
            Array of height x width x 3 bytes: red, green, blue.

        Raises:
            CannotDraw: says why.
        """
        return self._thread.submit(self._take, positions).result()

    def close(self) -> None:
        """Give back what draws."""
        self._thread.submit(self._close)
        self._thread.shutdown()

    def _take(self, positions: Any) -> Any:
        if Camera._broken:
            raise CannotDraw(Camera._broken)
        if not os.environ.get(VARIABLE) and not has_screen():
            raise CannotDraw(NOTHING_DRAWS)
        self._data.qpos[:] = positions
        self._mujoco.mj_fwdPosition(self._model, self._data)
        try:
            if self._renderer is None:
                self._renderer = self._mujoco.Renderer(self._model, self._height, self._width)
            self._renderer.update_scene(self._data, camera=self._number)
            return self._renderer.render().copy()
        except Exception as error:  # each way of drawing has errors of its own
            way = os.environ.get(VARIABLE) or "the screen"
            Camera._broken = f"{way} does not draw: {' '.join(str(error).split()) or type(error).__name__}"
            raise CannotDraw(Camera._broken) from None

    def _close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()


class Window:
    """MuJoCo's own window: look around with the mouse, push the robot with Ctrl and the mouse."""

    def __init__(self, base: MujocoBase) -> None:
        """Open it.

        Raises:
            CannotDraw: there is no screen.
        """
        if not has_screen():
            raise CannotDraw(NO_SCREEN)
        before = {*threading.enumerate()}
        try:
            _reach_screen()
            viewer = importlib.import_module("mujoco.viewer")
            # Its panels would cover the half of it; Tab shows them.
            self._handle = viewer.launch_passive(base.model, base.data, show_left_ui=False, show_right_ui=False)
            self._follow(base)
        except CannotDraw:
            raise
        except Exception as error:  # the screen may not be one that can be drawn on
            raise CannotDraw(f"MuJoCo's window cannot be opened: {error}") from None
        self._threads = {one for one in threading.enumerate() if one not in before and one.name.endswith(_VIEWER)}

    def _follow(self, base: MujocoBase) -> None:
        """Look at the robot from behind and above, wherever it drives; the mouse turns and shifts that."""
        with self._handle.lock():
            camera = self._handle.cam
            camera.type = int(base.mujoco.mjtCamera.mjCAMERA_TRACKING)
            camera.trackbodyid = base.model.body(PREFIX + mjcf.BASE).id
            camera.distance, camera.azimuth, camera.elevation = FROM

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it."""
        return bool(self._handle.is_running())

    def show(self) -> None:
        """Show how it is now."""
        self._handle.sync()

    def close(self) -> None:
        """Close it, and wait until it is closed: what draws must not be taken away from a window that still does."""
        self._handle.close()
        for thread in self._threads:
            thread.join(CLOSING)


def _reach_screen() -> None:
    """Find out whether a window can be shown at all; from where MuJoCo finds out itself, it ends the process.

    Raises:
        CannotDraw: the screen that is said is not there.
    """
    if sys.platform != "linux":
        return  # nothing says where it is; and macOS wants to be asked by its main thread alone
    glfw = importlib.import_module("glfw")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # which is how it says what `get_error` says too
        if glfw.init():
            return
        _, why = glfw.get_error()
    screen = ", ".join(f"{name}={os.environ[name]}" for name in _SCREENS if os.environ.get(name))
    raise CannotDraw(f"window: the screen {screen} cannot be reached{f': {why.decode()}' if why else ''}")


FROM = (6.0, 30.0, -35.0)
"""From where the window looks at the robot: how far away, m, in which direction, and how far up, degrees."""

_VIEWER = "(_launch_internal)"
"""The name of the thread that draws MuJoCo's window, which is named after what it does."""

NO_SCREEN = "window: there is no screen here (DISPLAY and WAYLAND_DISPLAY are not set); start it on a desktop"
