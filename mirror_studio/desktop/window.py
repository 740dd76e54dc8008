"""Show a mirror, its curvature and the ray fan in a window, or draw a picture of that window."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray

from mirror_cad.errors import WriteError
from mirror_studio.desktop.paraview import mirror_mesh, ray_lines
from mirror_studio.desktop.sheet import UNITS
from mirror_studio.desktop.subject import Fan, Subject

SIZE = 1500, 900  # px
LIFT_MM = 0.5  # of lines drawn on the mirror, towards the driver: within the surface they would come and go
INK, DARK, ORANGE, GLASS = "#222222", "#1f3f66", "#d55e00", "#7aa6d8"
RAY_PX = 2.0
SIGNED = ("deviation_k1", "deviation_k2")  # drawn about zero
TAIL = 0.002  # of the values at either end of a field that do not set its colours
STEPS = 5  # of the colour bar, at the least; a white line on the mirror at each
ROUNDING = 1e-9  # of a step
NEAR_MM = 450.0  # of each reflected ray, beside the mirror


def open_window(subject: Subject, picture: Path | None = None) -> None:
    """Show the mirror in the colours of a field, which F1 to F9 choose, the rays near it, and the fan to the plane.

    picture : draw once into this file instead of waiting for the window to be closed; needs no display.
    Raises: WriteError. See `check_display` first.
    """
    plotter: Any = pyvista.Plotter(shape="1|2", off_screen=picture is not None, window_size=list(SIZE), border=False,
                                   splitting_position=0.56, title=f"mirror-cad view {subject.name}")
    plotter.enable_anti_aliasing("ssaa" if picture is not None else "msaa")  # the first is slow to turn, and smooth
    mesh = mirror_mesh(subject.sheet)
    names = list(subject.sheet.fields)
    plotter.subplot(0)
    plotter.set_background("white")
    choice = _Choice(plotter, mesh, names, subject.name, keys=picture is None)
    choice.show(names[0])
    for number, name in enumerate(names, start=1):  # by function keys: VTK has uses of its own for digits
        plotter.add_key_event(f"F{number}", lambda name=name: choice.show(name))
    plotter.view_xy()
    plotter.camera.zoom(1.1)
    plotter.add_axes(color=INK, line_width=2)
    for place, draw in ((1, _draw_near), (2, _draw_far)):
        plotter.subplot(place)
        plotter.set_background("white")
        draw(plotter, subject.fan, mesh)
    if picture is None:
        plotter.show()
        return
    try:
        plotter.screenshot(str(picture))
    except (OSError, ValueError) as error:
        raise WriteError(f"{picture}: cannot be written: {error}") from None
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


def round_step(low: float, high: float) -> float:
    """1, 2 or 5 times a power of ten: the largest that goes STEPS times or more into what lies between low and high."""
    rough = (high - low) / STEPS
    power = 10.0 ** math.floor(math.log10(rough))
    return power * max(m for m in (1.0, 2.0, 5.0) if m * power <= rough * (1.0 + 1e-12))  # of rounding


class _Choice:
    """The mirror on the left, drawn again in the colours of another field."""

    def __init__(self, plotter: Any, mesh: Any, names: list[str], title: str, keys: bool) -> None:
        self._plotter, self._mesh, self._title, self._bar = plotter, mesh, title, ""
        shown = [f"F{number} {name}" for number, name in enumerate(names, start=1)] if keys else []
        self._keys = "\n".join("   ".join(shown[start: start + 6]) for start in range(0, len(shown), 6))
        self._rim = mesh.extract_feature_edges(boundary_edges=True, feature_edges=False, manifold_edges=False,
                                               non_manifold_edges=False).translate((0.0, 0.0, LIFT_MM))

    def show(self, name: str) -> None:
        plotter, signed = self._plotter, name in SIGNED
        plotter.subplot(0)
        if self._bar:
            plotter.remove_scalar_bar(self._bar)
        self._bar = f"{name}, {UNITS[name]}"
        low, high = colour_range(self._mesh.point_data[name], signed)
        step = round_step(low, high)
        levels = step * np.arange(math.floor(low / step + ROUNDING), math.ceil(high / step - ROUNDING) + 1)
        # Without lights: a shade would read as a value.
        plotter.add_mesh(self._mesh, scalars=name, cmap="RdBu_r" if signed else "viridis", name="mirror", lighting=False,
                         clim=(levels[0], levels[-1]), nan_color="lightgray", reset_camera=False,
                         scalar_bar_args={"title": self._bar, "color": INK, "fmt": "%.6g", "vertical": True, "height": 0.6,
                                          "width": 0.07, "position_x": 0.86, "position_y": 0.2, "title_font_size": 18,
                                          "label_font_size": 15, "n_labels": len(levels)})
        lines = self._mesh.contour(levels[1:-1], scalars=name)
        plotter.remove_actor("levels")
        if lines.n_points:
            plotter.add_mesh(lines.translate((0.0, 0.0, LIFT_MM)), color="white", line_width=1.5, name="levels", lighting=False,
                             reset_camera=False)
        plotter.add_mesh(self._rim, color=INK, line_width=2.0, name="rim", lighting=False, reset_camera=False)
        _title(plotter, f"{self._title}: {self._bar}", self._keys)
        plotter.render()


def _draw_near(plotter: Any, fan: Fan, mesh: Any) -> None:
    """The eye, the mirror, and the rays from one over the other, as far as NEAR_MM."""
    _draw_mirror(plotter, fan, mesh, 9.0)
    if len(fan.points):
        going = fan.ends - fan.points
        ends = fan.points + NEAR_MM * going / np.linalg.norm(going, axis=1, keepdims=True)
        plotter.add_lines(np.stack([fan.points, ends], axis=1).reshape(-1, 3), color=ORANGE, width=RAY_PX)
    _title(plotter, "rays from the eye (dark), reflected (orange)")
    plotter.view_vector((0.55, 0.5, 0.75), (0.0, 1.0, 0.0))
    plotter.reset_camera()
    plotter.camera.zoom(1.15)


def _draw_far(plotter: Any, fan: Fan, mesh: Any) -> None:
    """The same to the plane, on which each ray leaves a point."""
    _draw_mirror(plotter, fan, mesh, 0.008 * fan.plane_z_mm)
    if len(fan.points):
        plotter.add_mesh(ray_lines(fan), color=ORANGE, line_width=RAY_PX, lighting=False)
        low, high = fan.ends[:, :2].min(axis=0), fan.ends[:, :2].max(axis=0)
        across, up = 1.1 * (high - low)
        plane = pyvista.Plane(center=(*(0.5 * (low + high)), fan.plane_z_mm), direction=(0, 0, 1), i_size=across, j_size=up,
                              i_resolution=8, j_resolution=8)
        plotter.add_mesh(plane, color="#e9edf1", opacity=0.6, lighting=False, show_edges=True, edge_color="#9aa5ae")
        plotter.add_points(fan.ends, color=INK, point_size=6.0, render_points_as_spheres=True)
    _title(plotter, f"{len(fan.points)} rays to the plane z = {1e-3 * fan.plane_z_mm:.2f} m")
    plotter.view_vector((0.8, 0.35, -0.6), (0.0, 1.0, 0.0))
    plotter.reset_camera()
    plotter.camera.zoom(1.2)


def _draw_mirror(plotter: Any, fan: Fan, mesh: Any, eye_mm: float) -> None:
    plotter.add_mesh(mesh, color=GLASS, smooth_shading=True, specular=0.4, ambient=0.3)
    if len(fan.points):
        starts = np.broadcast_to(fan.eye, fan.points.shape)
        plotter.add_lines(np.stack([starts, fan.points], axis=1).reshape(-1, 3), color=DARK, width=RAY_PX)
    plotter.add_mesh(pyvista.Sphere(radius=eye_mm, center=fan.eye), color=DARK)
    plotter.add_axes(color=INK, line_width=2)


def _title(plotter: Any, words: str, below: str = "") -> None:
    plotter.add_text(words, position=(0.02, 0.94), viewport=True, font_size=11, color=INK, font="arial", name="title")
    if below:
        plotter.add_text(below, position=(0.02, 0.89), viewport=True, font_size=8, color=INK, font="arial", name="keys")
