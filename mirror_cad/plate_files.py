"""A plate's STEP files as the kernel reads them back, in plain records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.cad_file import FaceShape
from mirror_cad.errors import FileError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.bspline import BSplineSurface

if TYPE_CHECKING:
    from mirror_cad.kernel import ToldFile

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NamedFace:
    """A face with a name, its surface a B-spline.   shape : with its loops and sign.   area_mm2 : by the kernel."""

    name: str
    surface: BSplineSurface
    shape: FaceShape
    area_mm2: float


@dataclass(frozen=True, slots=True, eq=False)
class ReadStep:
    """A STEP file of a mirror as read.

    Attributes
    ----------
    solids : int
        How many it holds.
    valid : bool
        By the kernel's own check of all that it holds.
    volume_mm3 : float or None
        Of the one solid; None without, and of several.
    faces : tuple of NamedFace
        Optical and front face, in the file's order.
    sides : tuple of SurfaceMesh
        All other faces, in triangles.
    curves : tuple of ndarray
        Points (n, 3), mm, along each edge that bounds no face.
    """

    solids: int
    valid: bool
    volume_mm3: float | None
    faces: tuple[NamedFace, ...]
    sides: tuple[SurfaceMesh, ...]
    curves: tuple[Array, ...]

    @staticmethod
    def of(told: ToldFile) -> ReadStep:
        """From what `mirror_cad.occt.plate_step.told` returns."""
        solids, valid, volume, faces, sides, curves = told
        named = []
        for name, arrays, loops, sign, area in faces:
            surface = BSplineSurface(*arrays)
            named.append(NamedFace(name, surface, FaceShape(surface, tuple(loops), sign), area))
        return ReadStep(solids, valid, volume, tuple(named), tuple(SurfaceMesh(*each) for each in sides), tuple(curves))

    def named(self, name: str) -> NamedFace:
        """The one face of this name. Raises: FileError where there are none or several."""
        found = [face for face in self.faces if face.name == name]
        if len(found) != 1:
            raise FileError(f"the file has {len(found)} faces named {name!r}, not 1")
        return found[0]


class PlateFiles(NamedTuple):
    """A plate's area (mm²) and volume (mm³) as made, and its two files as read back."""

    area_mm2: float
    volume_mm3: float
    step: ReadStep
    sheet: ReadStep
