"""Which way round a mirror shows things, and whether it shows any of them twice."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raytrace.viewing.ray_differentials import frame, ray_differentials
from raytrace.viewing.view import View, mirror_grid
from raytrace.visibility.edge_of import edge_of

Array = NDArray[np.float64]
Sense = Literal["upright", "inverted", "reversed", "mixed"]

COLUMNS, ROWS = 17, 25  # places over the mirror
ON_EDGE = 128  # and along its edge
FLAT = 1e-6  # below 1: a flat mirror's eigenvalues are 1 but for differences of exact rays


@dataclass(frozen=True, slots=True)
class Orientation:
    """How a mirror shows far things beside a flat mirror in its place.

    Attributes
    ----------
    sense : "upright", the same way round; "inverted", upside down and left for right; "reversed", turned over in one direction
        only; "mixed", one here and another there.
    twice : whether some directions are shown at two points or more.
    converging : whether it enlarges anything: where it does, turning it may make it show something twice.
    """

    sense: Sense
    twice: bool
    converging: bool


@lru_cache(maxsize=8)
def orientation(view: View) -> Orientation:
    """Tell how a mirror shows far things, by the signs of the two eigenvalues of S⁻¹·∂d/∂ω over all that the eye sees.

    S is what ∂d/∂ω is for a flat mirror there; for a bare one S⁻¹·∂d/∂ω = 1 + 2a·cos β·TᵀWT, whose eigenvalues are above 1
    where the mirror is convex. Where it is concave and the eye farther
    away than about its focal length, 1/(2κ), one or both are below 0. Where one is 0 the mirror folds: the directions
    to one side of that line are shown by both sides of the mirror, those to the other side not at all. A field or a piece of
    ground that is bounded by the mirror's edge elsewhere is bounded by that line there, so what is measured by the edge
    (`eye_fields`, `plan`) and by the inverse ray (`raytrace.visibility.image_points`) does not hold for such a mirror.
    Looked at on a grid of 17 × 25 points, and at 128 of the edge. Not looked at is whether several faces show the same.

    Parameters
    ----------
    view : the mirror as the eye sees it.

    Returns
    -------
    Orientation

    References
    ----------
    docs/derivations/what-the-eye-sees.md
    """
    view = view.interpolated
    _, _, on_plane = mirror_grid(view, COLUMNS, ROWS)
    least, most = (np.concatenate(both)
                   for both in zip(_eigenvalues(view, on_plane.reshape(-1, 2)), _on_edge(view), strict=True))
    known = np.isfinite(least)
    signs = {(bool(a > 0.0), bool(b > 0.0)) for a, b in zip(least[known], most[known], strict=True)}
    senses: dict[tuple[bool, bool], Sense] = {(True, True): "upright", (False, False): "inverted", (False, True): "reversed"}
    sense: Sense = "mixed" if len(signs) > 1 else senses[signs.pop()] if signs else "upright"
    return Orientation(sense, sense == "mixed", bool((least[known] < 1.0 - FLAT).any()))


def _on_edge(view: View) -> tuple[Array, Array]:
    edge = edge_of(view)
    return _eigenvalues(edge.view, edge.on_plane[::max(1, len(edge.on_plane) // ON_EDGE)])


def _eigenvalues(view: View, on_plane: Array) -> tuple[Array, Array]:
    """The smaller and the larger eigenvalue of S⁻¹·∂d/∂ω at places (n, 2); NaN where nothing is shown."""
    looked, traced = view.towards(on_plane), view.trace_points(on_plane)
    normal = traced.directions - looked
    with np.errstate(invalid="ignore"):
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        before, after = (np.stack(frame(senses), axis=1) for senses in (looked, traced.directions))
        flat = after @ (before - 2.0 * np.einsum("nij,nj->ni", before, normal)[:, :, None] * normal[:, None]).transpose(0, 2, 1)
        beside = flat.transpose(0, 2, 1) @ ray_differentials(view, on_plane).jacobian  # S is orthogonal
        middle = 0.5 * np.trace(beside, axis1=1, axis2=2)
        apart = np.sqrt(np.maximum(middle * middle - np.linalg.det(beside), 0.0))
    return middle - apart, middle + apart
