"""Freeform reflectors as geometry: a curvature law in, a B-spline surface, a solid and its files out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
    from mirror_cad.mirror import Mirror, design
    from mirror_cad.spec import MirrorSpec
    from mirror_cad.spec_file import load_spec, preset_names

# Loaded when first asked for, so that importing the package costs nothing and brings in no kernel.
_HOME = {
    "FileError": "errors", "InstallationError": "errors", "MirrorError": "errors", "OutlineError": "errors",
    "ProfileError": "errors", "SolidError": "errors", "SpecError": "errors", "SurfaceError": "errors", "WriteError": "errors",
    "Mirror": "mirror", "design": "mirror",
    "MirrorSpec": "spec", "load_spec": "spec_file", "preset_names": "spec_file",
}
__all__ = [
    "FileError", "InstallationError", "Mirror", "MirrorError", "MirrorSpec", "OutlineError", "ProfileError", "SolidError",
    "SpecError", "SurfaceError", "WriteError", "design", "load_spec", "preset_names",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mirror_cad' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"mirror_cad.{_HOME[name]}"), name)
