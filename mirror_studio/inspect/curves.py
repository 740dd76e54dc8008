"""Sections and histograms of a made mirror's deviation, each with how sure it is; SVG."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.figures import COVERAGE
from mirror_cad.made.inspection import Inspection
from mirror_studio.report.drawing import SOFT, WIDTH, Panel, drawing, legend

Array = NDArray[np.float64]

LEFT, RIGHT, APART, TOP, HEIGHT, BELOW = 78.0, 12.0, 78.0, 30.0, 150.0, 62.0  # px
BLUE, RED, GREY = "#0072b2", "#d55e00", "#595959"
BINS = 41  # odd, so that one is centred on zero
LEAST = 1e-9  # of a scale: of a mirror without deviation


def sections_figure(found: Inspection) -> bytes:
    """Height, and kx and ky where any are known, along the middle across and the middle upright, with 95 % bands; SVG.

    Parameters
    ----------
    found : Inspection
        The mirror.
    """
    fields, lattice = found.fields, found.fields.lattice
    unit, scale = ("1/m", 1e3) if fields.flat else ("%", 1.0)
    curves = [("height, µm", [("height", BLUE, 1e3 * fields.height, 1e3 * fields.height_sigma)])]
    if fields.known.any():
        curves.append((f"curvature, {unit}", [
            (key, colour, *_known(found, scale * value, scale * sigma)) for key, colour, (value, sigma) in (
                ("kx", BLUE, _curvature(found, "kx")), ("ky", RED, _curvature(found, "ky")))]))
    width, parts = 0.5 * (WIDTH - LEFT - APART - RIGHT), []
    x_min, x_max, y_min, y_max = found.nominal.box
    for column, (at, ends, name) in enumerate(((lattice.x, (x_min, x_max), "x"), (lattice.y, (y_min, y_max), "y"))):
        for row, (label, lines) in enumerate(curves):
            cut = [(key, colour, _middle(found, value, name), _middle(found, sigma, name))
                   for key, colour, value, sigma in lines]
            reach = [float(np.nanmax(np.abs(value) + COVERAGE * sigma, initial=0.0)) for _, _, value, sigma in cut]
            top = 1.1 * max(*reach, LEAST)
            panel = Panel(LEFT + column * (width + APART), TOP + row * (HEIGHT + BELOW), width, HEIGHT, ends, (-top, top))
            panel.level(0.0, SOFT)
            for _, colour, value, sigma in cut:
                panel.band(at, value - COVERAGE * sigma, value + COVERAGE * sigma, colour, 0.18)
                panel.line(at, value, colour)
            other = "y" if name == "x" else "x"
            parts.append(panel.svg(2 * column + row, f"along {name}, at the middle of {other}" if row == 0 else "",
                                   f"{name}, mm", label if column == 0 else ""))
            if len(cut) > 1:
                parts.append(legend(panel.left + width, panel.top - 8.0, [(key, colour, 1.4, 1.0, "")
                                                                          for key, colour, _, _ in cut]))
    return drawing(TOP + len(curves) * (HEIGHT + BELOW) - 18.0, parts)


def histograms_figure(found: Inspection) -> bytes:
    """Share of the area over the deviation of height, and of the curvatures where any are known; SVG.

    Parameters
    ----------
    found : Inspection
        The mirror.
    """
    unit, scale = ("1/m", 1e3) if found.fields.flat else ("%", 1.0)
    groups = [("height, µm", [("height", BLUE, "", 1e3 * found.fields.height)])]
    curvatures = ((("k1", BLUE, ""), ("k2", RED, "")), (("kx", BLUE, ""), ("ky", RED, ""), ("twist", GREY, "6 3")))
    for keys in curvatures if found.fields.known.any() else ():
        groups.append((f"{', '.join(key for key, _, _ in keys)}, {unit}", [
            (key, colour, dash, _known(found, scale * _curvature(found, key)[0], scale * _curvature(found, key)[0])[0])
            for key, colour, dash in keys]))
    width, parts = (WIDTH - LEFT - 2.0 * 44.0 - RIGHT) / 3.0, []
    for k, (label, lines) in enumerate(groups):
        known = [(key, colour, dash, value[np.isfinite(value)]) for key, colour, dash, value in lines]
        top = max(*(float(np.abs(value).max(initial=0.0)) for *_, value in known), LEAST)
        edges = np.linspace(-1.05 * top, 1.05 * top, BINS + 1)
        shares = [100.0 * np.histogram(value, edges)[0] / max(1, value.size) for *_, value in known]
        panel = Panel(LEFT + k * (width + 44.0), TOP, width, HEIGHT, (float(edges[0]), float(edges[-1])),
                      (0.0, 1.08 * max(1e-3, *(float(share.max()) for share in shares))))
        for (_, colour, dash, _), share in zip(known, shares, strict=True):
            panel.stairs(edges, share, colour, 1.6, dash)
        parts.append(panel.svg(k, "", f"measured − designed, {label}", "share of area, %" if k == 0 else ""))
        parts.append(legend(panel.left + width, TOP - 8.0, [(key, colour, 1.6, 1.0, dash) for key, colour, dash, _ in known]))
    return drawing(TOP + HEIGHT + 42.0, parts)


def _curvature(found: Inspection, key: str) -> tuple[Array, Array]:
    fields = found.fields
    if fields.flat:
        return getattr(fields.curvature, key), getattr(fields.curvature_sigma, key)
    return fields.percent(key)  # type: ignore[arg-type]  # one of QUANTITIES


def _known(found: Inspection, value: Array, sigma: Array) -> tuple[Array, Array]:
    return np.where(found.fields.known, value, np.nan), np.where(found.fields.known, sigma, np.nan)


def _middle(found: Inspection, values: Array, along: str) -> Array:
    rectangle = found.fields.lattice.as_map(values)
    result: Array = rectangle[:, rectangle.shape[1] // 2] if along == "x" else rectangle[rectangle.shape[0] // 2]
    return result
