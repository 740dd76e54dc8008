"""What a law with one open number says: which it is, and the section field of view that it is solved for."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, model_validator
from pydantic.functional_validators import PlainValidator

from mirror_cad.keys import Number, Section, Shown, is_number
from mirror_cad.laws.base import Law
from mirror_cad.laws.words import plain

OPEN = "match"  # in place of the number
VERTICAL = "vertical"  # in a validation's context: the law is the vertical one, and nothing is solved for


def open_number(low: float, high: float, low_open: bool = False) -> PlainValidator:
    """Make the check of a key that is a number from `low` to `high`, or in the horizontal law "match"."""
    span = f"{'above' if low_open else 'at least'} {low:g} and at most {high:g}"

    def check(value: object, info: ValidationInfo) -> float | str:
        vertical = VERTICAL in (info.context or {})
        if value == OPEN and not vertical:
            return OPEN
        if not is_number(value) or not low <= value <= high or (low_open and value == low):
            what = "a number" if vertical else f"\"{OPEN}\" or a number"
            raise ValueError(f"must be {what} {span}" + (" (only [horizontal] is solved for)" if value == OPEN else ""))
        return float(value)

    return PlainValidator(check)


class Match(Section):
    """What the section H-FOV has to equal: that of a sphere, or an angle.

    Attributes
    ----------
    sphere_mm, h_fov_deg : float or None
        One of the two.
    """

    sphere_mm: Annotated[Annotated[Number, Field(gt=0)] | None,
                         Shown("Sphere", 300.0, 2000.0, 5.0, 1, start=950.0,
                               help="The open number is solved so that the section H-FOV is that of this sphere")] = None
    h_fov_deg: Annotated[Annotated[Number, Field(gt=0, lt=360)] | None,
                         Shown("H-FOV", 10.0, 90.0, 0.1, help="The open number is solved so that the section H-FOV is this"),
                         ] = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.sphere_mm is None) == (self.h_fov_deg is None):
            raise ValueError("give one of sphere_mm and h_fov_deg")
        return self


class Matched(Law):
    """A law one of whose numbers may be "match": it is then solved so that the horizontal section has a field of view.

    Attributes
    ----------
    open_key : str
        Which key that is.
    match : Match or None
        What it is solved for.
    """

    open_key: ClassVar[str]

    match: Match | None = None

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if self.open and self.match is None:
            raise ValueError(f"{self.open_key} = \"{OPEN}\" needs a section [horizontal.match] with sphere_mm or h_fov_deg")
        if self.match is not None and not self.open:
            raise ValueError(f"[horizontal.match] has nothing to solve for: set {self.open_key} = \"{OPEN}\" or leave it out")
        return self

    @property
    def open(self) -> bool:
        """Whether the number is "match"."""
        return bool(getattr(self, self.open_key) == OPEN)

    @property
    def parameter(self) -> float:
        """The number that may be open; NaN while it is."""
        return float("nan") if self.open else float(getattr(self, self.open_key))

    def with_parameter(self, value: float) -> Self:
        """Make the same law with its open number stated."""
        return self.model_copy(update={self.open_key: value, "match": None})

    def candidates(self) -> NDArray[np.float64]:
        """Return values of the open number between which it is looked for, rising, (n,)."""
        raise NotImplementedError(f"the law {self.law!r} does not say where its {self.open_key} lies: it needs `candidates`")

    def open_in_words(self, solved: float | None) -> str:
        """Say the number, or the one that was solved for."""
        if not self.open:
            return plain(self.parameter)
        return f"\"{OPEN}\"" if solved is None else f"{solved:#.4g} (solved for)"


def with_solved(law: Law, matched: tuple[str, float] | None) -> Law:
    """Put the value that was solved for, if there is one, in the law's place of "match".

    Parameters
    ----------
    law : Law
        With "match" or without.
    matched : tuple or None
        The key and its value, as `solve_match` returns them.
    """
    return law.with_parameter(matched[1]) if isinstance(law, Matched) and matched is not None else law
