"""One line of the table of verdicts: a limit, what is held against it, and what is left."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from mirror_studio.rules.verdicts import Verdict as RuleVerdict

Point = tuple[float, float]
Side = Literal["size", "least", "most"]


@dataclass(frozen=True, slots=True)
class Requirement:
    """One line of the verdict table; limit is None where nothing is asked, actual NaN where it cannot be measured.

    Attributes
    ----------
    group
        "part", "view", "rules", "numerical" or "files".
    name, unit
        As the table shows them.
    limit, actual
        What is asked, and what is.
    point
        Where it is, (x, y) in mm.
    side
        Whether `limit` holds for the size of `actual`, which may be signed, or is the least or the most that it may be.
    ruled
        The verdict of a rule of the road on its whole line.
    """

    group: str
    name: str
    unit: str
    limit: float | None
    actual: float
    point: Point | None = None
    side: Side = "size"
    ruled: RuleVerdict | None = None

    @property
    def margin(self) -> float | None:
        """What is left of the limit; negative beyond it."""
        if self.limit is None or (self.ruled == "open" and math.isnan(self.actual)):
            return None
        return self.actual - self.limit if self.side == "least" else self.limit - self.size

    @property
    def size(self) -> float:
        """What is held against the limit: the actual value, or its size."""
        return abs(self.actual) if self.side == "size" else self.actual

    @property
    def met(self) -> bool | None:
        """Whether the limit is kept; None without one and where a rule leaves it open, False where nothing was measured."""
        if self.margin is None or self.ruled == "open":
            return None
        return self.ruled == "met" or (self.margin > 0.0 if self.ruled == "missed" else self.margin >= 0.0)
