"""Triangle meshes as plain records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SurfaceError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceMesh:
    """Triangles.

    Attributes
    ----------
    vertices : ndarray
        (n, 3) float64, mm.
    faces : ndarray
        (m, 3) int32, counter-clockwise seen from outside.
    """

    vertices: Array
    faces: NDArray[np.int32]

    def __post_init__(self) -> None:
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or not np.isfinite(self.vertices).all():
            raise SurfaceError(f"a mesh needs finite vertices of shape (n, 3), not {self.vertices.shape}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or len(self.faces) == 0:
            raise SurfaceError(f"a mesh needs faces of shape (m, 3), m ≥ 1, not {self.faces.shape}")
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise SurfaceError(f"a face names vertex {int(self.faces.max())} of {len(self.vertices)}")
        self.vertices.setflags(write=False)
        self.faces.setflags(write=False)

    def facet_normals(self) -> Array:
        """Unit normals of the triangles, (m, 3); zero where a triangle has no area."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        result: Array = np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)
        return result
