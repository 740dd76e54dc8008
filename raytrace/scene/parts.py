"""Triangles of a file with one material each in, the joined arrays of one body out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mesh import SurfaceMesh
from raytrace.kernels.mesh_normals import corner_normals
from raytrace.scene.materials import Material

Array = NDArray[np.float64]

NORMAL_STEP = 1e-4  # normals closer than this are one: 0.006°


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Triangles of one material, as a file has them; what the file does not have is None.

    Parameters
    ----------
    vertices : (n, 3).
    faces : (m, 3).
    material : of all of them.
    normals : (n, 3), unit.
    uv : (n, 2), texture coordinates with v = 0 at the picture's first row.
    sky : (n,), the share of the surroundings that each vertex sees.
    colours : (n, 4), linear RGB and cover, 0 … 1, that the material's are multiplied by.
    """

    vertices: Array
    faces: NDArray[np.int64]
    material: Material
    normals: Array | None = None
    uv: Array | None = None
    sky: Array | None = None
    colours: Array | None = None


class Joined(NamedTuple):
    """All parts as one.

    Attributes
    ----------
    vertices, normals, uv, sky : (n, 3), (n, 3), (n, 2) and (n,); NaN where no part has them.
    faces : (m, 3).
    material : (m,), an index into `materials`.
    materials : each once.
    colours : (n, 4); None where no part has any.
    """

    vertices: Array
    normals: Array
    uv: Array
    sky: Array
    faces: NDArray[np.int32]
    material: NDArray[np.int32]
    materials: tuple[Material, ...]
    colours: Array | None


def joined(parts: Sequence[Part]) -> Joined:
    """Join many parts to one body. Where normals are missing they are made anew, with creases where facets turn by over 30°.

    Parameters
    ----------
    parts : one or more.

    Returns
    -------
    Joined
    """
    whole = [part if part.normals is not None else _with_normals(part) for part in parts]
    materials = list({id(part.material): part.material for part in whole}.values())
    number = {id(material): k for k, material in enumerate(materials)}
    offsets = np.cumsum([0, *(len(part.vertices) for part in whole)])
    return Joined(
        np.concatenate([part.vertices for part in whole]),
        np.concatenate([_numbers(part.normals, (len(part.vertices), 3)) for part in whole]),
        np.concatenate([_numbers(part.uv, (len(part.vertices), 2)) for part in whole]),
        np.concatenate([_numbers(part.sky, (len(part.vertices),)) for part in whole]),
        np.concatenate([part.faces + offset for part, offset in zip(whole, offsets, strict=False)]).astype(np.int32),
        np.concatenate([np.full(len(part.faces), number[id(part.material)], dtype=np.int32) for part in whole]),
        tuple(materials),
        None if all(part.colours is None for part in whole) else np.concatenate(
            [np.ones((len(part.vertices), 4)) if part.colours is None else part.colours for part in whole]))


def _numbers(values: Array | None, shape: tuple[int, ...]) -> Array:
    return np.full(shape, np.nan) if values is None else values


def _with_normals(part: Part) -> Part:
    """The part with a vertex for every place, texture coordinate, colour and normal that its corners have."""
    vertices, same = np.unique(part.vertices + 0.0, axis=0, return_inverse=True)
    same = same.ravel()
    mesh = SurfaceMesh(vertices, same[part.faces].astype(np.int32))
    has_area = mesh.facet_normals().any(axis=1)
    faces = part.faces[has_area]
    if len(faces) == 0:
        return Part(part.vertices, faces, part.material, np.zeros_like(part.vertices), part.uv, part.sky, part.colours)
    normals = corner_normals(SurfaceMesh(vertices, same[faces].astype(np.int32))).reshape(-1, 3)
    given = [np.nan_to_num(values[faces.ravel()]) for values in (part.uv, part.colours) if values is not None]
    texture = np.unique(np.column_stack(given), axis=0, return_inverse=True)[1].ravel() if given else np.zeros(faces.size, int)
    keys = np.column_stack([same[faces.ravel()], texture, np.rint(normals / NORMAL_STEP).astype(np.int64)])
    _, first, corner = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    vertex = faces.ravel()[first]
    return Part(part.vertices[vertex], corner.reshape(-1, 3), part.material, normals[first],
                None if part.uv is None else part.uv[vertex], None if part.sky is None else part.sky[vertex],
                None if part.colours is None else part.colours[vertex])
