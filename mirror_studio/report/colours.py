"""Scales of colours that colour-blind people can tell apart, and that stay ordered in grey: the studio's own."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Stops = tuple[str, ...]

# Viridis (van der Walt and Smith), nine of its colours; and blue to orange through a light grey.
VIRIDIS: Stops = ("#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725")
BLUE_ORANGE: Stops = ("#1c3f84", "#2f69ad", "#6ba0cf", "#b4cfe4", "#efefec", "#f3cfa0", "#e79c4c", "#c4691c", "#8a3f08")
COLOURS = 256  # of a scale: one a byte


@cache
def palette(stops: Stops) -> bytes:
    """Red, green and blue of COLOURS colours from the first stop to the last, linear between stops."""
    parts = np.array([[int(stop[k: k + 2], 16) for k in (1, 3, 5)] for stop in stops], dtype=np.float64)
    at = np.linspace(0.0, len(stops) - 1.0, COLOURS)
    mixed = np.stack([np.interp(at, np.arange(len(stops)), parts[:, k]) for k in range(3)], axis=1)
    return np.round(mixed).astype(np.uint8).tobytes()


def indices(values: Array, low: float, high: float) -> NDArray[np.uint8]:
    """Which colour of a scale from `low` to `high` each value has; what is not a number has the first."""
    share = np.clip((np.nan_to_num(values, nan=low) - low) / (high - low), 0.0, 1.0)
    return np.minimum(COLOURS * share, COLOURS - 1.0).astype(np.uint8)
