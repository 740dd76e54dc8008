"""Median times, observed orders of convergence and floors."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

RUNS = 5
BUDGET_S = 1.5  # for one figure: what takes longer is run once, so that the whole benchmark stays at minutes
# A smaller step that gains less than this in the exponent gains nothing: no error here falls slower than the cube root.
STALLED = 0.2
ABOVE_FLOOR = 10.0  # times: closer to the floor the error is no longer the method's alone
FINEST = 4  # steps that an order is fitted to: coarser ones have not reached it yet


@dataclass(frozen=True, slots=True)
class Convergence:
    """error ∝ step^order, fitted to the finest steps above the floor; each None where the errors do not show it."""

    order: float | None
    floor: float | None


def median_seconds(work: Callable[[], Any]) -> float:
    """Median time of up to RUNS runs within BUDGET_S, after one that warms up (and alone counts where it is too long)."""
    times: list[float] = []
    while len(times) <= RUNS and sum(times) < BUDGET_S:
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:] or times)


def convergence(steps: Sequence[float], errors: Sequence[float]) -> Convergence:
    """Order by a straight line through log error over log step; floor where a smaller step no longer helps.

    steps : falling.
    """
    h, e = np.asarray(steps, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    best = int(np.argmin(e))
    last_gain = np.log(e[-1] / e[-2]) / np.log(h[-1] / h[-2])
    floor = float(e[best]) if best < len(e) - 1 or last_gain < STALLED else None
    use = np.arange(len(e)) <= best
    if floor is not None:
        use &= e > ABOVE_FLOOR * floor
    h, e = h[use][-FINEST:], e[use][-FINEST:]
    order = float(np.polyfit(np.log(h), np.log(e), 1)[0]) if len(h) >= 2 else None
    return Convergence(order, floor)
