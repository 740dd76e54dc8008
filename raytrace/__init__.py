"""What an eye sees in a reflector: a STEP face, an STL mesh or a designed mirror in, rays and pictures out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from raytrace.errors import SceneError, TraceError
    from raytrace.placement import Placement
    from raytrace.reflector import Reflector, load_reflector
    from raytrace.trace import Status, Trace, reflect

_HOME = {
    "SceneError": "errors", "TraceError": "errors", "Status": "trace", "Trace": "trace", "reflect": "trace",
    "Placement": "placement", "Reflector": "reflector", "load_reflector": "reflector",
}
__all__ = ["Placement", "Reflector", "SceneError", "Status", "Trace", "TraceError", "load_reflector", "reflect"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'raytrace' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"raytrace.{_HOME[name]}"), name)
