"""The views of a posed mirror by two eyes and from the middle between them, and where a view looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.reflector import Reflector
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes
from raytrace.viewing.view import View

Array = NDArray[np.float64]

MARGIN = 0.03  # of the outline's box, beside it: glass shows a little beyond the outline of its back


@dataclass(frozen=True, eq=False)
class EyeViews:
    """The same posed mirror seen by the left eye, by the right one, and from the middle between them.

    Parameters
    ----------
    left, middle, right : the views.

    References
    ----------
    UN Regulation No. 46, section 12, reckons a driver's view from two ocular points 65 mm apart.
    """

    left: View
    middle: View
    right: View

    @staticmethod
    def of(reflector: Reflector, pose: Pose, eyes: Eyes) -> EyeViews:
        """The views of a posed reflector by a driver's eyes.

        Raises
        ------
        TraceError
            For an eye that no point of the mirror faces.
        """
        return EyeViews(*(View(reflector, pose, eye) for eye in (eyes.left, eyes.middle, eyes.right)))


def picture_grid(view: View, count: int) -> Array:
    """Points over all that a view may show, evenly spaced on the picture plane.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    count : of points a direction.

    Returns
    -------
    (count, count, 2), mm: rows, columns, and (x, y); over the outline's box and MARGIN of it on every side.
    """
    outline = view.on_plane_of(view.reflector.outline())
    low, high = outline.min(axis=0), outline.max(axis=0)
    low, high = low - MARGIN * (high - low), high + MARGIN * (high - low)
    return np.stack(np.meshgrid(np.linspace(low[0], high[0], count), np.linspace(low[1], high[1], count)), axis=2)
