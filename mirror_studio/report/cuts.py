"""Cut a mirror three times along x and y, with the curvatures along each cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirror_cad.designed import FLOOR
from mirror_cad.mirror import Mirror
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import ShapeOperator, shape_operator
from mirror_studio.report.fields import deviation_in
from mirror_studio.report.tables import Table

Array = NDArray[np.float64]

SAMPLES = 241  # on a cut across the whole box: a sample a millimetre, or finer than a plot shows
SHARES = (-1.0 / 3.0, 0.0, 1.0 / 3.0)  # of the half-extent: where the cuts lie beside the box's middle


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """A plane section of the optical face, inside the outline: y = at_mm for along "x", x = at_mm for along "y".

    points : (n, 3) mm, NaN outside the outline, so that drawn lines break there.   designed, realised : shape operators.
    plane_curvature : (n,) of the section itself as a curve in its plane, 1/mm, convex positive: z″/(1 + z′²)^(3/2), as a CAD
    system's comb shows it; by Meusnier's theorem the normal curvature is smaller by the cosine of the normal's tilt.
    slope : (n,) z′ along the cut.   deviation : of kx and ky, in `unit` (% or 1/m).
    band : (2, n) for kx and for ky, 1/mm: the designed curvature ± the limit, or None without a limit in percent.
    """

    along: Literal["x", "y"]
    at_mm: float
    points: Array
    designed: ShapeOperator
    realised: ShapeOperator
    plane_curvature: Array
    slope: Array
    deviation: dict[str, Array]
    unit: str
    band: dict[str, Array] | None

    @property
    def position(self) -> Array:
        """The coordinate along the cut, mm."""
        return self.points[:, 0 if self.along == "x" else 1]

    @property
    def name(self) -> str:
        """“y = 54 mm”."""
        return f"{'y' if self.along == 'x' else 'x'} = {self.at_mm:.4g}".replace("-", "−") + " mm"


def cuts(mirror: Mirror, surface: BSplineSurface, rms: float, unit: str) -> list[Cut]:
    """At the middle of the outline's box and a third of its half-extent to either side, first the horizontal ones.

    rms : of the designed curvature, 1/mm.   unit : of the deviation, "%" or "1/m".
    """
    x_min, x_max, y_min, y_max = mirror.box
    found = []
    for along, (low, high), (across_low, across_high) in (("x", (x_min, x_max), (y_min, y_max)),
                                                          ("y", (y_min, y_max), (x_min, x_max))):
        # A middle that is zero but for rounding is zero.
        middle, half = 0.5 * (across_low + across_high), 0.5 * (across_high - across_low)
        for share in SHARES:
            at = round(middle + share * half, 9) + 0.0
            found.append(_cut(mirror, surface, "x" if along == "x" else "y", at, np.linspace(low, high, SAMPLES), rms, unit))
    return found


def cuts_table(found: list[Cut]) -> Table:
    """All cuts under each other, the points outside the outline left out."""
    columns: dict[str, list[Array]] = {}
    for cut in found:
        inside = np.isfinite(cut.position)
        unit = "percent" if cut.unit == "%" else "per_m"
        one = {"cut": np.full(len(inside), ("y" if cut.along == "x" else "x")), "at_mm": np.full(len(inside), cut.at_mm),
               "x_mm": cut.points[:, 0], "y_mm": cut.points[:, 1], "z_mm": cut.points[:, 2],
               "kx_designed_per_m": 1e3 * cut.designed.w11, "kx_realised_per_m": 1e3 * cut.realised.w11,
               "ky_designed_per_m": 1e3 * cut.designed.w22, "ky_realised_per_m": 1e3 * cut.realised.w22,
               f"kx_deviation_{unit}": cut.deviation["kx"], f"ky_deviation_{unit}": cut.deviation["ky"],
               "twist_realised_per_m": 1e3 * cut.realised.w12, "section_curvature_per_m": 1e3 * cut.plane_curvature}
        for key, values in one.items():
            columns.setdefault(key, []).append(values[inside])
    return Table("sections", {key: np.concatenate(values) for key, values in columns.items()})


def _cut(mirror: Mirror, surface: BSplineSurface, along: Literal["x", "y"], at: float, t: Array, rms: float, unit: str) -> Cut:
    other = np.full_like(t, at)
    x, y = (t, other) if along == "x" else (other, t)
    # The ends of the box lie on the outline, where rounding may say outside: half a micrometre inside they do not.
    middle = 0.5 * (t[0] + t[-1])
    inward = t + np.clip(middle - t, -5e-4, 5e-4)
    inside = mirror.outline.contains(*((inward, other) if along == "x" else (other, inward)))
    d = surface.derivatives(x, y)
    realised, designed = shape_operator(d), mirror.curvature.shape(x)
    first, second = (d[key][:, 2] for key in (("u", "uu") if along == "x" else ("v", "vv")))
    values = deviation_in(unit, realised, designed, rms)
    limit, band = mirror.spec.limits.curvature_percent, None
    if limit is not None and rms > 0.0:
        band = {}
        for key, kappa in (("kx", designed.w11), ("ky", designed.w22)):
            allowed = 0.01 * limit * np.maximum(np.abs(kappa), FLOOR * rms)
            band[key] = _outside(np.stack([kappa - allowed, kappa + allowed]), inside)
    return Cut(along, at, _outside(d["s"].T, inside).T, _masked(designed, inside), _masked(realised, inside),
               _outside(-second / (1.0 + first**2) ** 1.5, inside), _outside(first, inside),
               {"kx": _outside(values.kx, inside), "ky": _outside(values.ky, inside)}, unit, band)


def _masked(w: ShapeOperator, inside: NDArray[np.bool_]) -> ShapeOperator:
    return ShapeOperator(*(_outside(each, inside) for each in w))


def _outside(values: Array, inside: NDArray[np.bool_]) -> Array:
    """NaN where not inside, along the last axis."""
    return np.where(inside, values, np.nan)
