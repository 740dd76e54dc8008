"""What a made mirror is compared with: a specification's design, or the face of a STEP file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.cad_file import read_cad
from mirror_cad.design_stages import design
from mirror_cad.errors import SpecError
from mirror_cad.made.motion import Motion
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.spline_fit import DEGREE, Observations, Space, fit_spline
from mirror_cad.mirror import Mirror
from mirror_cad.outline import Outline
from mirror_cad.outline.segments import Line
from mirror_cad.own_files import hand_of
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import graph
from raytrace.assembly import OPTICAL_FACE
from raytrace.file_kinds import CAD_KINDS
from raytrace.load import load_reflector
from raytrace.mesh_files import MESH_KINDS
from raytrace.placement import Placement
from raytrace.reflector import Reflector

Array = NDArray[np.float64]

FILES = (*CAD_KINDS, ".stl", *MESH_KINDS)
CORNER_MM = 0.01  # of an outline from a file: vertices that lie straighter are left out
SAMPLES_A_SPAN = 3
EXACT_MM = 1e-6  # of a face that is turned into heights over (x, y)
SPANS = (8, 12, 16, 24, 32, 40)


@dataclass(frozen=True, eq=False)
class Reference:
    """The design that a made mirror is compared with.

    Attributes
    ----------
    name : str
        What it is called.
    nominal : Nominal
        Its surface and outline, in mirror coordinates, of the part as it is made.
    given : Motion
        From the coordinates of its file to these.
    spec : MirrorSpec or None
        What it was designed from.
    mirror : Mirror or None
        The design.
    """

    name: str
    nominal: Nominal
    given: Motion
    spec: MirrorSpec | None = None
    mirror: Mirror | None = None

    @property
    def limit_percent(self) -> float | None:
        """What k1 and k2 may deviate by."""
        return None if self.spec is None else self.spec.limits.curvature_percent


def load_reference(name_or_path: str) -> Reference:
    """Read the design.

    Parameters
    ----------
    name_or_path : str
        A preset, a specification, or a CAD file with a face named "optical face", or one face.

    Raises
    ------
    MirrorError
        That says what is wrong with it.
    """
    path = Path(name_or_path)
    if path.suffix.lower() in FILES:
        return _of_file(path)
    spec = load_spec(name_or_path)
    mirror = design(spec)
    made = mirror.as_made
    return Reference(spec.name, Nominal(made.surface, made.outline), Motion.identity(), spec, mirror)


def _of_file(path: Path) -> Reference:
    if path.suffix.lower() not in CAD_KINDS:
        raise SpecError(f"--against {path}: a mesh is no design to measure against: give a specification, a preset or a STEP "
                        "file")
    reflector = load_reflector(path, place="file" if hand_of(path) else "face")
    placement = reflector.placement or Placement.identity("file")
    found = _own_heights(path) if placement.is_identity else None
    surface, loop = found or (_as_heights(path, reflector), np.ascontiguousarray(reflector.outline()[:, :2]))
    given = Motion(placement.rotation, -placement.rotation @ placement.origin_mm)
    return Reference(path.stem, Nominal(surface, polygon_outline(loop)), given)


def _own_heights(path: Path) -> tuple[BSplineSurface, Array] | None:
    """The face that reflects and its loop, where it is one B-spline of heights over (x, y): then nothing has to be fitted."""
    file = read_cad(path)
    faces = [face for face in file.faces if face.name == OPTICAL_FACE] or list(file.faces)
    if len(faces) != 1:
        return None
    shape = file.shapes(faces)[0]
    surface = shape.surface
    if not isinstance(surface, BSplineSurface) or not surface.is_height_field or len(shape.loops) != 1:
        return None
    return surface, shape.loops[0]


def polygon_outline(loop: Array) -> Outline:
    """The outline of a closed polygon, counter-clockwise, without vertices that lie straight.

    Parameters
    ----------
    loop : ndarray
        (n, 2), mm.
    """
    area = 0.5 * float((loop[:, 0] * np.roll(loop[:, 1], -1) - loop[:, 1] * np.roll(loop[:, 0], -1)).sum())
    points = loop if area > 0.0 else loop[::-1]
    kept = [0]
    k = 1
    while k < len(points):
        last = k
        while k + 1 <= len(points):
            chord = points[(k + 1) % len(points)] - points[kept[-1]]
            off = points[kept[-1] + 1: k + 1] - points[kept[-1]]
            length = max(float(np.hypot(*chord)), 1e-300)
            if np.abs(off[:, 0] * chord[1] - off[:, 1] * chord[0]).max() / length > CORNER_MM:
                break
            last = k + 1
            k += 1
        if last >= len(points):
            break
        kept.append(last)
        k = last + 1
    corners = [(float(x), float(y)) for x, y in points[kept]]
    return Outline(tuple(Line(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)))


def _as_heights(path: Path, reflector: Reflector) -> BSplineSurface:
    """The face as z(x, y), fitted to points of it until it is met to EXACT_MM."""
    low, high = reflector.bounds
    box = float(low[0]), float(high[0]), float(low[1]), float(high[1])
    best, off = None, np.inf
    for spans in SPANS:
        space = Space(box, (spans, max(1, round(spans * (box[3] - box[2]) / (box[1] - box[0])))))
        sites = [np.linspace(box[2 * k], box[2 * k + 1], SAMPLES_A_SPAN * space.spans[k] + 1) for k in (0, 1)]
        x, y = (each.ravel() for each in np.meshgrid(*sites))
        points = reflector.surface.points_over(x, y)
        found = np.isfinite(points).all(axis=1)
        if found.sum() < 12:
            raise SpecError(f"--against {path}: its face is not seen from the side that the driver looks at it from")
        x, y, z = x[found], y[found], points[found, 2]
        fit = fit_spline(space, Observations.of_heights(x, y, z, np.full(z.size, EXACT_MM)), (), 1.0)
        error = float(np.abs(fit.heights(x, y) - z).max())
        if error < off:
            best, off = fit, error
        if off <= EXACT_MM or np.prod(space.shape) > 2500:
            break
    assert best is not None
    return graph(*best.space.knots, DEGREE, best.coefficients)
