"""How much of a mirror's area has how much deviation: figures and a drawing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.deviation import Deviation
from mirror_studio.report.drawing import WIDTH, Panel, drawing, legend
from mirror_studio.report.fields import DeviationFields
from mirror_studio.report.maps import LIMIT
from mirror_studio.report.tables import Table
from mirror_studio.report.text import given

Array = NDArray[np.float64]

BINS = 81  # odd, so that one is centred on zero
LEFT, RIGHT, APART, TOP, HEIGHT = 78.0, 12.0, 58.0, 30.0, 190.0  # px of the drawing
LINES = {"k1": ("#0072b2", 1.8, ""), "k2": ("#d55e00", 1.8, ""), "kx": ("#0072b2", 1.8, ""), "ky": ("#d55e00", 1.8, ""),
         "twist": ("#595959", 1.8, "6 3")}


@dataclass(frozen=True, slots=True, eq=False)
class Histogram:
    """Share of the area, percent, of each deviation in bins between `edges`, by equal area in (x, y)."""

    edges: Array
    share: dict[str, Array]
    unit: str

    @property
    def bin_width(self) -> float:
        """In `unit`."""
        return float(self.edges[1] - self.edges[0])

    def table(self) -> Table:
        """A row a bin."""
        unit = "percent" if self.unit == "%" else "per_m"
        return Table("histogram", {f"from_{unit}": self.edges[:-1], f"to_{unit}": self.edges[1:]}
                     | {f"{key}_share_percent": share for key, share in self.share.items()})


def histogram(deviation: Deviation, fields: DeviationFields) -> Histogram:
    """Of all quantities, on the scale of their maps."""
    edges, weights = np.linspace(-fields.scale, fields.scale, BINS + 1), deviation.grid.weights
    share: dict[str, Array] = {
        key: 100.0 * np.histogram(fields.values[key], edges, weights=weights)[0] / weights.sum() for key in QUANTITIES}
    return Histogram(edges, share, fields.unit)


def histogram_figure(shares: Histogram, fields: DeviationFields) -> bytes:
    """k1 and k2 with the limit beside kx, ky and twist; SVG."""
    width = 0.5 * (WIDTH - LEFT - APART - RIGHT)
    scale, parts = (float(shares.edges[0]), float(shares.edges[-1])), []
    for k, keys in enumerate((("k1", "k2"), ("kx", "ky", "twist"))):
        highest = 1.05 * max(float(shares.share[key].max()) for key in keys)
        panel = Panel(LEFT + k * (width + APART), TOP, width, HEIGHT, scale, (0.0, highest))
        for key in keys:
            panel.stairs(shares.edges, shares.share[key], *LINES[key])
        note = ""
        if k == 0 and fields.limit is not None and not fields.limit_is_far:
            for limit in (-fields.limit, fields.limit):
                panel.upright(limit, LIMIT, 1.4, "6 4")
            note = f"dashed: limit ±{given(fields.limit, '%')}"
        names = [(key, LINES[key][0], LINES[key][1], 1.0, LINES[key][2]) for key in keys]
        parts += [panel.svg(k, note, f"realised − designed, {fields.unit}", "share of area, %" if k == 0 else ""),
                  legend(panel.left + width, TOP - 8.0, names)]
    return drawing(TOP + HEIGHT + 42.0, parts)
