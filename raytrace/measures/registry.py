"""Measures by name: what tables, limits, studies and pages know them by.

A file of this package that registers a measure is all that a new one needs; scripts may register their own with `register`.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Literal

from mirror_cad.limits import allow_limit

if TYPE_CHECKING:
    from raytrace.measures.in_use import MirrorInUse

Better = Literal["more", "less"]
# What a measure is taken of: the mirror alone with the eye where the specification has it, or the mirror on its vehicle.
Scope = Literal["setup", "vehicle"]
GROUPS = ("Aim", "Field of view", "Size", "Straightness", "Two eyes", "Ground and blind zone", "Other")


@dataclass(frozen=True, slots=True)
class Measure:
    """A figure of a mirror in use.

    Parameters
    ----------
    name : the one it has in files, limits and studies, with its unit at the end.
    title, unit, decimals : as tables show it; a figure without a unit is a share or a ratio.
    definition : what is measured, in a sentence.
    value : takes it; None where the mirror does not show what is measured.
    scope : what it is taken of.
    group : of `GROUPS`, where tables have it.
    better : whether more or less of it (of its size, where it is signed) serves the driver; None where neither does.
    local : whether it holds also for a mirror that shows some things twice, of which no field or line is measured.
    at_least : whether the value is a bound only, because what is measured goes on where looking ends.
    """

    name: str
    title: str
    unit: str
    decimals: int
    definition: str
    value: Callable[[MirrorInUse], float | None]
    scope: Scope = "vehicle"
    group: str = "Other"
    better: Better | None = None
    local: bool = False
    at_least: Callable[[MirrorInUse], bool] | None = None


# Some are known only with the scene: one for each distance that it asks about.
Family = Callable[["MirrorInUse"], "tuple[Measure, ...]"]
_measures: dict[str, Measure] = {}
_families: list[Family] = []


def register(measure: Measure) -> Measure:
    """Make a measure known under its name; one that has the name already is replaced.

    Parameters
    ----------
    measure : with a name that is an identifier, in one of `GROUPS`.

    Returns
    -------
    Measure
        The same.

    Raises
    ------
    ValueError
        For a name that is no identifier, or a group that tables do not have.
    """
    if not measure.name.isidentifier():
        raise ValueError(f"a measure's name must be letters, digits and underscores, not {measure.name!r}")
    if measure.group not in GROUPS:
        raise ValueError(f"{measure.name}: group {measure.group!r} is none of {', '.join(GROUPS)}")
    _measures[measure.name] = measure
    allow_limit(measure.name, measure.unit)
    return measure


def unregister(name: str) -> None:
    """Forget a measure that a script has registered; a name that is none is no fault."""
    _measures.pop(name, None)


def register_family(family: Family) -> Family:
    """Make measures known that depend on what the scene asks about.

    Parameters
    ----------
    family : gives the measures of a mirror in use, none where the scene asks about nothing; may be decorated with this.

    Returns
    -------
    The same.
    """
    _families.append(family)
    return family


def registered() -> dict[str, Measure]:
    """Every measure that has a name of its own, in the order of `GROUPS`."""
    _load()
    return {each.name: each for group in GROUPS for each in _measures.values() if each.group == group}


def measures_of(use: MirrorInUse, scope: Scope | None = None) -> dict[str, Measure]:
    """The measures that can be taken of a mirror in use, with those that its scene asks for at some distances.

    Parameters
    ----------
    use : the mirror.
    scope : of the measures; None for all that can be taken: those of the vehicle only where it is on one.

    Returns
    -------
    By name, in the order of `GROUPS`.
    """
    found = [*registered().values(), *(each for family in _families for each in family(use))]
    kept = [each for each in found if (each.scope == scope if scope else each.scope == "setup" or use.vehicle is not None)]
    return {each.name: each for group in GROUPS for each in kept if each.group == group}


@cache
def _load() -> None:
    """Import every file of this package: each registers what it measures."""
    package = import_module("raytrace.measures")
    for module in pkgutil.iter_modules(package.__path__):
        import_module(f"raytrace.measures.{module.name}")
