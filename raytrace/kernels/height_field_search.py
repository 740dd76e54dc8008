"""The first place where any ray meets a height field z(x, y): by steps that cannot pass a root, in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import (
    DX,
    DY,
    DZ,
    NX,
    NY,
    NZ,
    RX,
    RY,
    RZ,
    Results,
    T,
    X,
    Y,
    Z,
    store,
    unit,
    work,
)
from raytrace.kernels.cells import PADDED_POWERS, taylor
from raytrace.kernels.compiled import compiled
from raytrace.kernels.height_field import HeightField
from raytrace.kernels.outcomes import ACCEPTED, BEHIND, HIT, INVALID, LOST, NEAREST_MM, OUTSIDE, RESIDUAL
from raytrace.kernels.trimming import Strips, inside

Array = NDArray[np.float64]

MAX_STEPS = 400  # a ray along the surface takes the most


def _kernel(powers):
    """The kernel for `powers` = degree + 1 in both directions."""
    @compiled(nogil=True, fastmath={"contract"}, _nrt=False)
    def first_hits(w, q, state, field, strips, one_sided, origins, directions, results):
        cells, bottom, top = field.cells, field.bottom, field.top
        ends_x, ends_y = cells.ends_u, cells.ends_v
        for n in range(directions.size // 3):
            k = 0 if origins.size == 3 else 3 * n
            ox, oy, oz = origins[k], origins[k + 1], origins[k + 2]
            state[0] = INVALID
            if abs(ox) + abs(oy) + abs(oz) < np.inf and unit(directions, n, w, 0):
                dx, dy, dz = w[DX], w[DY], w[DZ]
                state[0] = OUTSIDE
                # The part of the ray within the sheet's box.
                near, far = NEAREST_MM, np.inf
                for o, d, from_, to in ((ox, dx, ends_x[0], ends_x[-2]), (oy, dy, ends_y[0], ends_y[-2]),
                                        (oz, dz, bottom, top)):
                    if d == 0.0:
                        if not from_ <= o <= to:
                            far = -np.inf
                    else:
                        a, b = (from_ - o) / d, (to - o) / d
                        near, far = max(near, min(a, b)), min(far, max(a, b))
                most = field.bend * (dx * dx + dy * dy) + 1e-300
                t = near
                limit = RESIDUAL * (abs(ox) + abs(oy) + abs(oz) + abs(far) + abs(top) + abs(bottom))
                for _ in range(MAX_STEPS):
                    if not t <= far:
                        break
                    x, y = ox + t * dx, oy + t * dy
                    taylor(powers, cells, x, y, q)
                    above = oz + t * dz - q[0]
                    rise = dz - q[1] * dx - q[2] * dy
                    steep = np.sqrt(1.0 + q[1] * q[1] + q[2] * q[2])
                    if abs(above) <= ACCEPTED * limit * steep:
                        if rise != 0.0:  # the last step is Newton's
                            t -= above / rise
                            x, y = ox + t * dx, oy + t * dy
                            taylor(powers, cells, x, y, q)
                            steep = np.sqrt(1.0 + q[1] * q[1] + q[2] * q[2])
                        if inside(strips, x, y):
                            state[0] = BEHIND if one_sided and rise >= 0.0 else HIT
                            w[X], w[Y], w[Z], w[T] = x, y, oz + t * dz, t
                            turn = -1.0 if rise >= 0.0 else 1.0
                            w[NX], w[NY], w[NZ] = -turn * q[1] / steep, -turn * q[2] / steep, turn / steep
                            break
                        # Trimmed away: on behind it, where the distance is no rounding any more.
                        t += max(1e3 * ACCEPTED * limit * steep / max(abs(rise), 1e-6), NEAREST_MM)
                        continue
                    # As far as the bound on f'' leaves f without a root: nearly a step of Newton's, and never past the root.
                    side = 1.0 if above > 0.0 else -1.0
                    slope = side * rise
                    root = np.sqrt(slope * slope + 2.0 * most * abs(above))
                    t += 2.0 * abs(above) / (root - slope) if slope < 0.0 else (slope + root) / most
                else:
                    state[0] = LOST
            twice = 2.0 * (w[DX] * w[NX] + w[DY] * w[NY] + w[DZ] * w[NZ])
            w[RX], w[RY], w[RZ] = w[DX] - twice * w[NX], w[DY] - twice * w[NY], w[DZ] - twice * w[NZ]
            store(w, state, n, 1, results)

    return first_hits


_KERNELS = {powers: _kernel(powers) for powers in PADDED_POWERS}


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
    rows, state, paraboloid = work()
    _KERNELS[field.cells.powers](rows, paraboloid, state, field, strips, one_sided, origins, directions, results)
