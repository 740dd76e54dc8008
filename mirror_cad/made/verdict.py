"""What a measurement says of a limit: pass, fail, or neither, at 95 %."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from mirror_cad.made.fields import DeviationFields

Array = NDArray[np.float64]
Outcome = Literal["pass", "fail", "undecided"]

LEVEL = 0.95
UNKNOWN = 0.01  # of the places that the gauge fits on: more of them unknown, and nothing passes
DIRECTIONS = 3.0  # curvatures of a place that are told independently


@dataclass(frozen=True, slots=True)
class Verdict:
    """The outcome of k1 and k2 against a limit in percent.

    Attributes
    ----------
    outcome : str
        "pass": at every place the deviation is below the limit at 95 %, and every place is known. "fail": at some place it is
        beyond, at 95 % for all places together. Else "undecided".
    limit_percent : float
        Asked for.
    surely_percent, possibly_percent : float or None
        The largest deviation that is there at 95 % for all places together, and the largest that may be there at 95 % of its
        place; None without a known place.
    known_share : float
        Of the places that the gauge fits on.
    """

    outcome: Outcome
    limit_percent: float
    surely_percent: float | None
    possibly_percent: float | None
    known_share: float


def verdict(fields: DeviationFields, limit_percent: float) -> Verdict:
    """Judge k1 and k2.

    A mirror passes where each place does: no correction for their number is needed (intersection-union). It fails by its worst
    place, which noise alone pushes up with their number: as many as gauges fit on the mirror (Bonferroni).

    Parameters
    ----------
    fields : DeviationFields
        Of a design that is no plane.
    limit_percent : float
        Of the local designed value.
    """
    known = fields.known
    share = float(known.sum() / max(1, int(fields.fits.sum())))
    if not known.any():
        return Verdict("undecided", limit_percent, None, None, share)
    lattice = fields.lattice
    apart = max(1.0, known.sum() * lattice.cell_mm2 / (0.25 * np.pi * fields.gauge_mm**2))
    alone, together = norm.ppf(LEVEL), norm.ppf(1.0 - (1.0 - LEVEL) / (2.0 * DIRECTIONS * apart))
    surely, possibly = 0.0, 0.0
    for quantity in ("k1", "k2"):
        value, sigma = fields.percent(quantity)  # type: ignore[arg-type]
        surely = max(surely, float((np.abs(value) - together * sigma)[known].max()))
        possibly = max(possibly, float((np.abs(value) + alone * sigma)[known].max()))
    outcome: Outcome = ("fail" if surely > limit_percent else
                        "pass" if possibly < limit_percent and share >= 1.0 - UNKNOWN else "undecided")
    return Verdict(outcome, limit_percent, surely, possibly, share)
