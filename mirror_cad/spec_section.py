"""A section's keys in, checked and frozen values out: what all sections of a specification share."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field
from pydantic.functional_validators import BeforeValidator


def _integer_valued(value: Any) -> Any:
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


Number = Annotated[float, BeforeValidator(_integer_valued), Field(allow_inf_nan=False)]
Coordinate = Annotated[Number, Field(ge=-1e6, le=1e6)]
Length = Annotated[Number, Field(gt=0, le=1e5)]


class Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
