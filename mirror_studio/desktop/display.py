"""Whether VTK can draw here, and on a screen; and where a picture may be written."""

from __future__ import annotations

import ctypes.util
import os
import sys
from pathlib import Path

from mirror_cad.errors import SpecError

# VTK takes the first of the system's windows (X on Linux), EGL and OSMesa that it can reach; OSMesa even where it is not there.
INTO_MEMORY = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")


def check_display(on_screen: bool) -> None:
    """Make sure that VTK can draw a picture here, or open a window.

    Raises
    ------
    SpecError
        Where it cannot, with what can be done.
    """
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 (has the kinds of window that the next one chooses from)
    from vtkmodules.vtkCommonCore import vtkLogger
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # it warns of each display that it tries
    kind = vtkRenderWindow().GetClassName()
    if kind == "vtkOSOpenGLRenderWindow" and ctypes.util.find_library("OSMesa") is None:  # it would end the process
        raise SpecError("nothing can be drawn here: there is no display that draws OpenGL, and neither EGL nor OSMesa to draw "
                        "without one; on Debian or Ubuntu:  apt-get install libegl1.  `--vtp DIR` writes the same for ParaView")
    if on_screen and kind in INTO_MEMORY:
        name = os.environ.get("DISPLAY")
        why = (f"the display {name} (DISPLAY) cannot be reached, or draws no OpenGL" if name and sys.platform == "linux"
               else "there is no display here (DISPLAY is not set)")
        raise SpecError(f"no window can be opened: {why}; `--png` draws a picture without one, and `--vtp DIR` writes the same "
                        f"for ParaView")


def check_picture(path: Path) -> None:
    """Make sure that a picture can be written there.

    Raises
    ------
    SpecError
        For another ending than .png, or a folder that is not there.
    """
    if path.suffix.lower() != ".png":
        raise SpecError(f"--png {path}: the file must end in .png")
    if not path.parent.is_dir():
        raise SpecError(f"--png {path}: there is no folder {path.parent}")
