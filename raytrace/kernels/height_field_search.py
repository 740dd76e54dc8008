"""The first place where any ray meets a height field z(x, y): by steps that cannot pass a root, in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import blocks
from raytrace.kernels.blocks import Results, store, unit, work
from raytrace.kernels.cells import Z_X, Z_Y, Z, taylor_of_any
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.height_field import HeightField
from raytrace.kernels.outcomes import ACCEPTED, BEHIND, HIT, INVALID, LOST, NEAREST_MM, OUTSIDE, RESIDUAL
from raytrace.kernels.trimming import Strips, inside

Array = NDArray[np.float64]

MAX_STEPS = 400  # a ray along the surface takes the most
# What is known of the point where a ray meets the sheet, as offsets after what `taylor` tells of it: distance, mm, the
# point, and how fast the ray rises over the sheet.
HIT_T, HIT_X, HIT_Y, HIT_Z, RISE = range(8, 13)
KNOWN = 13  # numbers


@inner(fastmath={"contract"})
def search(field, strips, one_sided, ox, oy, oz, dx, dy, dz, q):
    """What a ray, from where and in what unit direction, meets first: its status, and what is known of that point in q."""
    ends_x, ends_y = field.cells.ends_u, field.cells.ends_v
    # The part of the ray within the sheet's box.
    near, far = NEAREST_MM, np.inf
    for o, d, from_, to in ((ox, dx, ends_x[0], ends_x[-2]), (oy, dy, ends_y[0], ends_y[-2]),
                            (oz, dz, field.bottom, field.top)):
        if d == 0.0:
            if not from_ <= o <= to:
                far = -np.inf
        else:
            a, b = (from_ - o) / d, (to - o) / d
            near, far = max(near, min(a, b)), min(far, max(a, b))
    most = field.bend * (dx * dx + dy * dy) + 1e-300
    t = near
    limit = RESIDUAL * (abs(ox) + abs(oy) + abs(oz) + abs(far) + abs(field.top) + abs(field.bottom))
    for _ in range(MAX_STEPS):
        if not t <= far:
            return OUTSIDE
        x, y = ox + t * dx, oy + t * dy
        taylor_of_any(field.cells, x, y, q)
        above = oz + t * dz - q[Z]
        rise = dz - q[Z_X] * dx - q[Z_Y] * dy
        steep = np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
        if abs(above) <= ACCEPTED * limit * steep:
            if rise != 0.0:  # the last step is Newton's
                t -= above / rise
                x, y = ox + t * dx, oy + t * dy
                taylor_of_any(field.cells, x, y, q)
                steep = np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
            if inside(strips, x, y):
                q[HIT_T], q[HIT_X], q[HIT_Y], q[HIT_Z], q[RISE] = t, x, y, oz + t * dz, rise
                return BEHIND if one_sided and rise >= 0.0 else HIT
            # Trimmed away: on behind it, where the distance is no rounding any more.
            t += max(1e3 * ACCEPTED * limit * steep / max(abs(rise), 1e-6), NEAREST_MM)
            continue
        # As far as the bound on f'' leaves f without a root: nearly a step of Newton's, and never past the root.
        side = 1.0 if above > 0.0 else -1.0
        slope = side * rise
        root = np.sqrt(slope * slope + 2.0 * most * abs(above))
        t += 2.0 * abs(above) / (root - slope) if slope < 0.0 else (slope + root) / most
    return LOST


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _first_hits(w, q, state, field, strips, one_sided, origins, directions, results):
    for n in range(directions.size // 3):
        k = 0 if origins.size == 3 else 3 * n
        ox, oy, oz = origins[k], origins[k + 1], origins[k + 2]
        state[0] = INVALID
        if abs(ox) + abs(oy) + abs(oz) < np.inf and unit(directions, n, w, 0):
            dx, dy, dz = w[blocks.DX], w[blocks.DY], w[blocks.DZ]
            state[0] = search(field, strips, one_sided, ox, oy, oz, dx, dy, dz, q)
            turn = -1.0 if q[RISE] >= 0.0 else 1.0
            steep = np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
            nx, ny, nz = -turn * q[Z_X] / steep, -turn * q[Z_Y] / steep, turn / steep
            twice = 2.0 * (dx * nx + dy * ny + dz * nz)
            w[blocks.T], w[blocks.X], w[blocks.Y], w[blocks.Z] = q[HIT_T], q[HIT_X], q[HIT_Y], q[HIT_Z]
            w[blocks.NX], w[blocks.NY], w[blocks.NZ] = nx, ny, nz
            w[blocks.RX], w[blocks.RY], w[blocks.RZ] = dx - twice * nx, dy - twice * ny, dz - twice * nz
        store(w, state, n, 1, results)


def first_hits(field: HeightField, strips: Strips, one_sided: bool, origins: Array, directions: Array, results: Results,
               ) -> None:
    """Find the first place where a ray meets a height field, from above or below and however grazing.

    With |f''| ≤ bend·(d_x² + d_y²) there is no root of f before t + s, where |f| + f'·s − bend·(d_x² + d_y²)·s²/2 = 0: steps
    of that length run to the first root and cannot pass it, one ray at a time.

    Parameters
    ----------
    field, strips, origins, directions, results : as in `raytrace.kernels.height_field.hits`.
    one_sided : whether rays that arrive from below are BEHIND.
    """
    rows, state, _ = work()
    _first_hits(rows, np.zeros(KNOWN), state, field, strips, one_sided, origins, directions, results)
