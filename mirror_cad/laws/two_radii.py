"""What the laws between two radii share: their keys, their sign, and their words."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import model_validator

from mirror_cad.keys import Radius, Shown
from mirror_cad.laws.base import Law
from mirror_cad.laws.words import plain, radius_in_words


class TwoRadii(Law):
    """From one radius at t = 0 to another at t = 1, both finite and of one sign.

    Attributes
    ----------
    right_mm, left_mm : float
        R at t = 0 and at t = 1, mm.
    """

    right_mm: Annotated[Radius, Shown("{axis} right", 20.0, 3000.0, 5.0, 1, help="At the right edge, on the driver's side",
                                      start="$right", drag="right")]
    left_mm: Annotated[Radius, Shown("{axis} left", 20.0, 3000.0, 5.0, 1, help="At the left edge, outboard",
                                     start="$left", drag="left")]

    @model_validator(mode="after")
    def _one_sign(self) -> Self:
        if self.right_mm * self.left_mm < 0:
            raise ValueError(f"right_mm = {self.right_mm:g} and left_mm = {self.left_mm:g} have opposite signs, so the "
                             "radius would pass through 0: write a sign-changing law as curvature "
                             "(law = \"expression\" with curvature = \"…\", or \"table\" with curvature_per_mm)")
        return self

    def scaled(self, factor: float) -> Self:
        """Make the law whose radii are `factor` times as large everywhere."""
        return self.model_copy(update={"right_mm": factor * self.right_mm, "left_mm": factor * self.left_mm})

    def in_words(self, solved: float | None = None) -> str:
        """Say the law in a few words for a table."""
        return (f"{radius_in_words(self.right_mm)} at the right, {radius_in_words(self.left_mm)} at the left, "
                f"{self._between(solved)}")

    def in_short(self) -> str:
        """Say it in the fewest words, from right to left."""
        return f"{plain(self.right_mm)} → {plain(self.left_mm)} mm, {self.law}"

    def _between(self, solved: float | None) -> str:
        return f"{self.law} between"
