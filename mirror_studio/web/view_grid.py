"""The view that a mirror shows as a grid of directions over it, for a hand to draw another one."""

from __future__ import annotations

import numpy as np

from mirror_cad.errors import SurfaceError
from mirror_studio.json_types import Json
from mirror_studio.web.engine import Designed
from raytrace.rays import Status
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View

COLUMNS, ROWS = 9, 9  # as few as a hand moves, as many as follow a progressive zone to a tenth of a degree
DIGITS = 4  # of an angle in degrees, a third of an arc second, and of a place in mm


def view_grid(one: Designed) -> dict[str, Json]:
    """Where the eye's rays through a grid over the outline's box go, as `[target] projection = "table"` has it.

    Parameters
    ----------
    one : Designed
        The mirror.

    Raises
    ------
    SurfaceError
        Where its sheet does not reach over the whole grid.
    """
    x_min, x_max, y_min, y_max = one.mirror.box
    x, y = np.linspace(x_min, x_max, COLUMNS).round(DIGITS), np.linspace(y_min, y_max, ROWS).round(DIGITS)
    across, up = (each.ravel() for each in np.meshgrid(x, y))
    traced = View(one.reflector, Pose.identity(), one.setup.eye).untrimmed.trace(across, up)
    directions = traced.directions
    if not (np.all(traced.status == Status.REFLECTED) and (directions[:, 2] > 0.0).all()):
        raise SurfaceError("the mirror does not send every ray of a grid over its outline's box to the rear: draw the grid on "
                           "one that is less steep")
    azimuth, elevation = (np.degrees(np.arctan(directions[:, k] / directions[:, 2])).round(DIGITS).reshape(ROWS, COLUMNS)
                          for k in (0, 1))
    return {"projection": "table", "x_mm": x.tolist(), "y_mm": y.tolist(),
            "azimuth_deg": azimuth.tolist(), "elevation_deg": elevation.tolist(), "eye": "one", "convex": False}
