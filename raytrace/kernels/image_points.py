"""What Newton for image points does ray by ray, and the differentials of reflected rays that it goes by.

All vectors are in mirror coordinates.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.compiled import compiled, inner

Array = NDArray[np.float64]


@compiled(nogil=True)
def normals_between(rays: Array, directions: Array, normals: Array) -> None:
    """Write the unit normals that turn rays into the reflected directions.

    Parameters
    ----------
    rays, directions : (n, 3), unit.
    normals : (n, 3), what is written.
    """
    for n in range(rays.shape[0]):
        x, y, z = (directions[n, 0] - rays[n, 0], directions[n, 1] - rays[n, 1], directions[n, 2] - rays[n, 2])
        length = np.sqrt(x * x + y * y + z * z)
        normals[n, 0], normals[n, 1], normals[n, 2] = x / length, y / length, z / length


@compiled(nogil=True)
def reflected_differentials(eye: Array, rays: Array, turns: Array, points: Array, normals: Array, tensors: Array,
                            by_points: Array, by_directions: Array) -> None:
    """Write how points and directions of reflected rays change with the rays.

    dP = t·(δ − ω·(n·δ)/(n·ω)) and dd = δ − 2(δ·n + ω·dn)·n − 2(ω·n)·dn, dn = N·dP, of turns δ of rays ω.

    Parameters
    ----------
    eye : (3,), mm.
    rays, turns : (n, 3), unit, and (n, k, 3).
    points, normals : (n, 3), mm and unit, where the rays are reflected.
    tensors : (n, 3, 3), N, 1/mm.
    by_points, by_directions : (n, k, 3), what is written.
    """
    step, bent = np.empty(3), np.empty(3)
    for n in range(rays.shape[0]):
        along = path = 0.0
        for c in range(3):
            along += rays[n, c] * normals[n, c]
            path += (points[n, c] - eye[c]) ** 2
        path = np.sqrt(path)
        for k in range(turns.shape[1]):
            leaning = 0.0
            for c in range(3):
                leaning += turns[n, k, c] * normals[n, c]
            for c in range(3):
                step[c] = path * (turns[n, k, c] - rays[n, c] * (leaning / along))
                by_points[n, k, c] = step[c]
            twice = leaning
            for c in range(3):
                bent[c] = tensors[n, c, 0] * step[0] + tensors[n, c, 1] * step[1] + tensors[n, c, 2] * step[2]
                twice += bent[c] * rays[n, c]
            for c in range(3):
                by_directions[n, k, c] = turns[n, k, c] - 2.0 * twice * normals[n, c] - 2.0 * along * bent[c]


@compiled(nogil=True)
def rays_through(eye: Array, at: Array, rays: Array, turns: Array) -> None:
    """Write the unit rays from the eye through points of the plane z = 0, and their derivatives by these.

    Parameters
    ----------
    eye : (3,), mm.
    at : (n, 2), mm.
    rays, turns : (n, 3) and (n, 2, 3), 1/mm, what is written.
    """
    for n in range(at.shape[0]):
        x, y, z = at[n, 0] - eye[0], at[n, 1] - eye[1], -eye[2]
        length = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / length, y / length, z / length
        rays[n, 0], rays[n, 1], rays[n, 2] = x, y, z
        turns[n, 0, 0], turns[n, 0, 1], turns[n, 0, 2] = (1.0 - x * x) / length, -x * y / length, -x * z / length
        turns[n, 1, 0], turns[n, 1, 1], turns[n, 1, 2] = -x * y / length, (1.0 - y * y) / length, -y * z / length


@inner(fastmath={"contract"})
def smallest_axis(eye, wanted, n, at_infinity):
    """The coordinate in which target n is nearest to the eye: misses are measured from it, for all rays to one target."""
    least, size = 0, np.inf
    for c in range(3):
        far = abs(wanted[n, c] if at_infinity else wanted[n, c] - eye[c])
        if far < size:
            least, size = c, far
    return least


@inner(fastmath={"contract"})
def miss_of(wanted, n, at_infinity, point, direction, least, miss, axes):
    """`misses` of one ray into miss (2,) and axes (9,), of which the last three are τ; its reach."""
    to_x, to_y, to_z = wanted[n, 0], wanted[n, 1], wanted[n, 2]
    if not at_infinity:
        to_x, to_y, to_z = to_x - point[0], to_y - point[1], to_z - point[2]
    length = np.sqrt(to_x * to_x + to_y * to_y + to_z * to_z)
    axes[6], axes[7], axes[8] = to_x / length, to_y / length, to_z / length
    along = axes[6] * direction[0] + axes[7] * direction[1] + axes[8] * direction[2]
    a, b = (least + 1) % 3, (least + 2) % 3
    across = np.sqrt(axes[6 + a] * axes[6 + a] + axes[6 + b] * axes[6 + b])
    axes[least], axes[a], axes[b] = 0.0, axes[6 + b] / across, -axes[6 + a] / across
    for c in range(3):
        i, j = (c + 1) % 3, (c + 2) % 3
        axes[3 + c] = axes[6 + i] * axes[j] - axes[6 + j] * axes[i]
    miss[0] = miss[1] = np.nan
    if along > 0.0:
        for k in range(2):
            miss[k] = axes[3 * k] * direction[0] + axes[3 * k + 1] * direction[1] + axes[3 * k + 2] * direction[2]
    return 0.0 if at_infinity else along / length


@compiled(nogil=True)
def misses(eye: Array, wanted: Array, at_infinity: bool, points: Array, directions: Array, missed: Array, axes: Array,
           reach: Array) -> None:
    """By what angles, about, rays pass their targets: missed (n, 2), NaN where they are not reflected or leave it behind.

    axes (n, 2, 3) : across τ = (T − P)/|T − P|, that misses are measured along.   reach (n,) : (d·τ)/|T − P|, 1/mm.
    """
    across = np.empty(9)
    for n in range(wanted.shape[0]):
        reach[n] = miss_of(wanted, n, at_infinity, points[n], directions[n], smallest_axis(eye, wanted, n, at_infinity),
                           missed[n], across)
        for k in range(2):
            for c in range(3):
                axes[n, k, c] = across[3 * k + c]


@inner(fastmath={"contract"})
def newton_step(s00, s01, s10, s11, missed, longest, step):
    """`newton_steps` of one ray whose misses change by (s00, s10) and (s01, s11)."""
    determinant = s00 * s11 - s01 * s10
    x = (s01 * missed[1] - s11 * missed[0]) / determinant
    y = (s10 * missed[0] - s00 * missed[1]) / determinant
    length = np.sqrt(x * x + y * y)
    if length < np.inf:
        shorter = longest / length if length > longest else 1.0
        step[0], step[1] = shorter * x, shorter * y


@compiled(nogil=True)
def newton_steps(missed: Array, axes: Array, reach: Array, by_points: Array, by_directions: Array, longest: float,
                 steps: Array) -> None:
    """Write the steps of Newton, no longer than `longest`; where the derivatives fail, steps stay as they are.

    The misses s·d along the axes s change by s·(∂d + (d·τ)·∂P/|T − P|).

    Parameters
    ----------
    missed, axes, reach : (n, 2), (n, 2, 3) and (n,), as `misses` writes them.
    by_points, by_directions : (n, 2, 3), derivatives by the points of the plane.
    longest : mm.
    steps : (n, 2), mm, what is written.
    """
    slopes = np.empty((2, 2))
    for n in range(missed.shape[0]):
        for k in range(2):
            for i in range(2):
                slopes[k, i] = 0.0
                for c in range(3):
                    slopes[k, i] += axes[n, k, c] * (by_directions[n, i, c] + reach[n] * by_points[n, i, c])
        newton_step(slopes[0, 0], slopes[0, 1], slopes[1, 0], slopes[1, 1], missed[n], longest, steps[n])


@compiled(nogil=True)
def nearest_rays(wanted: Array, at_infinity: bool, points: Array, directions: Array, nearest: NDArray[np.intp]) -> None:
    """Write which of m rays goes most nearly towards each of n targets.

    Parameters
    ----------
    wanted : (n, 3), mm, the targets; or unit directions.
    at_infinity : whether they are directions.
    points, directions : (m, 3), mm and unit, of the rays.
    nearest : (n,), what is written.
    """
    for n in range(wanted.shape[0]):
        best, nearest[n] = -np.inf, 0
        for m in range(points.shape[0]):
            x, y, z = wanted[n, 0], wanted[n, 1], wanted[n, 2]
            if not at_infinity:
                x, y, z = x - points[m, 0], y - points[m, 1], z - points[m, 2]
            along = x * directions[m, 0] + y * directions[m, 1] + z * directions[m, 2]
            if not at_infinity:
                along /= np.sqrt(x * x + y * y + z * z)
            if along > best:
                best, nearest[n] = along, m


@compiled(nogil=True)
def keep_best(going: NDArray[np.intp], missed: Array, at: Array, points: Array, settled: float, passes: float, best: Array,
              kept: Array, leaving: Array, steps: Array, moving: NDArray[np.int8]) -> int:
    """Keep what is better of the rays of an index, and say what becomes of each.

    0 : it is settled.   1 : it takes a step of Newton from here.   2 : it was no better, and takes half the step before, in
    `steps`, from the best.

    Parameters
    ----------
    going : (m,), the rays' numbers.
    missed, at, points : (m, 2), (m, 2) and (m, 3), by what angles they miss, where they are, and where they leave.
    settled, passes : radians, below which a ray is settled, and does as it is.
    best, kept, leaving : (n,), (n, 2) and (n, 3), of all rays the best so far.
    steps : (m, 2), which are halved.
    moving : (m,), what is written.

    Returns
    -------
    How many take a step of Newton.
    """
    count = 0
    for m in range(going.size):
        n = going[m]
        now = np.sqrt(missed[m, 0] ** 2 + missed[m, 1] ** 2)
        if now < best[n]:  # not where it is NaN
            best[n] = now
            kept[n, 0], kept[n, 1] = at[m, 0], at[m, 1]
            leaving[n, 0], leaving[n, 1], leaving[n, 2] = points[m, 0], points[m, 1], points[m, 2]
            moving[m] = 0 if now <= settled else 1
            count += moving[m]
        else:
            moving[m] = 0 if best[n] <= passes else 2
        steps[m, 0], steps[m, 1] = 0.5 * steps[m, 0], 0.5 * steps[m, 1]
    return count
