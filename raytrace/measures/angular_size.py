"""How large the driver sees a following vehicle: in the mirror, in a flat one in its place, and without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.asked import Face
from raytrace.measures.field_of_view import angle_between
from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import Measure, register_family
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points

Array = NDArray[np.float64]

ARCMIN = float(np.degrees(1.0)) * 60.0
DISTANCES_MM = (20_000.0, 50_000.0)  # behind the ocular points


@dataclass(frozen=True, slots=True)
class AngularSize:
    """How large a face is seen at one distance, in the mirror, in a flat mirror and without one.

    A size is (width, height), arc minutes: the angle between the two sides at half the face's height, and that between its
    lower and upper edge at half its width.

    Attributes
    ----------
    distance_mm : X of the face, mm, behind the ocular points.
    mirror : in the mirror; None where it does not show the whole face.
    flat : in a flat mirror in its place, tangent to it where it shows the middle of the face; None where it does not.
    direct : by an eye that looks round, from the same point.
    """

    distance_mm: float
    mirror: tuple[float, float] | None
    flat: tuple[float, float] | None
    direct: tuple[float, float]


def angular_sizes(view: View, face: Face, distances_mm: Sequence[float] = DISTANCES_MM, host: HostVehicle | None = None,
                  ) -> tuple[AngularSize, ...]:
    """Measure how large a face is seen at each of several distances; a size is the angle between two directions of the eye.

    The directions are those in which the mirror shows the middles of the face's sides and edges, found on exact rays. It
    shows the whole face where these four and the four corners lie inside the outline and `host` hides none of them. A mesh
    stands for the smooth surface that its vertices lie on.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    face : what is looked at.
    distances_mm : X of the face, mm, behind the ocular points.
    host : what hides; None for nothing.

    Returns
    -------
    tuple of AngularSize
        One for each distance, in their order.
    """
    view = view.interpolated
    across, up = np.meshgrid([-0.5, 0.0, 0.5], [0.0, 0.5, 1.0])
    points = np.stack([np.zeros(9), face.y_mm + face.width_mm * across.ravel(), face.height_mm * up.ravel()], axis=1)
    targets = np.concatenate([points + [distance, 0.0, 0.0] for distance in distances_mm])
    on_plane, shown = image_points(view, targets)
    traced = view.trace_points(on_plane)
    if host is not None:
        shown &= ~host.hides(traced.points, targets)
    seen = view.towards(on_plane)
    found = []
    for k, distance in enumerate(distances_mm):
        these = slice(9 * k, 9 * k + 9)
        middle = 9 * k + 4
        mirror = _size(seen[these]) if shown[these].all() else None
        flat = None
        if shown[middle]:
            # What a flat mirror shows is seen as from the eye's own image in it.
            normal = traced.directions[middle] - seen[middle]
            normal /= np.linalg.norm(normal)
            image = view.eye - 2.0 * ((view.eye - traced.points[middle]) @ normal) * normal
            flat = _size(targets[these] - image)
        found.append(AngularSize(float(distance), mirror, flat, _size(targets[these] - view.eye)))
    return tuple(found)


def _size(directions: Array) -> tuple[float, float]:
    """The angles between left and right and between bottom and top of directions to the face's nine points, arc minutes."""
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return ARCMIN * angle_between(units[3], units[5]), ARCMIN * angle_between(units[1], units[7])


def sizes_in_use(use: MirrorInUse) -> tuple[AngularSize, ...]:
    """`angular_sizes` of the vehicle that the scene asks about, from between the eyes; empty where it asks about none."""
    there = use.on_vehicle
    face = there.asked.face
    return angular_sizes(there.views.middle, face, there.asked.distances, there.host) if face else ()


SIDES = (("width", "a vehicle's two sides at half its height"), ("height", "a vehicle's lower and upper edge"))


@register_family
def vehicle_sizes(use: MirrorInUse) -> tuple[Measure, ...]:
    """Make the measures of width and height of one vehicle, at each distance that the scene asks about.

    Parameters
    ----------
    use : the mirror; on no vehicle, or with a scene that asks about no face, there are none.

    Returns
    -------
    tuple of Measure
        Four for each distance: width and height, in the mirror and in a flat one in its place, arc minutes.
    """
    asked = None if use.vehicle is None else use.vehicle.asked
    found = []
    for k, at in enumerate(asked.distances if asked is not None and asked.face is not None else ()):
        place = f"{at / 1e3:g}".replace(".", "_")
        for i, (side, ends) in enumerate(SIDES):
            for kind, word, more in (("mirror", "", f"what the mirror shows of {ends}; none where it is not wholly shown"),
                                     ("flat", ", flat mirror", f"{ends} in a flat mirror in its place")):
                found.append(Measure(
                    f"vehicle_{place}_m_{side}_{'' if kind == 'mirror' else 'flat_'}arcmin",
                    f"vehicle at {at / 1e3:g} m, {side}{word}", "′", 1,
                    f"angle at the eye between {more}",
                    partial(_side, k, kind, i), group="Size",
                    better="more" if kind == "mirror" else None))
    return tuple(found)


def _side(k: int, kind: str, side: int, use: MirrorInUse) -> float | None:
    seen: tuple[float, float] | None = getattr(use.record(sizes_in_use)[k], kind)
    return None if seen is None else float(seen[side])
