"""Bodies, a road and daylight in, the radiance along any rays out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.embree import Hits, TriangleScene, extent
from raytrace.parallel import parallel_for
from raytrace.scene import shading
from raytrace.scene.bodies import Body
from raytrace.scene.cutouts import MAX_BLENDED, MIN_SEEN, Cutouts
from raytrace.scene.daylight import Daylight
from raytrace.scene.materials import Material, Palette, diffuse_colours
from raytrace.scene.road import Road
from raytrace.scene.shading import MIN_SLOPES, MIRRORED_SLOPES, Light, Mesh, SurfaceInteraction
from raytrace.scene.woods import Woods

Array = NDArray[np.float64]

# Rays leave a surface this far off it, of the scene's size: 16 units of the last place of Embree's float32, 2 mm in 2 km.
LIFT = 16.0 * 2.0**-23
# Materials smoother than this mirror the bodies and the road around them; rougher ones the sky and the ground's mean.
SMOOTH = 0.45
BIN_MM = 4000.0  # contact shadows are looked for in steps of X


class Shadows(NamedTuple):
    """The bodies' contact grids as `shading.contact_shadows` reads them.

    Attributes
    ----------
    first, which : the grids over each bin of X, BIN_MM wide: which[first[b]:first[b + 1]].
    bins_from : X where the first bin begins, mm.
    frames : (k, 6), of each grid its origin (X, Y), mm, and the two steps as multiples per mm².
    shapes : (k, 3), where a grid begins in `shares`, and its rows and columns.
    shares : of the sky that is left, one grid after the other.
    """

    first: NDArray[np.int64]
    which: NDArray[np.int64]
    bins_from: float
    frames: Array
    shapes: NDArray[np.int64]
    shares: Array

    def darken(self, points: Array, share: Array) -> None:
        """Multiply shares (n,) by what the grids leave of the sky at ground points (n, ≥ 2)."""
        shading.contact_shadows(points, self.first, self.which, self.bins_from, BIN_MM, self.frames, self.shapes, self.shares,
                                share)

    @staticmethod
    def of(bodies: Sequence[Body]) -> Shadows | None:
        """Those of bodies that have a contact grid; None where none has."""
        grids = [body.contact for body in bodies if body.contact is not None]
        if not grids:
            return None
        steps = np.array([[g.along, g.across] for g in grids])
        frames = np.concatenate([np.array([g.origin for g in grids]),
                                 (steps / (steps**2).sum(axis=2, keepdims=True)).reshape(-1, 4)], axis=1)
        sizes = np.array([g.sky.shape for g in grids], dtype=np.int64)
        corners = np.array([[g.origin + i * (g.sky.shape[0] - 1) * g.along + j * (g.sky.shape[1] - 1) * g.across
                             for i in (0, 1) for j in (0, 1)] for g in grids])
        low, high = corners[..., 0].min(axis=1), corners[..., 0].max(axis=1)
        bins_from = float(low.min())
        bins = [(int((a - bins_from) // BIN_MM), int((b - bins_from) // BIN_MM)) for a, b in zip(low, high, strict=True)]
        inside: list[list[int]] = [[] for _ in range(max(b for _, b in bins) + 1)]
        for k, (a, b) in enumerate(bins):
            for row in inside[a:b + 1]:
                row.append(k)
        offsets = np.cumsum([0, *sizes.prod(axis=1)[:-1]])
        return Shadows(np.cumsum([0, *(len(row) for row in inside)]),
                       np.array([k for row in inside for k in row], dtype=np.int64), bins_from, frames,
                       np.column_stack([offsets, sizes]), np.concatenate([g.sky.ravel() for g in grids]))


@dataclass(frozen=True, eq=False)
class LitWorld:
    """What stands under daylight.

    Parameters
    ----------
    bodies : in the world's frame, mm.
    road : the ground Z = 0; without one there is none, and what is below the horizon shows the daylight's mean ground.
    daylight : sky, sun and air.
    woods : the skyline; None for none.
    """

    bodies: tuple[Body, ...]
    road: Road | None
    daylight: Daylight
    woods: Woods | None = None

    def radiance(self, origins: ArrayLike, directions: ArrayLike, spread: ArrayLike) -> Array:
        """Find the light that comes back along rays; called from several threads at once.

        Bodies and ground: diffuse light of the sky, dimmed by what the body itself hides, and of the sun, unless anything
        stands before it; what smooth surfaces mirror, one time.

        Parameters
        ----------
        origins : (3,), (1, 3) or (n, 3), mm.
        directions : (n, 3), unit.
        spread : angular radius of the cone that a ray stands for, radians, one or (n,): what it covers at distance t is
            averaged over a radius of spread·t.

        Returns
        -------
        (n, 3), radiance, kcd/m² a channel of linear sRGB.

        Raises
        ------
        ValueError
            For rays as `TriangleScene.first_hits`.

        References
        ----------
        docs/derivations/daylight.md
        """
        rays = np.ascontiguousarray(directions, dtype=np.float64)
        starts = np.ascontiguousarray(np.atleast_2d(origins), dtype=np.float64)
        cones = np.broadcast_to(np.asarray(spread, dtype=np.float64), len(rays))
        out = np.empty(rays.shape)

        def work(start: int, stop: int) -> None:
            part = slice(start, stop)
            self._trace(starts if len(starts) == 1 else starts[part], rays[part], np.ascontiguousarray(cones[part]),
                        np.zeros(stop - start), True, out[part])

        parallel_for(work, len(rays))
        return out

    @cached_property
    def scene(self) -> TriangleScene:
        """All bodies' triangles in Embree; where there is none, one without area, which no ray meets."""
        return TriangleScene(self._mesh.vertices, self._mesh.faces) if self.bodies else TriangleScene(
            np.zeros((3, 3)), np.array([[0, 1, 2]]))

    @cached_property
    def _mesh(self) -> Mesh:
        vertices = np.cumsum([0, *(len(body.vertices) for body in self.bodies)])
        materials = np.cumsum([0, *(len(body.materials) for body in self.bodies)])
        parts = [(np.concatenate(arrays) if self.bodies else np.zeros(shape)) for arrays, shape in (
            ([body.vertices for body in self.bodies], (0, 3)), ([body.normals for body in self.bodies], (0, 3)),
            ([body.uv for body in self.bodies], (0, 2)), ([body.sky for body in self.bodies], (0,)))]
        faces = np.concatenate([np.zeros((0, 3), dtype=np.int64), *(b.faces + o for b, o in zip(
            self.bodies, vertices, strict=False))]).astype(np.int32)
        which = np.concatenate([np.zeros(0, dtype=np.int64), *(b.material + o for b, o in zip(
            self.bodies, materials, strict=False))]).astype(np.int32)
        return Mesh(parts[0], parts[1], parts[2], parts[3], faces, which, _uv_per_mm(parts[0], parts[2], faces))

    @cached_property
    def _colours(self) -> Array | None:
        """Colours and cover (n, 4) of all vertices, where a body has them."""
        if all(body.colours is None for body in self.bodies):
            return None
        return np.concatenate([np.ones((len(body.vertices), 4)) if body.colours is None else body.colours
                               for body in self.bodies])

    @cached_property
    def _materials(self) -> tuple[Material, ...]:
        return tuple(material for body in self.bodies for material in body.materials)

    @cached_property
    def _cutouts(self) -> Cutouts | None:
        return Cutouts.of(self._materials, self._mesh, self._colours, self._lift)

    @cached_property
    def _palette(self) -> Palette:
        return Palette.of(self._materials)

    @cached_property
    def _light(self) -> Light:
        return Light.of(self.daylight)

    @cached_property
    def _shadows(self) -> Shadows | None:
        return Shadows.of(self.bodies)

    @cached_property
    def _lift(self) -> float:
        """How far off a surface rays start, mm."""
        return LIFT * 0.5 * float(np.linalg.norm(np.subtract(*extent(self._mesh.vertices)))) if self.bodies else 0.0

    def __post_init__(self) -> None:
        # Made before threads ask for them.
        _ = self.scene, self._palette, self._light, self._shadows, self._lift, self._colours, self._cutouts

    def _trace(self, origins: Array, directions: Array, spread: Array, radius: Array, first: bool, out: Array,
               beyond: Array | None = None, layer: int = 0) -> None:
        """Radiance into `out`; `first`: rays that see the sun's disc and what smooth bodies mirror; mirrored ones do not.

        beyond (n,) : bodies nearer than this are left out, as the blended ones before them, `layer` in number.
        """
        n = len(directions)
        hits = self.scene.first_hits(origins, directions) if self._cutouts is None else self._cutouts.first_hits(
            self.scene, origins, directions, beyond)
        found = SurfaceInteraction.empty(n)
        on_ground, met = shading.interactions(origins, directions, spread, radius, *hits, self._mesh, self._light.sun,
                                        self.road is not None, self._lift, found)
        found = found.rows(slice(0, met))
        if met < n:
            shading.surroundings(directions, spread, self._light, first, out)
        if met > 0:
            self._shade(found, on_ground, directions, spread, first, hits, out)
            if self._cutouts is not None and layer < MAX_BLENDED:
                body = found.rows(slice(on_ground, met))
                self._blend(self._cutouts, body, hits, (origins, directions, spread, radius), first, layer, out)
        if self.woods is not None:
            nearest = np.full(n, np.inf)
            nearest[found.ray] = found.distance
            self._edge_of(self.woods.met(origins, directions, spread, radius, nearest, self._light.sun), directions, out)

    def _blend(self, cutouts: Cutouts, body: SurfaceInteraction, hits: Hits, rays: tuple[Array, Array, Array, Array],
               first: bool, layer: int, out: Array) -> None:
        """Lay what blended bodies show over what is behind them."""
        blended = body.ray[cutouts.blended[body.material]]
        share = cutouts.cover(hits.triangle[blended], hits.u[blended], hits.v[blended])
        blended, share = blended[share < 1.0 - MIN_SEEN], share[share < 1.0 - MIN_SEEN, None]
        if len(blended) == 0:
            return
        origins, directions, spread, radius = rays
        behind = np.empty((len(blended), 3))
        self._trace(origins if len(origins) == 1 else np.ascontiguousarray(origins[blended]), directions[blended],
                    spread[blended], radius[blended], first, behind, hits.distance[blended] + self._lift, layer + 1)
        out[blended] = share * out[blended] + (1.0 - share) * behind

    def _shade(self, found: SurfaceInteraction, on_ground: int, directions: Array, spread: Array, first: bool, hits: Hits,
               out: Array) -> None:
        """Light from the places that rays meet."""
        met = len(found.ray)
        diffuse = np.empty((met, 3))
        body = found.rows(slice(on_ground, met))
        if self.road is not None:
            self.road.colours(found.point[:on_ground], found.extent[:on_ground], diffuse[:on_ground])
            if self._shadows is not None:
                self._shadows.darken(found.point[:on_ground], found.sky[:on_ground])
                self._shadows.darken(body.foot, body.ground)
        diffuse_colours(self._palette, body.material, body.uv, body.covered, diffuse[on_ground:])
        if self._colours is not None:
            u, v = hits.u[body.ray, None], hits.v[body.ray, None]
            a, b, c = (self._colours[self._mesh.faces[hits.triangle[body.ray], k], :3] for k in range(3))
            diffuse[on_ground:] *= np.clip((1.0 - u - v) * a + u * b + v * c, 0.0, 1.0)
        bounce, image = np.empty((2, met - on_ground, 3))
        shading.mirrored(body, directions, bounce)
        shading.surroundings(bounce, body.radius, self._light, False, image)
        traced = np.zeros(met - on_ground, dtype=np.bool_)
        if first:
            self._mirror(body, spread, bounce, image, traced)
        shading.shade(found, directions, diffuse, self._lit(found), on_ground, self._palette.specular, self._palette.roughness,
                      bounce, image, traced, self._light, MIN_SLOPES if first else MIRRORED_SLOPES, out)

    def _edge_of(self, met: tuple[SurfaceInteraction, Array, Array], directions: Array, out: Array) -> None:
        """Lay the woods' edge over what the rays see."""
        found, share, diffuse = met
        rows = found.ray
        if len(rows) == 0:
            return
        none = np.empty((0, 3))
        shown = np.empty((len(rows), 3))
        own = found._replace(ray=np.arange(len(rows), dtype=np.int32))
        shading.shade(own, np.ascontiguousarray(directions[rows]), diffuse, found.to_sun > 0.0, len(rows), none, np.empty(0),
                      none, none, np.empty(0, dtype=np.bool_), self._light, MIN_SLOPES, shown)
        out[rows] += share[:, None] * (shown - out[rows])

    def _mirror(self, body: SurfaceInteraction, spread: Array, bounce: Array, image: Array, traced: NDArray[np.bool_]) -> None:
        """What smooth surfaces show of the bodies and the road."""
        rough = self._palette.roughness[body.material]
        rows = np.flatnonzero((rough < SMOOTH) & (self._palette.specular[body.material].max(axis=1) > 0.0))
        if len(rows) == 0:
            return
        shown = np.empty((len(rows), 3))
        self._trace(body.start[rows], bounce[rows], spread[body.ray[rows]] + rough[rows] ** 2, body.radius[rows], False, shown)
        image[rows], traced[rows] = shown, True

    def _lit(self, found: SurfaceInteraction) -> NDArray[np.bool_]:
        """Which places the sun's disc is seen from."""
        lit = found.to_sun > 0.0
        if not self._light.sun_irradiance.any():
            return lit
        rows = np.flatnonzero(lit)
        to_sun = np.broadcast_to(self._light.sun, (len(rows), 3))
        lit[rows] = ~(self.scene.occluded(found.start[rows], to_sun) if self._cutouts is None
                      else self._cutouts.occluded(self.scene, found.start[rows], to_sun))
        return lit


def _uv_per_mm(vertices: Array, uv: Array, faces: NDArray[np.int32]) -> Array:
    """How far (u, v) goes a millimetre on each triangle: the root of the areas' ratio; 0 without texture coordinates."""
    a, b, c = np.ascontiguousarray(faces.T)
    # By columns: numpy's cross product and its sums over three take four times as long.
    (ax, ay, az), (bx, by, bz) = ([column[to] - column[a] for column in np.ascontiguousarray(vertices.T)] for to in (b, c))
    area = np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    (pu, pv), (qu, qv) = ([column[to] - column[a] for column in np.ascontiguousarray(uv.T)] for to in (b, c))
    textured = np.abs(pu * qv - pv * qu)
    ratio = np.divide(textured, area, out=np.zeros_like(area), where=area > 0.0)
    return np.sqrt(np.where(np.isfinite(ratio), ratio, 0.0))
