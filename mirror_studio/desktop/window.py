"""A subject in, a window with the mirror, its curvature and the ray fan out, or a picture of that window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray

from mirror_cad.errors import WriteError
from mirror_studio.desktop.paraview import mirror_mesh, ray_lines
from mirror_studio.desktop.sheet import UNITS
from mirror_studio.desktop.subject import Subject

SIZE = 1400, 860  # px
INK = "#222222"
SIGNED = ("deviation_k1", "deviation_k2")  # drawn about zero
TAIL = 0.002  # of the values at either end of a field that do not set its colours


def open_window(subject: Subject, screenshot: Path | None = None) -> None:
    """Left the mirror in the colours of a field, which F1 to F9 choose; right the fan from the eye to the plane.

    screenshot : draw once into this file instead of waiting for the window to be closed. Raises: WriteError.
    Needs a display: see `check_display`.
    """
    plotter: Any = pyvista.Plotter(shape=(1, 2), off_screen=screenshot is not None, window_size=list(SIZE), border=False,
                                   title=f"mirror-cad view {subject.name}")
    plotter.set_background("white")
    mesh = mirror_mesh(subject.sheet)
    names = list(subject.sheet.fields)
    plotter.subplot(0, 0)
    choice = _Choice(plotter, mesh, names)
    choice.show(names[0])
    for number, name in enumerate(names, start=1):  # by function keys: VTK has uses of its own for digits
        plotter.add_key_event(f"F{number}", lambda name=name: choice.show(name))
    keys = [f"F{number} {name}" for number, name in enumerate(names, start=1)]
    _title(plotter, f"{subject.name}\n{'   '.join(keys[:6])}\n{'   '.join(keys[6:])}")
    _look(plotter, "front")
    plotter.subplot(0, 1)
    _draw_fan(plotter, subject, mesh)
    if screenshot is None:
        plotter.show()
        return
    try:
        plotter.screenshot(str(screenshot))
    except (OSError, ValueError) as error:
        raise WriteError(f"--screenshot {screenshot}: cannot be written: {error}") from None
    finally:
        plotter.close()


def colour_range(values: NDArray[np.float64], signed: bool) -> tuple[float, float]:
    """What the colours span: the values but for TAIL at either end, about zero where they are signed, never nothing."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return -1.0, 1.0
    low, high = (float(value) for value in np.quantile(finite, [TAIL, 1.0 - TAIL]))
    if signed:
        low, high = -max(abs(low), abs(high)), max(abs(low), abs(high))
    least = 1e-6 * max(abs(low), abs(high), 1e-9)
    return (low, high) if high - low > least else (low - 0.5 * least, high + 0.5 * least)


class _Choice:
    """The mirror on the left, drawn again in the colours of another field."""

    def __init__(self, plotter: Any, mesh: Any, names: list[str]) -> None:
        self._plotter, self._mesh, self._names, self._bar = plotter, mesh, names, ""

    def show(self, name: str) -> None:
        plotter, signed = self._plotter, name in SIGNED
        plotter.subplot(0, 0)
        if self._bar:
            plotter.remove_scalar_bar(self._bar)
        self._bar = f"{name}, {UNITS[name]}"
        # Without lights: a shade would read as a value.
        plotter.add_mesh(self._mesh, scalars=name, cmap="RdBu_r" if signed else "viridis", name="mirror", lighting=False,
                         clim=colour_range(self._mesh.point_data[name], signed), nan_color="lightgray",
                         scalar_bar_args={"title": self._bar, "color": INK, "fmt": "%.4g", "vertical": True, "height": 0.6,
                                          "position_x": 0.86, "position_y": 0.2, "title_font_size": 15, "label_font_size": 13},
                         reset_camera=False)
        plotter.render()


def _draw_fan(plotter: Any, subject: Subject, mesh: Any) -> None:
    fan = subject.fan
    plotter.add_mesh(mesh, color="#7aa6d8", smooth_shading=True)
    if len(fan.points):
        plotter.add_mesh(ray_lines(fan), color="#d55e00", line_width=1.0)
        starts = np.broadcast_to(fan.eye, fan.points.shape)
        plotter.add_lines(np.stack([starts, fan.points], axis=1).reshape(-1, 3), color="#1f3f66", width=1.0)
        low, high = fan.ends[:, :2].min(axis=0), fan.ends[:, :2].max(axis=0)
        plane = pyvista.Plane(center=(*(0.5 * (low + high)), fan.plane_z_mm), direction=(0, 0, 1), i_size=1.1 * (high - low)[0],
                              j_size=1.1 * (high - low)[1], i_resolution=1, j_resolution=1)
        plotter.add_mesh(plane, color="#d9dee3", opacity=0.5, show_edges=True, edge_color="#8a949c")
    plotter.add_mesh(pyvista.Sphere(radius=0.006 * fan.plane_z_mm, center=fan.eye), color="#1f3f66")
    _title(plotter, f"{len(fan.points)} rays from the eye (dark)\nover the mirror to the plane z = {fan.plane_z_mm:.0f} mm")
    _look(plotter, "side")


def _title(plotter: Any, words: str) -> None:
    plotter.add_text(words, position=(0.02, 0.9), viewport=True, font_size=9, color=INK, font="arial")


def _look(plotter: Any, way: str) -> None:
    """As the driver looks at the mirror, y up; or on the whole fan from above and beside."""
    if way == "front":
        plotter.view_xy()
        plotter.camera.zoom(1.05)
    else:
        plotter.view_vector((1.0, 0.4, -0.35), (0.0, 1.0, 0.0))
        plotter.reset_camera()
    plotter.add_axes(color=INK, line_width=2)
