"""One radius everywhere."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np

from mirror_cad.keys import RadiusOrFlat, Shown
from mirror_cad.laws.base import Law
from mirror_cad.laws.curvature import CurvatureLaw, Span
from mirror_cad.laws.words import radius_in_words


class Constant(Law):
    """κ = 1/R.

    Attributes
    ----------
    radius_mm : float
        R, mm; inf is flat, a negative radius concave.
    """

    law: Literal["constant"] = "constant"
    radius_mm: Annotated[RadiusOrFlat, Shown("{axis} everywhere", 20.0, 3000.0, 5.0, 1, start="$right", drag="everywhere")]

    @property
    def radius_everywhere_mm(self) -> float | None:
        """R, mm."""
        return self.radius_mm

    def over(self, span: Span) -> CurvatureLaw:
        """Make κ(x), 1/mm, convex positive, with t = 0 and 1 where `span` has them."""
        return CurvatureLaw(lambda x: np.full(np.shape(x), 1.0 / self.radius_mm), (), "constant law")

    def scaled(self, factor: float) -> Self:
        """Make the law whose radii are `factor` times as large everywhere."""
        return self.model_copy(update={"radius_mm": factor * self.radius_mm})

    def in_words(self, solved: float | None = None) -> str:
        """Say the law in a few words for a table."""
        return radius_in_words(self.radius_mm)
