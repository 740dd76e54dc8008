"""The height of a B-spline with u = x and v = y, as what asks for a sag takes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.sections import SagDerivatives
from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SplineSag:
    """z(x, y) of a B-spline with u = x, v = y."""

    surface: BSplineSurface

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """z at (x, y), mm, broadcast."""
        return self.derivatives(x, y).z

    def derivatives(self, x: ArrayLike, y: ArrayLike) -> SagDerivatives:
        """z, z_x, z_y, z_xx, z_xy, z_yy at (x, y), broadcast; mm and 1/mm."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        if x.ndim == 2 and x.shape[1] == 1 and y.ndim == 1:
            d = self.surface.on_grid(x[:, 0], y, component=2)
        else:
            d = {key: value[..., 2] for key, value in self.surface.derivatives(x, y).items()}
        return SagDerivatives(d["s"], d["u"], d["v"], d["uu"], d["uv"], d["vv"])
