"""The compiled part of `raytrace.visibility.extremes`: the best sample of each of several groups."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.compiled import compiled

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@compiled(nogil=True, _nrt=False)
def _best(which, values, inside, top, height, least, most):
    for n in range(which.size):
        c, value = which[n], values[n]
        if not abs(value) < np.inf:
            continue
        least[c], most[c] = min(least[c], value), max(most[c], value)
        if inside[n] and value > height[c]:
            height[c], top[c] = value, n


def best_samples(which: Index, values: Array, inside: NDArray[np.bool_], count: int) -> tuple[Index, Array, Array]:
    """Find the largest of the finite values that count in each group, the first of equal ones.

    Parameters
    ----------
    which : (n,), the group of each sample.   values : (n,).   inside : (n,), whether it counts.   count : of groups, m.

    Returns
    -------
    top : (m,), the sample.   height : (m,), its value, −∞ without one.
    change : (m,), by how much the finite values of the group differ, of those that count and others.
    """
    top, height = np.zeros(count, dtype=np.intp), np.full(count, -np.inf)
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    _best(which, values, inside, top, height, least, most)
    return top, height, most - least
