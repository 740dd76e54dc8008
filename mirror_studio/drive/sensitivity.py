"""How a mirror's figures change when it is turned a little, or made a little flatter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from mirror_cad.design_stages import design
from mirror_cad.laws.matched import with_solved
from mirror_cad.spec import MirrorSpec
from mirror_studio.drive.measured import MainFigures
from mirror_studio.drive.mirrors import DrivenMirror
from raytrace.reflector import Reflector
from raytrace.viewing.bezel import visible_aperture

TURN_DEG, RADII = 1.0, 0.05  # what a driver's hand and a glass maker's tolerance are good for


def sensitivity(mirror: DrivenMirror, figures: Callable[[DrivenMirror], MainFigures], over_mm: float) -> dict[str, MainFigures]:
    """Figures of the mirror with its yaw and pitch changed by ±TURN_DEG.

    Likewise with all its radii changed by ±RADII at the same yaw and pitch; the latter only for a mirror that was designed by
    laws. What the mirror no longer shows is None.
    """
    turn = math.radians(TURN_DEG)
    found = {"as aimed": figures(mirror)}
    for name, yaw, pitch in (("yaw", turn, 0.0), ("pitch", 0.0, turn)):
        for sign, word in ((1.0, "+"), (-1.0, "−")):
            found[f"{name} {word}{TURN_DEG:g}°"] = figures(mirror.turned(sign * yaw, sign * pitch))
    if mirror.spec is not None and mirror.spec.has_laws:
        for sign, word in ((1.0, "+"), (-1.0, "−")):
            # No file of it is given to anybody: the surface of a file is the design's to 1e-11 mm.
            whole = Reflector.from_mirror(design(with_radii(mirror.spec, 1.0 + sign * RADII)))
            other = replace(mirror, whole=whole, reflector=visible_aperture(whole, over_mm))
            found[f"R {word}{100 * RADII:g} %"] = figures(other)
    return found


def with_radii(spec: MirrorSpec, factor: float) -> MirrorSpec:
    """The specification with every radius of both laws `factor` times as large.

    A parameter that was solved for keeps the value that it had.
    """
    horizontal = with_solved(spec.horizontal, design(spec).matched)
    return spec.model_copy(update={"horizontal": horizontal.scaled(factor), "vertical": spec.vertical.scaled(factor)})
