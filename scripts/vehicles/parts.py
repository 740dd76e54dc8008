"""Dimensions in; parts that several vehicles have out: blocks, mudguards, box bodies (half of each, Y ≥ 0)."""

from __future__ import annotations

import build123d as bd
import numpy as np

from .imprint import Inlay, cut, rectangle
from .tessellate import Fineness, Patch, inner_point, solid, tessellated

Span = tuple[float, float]

PLAIN = Fineness(4.0, 0.7, 900.0)
RAIL = Fineness(4.0, 0.8, 9000.0)  # long and thin
RAIL_WIDTH = 60.0
LAMPS_EVERY = 1250.0


def block(x: Span, y: Span, z: Span, material: str, radius: float = 0.0) -> list[Patch]:
    """A box between two values of each coordinate, its edges rounded."""
    shape = bd.Pos(0.5 * sum(x), 0.5 * sum(y), 0.5 * sum(z)) * bd.Box(x[1] - x[0], y[1] - y[0], z[1] - z[0])
    return solid(bd.fillet(shape.edges(), radius) if radius else shape, material, PLAIN)


def mudguard(axle: float, y: Span, radius: float) -> list[Patch]:
    """A bent sheet above a wheel of that radius."""
    outer = bd.Cylinder(radius + 85.0, y[1] - y[0], rotation=(90, 0, 0))
    sheet = outer - bd.Cylinder(radius + 78.0, 2.0 * y[1], rotation=(90, 0, 0))
    sheet = sheet & bd.Pos(0, 0, 450.0 + radius) * bd.Box(3000.0, 3000.0, 1100.0)
    return solid(bd.Pos(axle, 0.5 * sum(y), radius) * sheet, "trim", PLAIN)


def box_body(x: Span, half: float, z: Span) -> list[Patch]:
    """Half of a box body: walls and roof, with metal rails along its edges and side lamps."""
    (x0, x1), (z0, z1) = x, z
    corner = {"align": (bd.Align.MIN,) * 3}
    walls = bd.Pos(x0, 0, z0) * bd.Box(x1 - x0 - 4.0, half - 8.0, z1 - z0 - 8.0, **corner)
    ahead = [edge for edge in walls.edges() if edge.center().X - x0 < 1.0]
    walls = bd.fillet([edge for edge in ahead if edge.center().Y - half > -10.0 or edge.center().Z - z1 > -10.0], 55.0)
    # The walls are cut where the rails cover them: a vertex under a rail sees nothing, and would darken the wall beside it.
    begin = x0 + RAIL_WIDTH
    shown = [Inlay("box", "side", rectangle((begin, x1 - 70.0), (z0 + 80.0, z1 - 90.0)), half - 20.0, half),
             Inlay("box", "top", rectangle((begin, x1 - 60.0), (-10.0, half - 60.0)), z1 - 20.0, z1),
             Inlay("box", "rear", rectangle((-10.0, half - 60.0), (z0 + 60.0, z1 - 115.0)), x1 - 20.0, x1)]
    pieces = cut(walls.faces(), [side for inlay in shown for side in inlay.sides()])
    places = [(piece, inner_point(piece)) for piece in pieces]
    seen = [(piece, "box") for piece, place in places if place[0] < begin or any(inlay.holds(place) for inlay in shown)]
    patches = tessellated(seen, PLAIN)
    rails = [((begin, x1), (half - 55.0, half), (z0 - 30.0, z0 + 80.0)), ((begin, x1), (half - 60.0, half), (z1 - 90.0, z1)),
             ((x1 - 70.0, x1), (half - 60.0, half), (z0, z1)), ((x1 - 60.0, x1), (0.0, half), (z1 - 115.0, z1)),
             ((x1 - 60.0, x1), (0.0, half), (z0 - 60.0, z0 + 60.0))]
    for a, b, c in rails:
        rail = bd.Pos(a[0], b[0], c[0]) * bd.Box(a[1] - a[0], b[1] - b[0], c[1] - c[0], **corner)
        outer = [edge for edge in rail.edges() if edge.center().Y - half > -1.0]
        patches += solid(bd.fillet(outer, 14.0), "steel", RAIL)
    for at in np.arange(x0 + 900.0, x1 - 300.0, LAMPS_EVERY):
        patches += block((at - 45.0, at + 45.0), (half - 20.0, half + 2.0), (z0 - 5.0, z0 + 31.0), "side-lamp")
    return patches
