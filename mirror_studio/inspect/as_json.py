"""The content of inspection.json, whose keys other programs hold on to."""

from __future__ import annotations

import numpy as np

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.made.fields import Lattice
from mirror_cad.made.figures import Figure, Figures
from mirror_cad.made.hidden_form import HiddenForm
from mirror_cad.made.inspection import Inspection
from mirror_cad.made.motion import Motion
from mirror_cad.made.verdict import Verdict
from mirror_studio.inspect.driver import DriversView
from mirror_studio.json_types import Json, JsonObject


def inspection_as_json(name: str, found: Inspection, left_out: dict[str, int], figures: Figures, verdict: Verdict | None,
                       motion: Motion, notes: tuple[str, ...]) -> dict[str, Json]:
    """What inspection.json holds.

    Parameters
    ----------
    name : str
        Of the mirror.
    found : Inspection
        The mirror.
    left_out : dict
        How many of its points do not count, by reason.
    figures : Figures
        Its main figures.
    verdict : Verdict or None
        Against a limit; None without one.
    motion : Motion
        From the file's coordinates to the design's own.
    notes : tuple of str
        What a user should know.
    """
    reconstruction = found.reconstruction
    alignment: dict[str, Json] = {"translation_mm": [float(v) for v in motion.translation],
                                  "rotation_deg": [float(v) for v in motion.rotation_deg], "reflected": motion.reflected}
    if found.alignment is not None:
        sigma = np.sqrt(np.maximum(np.diag(found.alignment.covariance), 0.0)) * found.sigma_mm
        alignment |= {"about_mm": [float(v) for v in found.alignment.centre],
                      "sigma_translation_mm": [float(v) for v in sigma[:3]],
                      "sigma_rotation_deg": [float(v) for v in np.degrees(sigma[3:])],
                      "directions_not_told_by_the_shape": found.alignment.undetermined}
    content: dict[str, Json] = {
        "schema": 1, "name": name,
        "points": {"used": int(found.used.sum()), "left_out": sum(left_out.values()),
                   "left_out_because": {**left_out}, "spacing_mm": reconstruction.coverage.spacing_mm},
        "sigma_mm": _finite(found.sigma_mm), "sigma_from": "stated" if found.sigma_stated else "residuals",
        "gauge_mm": found.fields.gauge_mm,
        "alignment": alignment,
        "reconstruction": {"span_mm": reconstruction.fit.space.span_mm, "principle": reconstruction.principle,
                           "residuals_over_sigma": _finite(reconstruction.fit.scale) if found.sigma_stated else None},
        "measured_share": figures.measured_share, "known_share": figures.known_share,
        "height": _figure(figures.height, "mm"), "slope": _figure(figures.slope, "arcmin")}
    for quantity in QUANTITIES:
        content[quantity] = _figure(figures.percent[quantity], "percent") | {
            "max_per_m": figures.per_m[quantity].largest, "sigma_per_m": figures.per_m[quantity].sigma}
    content["verdict"] = None if verdict is None else verdict.outcome
    content["verdict_basis"] = None if verdict is None else {
        "limit_percent": verdict.limit_percent, "surely_percent": verdict.surely_percent,
        "possibly_percent": verdict.possibly_percent, "known_share": verdict.known_share, "level": 0.95}
    content["notes"] = list(notes)
    return content


def view_as_json(view: DriversView, lattice: Lattice) -> JsonObject:
    """What the driver sees, as inspection.json has it.

    Parameters
    ----------
    view : DriversView
        Of the measured mirror.
    lattice : Lattice
        Where the turns of rays are told.
    """
    worst, at = int(np.nanargmax(view.turn)), lattice.places
    measures: dict[str, Json] = {each.name: {"designed": each.designed, "measured": each.measured, "sigma": each.sigma,
                                             "interval": each.interval} for each in view.measures}
    return {"measures": measures, "ray_turn": {
        "max_arcmin": float(view.turn[worst]), "rms_arcmin": float(np.sqrt(np.nanmean(view.turn**2))),
        "sigma_arcmin": float(np.sqrt(np.nanmean(view.turn_sigma**2))), "max_at_mm": [float(v) for v in at[worst]]}}


def hidden_as_json(hidden: HiddenForm, found: Inspection) -> JsonObject:
    """What the alignment takes away from the deviation of height, as inspection.json has it; null where it is not known.

    Parameters
    ----------
    hidden : HiddenForm
        Of the alignment.
    found : Inspection
        The mirror.
    """
    there = found.fields.measured_there
    taken = None if hidden.height is None or not there.any() else hidden.height[there]
    sigma = None if hidden.sigma is None or not there.any() else hidden.sigma[there]
    return {"max_mm": None if taken is None else float(taken[np.argmax(np.abs(taken))]),
            "rms_mm": None if taken is None else float(np.sqrt(np.mean(taken**2))),
            "sigma_mm": None if sigma is None else float(np.sqrt(np.mean(sigma**2)))}


def _figure(figure: Figure, unit: str) -> dict[str, Json]:
    interval = figure.interval
    return {f"max_{unit}": figure.largest, f"rms_{unit}": figure.rms, f"sigma_{unit}": figure.sigma, "max_at_mm": figure.at_mm,
            f"max_sigma_{unit}": figure.sigma_at_largest, f"max_interval_{unit}": interval}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
