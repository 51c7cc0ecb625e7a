"""With what MuJoCo makes pictures. It decides that when it is imported, so `choose_drawing` goes before."""

import ctypes.util
import os
import sys

VARIABLE = "MUJOCO_GL"
"""What a user says of it in the environment."""


def choose_drawing() -> None:
    """Let MuJoCo draw without a screen, whether or not there is one: a camera's picture needs none.

    EGL draws, or OSMesa, where Linux has either of them; what the user says holds.
    """
    if sys.platform != "linux" or os.environ.get(VARIABLE):
        return
    for library, way in (("EGL", "egl"), ("OSMesa", "osmesa")):
        if ctypes.util.find_library(library):
            os.environ[VARIABLE] = way
            return
