"""A radius or a curvature as a formula in t and x."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator, model_validator

from mirror_cad.errors import SpecError
from mirror_cad.keys import Shown
from mirror_cad.laws.base import Law
from mirror_cad.laws.curvature import Break, CurvatureLaw, Span
from mirror_cad.laws.formula import parse_formula

Array = NDArray[np.float64]


class Expression(Law):
    """R or κ as a formula in t and x (mm), evaluated without `eval`.

    Attributes
    ----------
    radius, curvature : str or None
        R in mm, or κ in 1/mm: one of the two.
    """

    title: ClassVar[str] = "formula"

    law: Literal["expression"] = "expression"
    radius: Annotated[str | None, Shown("R =", help="A formula in t and x (mm)", start="$right + ($left - $right)*t")] = None
    curvature: Annotated[str | None, Shown("or κ =", help="A formula in t and x (mm), per mm")] = None

    @field_validator("radius", "curvature")
    @classmethod
    def _readable(cls, formula: str | None) -> str | None:
        if formula is not None:
            try:
                parse_formula(formula)
            except SpecError as error:
                raise ValueError(str(error)) from None
        return formula

    @model_validator(mode="after")
    def _one_formula(self) -> Self:
        if (self.radius is None) == (self.curvature is None):
            raise ValueError("give one of radius and curvature, a formula in t and x")
        return self

    def over(self, span: Span) -> CurvatureLaw:
        """Make κ(x), 1/mm, convex positive, with t = 0 and 1 where `span` has them."""
        of_curvature = self.curvature is not None
        formula = (self.curvature if of_curvature else self.radius) or ""
        parsed = parse_formula(formula)

        def kappa(x: Array) -> Array:
            value = parsed(span.t(x), x)
            if of_curvature:
                return value
            with np.errstate(divide="ignore"):
                return 1.0 / value

        # t is held beyond the span: a kink there unless the formula happens to be level.
        return CurvatureLaw(kappa, (Break(span.left_mm, 0), Break(span.right_mm, 0)), f"expression law {formula!r}")

    def scaled(self, factor: float) -> Self:
        """Make the law whose radii are `factor` times as large everywhere."""
        if self.radius is not None:
            return self.model_copy(update={"radius": f"({self.radius})*{factor!r}"})
        return self.model_copy(update={"curvature": f"({self.curvature})/{factor!r}"})

    def in_words(self, solved: float | None = None) -> str:
        """Say the law in a few words for a table."""
        return f"radius = {self.radius}" if self.radius is not None else f"curvature = {self.curvature}"

    def in_short(self) -> str:
        """A formula is too long to be read in a few words."""
        return "a formula"
