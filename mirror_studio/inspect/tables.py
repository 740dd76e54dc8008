"""The maps and points of an inspection as CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.made.figures import ARCMIN
from mirror_cad.made.inspection import Inspection
from mirror_studio.inspect.driver import DriversView

Array = NDArray[np.float64]

MAX_RESIDUALS = 50_000  # rows: of more points every so-manieth


def write_maps(path: Path, found: Inspection, view: DriversView | None) -> None:
    """A row a place: height, slopes, curvatures, each with its sigma; empty where it is not known.

    Parameters
    ----------
    path : Path
        Of the file.
    found : Inspection
        The mirror.
    view : DriversView or None
        What the driver sees in it.
    """
    fields = found.fields
    places = fields.lattice.places
    columns: dict[str, Array] = {
        "x_mm": places[:, 0], "y_mm": places[:, 1], "height_mm": fields.height, "height_sigma_mm": fields.height_sigma,
        "slope_x_arcmin": ARCMIN * fields.slope_x, "slope_y_arcmin": ARCMIN * fields.slope_y,
        "slope_sigma_arcmin": ARCMIN * fields.slope_sigma}
    for quantity in QUANTITIES:
        columns[f"{quantity}_per_m"] = 1e3 * getattr(fields.curvature, quantity)
        columns[f"{quantity}_sigma_per_m"] = 1e3 * getattr(fields.curvature_sigma, quantity)
        if not fields.flat:
            columns[f"{quantity}_percent"], columns[f"{quantity}_sigma_percent"] = fields.percent(quantity)
    for name, w in (("designed", fields.designed), ("measured", fields.measured)):
        columns |= {f"{key}_{name}_per_m": 1e3 * value for key, value in zip(("kx", "ky", "twist"), w, strict=True)}
    if view is not None:
        columns |= {"ray_turn_arcmin": view.turn, "ray_turn_sigma_arcmin": view.turn_sigma}
    columns["gauge_stands"] = fields.known.astype(np.float64)
    _write(path, columns)


def write_residuals(path: Path, found: Inspection) -> None:
    """The points in the design's coordinates, what they are off the reconstructed surface, and whether they count.

    Parameters
    ----------
    path : Path
        Of the file.
    found : Inspection
        The mirror.
    """
    rows = found.rows
    some = slice(None, None, max(1, -(-len(rows) // MAX_RESIDUALS)))
    at, residuals, kept = found.points[rows[some]], found.reconstruction.residuals[some], found.reconstruction.kept[some]
    _write(path, {"x_mm": at[:, 0], "y_mm": at[:, 1], "z_mm": at[:, 2], "residual_mm": residuals,
                  "counts": kept.astype(np.float64)})


def _write(path: Path, columns: dict[str, Array]) -> None:
    with path.open("w", encoding="utf-8") as stream:
        stream.write(",".join(columns) + "\n")
        np.savetxt(stream, np.stack(list(columns.values()), axis=1), fmt="%.9g", delimiter=",")
    text = path.read_text("utf-8")
    path.write_text(text.replace("nan", ""), encoding="utf-8")
