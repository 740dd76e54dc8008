"""A wheel's dimensions in, its tyre, rim, brake disc and hub as patches about the origin out, the outer side at Y = 0."""

from __future__ import annotations

from dataclasses import dataclass

import build123d as bd
import numpy as np

from .imprint import polygon
from .tessellate import Fineness, Patch, solid

ALONG, TURNS = 12, 34  # points of a tyre's section and around it
SPOKES = 5  # pairs
RIM = Fineness(5.0, 0.8, 400.0)
HIDDEN = Fineness(4.0, 0.45, 300.0)


@dataclass(frozen=True, slots=True)
class Wheel:
    """Radius of the tyre and of the rim's edge, width of the tyre [mm]."""

    radius: float
    rim: float
    width: float
    steel: bool = False  # a commercial vehicle's pressed wheel with round holes


def _turned(region: bd.Face) -> bd.Solid:
    """A section (first coordinate: radius, second: Y) turned about the axle, its seam downwards."""
    plane = bd.Plane(origin=(0, 0, 0), x_dir=(0, 0, -1), z_dir=(1, 0, 0))  # radius along −Z, y_dir = z × x = +Y
    return bd.revolve(plane * region, axis=bd.Axis.Y, revolution_arc=360.0)


def _round(section: bd.Edge, count: int, radius: float, material: str, inward: bool = False) -> Patch:
    """A curve turned about the axle: count points (first coordinate: radius, no more than that given; second: Y).

    It faces outward, away from the axle, or inward; a point lies lowest.
    """
    at = np.linspace(0.0, 1.0, count)
    line = np.array([(point.X, point.Y) for point in (section @ float(t) for t in at)])
    line[:, 0] = np.minimum(line[:, 0], radius)
    tangents = np.array([(tangent.X, tangent.Y) for tangent in (section % float(t) for t in at)])
    angles = 2.0 * np.pi * np.arange(TURNS + 1) / TURNS
    spoke = np.column_stack([np.sin(angles), np.zeros(TURNS + 1), -np.cos(angles)])
    axle = np.array([0.0, 1.0, 0.0])
    points = line[None, :, :1] * spoke[:, None] + line[None, :, 1:] * axle
    normals = -tangents[None, :, 1:] * spoke[:, None] + tangents[None, :, :1] * axle
    i, j = (index.ravel() for index in np.meshgrid(np.arange(TURNS), np.arange(count - 1), indexing="ij"))
    a, b, c, d = i * count + j, i * count + j + 1, (i + 1) * count + j + 1, (i + 1) * count + j
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    away = float(np.sign((normals * points * (1.0, 0.0, 1.0)).sum())) * (-1.0 if inward else 1.0)
    return Patch(material, points.reshape(-1, 3), away * normals.reshape(-1, 3), faces).wound()


def _fan(inner: float, outer: float, half_angle: float, gap: float) -> bd.Face:
    """A window between two spokes about the direction +x: it ends a gap beside the rays at ± half_angle."""
    near, far = (float(r * np.sin(half_angle)) - gap for r in (inner, outer))
    return polygon([(inner, -near), (outer, -far), (outer + 0.12 * far, 0.0), (outer, far), (inner, near)])


def wheel(size: Wheel) -> list[Patch]:
    """The patches of a wheel whose centre is the origin but for Y: its outermost plane is Y = 0, it lies at Y ≤ 0."""
    radius, rim, width = size.radius, size.rim, size.width
    wall = radius - rim
    right = [(rim, -16.0), (rim + 0.25 * wall, -3.0), (rim + 0.6 * wall, 0.0), (radius - 14, -12.0), (radius - 2, -32.0),
             (radius, -0.27 * width)]
    section = right + [(r, -width - y) for r, y in right[::-1]]
    patches = [_round(bd.Edge.make_spline([bd.Vector(*point) for point in section]), ALONG, radius, "tyre")]
    well = [(rim + 8, -14), (rim + 2, -8), (rim - 7, -11), (rim - 13, -40), (rim - 15, -120)]
    patches.append(_round(bd.Edge.make_spline([bd.Vector(*point) for point in well]), 6, rim + 9.0, "rim", inward=True))
    if size.steel:
        dish = _turned(polygon([(0, -70), (0.45 * rim, -70), (0.55 * rim, -30), (0.8 * rim, -34), (rim - 8, -60),
                                (rim - 8, -70), (0.78 * rim, -46), (0.6 * rim, -42), (0.5 * rim, -82), (0, -82)]))
        openings = [bd.Rot(0, 360.0 * k / 10, 0) * bd.Pos(0.79 * rim, -50, 0) * bd.Rot(90, 0, 0) * bd.Cylinder(0.075 * rim, 120)
                    for k in range(10)]
        hub = _turned(polygon([(0, -28), (0.2 * rim, -32), (0.24 * rim, -72), (0, -72)]))
        patches += solid(dish - openings, "rim", RIM) + solid(hub, "trim", RIM)
    else:
        dish = _turned(polygon([(0, -36), (60, -36), (rim - 8, -18), (rim - 8, -60), (0, -80)]))
        step = np.pi / SPOKES
        openings = []
        wide, narrow = _fan(74.0, rim - 26, 0.70 * step, 10.0), _fan(104.0, rim - 26, 0.30 * step, 9.0)
        for k in range(2 * SPOKES):
            plane = bd.Plane(origin=(0, -120, 0), x_dir=(np.cos(k * step), 0, np.sin(k * step)), z_dir=(0, 1, 0))
            openings.append(bd.extrude(plane * (narrow if k % 2 else wide), amount=130.0))
        patches += solid(dish - openings, "rim", RIM)
        cap = _turned(polygon([(0, -29), (24, -31), (30, -36), (0, -36)]))
        patches += solid(cap, "trim", RIM)
        disc = _turned(polygon([(0, -96), (0.72 * rim, -96), (0.72 * rim, -112), (0, -112)]))
        patches += solid(disc, "steel", HIDDEN)
    back = _turned(polygon([(0, -118), (rim - 14, -118), (rim - 14, -126), (0, -126)]))
    return [seen for patch in patches + solid(back, "trim", HIDDEN) if len((seen := _outer(patch)).faces)]


def _outer(patch: Patch) -> Patch:
    """The patch without what faces the vehicle's middle; the tyre stays whole."""
    if patch.material == "tyre":
        return patch
    facing = patch.normals[patch.faces][..., 1].mean(axis=1) > -0.3
    used, index = np.unique(patch.faces[facing], return_inverse=True)
    return Patch(patch.material, patch.points[used], patch.normals[used], index.reshape(-1, 3), None)
