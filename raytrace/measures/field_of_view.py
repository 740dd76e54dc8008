"""Field of view: the angle between two rays as they leave the mirror."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import normals
from raytrace.reflector import Reflector, TrimmedSurface
from raytrace.surfaces.plate import trace_through

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

MAX_STEPS = 12  # of Newton for the path through the glass: from the place right above, four or five serve
# The path is found when a step moves its place on the front by less: rounding of coordinates of some 100 mm.
STEP_MM = 1e-11


@dataclass(frozen=True, slots=True, eq=False)
class GlassSheets:
    """Both sheets of a plate that reflects from its back, on the same parameters, without the outline; u = x, v = y on the
    back.   Outward sides and index as for `trace_through`."""

    front: TrimmedSurface
    back: TrimmedSurface
    index: float

    @staticmethod
    def of(front: TrimmedSurface, back: TrimmedSurface, index: float) -> GlassSheets:
        """The sheets that a plate's faces were cut from."""
        return GlassSheets(front.untrimmed(), back.untrimmed(), index)

    @staticmethod
    def before(reflector: Reflector) -> GlassSheets | None:
        """Those of a plate of B-splines that reflects from its back; None for another reflector."""
        glass, back = reflector.glass, reflector.only
        if glass is None or back is None or not isinstance(glass.front, TrimmedSurface):
            return None
        return GlassSheets.of(glass.front, back, glass.index)

    @property
    def domain(self) -> Box:
        return self.back.surface.domain


def reflected_at(surface: BSplineSurface | GlassSheets, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Points (n, 3) where rays from the eye leave the mirror, and their unit directions (n, 3) then.

    x, y : where the rays are reflected, on a sheet with u = x, v = y. On a bare sheet they leave it there; from glass they
    leave by its front, near by, and are NaN where they would leave beside the front's sheet.
    """
    if isinstance(surface, GlassSheets):
        trace = trace_through(surface.front, surface.back, surface.index, eye, towards(surface, eye, x, y))
        return trace.points, trace.directions
    if surface.weights is None:  # u = x, v = y: the height and its two slopes say it all
        return _reflected_from_graph(eye, x, y, *surface.heights(x, y))
    d = surface.derivatives(x, y)
    return _reflected(eye, d["s"], normals(d["u"], d["v"]))


def reflected_on_grid(surface: BSplineSurface | GlassSheets, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """`reflected_at` on the grid of x (m,) and y (n,): (m·n, 3) each, y running first; quicker on a bare sheet."""
    at_x, at_y = np.repeat(x, len(y)), np.tile(y, len(x))
    if isinstance(surface, GlassSheets) or surface.weights is not None:
        return reflected_at(surface, eye, at_x, at_y)
    d = surface.on_grid(x, y, component=2)
    return _reflected_from_graph(eye, at_x, at_y, *(d[key].ravel() for key in ("s", "u", "v")))


def _reflected_from_graph(eye: Array, x: Array, y: Array, z: Array, z_x: Array, z_y: Array) -> tuple[Array, Array]:
    normal = np.stack([-z_x, -z_y, np.ones_like(z)], axis=1)
    return _reflected(eye, np.stack([x, y, z], axis=1), normal / np.sqrt(1.0 + z_x * z_x + z_y * z_y)[:, None])


def _reflected(eye: Array, points: Array, normal: Array) -> tuple[Array, Array]:
    ray = points - eye
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return points, ray - 2.0 * np.einsum("ij,ij->i", ray, normal)[:, None] * normal


def towards(glass: GlassSheets, eye: Array, x: Array, y: Array) -> Array:
    """Directions (n, 3), of any length, from the eye to where the front lets rays in that are reflected at (x, y).

    By Fermat's principle: with P the place on the back and F(u, v) on the front, n·|F − P| + |F − eye| is stationary in
    (u, v); Newton on its two derivatives, from the place right above. NaN where no such place is on the front's sheet.
    """
    place = glass.back.surface.evaluate(x, y)
    u_min, u_max, v_min, v_max = glass.front.surface.domain
    u, v = np.array(x, dtype=np.float64), np.array(y, dtype=np.float64)
    size = np.full(u.shape, np.inf)
    for _ in range(MAX_STEPS):
        d = glass.front.surface.derivatives(np.clip(u, u_min, u_max), np.clip(v, v_min, v_max))
        pull = np.zeros_like(d["s"])
        bend = np.zeros((*u.shape, 3, 3))
        for end, index in ((place, glass.index), (eye, 1.0)):
            along = d["s"] - end
            length = np.linalg.norm(along, axis=-1)[..., None]
            along /= length
            pull += index * along
            bend += index * (np.eye(3) - along[..., :, None] * along[..., None, :]) / length[..., None]
        g_u, g_v = (np.einsum("...i,...i->...", pull, d[key]) for key in ("u", "v"))
        h_uu, h_uv, h_vv = (np.einsum("...i,...ij,...j->...", d[a], bend, d[b]) + np.einsum("...i,...i->...", pull, d[a + b])
                            for a, b in ("uu", "uv", "vv"))
        determinant = h_uu * h_vv - h_uv * h_uv
        step_u, step_v = (h_vv * g_u - h_uv * g_v) / determinant, (h_uu * g_v - h_uv * g_u) / determinant
        u, v = u - step_u, v - step_v
        size = np.hypot(step_u, step_v)
        if (size <= STEP_MM).all():
            break
    found = (size <= STEP_MM) & (u >= u_min) & (u <= u_max) & (v >= v_min) & (v <= v_max)
    ends = glass.front.surface.evaluate(np.clip(u, u_min, u_max), np.clip(v, v_min, v_max))
    return np.where(found[:, None], ends - eye, np.nan)


def angle_between(a: Array, b: Array) -> float:
    """Angle between two unit vectors, radians, exact for small and large ones: 2·atan2(|a − b|, |a + b|)."""
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def traced_fields_of_view(surface: BSplineSurface | GlassSheets, eye: Array, box: Box, left_height_mm: float,
                          ) -> tuple[float, float]:
    """H-FOV and V-FOV at the left edge, radians, with the eye where it really sits.

    H: between the rays reflected at the mirror's left and right edge, y = 0. V: between those at the left edge's two
    corners before rounding, (x_left, ±left height/2), which lie on the surface but outside the outline. Through glass,
    both are those of the same places of the reflecting back, as if front and glass went on beyond the outline; NaN where
    its sheet ends before the ray leaves.
    """
    x_min, x_max = box[0], box[1]
    half = 0.5 * left_height_mm
    _, out = reflected_at(surface, eye, np.array([x_min, x_max, x_min, x_min]), np.array([0.0, 0.0, -half, half]))
    return angle_between(out[0], out[1]), angle_between(out[2], out[3])
