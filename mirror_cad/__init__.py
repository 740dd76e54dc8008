"""Freeform reflectors as geometry: curvature laws, B-spline surfaces, solids and their files.

import mirror_cad as mc

spec = mc.MirrorSpec(horizontal=mc.laws.Zones(right_mm=1250, left_mm=400, blend_from=0.59),
vertical=mc.laws.Linear(right_mm=1250, left_mm=1350))
mirror = mc.design(spec)
mirror.surface.principal_curvatures(x, y)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mirror_cad import laws, spec
    from mirror_cad.design_stages import design
    from mirror_cad.deviation import Deviation
    from mirror_cad.errors import (
        FileError,
        InstallationError,
        MirrorError,
        OutlineError,
        ProfileError,
        SolidError,
        SpecError,
        SurfaceError,
        WriteError,
    )
    from mirror_cad.mirror import Mirror
    from mirror_cad.spec.file import load_spec, preset_names
    from mirror_cad.spec.schema import MirrorSpec

# Loaded when first asked for, so that importing the package costs nothing and brings in no kernel.
_HOME = {
    "FileError": "errors", "InstallationError": "errors", "MirrorError": "errors", "OutlineError": "errors",
    "ProfileError": "errors", "SolidError": "errors", "SpecError": "errors", "SurfaceError": "errors", "WriteError": "errors",
    "Deviation": "deviation", "Mirror": "mirror", "design": "design_stages",
    "MirrorSpec": "spec.schema", "load_spec": "spec.file", "preset_names": "spec.file",
}
_PACKAGES = ("laws", "spec")
__all__ = [
    "Deviation", "FileError", "InstallationError", "Mirror", "MirrorError", "MirrorSpec", "OutlineError", "ProfileError",
    "SolidError", "SpecError", "SurfaceError", "WriteError", "design", "laws", "load_spec", "preset_names", "spec",
]


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name in _PACKAGES:
        return import_module(f"mirror_cad.{name}")
    if name in _HOME:
        return getattr(import_module(f"mirror_cad.{_HOME[name]}"), name)
    raise AttributeError(f"module 'mirror_cad' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
