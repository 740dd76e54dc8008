"""What a file of polygons holds, in one form for every format: OBJ, PLY and OFF in, triangles or parts of a body out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from raytrace.polygons import triangulated

if TYPE_CHECKING:
    from raytrace.scene.materials import Material
    from raytrace.scene.parts import Part

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Of a coordinate, in any unit: whoever writes more has damaged numbers, and products of them would leave float64.
FARTHEST = 1e30


class CornerValues(NamedTuple):
    """Values (t, w) that corners take: of (k,), the row of each corner, −1 for a corner without."""

    values: Array
    of: Integers


@dataclass(frozen=True, slots=True, eq=False)
class PolygonMesh:
    """Polygons with what their corners are given.

    Attributes
    ----------
    vertices : (n, 3).
    corners : (k,), the vertices of all polygons, one polygon after the other.
    starts : (p + 1,), where each begins in `corners`.
    look : (p,), which of the file's materials each has, −1 for none.
    uv : of width 2, v = 0 at the picture's bottom.
    colours : of width 3, sRGB 0 … 255.
    looks : the materials' names.
    libraries : the names of the files that hold them.
    picture : one for the whole mesh.
    """

    vertices: Array
    corners: Integers
    starts: Integers
    look: Integers
    uv: CornerValues | None = None
    colours: CornerValues | None = None
    looks: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ()
    picture: str | None = None

    @staticmethod
    def of_one_look(vertices: Array, corners: Integers, starts: Integers, uv: CornerValues | None = None,
                    colours: CornerValues | None = None, picture: str | None = None) -> PolygonMesh:
        """A mesh whose file knows no materials."""
        return PolygonMesh(vertices, corners, starts, np.full(len(starts) - 1, -1), uv, colours, picture=picture)


class Cut(NamedTuple):
    """Triangles (m, 3) as rows of the mesh's corners, the polygon (m,) of each, and how many polygons cross themselves."""

    corners: Integers
    polygon: Integers
    crossed: int


def cut(path: Path, mesh: PolygonMesh, most_triangles: int) -> Cut:
    """The mesh's polygons as triangles.

    Raises
    ------
    FileError
        For a mesh without triangles or with more than `most_triangles`, for corners that name no vertex or are not finite.
    """
    count = int(np.maximum(np.diff(mesh.starts) - 2, 0).sum())
    if count == 0:
        raise FileError(f"{path}: holds no triangles")
    if count > most_triangles:
        raise FileError(f"{path}: {count} triangles are more than {most_triangles}: reduce the mesh")
    wrong = (mesh.corners < 0) | (mesh.corners >= len(mesh.vertices))
    if wrong.any():
        face = _face_of(mesh, wrong)
        named = mesh.corners[mesh.starts[face]:mesh.starts[face + 1]].tolist()
        raise FileError(f"{path}: face {face} names vertices {named} of {len(mesh.vertices)}")
    wrong = misplaced(mesh.vertices)[mesh.corners]
    if wrong.any():
        raise FileError(f"{path}: face {_face_of(mesh, wrong)} has a corner that is not finite, or beyond {FARTHEST:g}")
    found = triangulated(mesh.vertices[mesh.corners], mesh.starts)
    return Cut(found.corners, found.polygon, len(found.crossed))


def misplaced(vertices: Array) -> NDArray[np.bool_]:
    """Which vertices (n, 3) are no place: not finite, or beyond FARTHEST."""
    return np.asarray(~(np.abs(vertices) <= FARTHEST).all(axis=1))


def _face_of(mesh: PolygonMesh, corners: NDArray[np.bool_]) -> int:
    """The face of the first of the marked corners, counted from 0."""
    return int(np.searchsorted(mesh.starts, np.argmax(corners), side="right")) - 1


def parts_of(mesh: PolygonMesh, triangles: Cut, materials: Sequence[Material], bare: Material) -> list[Part]:
    """One part a material: those of `mesh.looks`, and `bare` for polygons without one, or white where they have colours."""
    from raytrace.scene.materials import linear
    from raytrace.scene.parts import Part

    parts = []
    look = mesh.look[triangles.polygon]
    for k in np.unique(look):
        rows = triangles.corners[look == k].ravel()
        material = bare if k < 0 else materials[k]
        # A vertex for each place with the values that corners there have.
        key = np.unique(mesh.corners[rows], return_inverse=True)[1]
        uv = mesh.uv if mesh.uv is not None and (mesh.uv.of[rows] >= 0).any() else None
        colours = mesh.colours if mesh.colours is not None and k < 0 and (mesh.colours.of[rows] >= 0).any() else None
        for values in (uv, colours):
            if values is not None:
                key = np.unique(key * (len(values.values) + 1) + values.of[rows] + 1, return_inverse=True)[1]
        _, first = np.unique(key, return_index=True)
        vertex = rows[first]
        parts.append(Part(
            mesh.vertices[mesh.corners[vertex]], key.reshape(-1, 3), material,
            uv=None if uv is None else _taken(uv, vertex, np.nan) * [1.0, -1.0] + [0.0, 1.0],
            # A place that is given no colour has the material's.
            colours=None if colours is None else np.concatenate(
                [linear(_taken(colours, vertex, 255.0)), np.ones((len(vertex), 1))], axis=1)))
    return parts


def _taken(values: CornerValues, corners: Integers, missing: float) -> Array:
    rows = values.of[corners]
    return np.where((rows >= 0)[:, None], values.values[rows], missing)
