"""Write a mirror's plate as STEP files: of a plate that is there, or, in the child process, of its surfaces' arrays.

There they are read back too, as numbers, texts and arrays. Nothing here imports numba, as in `reading`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mirror_cad.occt.convert import Array, BSplineArrays, as_geom_bspline, bspline_arrays, face_loops, is_reversed
from mirror_cad.occt.shapes import free_curves_of, solids_of
from mirror_cad.occt.solid import PlateShapes, area, is_valid, outer_wire, plate_shapes, sheet, upright_curve, volume
from mirror_cad.occt.step import (
    FRONT_FACE,
    GLASS_COLOUR,
    OPTICAL_COLOUR,
    OPTICAL_FACE,
    TRIM_CURVE,
    Part,
    StepFace,
    read_step,
    write_step,
)
from mirror_cad.occt.tessellate import face_mesh, triangulate
from mirror_cad.outline.transition import TRANSITION_LINE, TransitionLine

if TYPE_CHECKING:
    from mirror_cad.kernel import PlateText, ToldFace, ToldFile
    from mirror_cad.occt.convert import BSplineRecord
    from mirror_cad.outline import Outline


CURVE_POINTS = 33  # of a curve that bounds no face


class _Arrays(NamedTuple):
    """What a BSplineSurface is made from."""

    degree_u: int
    degree_v: int
    knots_u: Array
    knots_v: Array
    poles: Array
    weights: Array | None

    @property
    def domain(self) -> tuple[float, float, float, float]:
        """(u_min, u_max, v_min, v_max)."""
        p, q = self.degree_u, self.degree_v
        return (float(self.knots_u[p]), float(self.knots_u[-p - 1]), float(self.knots_v[q]), float(self.knots_v[-q - 1]))


def write_plate(path: Path, made: PlateShapes, optical: BSplineRecord, said: PlateText) -> None:
    """Write a plate with its faces named, and the transition line on its optical surface. Raises: WriteError."""
    faces = {OPTICAL_FACE: made.optical}
    if said.reflecting == "back":
        faces[FRONT_FACE] = made.front_face
    parts = [Part(made.solid, said.name, GLASS_COLOUR, faces)]
    parts += transition_part(optical, said.transition)
    write_step(path, parts, said.name, said.hand, said.transition_mm)


def write_sheet(path: Path, made: PlateShapes, optical: BSplineRecord, box: tuple[float, float, float, float],
                said: PlateText) -> None:
    """Write the optical surface over a box in (u, v), with the plate's trim curve and transition line. Raises: WriteError."""
    name = f"{said.name}-surface"
    shell, face = sheet(optical, box)
    parts = [Part(shell, name, OPTICAL_COLOUR, {OPTICAL_FACE: face}), Part(outer_wire(made.optical), TRIM_CURVE),
             *transition_part(optical, said.transition)]
    write_step(path, parts, name, said.hand, said.transition_mm)


def transition_part(optical: BSplineRecord, line: TransitionLine | None) -> list[Part]:
    """The transition line as a curve on the optical surface; nothing without one."""
    if line is None:
        return []
    return [Part(upright_curve(optical, line.x_mm, line.low_mm, line.high_mm), TRANSITION_LINE)]


def write_from_arrays(path: str, optical: BSplineArrays, other: BSplineArrays, outline: Outline, thickness_mm: float,
                      said: PlateText) -> None:
    """Make a plate of its two surfaces and write it. Raises: SolidError, WriteError."""
    surface = _Arrays(*optical)
    write_plate(Path(path), plate_shapes(surface, _Arrays(*other), outline, thickness_mm, said.reflecting), surface, said)


def write_and_read(step: str, sheet_step: str, optical: BSplineArrays, other: BSplineArrays, outline: Outline,
                   thickness_mm: float, box: tuple[float, float, float, float], said: PlateText, sides_mm: float,
                   ) -> tuple[float, float, ToldFile, ToldFile]:
    """Make a plate, write it and its untrimmed sheet, and read both back.

    Returns the area of the optical face (mm²) and the plate's volume (mm³) as made, and what the files hold.

    Raises: SolidError, WriteError, and FileError for a file that cannot be read again.
    """
    surface = _Arrays(*optical)
    made = plate_shapes(surface, _Arrays(*other), outline, thickness_mm, said.reflecting)
    write_plate(Path(step), made, surface, said)
    write_sheet(Path(sheet_step), made, surface, box, said)
    return area(made.optical), volume(made.solid), told(step, sides_mm), told(sheet_step, sides_mm)


def told(path: str, sides_mm: float) -> ToldFile:
    """What a file of ours holds. sides_mm : the deflection of the triangles of faces without a name. Raises: FileError."""
    read = read_step(Path(path))
    solids = solids_of(read.shape)
    valid, inside = is_valid(read.shape), volume(solids[0]) if len(solids) == 1 else None
    named: list[ToldFace] = []
    sides = []
    for face in read.faces:
        if face.name in (OPTICAL_FACE, FRONT_FACE):
            named.append(_told_face(face))
        else:
            triangulate(face.raw, sides_mm, straight=True)
            mesh = face_mesh(face.raw)
            sides.append((mesh.vertices, mesh.faces))
    return len(solids), valid, inside, named, sides, free_curves_of(read.shape, CURVE_POINTS)


def _told_face(face: StepFace) -> ToldFace:
    geom, converted = as_geom_bspline(face.raw)
    return (face.name, bspline_arrays(geom), face_loops(converted), -1.0 if is_reversed(converted) else 1.0, area(face.raw))
