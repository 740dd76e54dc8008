"""Write a mirror's plate as a STEP file: of a plate that is there, or, in the child process, of its surfaces' arrays.

Nothing here imports numba, as in `reading`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mirror_cad.occt.convert import Array, BSplineArrays
from mirror_cad.occt.solid import PlateShapes, plate_shapes, upright_curve
from mirror_cad.occt.step import FRONT_FACE, GLASS_COLOUR, OPTICAL_FACE, Part, write_step
from mirror_cad.outline.transition import TRANSITION_LINE, TransitionLine

if TYPE_CHECKING:
    from mirror_cad.kernel import PlateText
    from mirror_cad.occt.convert import BSplineRecord
    from mirror_cad.outline import Outline


class _Arrays(NamedTuple):
    """What a BSplineSurface is made from."""

    degree_u: int
    degree_v: int
    knots_u: Array
    knots_v: Array
    poles: Array
    weights: Array | None


def write_plate(path: Path, made: PlateShapes, optical: BSplineRecord, said: PlateText) -> None:
    """Write a plate with its faces named, and the transition line on its optical surface. Raises: WriteError."""
    faces = {OPTICAL_FACE: made.optical}
    if said.reflecting == "back":
        faces[FRONT_FACE] = made.front_face
    parts = [Part(made.solid, said.name, GLASS_COLOUR, faces)]
    parts += transition_part(optical, said.transition)
    write_step(path, parts, said.name, said.hand, said.transition_mm)


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
