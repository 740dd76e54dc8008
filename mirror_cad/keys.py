"""What the sections of a specification share: checked, frozen records, the kinds of their keys, and how a key is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Annotated, TypeGuard

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.functional_validators import BeforeValidator, PlainValidator

from mirror_cad.errors import SpecError
from mirror_cad.messages import faults

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

# The smallest radius of curvature that any key takes, and so the largest curvature, 1/mm: no mirror of a vehicle comes near,
# and a slip of the unit or of the keyboard passes it at once.
SMALLEST_RADIUS_MM = 1.0


class _SectionType(ModelMetaclass):
    def __call__(cls, *values: object, **keys: object) -> object:  # noqa: N805  # of a metaclass
        try:
            return super().__call__(*values, **keys)
        except (ValidationError, OverflowError) as error:
            raise SpecError(faults(error, keys, cls, cls.__name__)) from None  # type: ignore[arg-type]  # cls is a Section


class Section(BaseModel, metaclass=_SectionType):
    """A section of a specification: its keys are its fields, checked and frozen.

    Raises
    ------
    SpecError
        When made in Python from keys that are unknown, missing or out of range, one sentence each.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    def __repr_args__(self) -> list[tuple[str | None, object]]:
        """What differs from the defaults."""
        fields = type(self).model_fields
        return [(key, value) for key, value in super().__repr_args__()
                if key not in fields or value != fields[key].get_default(call_default_factory=True)]

    __str__ = BaseModel.__repr__


@dataclass(frozen=True, slots=True)
class Shown:
    """How a key is shown where it is changed by hand, as metadata of its field; what it may be, the field itself says.

    Attributes
    ----------
    label : str
        In a law, "{axis}" stands for Rx or Ry. Without one, the key's own name.
    low, high : float or None
        Ends of a slider; without them, the key's own range.
    step : float
        What an arrow key changes the value by.
    digits : int
        Decimals shown.
    unit : str
        Where the key's own name does not end in it.
    words : tuple
        What the values of a choice are called, where their names do not say it.
    help : str
        A sentence.
    start : object
        What the key has when it is put in by hand. A law's key may also start from the law there was before: "$right" and
        "$left" are its radii at the edges, also inside a text; "$x" with "$radius" or "$curvature" its samples.
    drag : str
        How a law's curve is dragged by this key: "right", "left" and "everywhere" are radii at the right edge, the left edge
        and in the middle, "t" is a point on the axis; "" is not at all.
    elsewhere : bool
        The key is changed by other means than an input of its own.
    """

    label: str = ""
    low: float | None = None
    high: float | None = None
    step: float = 1.0
    digits: int = 3
    unit: str = ""
    words: tuple[tuple[object, str], ...] = ()
    help: str = ""
    start: object = None
    drag: str = ""
    elsewhere: bool = False


ELSEWHERE = Shown(elsewhere=True)


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a real number: numpy's are, a truth value is none."""
    return isinstance(value, Real) and not isinstance(value, bool)


def _as_float(value: object) -> object:
    return float(value) if is_number(value) else value


def _as_tuple(value: object) -> object:
    """Lists and arrays as tuples."""
    value = value.tolist() if hasattr(value, "tolist") else value
    return tuple(value) if isinstance(value, list) else value


def _radius(value: object) -> float:
    if not is_number(value) or math.isnan(value) or math.isinf(value) or value == 0:
        raise ValueError("must be a finite number of mm other than 0 (flat, concave and sign-changing laws are written "
                         "as curvature: law = \"expression\" or \"table\")")
    return _not_tiny(float(value))


def _radius_or_flat(value: object) -> float:
    if isinstance(value, str) and value in ("inf", "-inf"):  # what JSON, which has no such number, is given for it
        value = float(str(value))
    if not is_number(value) or math.isnan(value) or value == 0:
        raise ValueError("must be a number of mm other than 0 (inf is flat, a negative radius concave)")
    return _not_tiny(float(value))


def _not_tiny(radius_mm: float) -> float:
    if abs(radius_mm) < SMALLEST_RADIUS_MM:
        raise ValueError(f"must be at least {SMALLEST_RADIUS_MM:g} mm in size: no mirror is bent more tightly")
    return radius_mm


Number = Annotated[float, BeforeValidator(_as_float), Field(allow_inf_nan=False)]
Coordinate = Annotated[Number, Field(ge=-1e6, le=1e6)]
Length = Annotated[Number, Field(gt=0, le=1e5)]
Curvature = Annotated[Number, Field(ge=-1.0 / SMALLEST_RADIUS_MM, le=1.0 / SMALLEST_RADIUS_MM)]
Radius = Annotated[float, PlainValidator(_radius)]
RadiusOrFlat = Annotated[float, PlainValidator(_radius_or_flat)]
AsTuple = BeforeValidator(_as_tuple)
