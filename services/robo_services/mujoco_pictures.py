"""Pictures of what is in MuJoCo: those of the robot's camera, and a window for people.

A screen is not needed for the camera: EGL draws without one, or OSMesa, where Linux has either of them. MuJoCo decides
between them when it is imported; so `choose_drawing` goes before.
"""

import ctypes.util
import importlib
import os
import sys
import threading
from typing import Any

from robo.errors import RunError
from robo_services import mjcf
from robo_services.mujoco_physics import PREFIX, MujocoBase
from robo_services.mujoco_sensors import ModelError

NOTHING_DRAWS = "there is neither a screen nor EGL nor OSMesa (Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri)"

CLOSING = 3.0
"""A window is closed within so many seconds, or left."""


class CannotDraw(RunError):
    """No picture can be made here; says why."""


def has_screen() -> bool:
    """Whether a window could be shown."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def choose_drawing() -> None:
    """Let MuJoCo draw without a screen where there is none; what `MUJOCO_GL` says holds."""
    if "MUJOCO_GL" in os.environ or has_screen():
        return
    for library, way in (("EGL", "egl"), ("OSMesa", "osmesa")):
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = way
            return


class Camera:
    """The robot's camera. All pictures are made by one thread, and beside the physics: it has a state of its own."""

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

    def take(self, positions: Any) -> Any:
        """A picture of where everything is.

        Args:
            positions: MuJoCo's `qpos`.

        Returns:
            Array of height x width x 3 bytes: red, green, blue.

        Raises:
            CannotDraw: says why.
        """
        if self._renderer is None:
            self._renderer = self._new_renderer()
        self._data.qpos[:] = positions
        self._mujoco.mj_fwdPosition(self._model, self._data)
        self._renderer.update_scene(self._data, camera=self._number)
        return self._renderer.render().copy()

    def close(self) -> None:
        """Give back what draws; by the thread that makes the pictures."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _new_renderer(self) -> Any:
        if "MUJOCO_GL" not in os.environ and not has_screen():
            raise CannotDraw(NOTHING_DRAWS)
        try:
            return self._mujoco.Renderer(self._model, self._height, self._width)
        except Exception as error:  # each way of drawing has errors of its own
            way = os.environ.get("MUJOCO_GL", "the screen")
            raise CannotDraw(f"{way} does not draw: {' '.join(str(error).split()) or type(error).__name__}") from None


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
            viewer = importlib.import_module("mujoco.viewer")
            self._handle = viewer.launch_passive(base.model, base.data)
        except Exception as error:  # the screen may not be one that can be drawn on
            raise CannotDraw(f"MuJoCo's window cannot be opened: {error}") from None
        self._threads = {*threading.enumerate()} - before

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


NO_SCREEN = "window: there is no screen here (DISPLAY and WAYLAND_DISPLAY are not set); start it on a desktop"
