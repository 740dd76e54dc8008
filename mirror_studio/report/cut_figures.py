"""Draw the radii of three cuts each along x and y with the limit's band, and their curvature combs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_studio.report.cuts import Cut
from mirror_studio.report.drawing import WIDTH, Panel, Range, drawing, legend
from mirror_studio.report.fields import FAR_LIMIT, MIN_CURVATURE_PER_M, MIN_PERCENT, radius_pair, widened
from mirror_studio.report.maps import DESIGNED, LIMIT, REALISED
from mirror_studio.report.text import given

Array = NDArray[np.float64]

LEFT, RIGHT, APART = 78.0, 12.0, 22.0  # px, beside and between the panels
TOP, RADIUS_HEIGHT, DEVIATION_HEIGHT, BETWEEN, BELOW = 46.0, 140.0, 80.0, 16.0, 42.0
COMB_HEIGHT, COMB_BETWEEN = 150.0, 62.0
ROWS = (("kx", "Rx", "w11"), ("ky", "Ry", "w22"))
DASH = "6 4"
TEETH = 41  # of a comb
LONGEST_TOOTH = 0.22  # of the cuts' length


def radius_figure(cuts: list[Cut], limit_percent: float | None) -> bytes:
    """Rx and Ry along the cuts of one direction, designed and realised with the limit's band, and their deviation; SVG."""
    width = (WIDTH - LEFT - RIGHT - APART * (len(cuts) - 1)) / len(cuts)
    parts: list[str] = []
    top, banded = TOP, False
    for key, name, part in ROWS:
        label, shown, scale = _radii(cuts, name, part, key)
        low, high = _deviation_range(cuts, key, limit_percent)
        last = key == ROWS[-1][0]
        for k, cut in enumerate(cuts):
            left, ends = LEFT + k * (width + APART), (float(np.nanmin(cut.position)), float(np.nanmax(cut.position)))
            upper = Panel(left, top, width, RADIUS_HEIGHT, ends, scale)
            designed, realised, band = shown[k]
            if band is not None:
                upper.band(cut.position, *band, LIMIT, 0.16)
                banded = True
            upper.line(cut.position, designed, DESIGNED, 5.5)
            upper.line(cut.position, realised, REALISED, 1.5)
            lower = Panel(left, top + RADIUS_HEIGHT + BETWEEN, width, DEVIATION_HEIGHT, ends, (low, high))
            lower.level(0.0, "#999999")
            lower.line(cut.position, cut.deviation[key], REALISED, 1.5)
            if limit_percent is not None and cut.unit == "%" and limit_percent < high:
                for edge in (-limit_percent, limit_percent):
                    lower.level(edge, LIMIT, 1.4, DASH)
            first = k == 0
            labels = (label, f"Δ{key}, {cut.unit}") if first else ("", "")
            parts += [upper.svg(len(parts), cut.name if key == "kx" else "", "", labels[0], False, first),
                      lower.svg(len(parts) + 1, "", f"{cut.along}, mm" if last else "", labels[1], last, first)]
        top += RADIUS_HEIGHT + DEVIATION_HEIGHT + 2.0 * BETWEEN
    keys = [("designed", DESIGNED, 5.5, 1.0, ""), ("realised", REALISED, 1.5, 1.0, "")]
    if banded and limit_percent is not None:
        keys.append((f"±{given(limit_percent, '%')} of curvature", LIMIT, 11.0, 0.16, ""))
    return drawing(top - BETWEEN + BELOW, [*parts, legend(WIDTH - RIGHT, 16.0, keys)])


def comb_figure(cuts: list[Cut]) -> bytes:
    """Every cut with its curvature comb to scale, teeth along its normal, and the law's line through where they would end; SVG.

    Cuts of one direction share a scale; a tooth towards the driver (up) is convex.
    """
    parts: list[str] = []
    top = TOP
    for along in ("x", "y"):
        some = [cut for cut in cuts if cut.along == along]
        width = (WIDTH - LEFT - RIGHT - APART * (len(some) - 1)) / len(some)
        length = max(float(np.nanmax(cut.position) - np.nanmin(cut.position)) for cut in some)
        largest = max(float(np.nanmax(np.abs(cut.plane_curvature))) for cut in some)
        scale = LONGEST_TOOTH * length / max(largest, 1e-3 * MIN_CURVATURE_PER_M)
        combs = [_comb(cut, scale) for cut in some]
        drawn = np.concatenate([np.concatenate(comb, axis=1) for comb in combs], axis=1)
        low, high = np.nanmin(drawn, axis=1), np.nanmax(drawn, axis=1)
        # One scale for both axes: the way that has room to spare is opened.
        middle, per_px = 0.5 * (low + high), 1.06 * max((high[0] - low[0]) / width, (high[1] - low[1]) / COMB_HEIGHT)
        x, z = ((float(middle[i] - 0.5 * per_px * size), float(middle[i] + 0.5 * per_px * size))
                for i, size in enumerate((width, COMB_HEIGHT)))
        for k, (cut, (curve, ends, meant)) in enumerate(zip(some, combs, strict=True)):
            panel = Panel(LEFT + k * (width + APART), top, width, COMB_HEIGHT, x, z)
            inside = np.flatnonzero(np.isfinite(curve[1]))
            chosen = inside[np.unique(np.round(np.linspace(0, len(inside) - 1, TEETH)).astype(int))]
            panel.segments(curve[:, chosen].T, ends[:, chosen].T, "#8aa4bf", 0.8)
            panel.line(meant[0], meant[1], LIMIT, 3.2, opacity=0.55)
            panel.line(ends[0], ends[1], REALISED, 1.3)
            panel.line(curve[0], curve[1], "#222222", 1.9)
            note = f"{1e-3 * scale:.4g} mm of tooth = 1/m" if k == len(some) - 1 else ""
            parts.append(panel.svg(len(parts), cut.name, f"{along}, mm", "z, mm" if k == 0 else "", True, k == 0, note))
        top += COMB_HEIGHT + COMB_BETWEEN
    keys = [("the cut", "#222222", 1.9, 1.0, ""), ("its curvature", REALISED, 1.3, 1.0, ""),
            ("the law's", LIMIT, 3.2, 0.55, "")]
    return drawing(top - COMB_BETWEEN + BELOW, [*parts, legend(WIDTH - RIGHT, 16.0, keys)])


def _comb(cut: Cut, scale: float) -> tuple[Array, Array, Array]:
    """The cut, its teeth's ends and where the law would have them, (2, n) each."""
    curve = np.stack([cut.position, cut.points[:, 2]])
    normal = np.stack([-cut.slope, np.ones_like(cut.slope)]) / np.hypot(1.0, cut.slope)
    law = cut.designed.w11 if cut.along == "x" else cut.designed.w22
    return curve, curve + scale * cut.plane_curvature * normal, curve + scale * law * normal


Shown = tuple[Array, Array, tuple[Array, Array] | None]


def _radii(cuts: list[Cut], name: str, part: str, key: str) -> tuple[str, list[Shown], Range]:
    """Label of the axis; designed, realised and band of each cut in its unit; and the axis's range."""
    designed = np.concatenate([getattr(cut.designed, part) for cut in cuts])
    realised = np.concatenate([getattr(cut.realised, part) for cut in cuts])
    inside = np.isfinite(designed)
    pair = radius_pair(name, designed[inside], realised[inside])

    def in_unit(kappa: Array) -> Array:
        result: Array = 1e3 * kappa if pair.as_curvature else 1.0 / kappa
        return result

    shown: list[Shown] = []
    for cut in cuts:
        band = None
        # A limit of 100 % and more lets the curvature through zero, where the radius has no band.
        if cut.band is not None and (pair.as_curvature or not bool((cut.band[key][0] * cut.band[key][1] <= 0.0).any())):
            band = in_unit(cut.band[key][0]), in_unit(cut.band[key][1])
        shown.append((in_unit(getattr(cut.designed, part)), in_unit(getattr(cut.realised, part)), band))
    both = np.concatenate([pair.designed, pair.realised])
    least = MIN_CURVATURE_PER_M if pair.as_curvature else 2e-3 * float(np.abs(both).max())
    low, high = widened(float(both.min()), float(both.max()), least)
    edges = np.concatenate([edge for *_, band in shown if band is not None for edge in band] or [both])
    # The band opens the scale as long as the curves can still be told apart on it.
    if np.nanmax(edges) - np.nanmin(edges) <= FAR_LIMIT * (high - low) or high - low <= least:
        low, high = min(low, float(np.nanmin(edges))), max(high, float(np.nanmax(edges)))
    margin = 0.1 * (high - low)
    return f"{pair.name}, {pair.unit}", shown, (low - margin, high + margin)


def _deviation_range(cuts: list[Cut], key: str, limit_percent: float | None) -> Range:
    largest = max(float(np.nanmax(np.abs(cut.deviation[key]))) for cut in cuts)
    span = max(1.15 * largest, MIN_PERCENT if cuts[0].unit == "%" else MIN_CURVATURE_PER_M)
    if limit_percent is not None and cuts[0].unit == "%" and limit_percent <= FAR_LIMIT * span:
        span = max(span, 1.15 * limit_percent)
    return -span, span
