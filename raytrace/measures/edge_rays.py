"""The traced horizontal field of view between the two edges of whatever reflects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import TraceError
from raytrace.measures.field_of_view import angle_between
from raytrace.reflector import Reflector
from raytrace.surfaces.base import Box
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.ray_function import RayFunction

Array = NDArray[np.float64]


def h_fov_between_edges(reflector: Reflector, eye: Array, box: Box) -> float | None:
    """Compute the traced horizontal field of view of any reflector, with the eye where it really sits.

    Where a sheet goes on beyond the outline, it is the angle between the rays reflected at the box's edges, (x_min, 0) and
    (x_max, 0), as `traced_fields_of_view` has it for a designed mirror. Of whatever else reflects, the angle
    between the rays at the outermost two places at which the row y = 0 crosses the edge of what the eye sees reflecting;
    these are roots along that edge (`raytrace.visibility.edge`), not samples of the row.

    Parameters
    ----------
    reflector : in mirror coordinates, mm.
    eye : (3,) float64, mm, in the same coordinates.
    box : (x_min, x_max, y_min, y_max), mm, of what reflects.

    Returns
    -------
    The angle in radians; None where the eye sees nothing reflecting on that row.
    """
    surface = reflector.surface
    if surface.extends:
        inset = surface.edge_inset * (box[1] - box[0])
        _, ends = surface.reflected_at(eye, np.array([box[0] + inset, box[1] - inset]), np.zeros(2))
        if np.isfinite(ends).all():
            return angle_between(ends[0], ends[1])
    try:
        view = View(reflector, Pose.identity(), eye)
    except TraceError:  # an eye that the mirror does not face sees nothing in it
        return None
    edge = edge_of(view)
    if len(edge.on_plane) == 0:
        return None
    _, _, traced = edge.crossings(RayFunction.of(point=np.array([0.0, 1.0, 0.0])))
    if len(traced.points) < 2:
        return None
    x = traced.on_mirror[:, 0]
    return angle_between(traced.directions[np.argmin(x)], traced.directions[np.argmax(x)])
