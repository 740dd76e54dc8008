"""A radius that changes evenly from the right edge to the left."""

from __future__ import annotations

from typing import Literal

from mirror_cad.laws.curvature import CurvatureLaw, Span, over_t
from mirror_cad.laws.two_radii import TwoRadii


class Linear(TwoRadii):
    """R = right + (left − right)·t."""

    law: Literal["linear"] = "linear"

    def over(self, span: Span) -> CurvatureLaw:
        """Make κ(x), 1/mm, convex positive, with t = 0 and 1 where `span` has them."""
        right, left = self.right_mm, self.left_mm
        breaks = {} if right == left else {0.0: 0, 1.0: 0}
        return over_t(lambda t: right + (left - right) * t, span, breaks, "linear law")
