"""Measures of what a mirror shows: one a file, with its definition, unit and source."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from raytrace.measures.lane import LaneStraightness, lane_straightness

_HOME = {"LaneStraightness": "lane", "lane_straightness": "lane"}
__all__ = ["LaneStraightness", "lane_straightness"]


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module 'raytrace.measures' has no attribute {name!r}")
    return getattr(import_module(f"raytrace.measures.{_HOME[name]}"), name)
