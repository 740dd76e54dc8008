"""A radius that changes as a power of t: slowly at the right edge, faster to the left."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from mirror_cad.keys import Shown
from mirror_cad.laws.curvature import CurvatureLaw, Span, over_t
from mirror_cad.laws.matched import Matched, open_number
from mirror_cad.laws.two_radii import TwoRadii


class Power(Matched, TwoRadii):
    """R = right + (left − right)·t^exponent.

    Attributes
    ----------
    exponent : float or "match"
        Above 0 and at most 50; "match" is solved for.
    """

    open_key: ClassVar[str] = "exponent"

    law: Literal["power"] = "power"
    exponent: Annotated[float | Literal["match"], open_number(0.0, 50.0, low_open=True),
                        Shown("Exponent", 0.2, 8.0, 0.05, start=2.0)]

    def over(self, span: Span) -> CurvatureLaw:
        """Make κ(x), 1/mm, convex positive, with t = 0 and 1 where `span` has them."""
        right, left, exponent = self.right_mm, self.left_mm, self.parameter
        at_zero = int(np.ceil(exponent)) - 1  # t^n with t held at 0 beyond has ⌈n⌉ − 1 continuous derivatives at 0
        breaks = {} if right == left else {0.0: at_zero, 1.0: 0}
        return over_t(lambda t: right + (left - right) * t**exponent, span, breaks, "power law")

    def candidates(self) -> NDArray[np.float64]:
        """Return values of the open number between which it is looked for, rising, (n,)."""
        return np.geomspace(0.02, 50.0, 17)

    def _between(self, solved: float | None) -> str:
        return f"as t to the power {self.open_in_words(solved)}"
