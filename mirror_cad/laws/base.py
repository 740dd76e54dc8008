"""What a curvature law is: its keys, κ(x), what scales it, and how it is said in words."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, ClassVar, Self

from pydantic import field_validator, model_serializer
from pydantic.functional_validators import PlainValidator

from mirror_cad.keys import AsTuple, Coordinate, Section, Shown, is_number
from mirror_cad.laws.curvature import CurvatureLaw, Span

LEVEL_WORDS = ("centre", "right", "left")


def _level(value: object) -> float | str:
    if value in LEVEL_WORDS:
        return str(value)
    if not is_number(value) or not math.isfinite(value):
        raise ValueError("must be \"centre\", \"right\", \"left\" or a number of mm")
    return float(value)


class Law(Section):
    """A curvature law over x: a section whose key `law` names it.

    A law of one's own is a subclass with `law: Literal["its-name"] = "its-name"`, its keys as fields (with their ranges, and
    `Shown` for how the studio's page shows them) and the methods below, made known by `register`.

    The keys here are those of [horizontal] alone: the vertical law runs over the same t, and the profile, not the circles,
    is level somewhere.

    Attributes
    ----------
    level_at : str or float
        Where the tangent angle is 0: "centre", "right" or "left" of the outline, or x in mm.
    span_mm : tuple or None
        x where t = 1 (left) and where t = 0 (right); the outline's edges without it.
    """

    horizontal_only: ClassVar[frozenset[str]] = frozenset({"level_at", "span_mm", "match"})
    known: ClassVar[dict[str, type[Law]]] = {}  # by name; `register` adds to it
    title: ClassVar[str] = ""  # what a menu calls it; its name without one

    law: str
    level_at: Annotated[float | str, PlainValidator(_level),
                        Shown("Level at", -115.0, 115.0, digits=1, unit="mm", start=0.0,
                              words=(("centre", "centre"), ("right", "right edge"), ("left", "left edge"), ("number", "x =")),
                              )] = "centre"
    span_mm: Annotated[tuple[Coordinate, Coordinate] | None, AsTuple,
                       Shown("t = 1 at x, t = 0 at x", -200.0, 200.0, digits=1, start=(-115.0, 115.0))] = None

    @field_validator("span_mm")
    @classmethod
    def _rising(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError(f"must rise from where t = 1 (left) to where t = 0 (right), not {value[0]:g} to {value[1]:g}")
        return value

    @model_serializer(mode="wrap")
    def _named(self, handler: Callable[[Law], dict[str, object]]) -> dict[str, object]:
        """With its name, even where defaults are left out; its own keys first."""
        content = handler(self)
        of_law = {key: value for key, value in content.items() if key not in self.horizontal_only}
        return {"law": self.law} | of_law | content

    def over(self, span: Span) -> CurvatureLaw:
        """Make κ(x), 1/mm, convex positive, with t = 0 and 1 where `span` has them.

        Returns
        -------
        CurvatureLaw
        """
        raise NotImplementedError(f"the law {self.law!r} does not say what its curvature is: it needs a method `over`")

    def scaled(self, factor: float) -> Self:
        """Make the law whose radii are `factor` times as large everywhere.

        Parameters
        ----------
        factor : float
            Above 0.
        """
        raise NotImplementedError(f"the law {self.law!r} does not say what scales it: it needs a method `scaled`")

    def in_words(self, solved: float | None = None) -> str:
        """Say the law in a few words for a table: “950 mm”, “1250 mm at the right, 400 mm at the left, …”.

        Parameters
        ----------
        solved : float or None
            What was found for a key that is "match".
        """
        return self.law

    def in_short(self) -> str:
        """Say it in the fewest words: “1250 → 400 mm, zones”, from right to left."""
        return self.in_words()

    @property
    def radius_everywhere_mm(self) -> float | None:
        """The one radius of a law that has it everywhere, inf of a flat one; None of any other."""
        return None

    def extent(self) -> tuple[float, float] | None:
        """Return the x between which the law is stated and beyond which it is held, mm; None for all of the mirror."""
        return self.span_mm

    def remarks(self, x_min: float, x_max: float) -> list[str]:
        """Say what the maker of a law should know of it on a mirror from x_min to x_max, mm, and no error says.

        Each sentence goes on from “the horizontal law” or “the vertical law”.
        """
        extent = self.extent()
        if extent is None or not (extent[1] <= x_min or extent[0] >= x_max):
            return []
        return [f"runs from x = {extent[0]:g} to {extent[1]:g} mm, beside the mirror ({x_min:g} to {x_max:g} mm), and is held "
                "at its end value all over it: is its unit mm?"]
