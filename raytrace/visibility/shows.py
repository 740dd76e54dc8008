"""Whether points of the picture plane show what the mirror's face reflects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.viewing.view import Mask, TracedRays, View

Array = NDArray[np.float64]

RIM = 0.5  # the cosine of the turn against the mirror's z from which a face is a rim: mirrors slope by less than 60°


def shows(view: View, on_plane: Array, traced: TracedRays | None = None) -> Mask:
    """Tell whether points show a reflection, and not one from a rim: the mirror looks where its face is turned.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    on_plane : (m, 2), mm, of the picture plane.
    traced : the rays through them, where they are known.

    Returns
    -------
    (m,).
    """
    traced = traced or view.trace_points(on_plane)
    normal = traced.directions - view.towards(on_plane)
    with np.errstate(invalid="ignore"):
        towards = view.pose.directions_to_mirror(normal)[:, 2] / np.linalg.norm(normal, axis=1)
        found: Mask = traced.seen & (towards > RIM)
    return found
