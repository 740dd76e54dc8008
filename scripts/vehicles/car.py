"""A car's dimensions and its face in; body, wheels, lamps, plates and mirrors as patches out.

Half of the car is modelled, Y ≥ 0, and mirrored; only what carries characters is whole.
"""

from __future__ import annotations

import build123d as bd
import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.ShapeFix import ShapeFix_Face

from .car_lines import Car, Lines, cabin_grid, lower_grid
from .car_outlines import WELL, Face, arches, flank, front, glazing, rear
from .imprint import Inlay, cut, imprinted, polygon, rectangle
from .plate import plate
from .surfaces import facing, height_field, interpolated
from .tessellate import Fineness, Patch, inner_point, solid, tessellated, walls
from .wheels import wheel

Array = NDArray[np.float64]

BODY = Fineness(4.0, 0.6, 300.0, 160.0, 0.36)
SMALL = Fineness(2.0, 0.5, 300.0)
SET_IN = 20.0  # mm from the greatest half width to a wheel's outer plane
FLOOR_EVERY = 3  # of the dome's columns: the floor's outline is coarser, nobody sees it
UPRIGHT = 14  # rows of the lower dome's grid that are wall
UNDER = 130.0  # mm below the windscreen's foot: nothing lower lies under the cabin


def car(size: Car, face: Face, windows: tuple[float, ...], cladding: bool = False, doors: int = 2) -> list[Patch]:
    """All patches of a car.

    windows : x of the pillars between the side windows; the last is where the last window ends.
    cladding : plastic around the wheel arches.   doors : on a side.
    """
    lines = Lines(size)
    grid = lower_grid(lines)
    half = body(lines, grid, glazing(lines, windows), *_on_lower_body(lines, face, windows, cladding, doors))
    for axle in lines.axles:
        half += [patch.moved((axle, lines.half - SET_IN, size.wheel.radius)) for patch in wheel(size.wheel)]
    half += door_mirror(lines)
    half += handles(lines, grid, [windows[0] - 60.0, lines.axles[1] - size.wheel.radius + 40.0][:doors])
    patches = half + [patch.mirrored() for patch in half] + plate(0.0, face.plate, False)
    return patches + plate(float(lines.tail(face.rear_plate)) - 6.0, face.rear_plate, True, 4.0)


def _on_lower_body(lines: Lines, face: Face, windows: tuple[float, ...], cladding: bool, doors: int) -> list[list[Inlay]]:
    rims, houses = arches(lines, cladding)
    return [rims, flank(lines, face, windows, doors), front(lines, face), rear(lines, face), houses]


def body(lines: Lines, grid: Array, glass: list[Inlay], *groups: list[Inlay]) -> list[Patch]:
    """Half of the body: the lower dome through the grid with inlays in groups, later over earlier, and the glazed cabin."""
    lower, upper = (facing(interpolated(points), 0.0, 1.0, 0.2) for points in (grid, cabin_grid(lines)))
    outside = [inlay for group in groups for inlay in group]
    low_pieces = cut([lower], [side for inlay in outside for side in inlay.sides()] + [upper])
    high_pieces = cut([upper, _roof(lines, upper)], [side for inlay in glass for side in inlay.sides()] + [lower])
    shown = [(piece, "paint") for piece in low_pieces if not _covered(lines, inner_point(piece))]
    above = [(piece, "paint") for piece in high_pieces if (p := inner_point(piece))[2] > float(lines.bonnet(p[0], p[1]))]
    below, on_top = imprinted(shown, outside), imprinted(above, glass)
    return tessellated([*below.faces, *on_top.faces, (_floor(lines, grid), "trim")], BODY) + walls(below.seams)


def _floor(lines: Lines, grid: Array) -> bd.Face:
    """The flat face that closes the lower body below, without the wheel houses; it faces down."""
    outline = np.vstack([grid[:-1:FLOOR_EVERY, 0, :2], grid[-1:, 0, :2]])
    flat = polygon(outline)
    for axle in lines.axles:
        reach = lines.car.wheel.radius + 35.0
        flat = (flat - rectangle((axle - reach, axle + reach), (WELL, 2000.0))).faces()[0]
    return facing(bd.Pos(0.0, 0.0, lines.car.clearance + 1.0) * flat, 0.0, 0.0, -1.0)


def _roof(lines: Lines, upper: bd.Face) -> bd.Face:
    """The roof's panel within the cabin's dome, on the same height field, sharing its edge."""
    edge = max(upper.edges(), key=lambda edge: edge.center().Z)
    first, last = sorted(((edge @ 0).X, (edge @ 1).X))
    x = np.linspace(first, last, 24)
    ridge = bd.Edge.make_spline([bd.Vector(float(a), 0.0, float(z)) for a, z in zip(x, lines.roof(x, 0.0 * x), strict=True)])
    wide = np.linspace(first - 100.0, last + 100.0, 24), np.linspace(-50.0, lines.half, 10)
    field = height_field(*wide, lines.roof(*np.meshgrid(*wide, indexing="ij")))
    made = BRepBuilderAPI_MakeFace(BRep_Tool.Surface_s(field.wrapped), bd.Wire([edge, ridge]).wrapped, True)
    fixed = ShapeFix_Face(made.Face())  # adds the curves in the surface's parameters
    fixed.Perform()
    fixed.FixOrientation()
    return facing(bd.Face(fixed.Face()), 0.0, 0.0, 1.0)


def _covered(lines: Lines, point: Array) -> bool:
    """Whether a point of the lower body lies under the cabin."""
    x, y, z = (float(value) for value in point)
    if z < lines.car.cowl[1] - UNDER:
        return False
    q = y / float(lines.cabin_half(z))
    return q < 1.0 and float(lines.screen(z, q)) < x < float(lines.back(z, q))


def door_mirror(lines: Lines) -> list[Patch]:
    """The right-hand door mirror."""
    z = lines.car.cowl[1] + 105.0
    x, y = float(lines.screen(z, 0.985)) + 150.0, float(lines.cabin_half(z)) + 115.0
    turn = bd.Rot(0, 0, -8)
    head = bd.Pos(x, y, z + 12.0) * turn * bd.fillet(bd.Box(110.0, 212.0, 140.0).edges(), 52.0)
    glass = bd.Pos(x + 52.5, y, z + 12.0) * turn * bd.Box(6.0, 130.0, 70.0)
    arm = bd.Pos(x + 5.0, y - 105.0, z - 45.0) * bd.fillet(bd.Box(60.0, 190.0, 34.0).edges(), 14.0)
    return solid(head, "paint", SMALL) + solid(glass, "glass", SMALL) + solid(arm, "trim", SMALL)


def handles(lines: Lines, grid: Array, at: list[float]) -> list[Patch]:
    """Door handles of the right side at values of x."""
    z = lines.car.cowl[1] - 130.0
    level = np.array([[np.interp(z, column[:, 2], column[:, k]) for k in (0, 1)] for column in grid[:, :UPRIGHT]])
    bar = bd.fillet(bd.Box(185.0, 30.0, 26.0).edges(), 11.0)
    return [patch for x in at for patch in solid(bd.Pos(x, float(np.interp(x, *level.T)) + 12.0, z) * bar, "paint", SMALL)]
