"""Specifications: what a mirror is asked to be, read from TOML or made in Python."""

from mirror_cad.spec.file import load_spec, preset_names, spec_as_json, validate_spec
from mirror_cad.spec.schema import (
    Blank,
    Export,
    Eye,
    Glass,
    Lane,
    Limits,
    MirrorSpec,
    OutlineSpec,
    PartSpec,
    SceneSpec,
    SurfaceSpec,
    View,
)
from mirror_cad.spec.target import Target

__all__ = ["Blank", "Export", "Eye", "Glass", "Lane", "Limits", "MirrorSpec", "OutlineSpec", "PartSpec", "SceneSpec",
           "SurfaceSpec", "Target", "View", "load_spec", "preset_names", "spec_as_json", "validate_spec"]
