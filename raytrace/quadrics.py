"""Rays and a trimmed plane, sphere or cylinder in, where each ray meets it in closed form out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_cad.quadric import Quadric
from raytrace.newton import NEAREST_MM
from raytrace.trimming import Trimming

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
SEAM = 1e-12  # radians beside a seam or pole, which is less than any place is known


@dataclass(frozen=True, eq=False)
class TrimmedQuadric:
    """A quadric inside trimming loops (closed polygons in its (u, v), even-odd), S_u × S_v times `sign` outward.

    one_sided : whether only the outward side reflects.
    """

    quadric: Quadric
    loops: tuple[Array, ...]
    sign: float = 1.0
    one_sided: bool = True

    @cached_property
    def trimming(self) -> Trimming:
        """The loops as the kernels take them."""
        return Trimming.of(self.loops)

    def outline(self) -> Array:
        """Points of the loops (n, 3), mm."""
        return np.concatenate([self.quadric.evaluate(*loop.T) for loop in self.loops])

    def untrimmed(self) -> TrimmedQuadric:
        """A part of the same quadric that reaches farther than its loops by half of their size, on every side."""
        u_min, u_max, v_min, v_max = self.trimming.box
        more_u, more_v = 0.5 * (u_max - u_min), 0.5 * (v_max - v_min)
        low, high, bottom, top = u_min - more_u, u_max + more_u, v_min - more_v, v_max + more_v
        if self.quadric.kind != "plane" and high - low > TURN:
            low, high = u_min, u_min + TURN
        if self.quadric.kind == "sphere":
            bottom, top = max(bottom, -0.5 * np.pi), min(top, 0.5 * np.pi)
        return replace(self, loops=(np.array([[low, bottom], [high, bottom], [high, top], [low, top]]),))

    def nearest(self, origins: Array, directions: Array) -> tuple[Array, Array, Array]:
        """Where rays from origins (n, 3) along unit directions (n, 3) first meet it inside its loops.

        Returns: distances (n,), inf for none; points (n, 3); outward unit normals (n, 3).
        """
        distances = np.full(len(directions), np.inf)
        points, normals = np.empty_like(directions), np.empty_like(directions)
        o, d = (origins - self.quadric.centre) @ self.quadric.axes.T, directions @ self.quadric.axes.T
        for t in _roots(self.quadric, o, d):
            # A NaN, a ray without this root, passes no comparison.
            index = np.flatnonzero((t > NEAREST_MM) & (t < distances))
            place = o[index] + t[index, None] * d[index]
            place, normal, u, v = _on(self.quadric, place)
            inside = self._inside(u, v)
            index = index[inside]
            distances[index] = t[index]
            points[index] = self.quadric.centre + place[inside] @ self.quadric.axes
            normals[index] = self.sign * np.linalg.det(self.quadric.axes) * normal[inside] @ self.quadric.axes
        return distances, points, normals

    def _inside(self, u: Array, v: Array) -> NDArray[np.bool_]:
        """Whether places lie inside the loops, whose u may run over several turns."""
        if self.quadric.kind == "plane":
            return self.trimming.contains(u, v)
        low, high = self.trimming.box[:2]
        u = low + np.mod(u - low, TURN)
        # The even-odd rule leaves out the upper edge; but a seam is no edge, nor is a pole.
        if high - low >= TURN - SEAM:
            u = np.minimum(u, low + TURN - SEAM)
        if self.quadric.kind == "sphere":
            v = np.minimum(v, 0.5 * np.pi - SEAM)
        inside = self.trimming.contains(u, v)
        for turn in range(1, int(np.ceil((high - low) / TURN - SEAM))):
            inside |= self.trimming.contains(u + turn * TURN, v)
        return inside


def _roots(quadric: Quadric, o: Array, d: Array) -> tuple[Array, ...]:
    """Distances along the ray at which it meets the whole quadric, nearer first, NaN for none; in the quadric's frame.

    For sphere and cylinder the discriminant is taken from the ray's distance q to the centre or axis, (R − q)(R + q): as
    the square of a root's difference it would lose half of the digits where the ray grazes.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        if quadric.kind == "plane":
            return (np.where(d[:, 2] != 0.0, -o[:, 2] / d[:, 2], np.nan),)
        columns = slice(0, 3 if quadric.kind == "sphere" else 2)
        o, d = o[:, columns], d[:, columns]
        squared = np.einsum("ij,ij->i", d, d)
        middle = -np.einsum("ij,ij->i", o, d) / squared
        foot = np.linalg.norm(o + middle[:, None] * d, axis=1)
        half = np.sqrt((quadric.radius_mm - foot) * (quadric.radius_mm + foot) / squared)
        start = np.linalg.norm(o, axis=1)
        product = (start - quadric.radius_mm) * (start + quadric.radius_mm) / squared
        # The root nearer to zero from the product of both: as a difference it would lose digits next to the surface.
        far = np.where(middle >= 0.0, middle + half, middle - half)
        near = np.where(far != 0.0, product / far, 0.0)
    return np.fmin(near, far), np.fmax(near, far)


def _on(quadric: Quadric, place: Array) -> tuple[Array, Array, Array, Array]:
    """Places (n, 3) that lie on it but for rounding: brought onto it; normals away from its centre; u; v."""
    x, y, z = place.T
    if quadric.kind == "plane":
        normal = np.zeros_like(place)
        normal[:, 2] = 1.0
        return np.stack([x, y, np.zeros_like(z)], axis=1), normal, x, y
    outward = place.copy()
    if quadric.kind == "cylinder":
        outward[:, 2] = 0.0
    normal = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    on = quadric.radius_mm * normal
    u = np.arctan2(y, x)
    if quadric.kind == "cylinder":
        on[:, 2] = z
        return on, normal, u, z
    return on, normal, u, np.arctan2(z, np.hypot(x, y))
