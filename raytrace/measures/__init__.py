"""Measures of what a mirror shows: one a file, with its definition, unit and source.

By name, as tables and limits know them: `registered()["lane_straightness_percent"].value(use)`, with a `raytrace.MirrorInUse`.
As functions of a view, each in its file, `measures.disparity.disparity`; those not named as their file is are here too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from raytrace.measures.angular_size import angular_sizes
    from raytrace.measures.field_of_view import traced_fields_of_view
    from raytrace.measures.lane import LaneStraightness, lane_straightness
    from raytrace.measures.magnification import magnification_extremes, magnification_map
    from raytrace.measures.registry import Measure, measures_of, register, registered, unregister

_HOME = {
    "LaneStraightness": "lane", "Measure": "registry", "angular_sizes": "angular_size", "lane_straightness": "lane",
    "magnification_extremes": "magnification", "magnification_map": "magnification", "measures_of": "registry",
    "register": "registry", "registered": "registry", "traced_fields_of_view": "field_of_view", "unregister": "registry",
}
__all__ = ["LaneStraightness", "Measure", "angular_sizes", "lane_straightness", "magnification_extremes", "magnification_map",
           "measures_of", "register", "registered", "traced_fields_of_view", "unregister"]


def __getattr__(name: str) -> object:
    from importlib import import_module
    from importlib.util import find_spec

    if name in _HOME:
        return getattr(import_module(f"raytrace.measures.{_HOME[name]}"), name)
    if not name.startswith("_") and find_spec(f"raytrace.measures.{name}"):  # always its file, whatever was imported before
        return import_module(f"raytrace.measures.{name}")
    raise AttributeError(f"module 'raytrace.measures' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
