"""A zone of one radius at the right, another at the left, and a blend between them."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from mirror_cad.keys import Number, Shown
from mirror_cad.laws.curvature import CurvatureLaw, Span, over_t
from mirror_cad.laws.matched import Matched, open_number
from mirror_cad.laws.two_radii import TwoRadii
from mirror_cad.laws.words import plain

Array = NDArray[np.float64]


class Zones(Matched, TwoRadii):
    """R = right up to blend_from, left from blend_to on; between them right + (left − right)·b(u).

    u = (t − blend_from)/(blend_to − blend_from); b = u (linear) or u²(3 − 2u) (smooth).

    Attributes
    ----------
    blend_from : float or "match"
        In t, 0 to 1; "match" is solved for.
    blend_to : float
        In t, above blend_from and at most 1.
    blend : "linear" or "smooth"
    """

    open_key: ClassVar[str] = "blend_from"

    law: Literal["zones"] = "zones"
    blend_from: Annotated[float | Literal["match"], open_number(0.0, 1.0),
                          Shown("Blend from t", 0.0, 1.0, 0.01, start=0.5, drag="t",
                                help="t runs from 0 at the right edge to 1 at the left")]
    blend_to: Annotated[Number, Field(ge=0, le=1), Shown("Blend to t", step=0.01, start=1.0, drag="t")] = 1.0
    blend: Annotated[Literal["linear", "smooth"], Shown("Blend", start="smooth")] = "smooth"

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not isinstance(self.blend_from, str) and self.blend_from >= self.blend_to:
            raise ValueError(f"blend_from = {self.blend_from:g} must lie below blend_to = {self.blend_to:g}")
        return self

    def over(self, span: Span) -> CurvatureLaw:
        """Make κ(x), 1/mm, convex positive, with t = 0 and 1 where `span` has them."""
        right, left, blend_from, blend_to = self.right_mm, self.left_mm, self.parameter, self.blend_to
        linear = self.blend == "linear"

        def radius(t: Array) -> Array:
            u = np.clip((t - blend_from) / (blend_to - blend_from), 0.0, 1.0)
            return right + (left - right) * (u if linear else u * u * (3.0 - 2.0 * u))

        smoothness = 0 if linear else 1
        breaks = {} if right == left else {blend_from: smoothness, blend_to: smoothness}
        return over_t(radius, span, breaks, "zones law")

    def candidates(self) -> Array:
        """Return values of the open number between which it is looked for, rising, (n,)."""
        return np.linspace(0.0, self.blend_to - 1e-3, 17)

    def _between(self, solved: float | None) -> str:
        return f"{self.blend} blend from t = {self.open_in_words(solved)} to {plain(self.blend_to)}"
