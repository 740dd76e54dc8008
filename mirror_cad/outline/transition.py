"""The line that parts a mirror's aspheric part from its main part: where it meets the outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirror_cad.errors import SpecError
from mirror_cad.outline.record import Outline

CHORD_MM = 1e-6  # of the polygon that the line is cut off at: its ends are right to this
TRANSITION_LINE = "transition line"  # what STEP files call the curve
TRANSITION_LAYER = "TRANSITION"  # of drawings


@dataclass(frozen=True, slots=True)
class TransitionLine:
    """The line x = x_mm from (x_mm, low_mm) to (x_mm, high_mm) on the outline, mm."""

    x_mm: float
    low_mm: float
    high_mm: float


def transition_line(outline: Outline, x_mm: float) -> TransitionLine:
    """Find where an upright line cuts an outline into two parts.

    Parameters
    ----------
    outline : Outline
        In (x, y), mm.
    x_mm : float
        Of the line.

    Returns
    -------
    TransitionLine

    Raises
    ------
    SpecError
        For a line beside the outline, or one that meets it more than twice.
    """
    a = outline.polyline(CHORD_MM)
    b = np.roll(a, -1, axis=0)
    cut = (a[:, 0] > x_mm) != (b[:, 0] > x_mm)
    a, b = a[cut], b[cut]
    y = np.sort(a[:, 1] + (x_mm - a[:, 0]) / (b - a)[:, 0] * (b - a)[:, 1])
    if len(y) != 2:
        x_min, x_max, _, _ = outline.bounding_box()
        what = "lies beside the outline" if len(y) == 0 else f"meets the outline {len(y)} times, and cuts it into more than two"
        raise SpecError(f"part.transition_mm = {x_mm:g} {what}: the outline reaches from x = {x_min:.1f} to {x_max:.1f} mm")
    return TransitionLine(x_mm, float(y[0]), float(y[1]))
