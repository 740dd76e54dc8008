"""Labelled segments in mirror coordinates: what the readers of both drawing formats share."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import FULL_TURN, LARGEST, point_text
from mirror_cad.outline.segments import Arc, Segment, Spline


class Piece(NamedTuple):
    """One segment in mirror coordinates, and what it was in the file."""

    segment: Segment
    label: str


def elliptic_arc(centre: ArrayLike, u: ArrayLike, v: ArrayLike, start: float, sweep: float) -> Segment:
    """centre + cos(a) u + sin(a) v for a from `start` over `sweep`: an `Arc`, or a rational quadratic `Spline`.

    Between the angles a - h and a + h the conic has the inner pole centre + (cos(a) u + sin(a) v) / cos(h) of weight cos(h);
    pieces of at most a quarter turn keep the weights at 0.7 and above.

    Parameters
    ----------
    centre, u, v : tuple
        (x, y), mm.
    start, sweep : float
        Radians.
    """
    c, u, v = (np.asarray(value, dtype=float) for value in (centre, u, v))
    if not max(np.abs(value).max() for value in (c, u, v)) <= LARGEST:
        raise OutlineError(f"an ellipse about {point_text(c)} has half axes beyond {LARGEST:g} mm: check its numbers")
    cross = u[0] * v[1] - u[1] * v[0]
    length_u, length_v = math.hypot(*u), math.hypot(*v)
    if not (math.isfinite(cross) and abs(cross) > 1e-12 * max(length_u, length_v) ** 2):
        raise OutlineError(f"the ellipse about {point_text(c)} is flat, with half axes {length_u:.6g} and {length_v:.6g} mm")
    if abs(float(u @ v)) <= 1e-12 * abs(cross) and abs(length_u - length_v) <= 1e-12 * length_u:
        turn = math.copysign(1.0, cross)
        return Arc((c[0], c[1]), length_u, math.atan2(u[1], u[0]) + turn * start, turn * sweep)
    count = max(1, math.ceil(abs(sweep) / (0.5 * math.pi) - 1e-9))
    half = 0.5 * sweep / count
    angles = start + half * np.arange(2 * count + 1)
    weights = np.ones(2 * count + 1)
    weights[1::2] = math.cos(half)
    poles = c + (np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v) / weights[:, None]
    if abs(sweep) >= FULL_TURN * (1.0 - 1e-15):
        poles[-1] = poles[0]
    knots = np.concatenate([[0.0], np.repeat(np.arange(count + 1.0), 2), [count]])
    return Spline(2, knots, poles, weights)
