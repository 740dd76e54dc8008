"""What `mirror-cad inspect` wrote of a made mirror, as the page shows it: figures, and maps to colour the mirror by."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.made.figures import ARCMIN, angle_between_normals
from mirror_cad.mirror import Mirror
from mirror_studio.json_types import Json

Array = NDArray[np.float64]

# Over what was measured; of curvature only where the gauge stands.
FORM = ("height_mm", "height_sigma_mm", "slope_sigma_arcmin", "ray_turn_arcmin", "ray_turn_sigma_arcmin")


@dataclass(frozen=True, eq=False)
class Shown:
    """A made mirror for the page.

    Attributes
    ----------
    header
        inspection.json, the titles of the driver's measures, and where the maps lie, mm.
    arrays
        By name, (columns, rows) of cells, NaN where nothing is known: deviations, their sigmas as NAME_sigma, and
        `stands`, 1 where the gauge does.
    """

    header: dict[str, Json]
    arrays: dict[str, Array]


def shown(folder: Path, mirror: Mirror) -> Shown:
    """Read the files of an inspection.

    Parameters
    ----------
    folder
        Where they are.
    mirror
        The design that it was against; maps are told in its coordinates, those of a left-hand mirror.
    """
    content: dict[str, Any] = json.loads((folder / "inspection.json").read_text("utf-8"))
    columns = _columns(folder / f"{content['name']}-maps.csv")
    x, y = columns["x_mm"], columns["y_mm"]
    _, zx, zy = mirror.as_made.surface.heights(x, y)
    dx, dy = columns["slope_x_arcmin"] / ARCMIN, columns["slope_y_arcmin"] / ARCMIN
    arcmin = {"slope_arcmin": ARCMIN * angle_between_normals(zx, zy, dx, dy)}
    arcmin |= {name: columns[name] for name in FORM if name in columns}
    stands = columns["gauge_stands"] > 0.0
    unit = "percent" if "k1_percent" in columns else "per_m"
    values = arcmin | {"stands": stands.astype(np.float64)}
    for quantity in QUANTITIES:
        for name in (quantity, f"{quantity}_sigma"):
            values[name] = np.where(stands, columns[f"{name}_{unit}"], np.nan)
    if mirror.spec.part.hand == "right":  # told of the part as it is made
        x, values["twist"] = -x, -values["twist"]
    cells = _Cells.of(x, y)
    measures = _titled(content["driver"]["measures"]) if "driver" in content else []
    return Shown({"inspection": content, "measures": measures, "cells_mm": list(cells.box), "unit": unit},
                 {name: cells.filled(value) for name, value in values.items()})


def _columns(path: Path) -> dict[str, Array]:
    """A table of numbers, by the names of its columns; an empty field is NaN."""
    with path.open(encoding="utf-8") as stream:
        names = stream.readline().strip().split(",")
        rows = np.genfromtxt(stream, delimiter=",", ndmin=2)
    return dict(zip(names, np.ascontiguousarray(rows.T), strict=True))


@dataclass(frozen=True, eq=False)
class _Cells:
    """The rectangle of cells whose middles inside the outline a table lists.   box : its edges, mm."""

    box: tuple[float, float, float, float]
    at: tuple[NDArray[np.int64], NDArray[np.int64]]
    shape: tuple[int, int]

    @staticmethod
    def of(x: Array, y: Array) -> _Cells:
        ends, at, shape = [], [], []
        for values in (x, y):
            middles = np.unique(values)
            pitch = float(np.diff(middles).min())
            at.append(np.rint((values - middles[0]) / pitch).astype(np.int64))
            shape.append(int(at[-1].max()) + 1)
            ends += [float(middles[0]) - 0.5 * pitch, float(middles[-1]) + 0.5 * pitch]
        return _Cells((ends[0], ends[1], ends[2], ends[3]), (at[0], at[1]), (shape[0], shape[1]))

    def filled(self, values: Array) -> Array:
        """A map of the values; a cell whose middle lies outside the outline has what the nearest one inside has."""
        found, outside = np.full(self.shape, np.nan), np.ones(self.shape, dtype=bool)
        found[self.at], outside[self.at] = values, False
        nearest = distance_transform_edt(outside, return_distances=False, return_indices=True)
        result: Array = found[tuple(nearest)]
        return result


def _titled(measures: dict[str, dict[str, Any]]) -> list[dict[str, Json]]:
    from raytrace.measures.registry import registered

    known = registered()
    return [{"name": name, "title": known[name].title, "unit": known[name].unit, "decimals": known[name].decimals, **found}
            for name, found in measures.items() if name in known]
