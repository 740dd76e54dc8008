"""What an eye sees in a reflector: a STEP face, a mesh or a designed mirror, traced by exact rays.

Rays                reflect, Rays, Trace, Status
Reflectors          load_reflector, Reflector, Placement
Looking into them   View, Pose, Eyes, EyeViews, HostVehicle, Aim, aimed, driver_view
Measures            measures, Lane, MirrorInUse

    import raytrace as rt

    view = rt.View(rt.load_reflector("mirror.step"))
    rt.measures.lane_straightness(view, rt.Lane(x0_mm=0.0, y0_mm=2400.0, slope=0.6)).percent
    rt.driver_view(view).save("driver-view.png")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from raytrace import measures
    from raytrace.driver_picture import DriverView, driver_view
    from raytrace.errors import SceneError, TraceError
    from raytrace.load import load_reflector
    from raytrace.measures.in_use import MirrorInUse
    from raytrace.measures.straight_lane import Lane
    from raytrace.placement import Placement
    from raytrace.rays import Rays, Status, Trace
    from raytrace.reflector import Reflector
    from raytrace.trace import reflect
    from raytrace.viewing.aim import Aim, aimed
    from raytrace.viewing.eye_views import EyeViews
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
    "Aim": "viewing.aim", "DriverView": "driver_picture", "EyeViews": "viewing.eye_views", "Eyes": "viewing.vehicle",
    "HostVehicle": "viewing.vehicle", "Lane": "measures.straight_lane",
    "MirrorInUse": "measures.in_use", "Placement": "placement",
    "Pose": "viewing.pose", "Rays": "rays", "Reflector": "reflector", "SceneError": "errors", "Status": "rays", "Trace": "rays",
    "TraceError": "errors", "TracedRays": "viewing.view", "View": "viewing.view", "aimed": "viewing.aim",
    "driver_view": "driver_picture", "load_reflector": "load", "measures": "measures", "reflect": "trace",
}
__all__ = ["Aim", "DriverView", "EyeViews", "Eyes", "HostVehicle", "Lane", "MirrorInUse", "Placement", "Pose", "Rays",
           "Reflector", "SceneError", "Status", "Trace", "TraceError", "TracedRays", "View", "aimed", "driver_view",
           "load_reflector", "measures", "reflect"]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'raytrace' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(f"raytrace.{_HOME[name]}")
    return module if name == "measures" else getattr(module, name)


def __dir__() -> list[str]:
    return __all__
