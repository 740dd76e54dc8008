"""Nothing in, whether a window can be opened here out: asked in a child, since VTK ends the process where it cannot."""

from __future__ import annotations

import os
import subprocess
import sys

from mirror_cad.errors import SpecError

SECONDS = 60.0  # a display across a network that has not answered by then is none to work on
WITHOUT = "`--vtp DIR` writes the same for ParaView without a display"
# Opens what the window will need and draws in it. VTK without a display aborts, and with it its process: this one.
TRIAL = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Sphere())
plotter.show(auto_close=True)
"""


def check_display() -> None:
    """Raise SpecError where no window can be opened: DISPLAY is not set, or nothing answers there, or it cannot draw."""
    name = os.environ.get("DISPLAY")
    if not name:
        raise SpecError(f"there is no display here (DISPLAY is not set), so no window can be opened; {WITHOUT}")
    try:
        tried = subprocess.run([sys.executable, "-c", TRIAL], capture_output=True, text=True, errors="replace", timeout=SECONDS)
    except subprocess.TimeoutExpired:
        raise SpecError(f"the display {name} does not answer within {SECONDS:g} s; {WITHOUT}") from None
    if tried.returncode != 0:
        raise SpecError(f"no window can be opened on the display {name} (DISPLAY): it cannot be reached, or draws no OpenGL; "
                        f"{WITHOUT}")
