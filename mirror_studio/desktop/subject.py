"""What the window shows: a mirror's sheet, and the fan of rays from the eye."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.cad_file import read_cad
from mirror_cad.design_stages import design
from mirror_cad.errors import FileError
from mirror_cad.own_files import hand_of
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.quadric import Quadric
from mirror_studio.desktop.sheet import Sheet, sheet
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.assembly import OPTICAL_FACE
from raytrace.cad_reflector import reflector_from_cad
from raytrace.file_kinds import CAD_KINDS
from raytrace.placement import Placement
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.seating import seated
from raytrace.trace import reflect

Array = NDArray[np.float64]

LENDER = "progressive-c"  # the preset whose eye and reference plane a STEP file borrows, as `mirror-cad trace` has it
FAN = (9, 7)  # rays over the mirror's box, upright and across
RIM_CHORD_MM = 0.02  # of the outline: far below a pixel


@dataclass(frozen=True, slots=True, eq=False)
class Fan:
    """Rays that the mirror reflects.

    Starts (3,) at the eye, points (n, 3) on the mirror, ends (n, 3) on the reference plane, or as far away where a ray does not
    meet it; incidence (n,) degrees.
    """

    eye: Array
    points: Array
    ends: Array
    incidence_deg: Array
    plane_z_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What is shown, under its name."""

    name: str
    sheet: Sheet
    fan: Fan


def load_subject(what: str) -> Subject:
    """A CAD file by its ending (its optical face, or all faces where none is named so), else a specification or preset.

    Raises: MirrorError as the readers and `design` do.
    """
    if Path(what).suffix.lower() in CAD_KINDS:
        return _of_cad(Path(what))
    spec = load_spec(what)
    mirror = design(spec)
    rms = mirror.curvature.rms(mirror.outline)
    shown = sheet(mirror.surface, (mirror.outline.polyline(RIM_CHORD_MM),), mirror.curvature, rms)
    return Subject(spec.name, shown, _fan(Reflector.from_mirror(mirror), shown, spec))


def _of_cad(path: Path) -> Subject:
    file = read_cad(path)
    chosen = [face for face in file.faces if face.name == OPTICAL_FACE] or list(file.faces)
    sheets = []
    for face, as_spline, as_it_is in zip(chosen, file.shapes(chosen, splines=True), file.shapes(chosen), strict=True):
        if not isinstance(as_spline.surface, BSplineSurface):
            raise FileError(f"{path}: face {face.number} is triangles without a surface: its curvature is not to be had")
        quadric = as_it_is.surface if isinstance(as_it_is.surface, Quadric) else None
        sheets.append(sheet(as_spline.surface, as_spline.loops, quadric=quadric))
    starts = np.cumsum([0, *(len(each.vertices) for each in sheets[:-1])])
    spec = load_spec(LENDER)
    hand = hand_of(path)
    reflector = seated(reflector_from_cad(file, None, spec.glass.index, "facets"), hand is not None, hand=hand or "left")
    placement = reflector.placement or Placement.identity()
    shown = Sheet(placement.to_mirror(np.concatenate([each.vertices for each in sheets])),
                  np.concatenate([each.normals for each in sheets]) @ placement.rotation.T,
                  np.concatenate([each.faces + start for each, start in zip(sheets, starts, strict=True)])
                  [:, :: 1 if placement.hand == "left" else -1],
                  {key: np.concatenate([each.fields[key] for each in sheets]) for key in sheets[0].fields})
    return Subject(path.stem, shown, _fan(reflector, shown, spec))


def _fan(reflector: Reflector, shown: Sheet, spec: MirrorSpec) -> Fan:
    (x_min, y_min, _), (x_max, y_max, _) = shown.vertices.min(axis=0), shown.vertices.max(axis=0)
    setup = ViewingSetup.of(spec, (float(x_min), float(x_max), float(y_min), float(y_max)))
    y, x = (low + (high - low) * (np.arange(n) + 0.5) / n for n, low, high in ((FAN[0], y_min, y_max), (FAN[1], x_min, x_max)))
    aimed = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1).reshape(-1, 3)
    trace = reflect(reflector, setup.eye, aimed - setup.eye)
    seen = trace.status == Status.REFLECTED
    points, directions = trace.points[seen], trace.directions[seen]
    with np.errstate(divide="ignore"):
        reach = (setup.plane_z_mm - points[:, 2]) / directions[:, 2]
    far = np.where((reach > 0.0) & (reach < 10.0 * setup.plane_z_mm), reach, setup.plane_z_mm)
    incoming = points - setup.eye
    cosine = -np.einsum("ij,ij->i", incoming, trace.normals[seen]) / np.linalg.norm(incoming, axis=1)
    return Fan(setup.eye, points, points + far[:, None] * directions, np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))),
               setup.plane_z_mm)
