"""Which rule of the road a mirror is to be held against, and what of it the surface does not tell."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from mirror_cad.keys import Number, Section

Percent = Annotated[Number, Field(ge=0, le=100)]
Name = Annotated[str, Field(min_length=1, max_length=255)]


class RulesSection(Section):
    """A rule of the road, and one of its classes, that `build` holds radii and sizes against.

    rule : R46, GB15084, FMVSS111, another rule file of the package, or a TOML file beside the specification.   class : of the
    rule; without one, that which the rule's file has first in mind.   leg_mm : between the spherometer's outer feet; without it
    the rule's.   reflectance_percent, reflectance_night_percent : as the maker measured them.
    """

    model_config = ConfigDict(serialize_by_alias=True)

    rule: Name
    class_name: Annotated[Name | None, Field(alias="class")] = None
    leg_mm: Annotated[Number, Field(ge=1, le=300)] | None = None
    reflectance_percent: Percent | None = None
    reflectance_night_percent: Percent | None = None
