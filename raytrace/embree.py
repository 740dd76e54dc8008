"""First hits and shadows of rays on triangles: the only importer of embreex, which checks nothing that it is given."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import InstallationError
from raytrace.kernels import facets
from raytrace.parallel import parallel_for

if TYPE_CHECKING:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

Array = NDArray[np.float64]

# Beyond this the squares of distances would leave float64.
FARTHEST = 1e150


class Hits(NamedTuple):
    """First hits of n rays on triangles, float64 on the triangle's own plane.

    Which triangle it is comes from float32: a ray within some 1e-6 of the mesh's radius of an edge may get the neighbour's,
    with u or v as much outside 0…1.

    Attributes
    ----------
    distance : (n,), along the direction; inf for none.
    triangle : (n,), −1 for none.
    u, v : (n,), barycentric: P = (1 − u − v)·v0 + u·v1 + v·v2; 0 for none.
    """

    distance: Array
    triangle: NDArray[np.int32]
    u: Array
    v: Array


class TriangleScene:
    """One mesh in Embree, committed once.

    Parameters
    ----------
    vertices : (n, 3), finite, in any unit and place.
    faces : (m, 3), integers below n.

    Raises
    ------
    ValueError
        That names what is wrong with them.
    InstallationError
        Where embreex is not installed.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        points = _numbers("vertices", vertices)
        corners = np.asarray(faces)
        if len(points) == 0:
            raise ValueError("vertices are empty: a scene needs a triangle")
        if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) == 0:
            raise ValueError(f"faces must be of shape (m, 3), m ≥ 1, not {corners.shape}")
        if not np.issubdtype(corners.dtype, np.integer):
            raise ValueError(f"faces must be integers, not {corners.dtype}")
        if not np.isfinite(points).all():
            finite = np.isfinite(points).all(axis=1)
            raise ValueError(f"vertices must be finite: vertex {int(np.argmin(finite))} is {points[np.argmin(finite)]}")
        if corners.min() < 0 or corners.max() >= len(points):
            row = int(np.argmax(((corners < 0) | (corners >= len(points))).any(axis=1)))
            raise ValueError(f"faces must name vertices 0 to {len(points) - 1}: face {row} is {corners[row]}")
        if np.abs(points).max() > FARTHEST:
            raise ValueError(f"vertices must lie within {FARTHEST:g}: one is at {np.abs(points).max():g}")
        low, high = extent(points)
        self._centre = 0.5 * (low + high)
        radius = 0.5 * float(np.linalg.norm(high - low))
        self._scale = float(np.ldexp(1.0, -int(np.frexp(radius)[1])))  # a power of two: it costs no digit
        self._radius = 1.001 * radius * self._scale  # the overlap sticks out a little
        self._vertices = (points - self._centre) * self._scale
        self._faces = np.ascontiguousarray(corners, dtype=np.int32)
        cast_corners = np.empty((len(corners), 3, 3), dtype=np.float32)
        facets.overlapping(self._vertices, self._faces, cast_corners)
        self._scene, self._mesh = _embree_scene(cast_corners)
        # The first run commits the scene: do it here, before threads share it.
        self._scene.run(np.zeros((1, 3), dtype=np.float32), np.ones((1, 3), dtype=np.float32))

    def first_hits(self, origins: ArrayLike, directions: ArrayLike) -> Hits:
        """Find the first triangle that each ray meets.

        Parameters
        ----------
        origins : (3,), (1, 3) or (n, 3), finite.
        directions : (n, 3), unit.

        Returns
        -------
        Hits
            In the vertices' unit.

        Raises
        ------
        ValueError
            For other shapes, and for a ray that is not finite or whose direction is not unit, with its row.
        """
        starts, rays = _rays(origins, directions)
        n = len(rays)
        out = Hits(np.empty(n), np.empty(n, dtype=np.int32), np.empty(n), np.empty(n))
        parallel_for(lambda start, stop: self._chunk(slice(start, stop), starts, rays, out), n)
        return out

    def first_triangles(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.int32]:
        """`first_hits` without the places: the triangle alone that each ray meets first, (n,), −1 for none."""
        starts, rays = _rays(origins, directions)
        found = np.empty(len(rays), dtype=np.int32)

        def work(start: int, stop: int) -> None:
            ends = self._cast(slice(start, stop), starts, rays)
            found[start:stop] = self._scene.run(ends[0], ends[1])

        parallel_for(work, len(rays))
        return found

    def occluded(self, origins: ArrayLike, directions: ArrayLike) -> NDArray[np.bool_]:
        """Find whether a triangle stands in the way of each ray, however far.

        In float32: a ray that starts within some 1e-6 of the mesh's radius of a triangle may or may not meet it.

        Parameters
        ----------
        origins, directions : as in `first_hits`.

        Returns
        -------
        (n,).

        Raises
        ------
        ValueError
            As `first_hits`.
        """
        starts, rays = _rays(origins, directions)
        out = np.empty(len(rays), dtype=np.bool_)

        def work(start: int, stop: int) -> None:
            ends = self._cast(slice(start, stop), starts, rays)
            np.greater_equal(self._scene.run(ends[0], ends[1], query="OCCLUDED"), 0, out=out[start:stop])

        parallel_for(work, len(rays))
        return out

    def _chunk(self, part: slice, origins: Array, directions: Array, out: Hits) -> None:
        ends = self._cast(part, origins, directions)
        found = self._scene.run(ends[0], ends[1])
        facets.refine(origins if len(origins) == 1 else origins[part], directions[part], self._centre, self._scale,
                      self._vertices, self._faces, found, out.distance[part], out.triangle[part], out.u[part], out.v[part])

    def _cast(self, part: slice, origins: Array, directions: Array) -> NDArray[np.float32]:
        """Starts and directions of some rays as Embree takes them, (2, n, 3)."""
        rays = directions[part]
        starts = origins if len(origins) == 1 else origins[part]
        ends = np.empty((2, len(rays), 3), dtype=np.float32)
        fault, row = facets.cast(starts, rays, self._centre, self._scale, self._radius, ends[0], ends[1])
        if fault != facets.GOOD:
            _refuse(fault, part.start + row, starts[min(row, len(starts) - 1)], rays[row])
        return ends


def extent(points: Array) -> tuple[Array, Array]:
    """The least and the largest coordinates of points (n, 3), n ≥ 1: column by column, ten times as fast as by rows."""
    return np.array([column.min() for column in points.T]), np.array([column.max() for column in points.T])


def _embree_scene(corners: NDArray[np.float32]) -> tuple[EmbreeScene, TriangleMesh]:
    """Loaded here, so that surfaces can be traced where no wheel of embreex exists."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise InstallationError(f"triangles are traced with Embree, and embreex cannot be imported ({error}): meshes and the "
                                f"lit road need it; pip install embreex, which has no wheel for Linux on aarch64") from error
    scene = EmbreeScene(robust=True)
    return scene, TriangleMesh(scene, corners)


def _rays(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Origins (1, 3) or (n, 3) and directions (n, 3), or ValueError."""
    rays = _numbers("directions", directions)
    starts = _numbers("origins", np.atleast_2d(origins))
    if len(starts) not in (1, len(rays)):
        raise ValueError(f"origins must be of shape (3,) or {rays.shape} like the directions, not {starts.shape}")
    return starts, rays


def _numbers(name: str, values: ArrayLike) -> Array:
    """A contiguous float64 array (n, 3) of real numbers, or ValueError."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be real numbers, not {array.dtype}")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} must be of shape (n, 3), not {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float64)


def _refuse(fault: int, ray: int, origin: Array, direction: Array) -> None:
    if fault == facets.BAD_ORIGIN:
        raise ValueError(f"origins must be finite: that of ray {ray} is {origin}")
    if fault == facets.BAD_DIRECTION:
        raise ValueError(f"directions must be finite: that of ray {ray} is {direction}")
    raise ValueError(f"directions must be of length 1: that of ray {ray} is {direction}, "
                     f"of length {np.linalg.norm(direction):g}")
