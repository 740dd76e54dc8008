"""A design and its departures in, the mirror as it comes out, in use, and its row of measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mirror_cad.design_stages import design
from mirror_cad.made.form_error import Waves, random_map, wave, with_form_error
from mirror_cad.mirror import Mirror
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import validate_spec
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.drive.measured import in_use
from mirror_studio.drive.mirrors import on_vehicle
from mirror_studio.explore.evaluate import Row, row_of, scene_and_asked
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.in_use import MirrorInUse
from raytrace.reflector import Reflector

DRAWS = 2.0**53  # a double between 0 and 1 is told from so many


@dataclass(frozen=True, slots=True)
class FormOfRow:
    """An error of form as a row has it: a wave in a direction at a phase, degrees, or a random map by its draw."""

    size_mm: float
    wavelength_mm: float
    direction_deg: float | None
    phase_deg: float | None
    draw: float | None

    @property
    def waves(self) -> Waves:
        """What it is made of."""
        if self.draw is not None:
            return random_map(self.size_mm, self.wavelength_mm, np.random.default_rng(int(self.draw * DRAWS)))
        return wave(self.size_mm, self.wavelength_mm, np.radians(self.direction_deg or 0.0), np.radians(self.phase_deg or 0.0))


@dataclass(frozen=True, slots=True)
class Departures:
    """What of a made mirror no specification says.

    Attributes
    ----------
    forms : tuple of FormOfRow
        On the reflecting surface; before it, glass of even thickness follows.
    wedge_arcmin : tuple
        By which the glass becomes thicker to the right and upwards.
    turned_deg : tuple
        Yaw and pitch beside the aim.
    eye_mm : tuple
        Where the eye is beside its place: to the right, up, rearward.
    """

    forms: tuple[FormOfRow, ...] = ()
    wedge_arcmin: tuple[float, float] = (0.0, 0.0)
    turned_deg: tuple[float, float] = (0.0, 0.0)
    eye_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


def evaluate_made(index: int, values: tuple[float | str | bool, ...], raw: dict[str, Any], folder: str, scene: str | None,
                  measures: Sequence[str]) -> Row:
    """Take the measures of one mirror; `raw` has its specification as "spec" and its departures as "made"."""
    return row_of(index, values, measures, lambda: _made(raw, folder, scene))


def reflector_made(mirror: Mirror, made: Departures) -> Reflector:
    """What a mirror reflects with as it came out.

    Parameters
    ----------
    mirror : Mirror
        As designed.
    made : Departures
        From that.
    """
    if made.forms:
        parts = [each.waves for each in made.forms]
        waves = Waves(*(np.concatenate([getattr(part, name) for part in parts])
                        for name in ("amplitude", "wavelength", "direction", "phase")))
        mirror = replace(mirror, surface=with_form_error(mirror.surface, waves))
    wedged = any(made.wedge_arcmin) and mirror.spec.glass.reflecting == "back"
    return Reflector.from_mirror(mirror, _wedged(mirror.front, made.wedge_arcmin) if wedged else None)


def _made(raw: dict[str, Any], folder: str, scene: str | None) -> tuple[MirrorSpec, MirrorInUse]:
    spec, made = validate_spec(raw["spec"], "mirror", Path(folder)), raw["made"]
    mirror = design(spec)
    reflector = reflector_made(mirror, made)
    right, up, rearward = made.eye_mm
    if scene is None:
        use = ViewingSetup.of(spec, mirror.box).in_use(reflector, mirror)
    else:
        loaded, asked = scene_and_asked(scene)
        driven = on_vehicle(spec.name, reflector, loaded, spec, mirror).turned(*np.radians(made.turned_deg))
        eyes = replace(driven.eyes, middle=driven.eyes.middle + np.array([rearward, right, up]))
        use = in_use(replace(driven, eyes=eyes), asked)
    # The plane behind stays where it is when the eye moves.
    lane = replace(use.lane, distance_mm=use.lane.distance_mm - rearward)
    return spec, replace(use, setup=replace(use.setup, eye=use.setup.eye + np.array([right, up, rearward])), lane=lane)


def _wedged(front: BSplineSurface, arcmin: tuple[float, float]) -> BSplineSurface:
    """z + x·tan α + y·tan β: exact on a spline's poles, as any affine map is."""
    a, b = np.tan(np.radians(np.array(arcmin) / 60.0))
    poles = front.poles.copy()
    poles[..., 2] += a * poles[..., 0] + b * poles[..., 1]
    return replace(front, poles=poles)
