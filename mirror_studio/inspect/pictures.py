"""Draw the deviations of a made mirror over its outline; what is not known stays grey."""

from __future__ import annotations

import io

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.made.figures import ARCMIN, slope_angles
from mirror_cad.made.hidden_form import HiddenForm
from mirror_cad.made.inspection import Inspection
from mirror_studio.report.figure_style import DIVERGING, DPI, STYLE, WIDTH_IN

Array = NDArray[np.float64]

UNKNOWN = "#d4d4d0"
MIN_SCALE = 1e-9


def form_maps(found: Inspection) -> bytes:
    """Height, slope and the residuals of the points; PNG.

    Parameters
    ----------
    found : Inspection
        The mirror.
    """
    fields = found.fields
    maps = [("height, µm", 1e3 * fields.height, True), ("sigma of height, µm", 1e3 * fields.height_sigma, False),
            ("slope, arcmin", ARCMIN * slope_angles(found.nominal, fields), False),
            ("sigma of slope, arcmin", ARCMIN * fields.slope_sigma, False)]
    return _row(found, maps)


def curvature_maps(found: Inspection) -> bytes:
    """k1, k2, kx, ky and twist; PNG.

    Parameters
    ----------
    found : Inspection
        The mirror.
    """
    return _row(found, [(f"{key}, {_unit(found)}", _curvature(found, key)[0], True) for key in QUANTITIES], one_scale=True)


def sigma_maps(found: Inspection) -> bytes:
    """The sigmas of the same; PNG.

    Parameters
    ----------
    found : Inspection
        The mirror.
    """
    return _row(found, [(f"sigma of {key}, {_unit(found)}", _curvature(found, key)[1], False) for key in QUANTITIES],
                one_scale=True)


def turn_maps(found: Inspection, turn: Array, sigma: Array) -> bytes:
    """By how much the reflected rays turn, and its sigma; PNG.

    Parameters
    ----------
    found : Inspection
        The mirror.
    turn, sigma : ndarray
        (k,), arc minutes, at the lattice's places.
    """
    return _row(found, [("turn of the ray, arcmin", turn, False), ("sigma of the turn, arcmin", sigma, False)], width=0.5)


def hidden_maps(found: Inspection, hidden: HiddenForm) -> bytes | None:
    """The deviation as the points were given, what the alignment takes away of it, what is left, and a sigma; PNG.

    Parameters
    ----------
    found : Inspection
        The mirror.
    hidden : HiddenForm
        Of its alignment.

    Returns
    -------
    bytes or None
        None where nothing of it is known, and where nothing was aligned.
    """
    if found.align == "none":
        return None
    maps: list[tuple[str, Array, bool]] = []
    if hidden.height is not None:
        taken = np.where(found.fields.measured_there, hidden.height, np.nan)
        maps += [("as given, µm", 1e3 * (found.fields.height + taken), True),
                 ("taken away by the motion, µm", 1e3 * taken, True),
                 ("left after alignment, µm", 1e3 * found.fields.height, True)]
    if hidden.sigma is not None:
        maps.append(("sigma by the alignment, µm", 1e3 * hidden.sigma, False))
    return _row(found, maps, width=min(1.0, 0.25 * len(maps))) if maps else None


def correction_maps(found: Inspection, deviation: Array, correction: Array, sigma: Array | None) -> bytes:
    """What mirrors deviate by and what a mould is changed by; PNG.

    Parameters
    ----------
    found : Inspection
        One of the mirrors.
    deviation, correction, sigma : ndarray
        (k,), mm, at the lattice's places; the sigma of the mean, where there are several mirrors.
    """
    maps = [("deviation, µm", 1e3 * deviation, True), ("correction, µm", 1e3 * correction, True)]
    return _row(found, maps if sigma is None else [*maps, ("sigma of the mean, µm", 1e3 * sigma, False)], width=0.7)


def _unit(found: Inspection) -> str:
    return "1/m" if found.fields.flat else "%"


def _curvature(found: Inspection, key: str) -> tuple[Array, Array]:
    fields = found.fields
    value, sigma = ((1e3 * getattr(fields.curvature, key), 1e3 * getattr(fields.curvature_sigma, key)) if fields.flat else
                    fields.percent(key))  # type: ignore[arg-type]  # one of QUANTITIES
    return np.where(fields.known, value, np.nan), np.where(fields.known, sigma, np.nan)


def _row(found: Inspection, maps: list[tuple[str, Array, bool]], one_scale: bool = False, width: float = 1.0) -> bytes:
    x_min, x_max, y_min, y_max = found.nominal.box
    known = found.fields.known if found.fields.known.any() else slice(None)
    with matplotlib.rc_context(STYLE):
        each = width * WIDTH_IN / len(maps)
        height = float(np.clip(0.78 * each * (y_max - y_min) / (x_max - x_min), 1.0, 6.0)) + 1.15
        figure = Figure(figsize=(width * WIDTH_IN, height), layout="constrained")
        row = figure.subplots(1, len(maps), squeeze=False)[0]
        # What stands at the rim, where the gauge does not, is less sure and sets no scale.
        largest = [float(np.nanmax(np.abs(v[known]), initial=0.0)) for _, v, _ in maps]
        for axes, (title, values, signed), own in zip(row, maps, largest, strict=True):
            top = max(max(largest) if one_scale else own, MIN_SCALE)
            drawn = axes.imshow(found.fields.lattice.as_map(values).T, origin="lower", extent=(x_min, x_max, y_min, y_max),
                                cmap=DIVERGING if signed else "viridis", norm=Normalize(-top if signed else 0.0, top),
                                interpolation="nearest", aspect="equal")
            _frame(axes, drawn, found.nominal.rim, title)
            if not one_scale or axes is row[-1]:
                bar = figure.colorbar(drawn, ax=row if one_scale else axes, location="bottom", shrink=0.9, pad=0.02,
                                      aspect=60 if one_scale else 18)
                bar.ax.tick_params(labelsize=8.0, length=2.5)
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
        return file.getvalue()


def _frame(axes: Axes, drawn: object, rim: Array, title: str) -> None:
    axes.set_facecolor("white")
    grey = Polygon(rim.tolist(), closed=True, fc=UNKNOWN, ec="none", zorder=-1)
    axes.add_patch(grey)
    drawn.set_clip_path(Polygon(rim.tolist(), closed=True, transform=axes.transData))  # type: ignore[attr-defined]
    axes.add_patch(Polygon(rim.tolist(), closed=True, fill=False, ec="#555555", lw=0.7, clip_on=False))
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title(title, loc="left")
    axes.tick_params(labelsize=7.5, length=2.0)
