"""Put a reflector together from the faces of a file: what reflects, the glass before it, and what stands in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError
from raytrace.reflector import Reflector
from raytrace.surfaces.faces import Face
from raytrace.surfaces.plate import Plate
from raytrace.surfaces.seams import without_seams

OPTICAL_FACE = "optical face"
FRONT_FACE = "front face"


def assembled(faces: list[Face], fronts: list[Face], obstacles: list[SurfaceMesh], index: float) -> Reflector:
    """What reflects, the glass's front faces before it and what stands in the way, as one reflector.

    Faces that a mirror was drawn in parts as are one again.

    Raises
    ------
    TraceError
        For glass with more than one face to either side.
    """
    surfaces = without_seams(faces)
    if not fronts:
        return Reflector.of_faces(surfaces, joined(obstacles))
    if len(fronts) != 1 or len(surfaces) != 1:
        raise TraceError(f"glass is traced through one {FRONT_FACE!r} and one {OPTICAL_FACE!r}; the file has "
                         f"{len(fronts)} and {len(surfaces)}")
    # The reflecting side of the back is that of the glass, the file's inner one.
    back = replace(surfaces[0], sign=-surfaces[0].sign)
    return Reflector(Plate(fronts[0], back, index), joined(obstacles))


def joined(meshes: list[SurfaceMesh]) -> SurfaceMesh | None:
    """Meshes as one; None where there are none."""
    if not meshes:
        return None
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return SurfaceMesh(np.concatenate([mesh.vertices for mesh in meshes]),
                       np.concatenate([mesh.faces + o for mesh, o in zip(meshes, offsets, strict=False)]).astype(np.int32))
