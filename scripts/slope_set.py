"""Heights from the public slopes of Huang et al. (2017), beside the heights that come with them.

    git clone https://github.com/huanglei0114/Zonal-wavefront-reconstruction-in-quadrilateral-geometry
    python scripts/slope_set.py Zonal-wavefront-reconstruction-in-quadrilateral-geometry/data

Its files X, Y, Sx, Sy, Z and Z_calc (.bin) hold 128 × 128 quadrilaterals with the slopes and heights of a closed form and the
heights that its authors' program integrated. Prints the RMS of heights less their mean, for several numbers of spans.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.spline_fit import Observations, Space, fit_spline

Array = NDArray[np.float64]


def main(folder: Path) -> None:
    """Print the table.

    Parameters
    ----------
    folder : Path
        Of the files.
    """
    x, y, slope_x, slope_y, z, integrated = (_read(folder / f"{name}.bin") for name in ("X", "Y", "Sx", "Sy", "Z", "Z_calc"))
    print(f"heights that come with it: RMS {np.std(integrated - z):.2g}")
    operators = np.zeros((2 * x.size, 6))
    operators[: x.size, 1], operators[x.size:, 2] = 1.0, 1.0
    observed = Observations(np.tile(x, 2), np.tile(y, 2), operators, np.concatenate([slope_x, slope_y]),
                            np.full(2 * x.size, 1e-6), np.ones(2 * x.size))
    for spans in (24, 32, 48):
        space = Space((float(x.min()), float(x.max()), float(y.min()), float(y.max())), (spans, spans))
        off = fit_spline(space, observed, (), 1e9).heights(x, y) - z
        print(f"{spans} × {spans} spans: RMS {np.std(off):.2g}")


def _read(path: Path) -> Array:
    content = path.read_bytes()
    rows, columns = np.frombuffer(content[:8], "<i4")
    return np.frombuffer(content[8:], "<f8", count=int(rows) * int(columns)).copy()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
