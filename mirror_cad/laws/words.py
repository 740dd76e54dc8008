"""How the numbers of a law are written in a sentence."""

from __future__ import annotations

import math


def plain(value: float) -> str:
    """Write a number as its writer gave it: 1250, 0.5, −2000."""
    return f"{value:.10g}".replace("-", "−")


def radius_in_words(radius_mm: float) -> str:
    """Say a radius of curvature: “950 mm”, “−2000 mm (concave)”, “flat”."""
    if math.isinf(radius_mm):
        return "flat"
    return f"{plain(radius_mm)} mm{' (concave)' if radius_mm < 0 else ''}"
