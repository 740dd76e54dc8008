"""Checks of written files: each is read back and compared with the design before a set is complete."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline

from mirror_cad.errors import FileError, WriteError
from mirror_cad.mirror import Mirror
from mirror_cad.outline.files import read_outline
from mirror_cad.part21 import read_named_surface
from mirror_cad.plate_files import ReadStep
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.build.results import StepCheck
from raytrace.assembly import FRONT_FACE, OPTICAL_FACE

Array = NDArray[np.float64]

# STEP writes coordinates to some 13 digits: 1e-11 mm at 100 mm, and a hundred times that is still below any use.
SAME_MM = 1e-9
# The volume of the plate, by the kernel's own integration before and after: relative.
SAME_VOLUME = 1e-9


def check_step(path: Path, read: ReadStep, mirror: Mirror, volume_mm3: float) -> StepCheck:
    """How far the named faces of the file as read back, and its Part 21 text, are from what was designed, mm.

    volume_mm3 : of the plate that was written. Named are the optical face and, of glass that reflects from its back, the
    front face.
    Raises: WriteError where the file holds no valid single solid, another volume, or another named face.
    """
    if read.volume_mm3 is None or not read.valid:
        raise WriteError(f"{path.name}: reads back as {read.solids} solids, {'valid' if read.valid else 'invalid'}")
    change = abs(read.volume_mm3 / volume_mm3 - 1.0)
    if change > SAME_VOLUME:
        raise WriteError(f"{path.name}: the volume reads back {change:.2g} off (relative)")
    designed = {OPTICAL_FACE: mirror.surface}
    if mirror.spec.glass.reflecting == "back":
        designed[FRONT_FACE] = mirror.front
    u, v = _check_points(mirror)
    off = off_text = 0.0
    for name, surface in designed.items():
        meant = surface.evaluate(u, v)
        off = max(off, float(np.linalg.norm(_named_surface(path, read, name).evaluate(u, v) - meant, axis=1).max()))
        # Without the kernel: degree, knots and poles from the text, evaluated by scipy.
        text = read_named_surface(path, name)
        spline = NdBSpline((text.knots_u, text.knots_v), text.poles, (text.degree_u, text.degree_v))
        off_text = max(off_text, float(np.linalg.norm(spline(np.stack([u, v], axis=1)) - meant, axis=1).max()))
        for what, distance in ((f"the {name}", off), ("the Part 21 text", off_text)):
            if not distance <= SAME_MM:
                raise WriteError(f"{path.name}: {what} is {distance:.2g} mm from the design (at most {SAME_MM:g})")
    check_transition(path, read, mirror)
    return StepCheck(off, off_text, change)


def check_transition(path: Path, read: ReadStep, mirror: Mirror) -> None:
    """Raises: WriteError where the file's transition line is not the design's, on the surface from edge to edge."""
    line = mirror.transition
    if line is None:
        return
    off = np.inf
    for curve in read.curves:
        if np.ptp(curve[:, 0]) <= SAME_MM:
            meant = mirror.surface.evaluate(line.x_mm, np.linspace(line.low_mm, line.high_mm, len(curve)))
            off = min(off, float(np.abs(curve - meant).max()))
    if not off <= SAME_MM:
        raise WriteError(f"{path.name}: the transition line reads back {off:.2g} mm off (at most {SAME_MM:g})")


def check_surface_step(path: Path, read: ReadStep, mirror: Mirror) -> float:
    """How far the untrimmed sheet as read back is from the design over its box, mm. Raises: WriteError where it differs."""
    check_transition(path, read, mirror)
    surface = _named_surface(path, read, OPTICAL_FACE)
    box = mirror.sheet_box()
    if not np.allclose(surface.domain, box, rtol=0, atol=SAME_MM):
        raise WriteError(f"{path.name}: the sheet reads back over {surface.domain}, not {box}")
    u, v = np.meshgrid(np.linspace(*box[:2], 53), np.linspace(*box[2:], 61))
    u, v = np.clip(u, *surface.domain[:2]), np.clip(v, *surface.domain[2:])
    off = float(np.linalg.norm(surface.evaluate(u, v) - mirror.surface.evaluate(u, v), axis=-1).max())
    if not off <= SAME_MM:
        raise WriteError(f"{path.name}: the sheet is {off:.2g} mm from the design (at most {SAME_MM:g})")
    return off


def check_outline(path: Path, mirror: Mirror) -> float:
    """How much the outline's box differs after reading back, mm. Raises: WriteError where it or the area does."""
    outline = read_outline(path)
    area = abs(outline.area_mm2() / mirror.outline.area_mm2() - 1.0)
    box = float(np.abs(np.subtract(outline.bounding_box(), mirror.box)).max())
    if area > 1e-9 or box > SAME_MM:
        raise WriteError(f"{path.name}: reads back with its area {area:.2g} off (relative) and its box {box:.2g} mm off")
    return box


def check_points(path: Path, points: Array) -> int:
    """The number of rows of the table of points. Raises: WriteError where it reads back different; rows hold 1e-9 mm."""
    read = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    if read.shape != points.shape or not np.allclose(read, points, rtol=0, atol=SAME_MM):
        raise WriteError(f"{path.name}: reads back as {read.shape} numbers that differ from those written")
    return len(read)


def _named_surface(path: Path, read: ReadStep, name: str) -> BSplineSurface:
    try:
        return read.named(name).surface
    except FileError as error:
        raise WriteError(f"{path.name}: reads back different from what was written: {error}") from None


def _check_points(mirror: Mirror) -> tuple[Array, Array]:
    """Points off the nodes all over the surface, its corners among them."""
    u_min, u_max, v_min, v_max = mirror.surface.domain
    u, v = np.meshgrid(np.linspace(u_min, u_max, 67), np.linspace(v_min, v_max, 71))
    return u.ravel(), v.ravel()
