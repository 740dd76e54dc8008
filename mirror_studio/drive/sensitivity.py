"""A mirror on the vehicle in, what its figures become when it is turned a little, or made a little flatter, out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mirror_cad.mirror import design
from mirror_cad.spec import MirrorSpec
from mirror_studio.drive.mirrors import DrivenMirror, exported
from raytrace.viewing.bezel import visible_aperture

TURN_DEG, RADII = 1.0, 0.05  # what a driver's hand and a glass maker's tolerance are good for

Figures = dict[str, float | bool | None]


def sensitivity(mirror: DrivenMirror, figures: Callable[[DrivenMirror], Figures], over_mm: float) -> dict[str, Figures]:
    """Figures of the mirror with its yaw and pitch changed by ±TURN_DEG, and with all its radii changed by ±RADII at the
    same yaw and pitch; the latter only for a mirror that was designed. What the mirror no longer shows is None."""
    turn = math.radians(TURN_DEG)
    found = {"as aimed": figures(mirror)}
    for name, yaw, pitch in (("yaw", turn, 0.0), ("pitch", 0.0, turn)):
        for sign, word in ((1.0, "+"), (-1.0, "−")):
            found[f"{name} {word}{TURN_DEG:g}°"] = figures(mirror.turned(sign * yaw, sign * pitch))
    if mirror.spec is not None:
        for sign, word in ((1.0, "+"), (-1.0, "−")):
            whole = exported(with_radii(mirror.spec, 1.0 + sign * RADII))
            other = replace(mirror, whole=whole, reflector=visible_aperture(whole, over_mm))
            found[f"R {word}{100 * RADII:g} %"] = figures(other)
    return found


def with_radii(spec: MirrorSpec, factor: float) -> MirrorSpec:
    """The specification with every radius of both laws `factor` times as large; a parameter that was solved for keeps the
    value that it had."""
    solved = design(spec).matched
    sections: dict[str, Any] = {}
    for name in ("horizontal", "vertical"):
        law = getattr(spec, name)
        changed: dict[str, Any] = {}
        for key in ("right_mm", "left_mm", "radius_mm"):
            value = getattr(law, key, None)
            if value is not None:
                changed[key] = tuple(factor * one for one in value) if isinstance(value, tuple) else factor * value
        if getattr(law, "curvature_per_mm", None) is not None:
            changed["curvature_per_mm"] = tuple(one / factor for one in law.curvature_per_mm)
        if getattr(law, "radius", None) is not None:
            changed["radius"] = f"({law.radius})*{factor!r}"
        if getattr(law, "curvature", None) is not None and isinstance(law.curvature, str):
            changed["curvature"] = f"({law.curvature})/{factor!r}"
        if name == "horizontal" and solved is not None:
            changed |= {solved[0]: solved[1], "match": None}
        sections[name] = law.model_copy(update=changed)
    return spec.model_copy(update=sections)
