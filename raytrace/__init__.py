"""What an eye sees in a reflector: a STEP face, a mesh or a designed mirror, traced by exact rays.

Rays                reflect, Rays, Trace, Status
Reflectors          load_reflector, Reflector, Placement
Looking into them   View, Pose, Eyes, HostVehicle, driver_view
Measures            measures, Lane
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from raytrace import measures
    from raytrace.driver_picture import DriverView, driver_view
    from raytrace.errors import SceneError, TraceError
    from raytrace.load import load_reflector
    from raytrace.measures.lane import Lane
    from raytrace.placement import Placement
    from raytrace.rays import Rays, Status, Trace
    from raytrace.reflector import Reflector
    from raytrace.trace import reflect
    from raytrace.viewing.pose import Pose
    from raytrace.viewing.vehicle import Eyes, HostVehicle
    from raytrace.viewing.view import TracedRays, View

from mirror_cad.limits import add_source


def _all_measures() -> object:
    from raytrace.measures.registry import registered

    return registered()


add_source(_all_measures)
# Loaded when first asked for, so that importing the package costs nothing: name -> module below this one.
_HOME = {
    "SceneError": "errors", "TraceError": "errors", "load_reflector": "load", "Lane": "measures.lane",
    "Placement": "placement", "Rays": "rays",
    "Status": "rays", "Trace": "rays", "Reflector": "reflector", "reflect": "trace", "DriverView": "driver_picture",
    "driver_view": "driver_picture", "Pose": "viewing.pose", "Eyes": "viewing.vehicle", "HostVehicle": "viewing.vehicle",
    "TracedRays": "viewing.view", "View": "viewing.view", "measures": "measures",
}
__all__ = ["DriverView", "Eyes", "HostVehicle", "Lane", "Placement", "Pose", "Rays", "Reflector", "SceneError", "Status",
           "Trace", "TraceError", "TracedRays", "View", "driver_view", "load_reflector", "measures", "reflect"]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'raytrace' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(f"raytrace.{_HOME[name]}")
    return module if name == "measures" else getattr(module, name)


def __dir__() -> list[str]:
    return __all__
