"""What several tests share: designed presets, made once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

import mirror_cad
import raytrace
from mirror_cad.mirror import Mirror
from mirror_cad.spec.file import validate_spec
from raytrace.surfaces.base import OpticalSurface

# The machine is shared: a slow example is no failure.
settings.register_profile("shared", deadline=None, print_blob=True)
settings.load_profile("shared")

PAPER_MIRRORS = ("sphere-1250", "sphere-1050", "sphere-950", "progressive-a", "progressive-b", "progressive-c")


@cache
def designed(name: str) -> Mirror:
    """A preset, designed once for all tests."""
    return mirror_cad.design(mirror_cad.load_spec(name))


def face_of(mirror: Mirror) -> OpticalSurface:
    """The mirror's reflecting face, inside its outline, without glass before it."""
    return raytrace.Reflector.from_mirror(mirror).uncoated.surface


def spec_of(horizontal: dict[str, Any], vertical: dict[str, Any], **sections: Any) -> mirror_cad.MirrorSpec:
    """A specification from dictionaries."""
    return validate_spec({"name": "test", "horizontal": horizontal, "vertical": vertical, **sections})


def constant(radius: float) -> dict[str, Any]:
    """A constant law."""
    return {"law": "constant", "radius_mm": radius}


@pytest.fixture
def spec_file(tmp_path: Path) -> Callable[[str], Path]:
    """Write a specification's text to a file."""

    def write(text: str, name: str = "spec.toml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
