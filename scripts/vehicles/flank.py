"""The driver's own light truck from 0.2 m behind the eyes on: cab door, box body, rear wheel, as far as the mirrors see it.

The origin is where it begins, X = −200 mm of the driver's world, so a scene places its front end there. The flanks lie at
Y = ±870 mm and the rear end at x = 4100 (X = +3900).
"""

from __future__ import annotations

import build123d as bd
import numpy as np

from .imprint import Inlay, cut, grown, imprinted, polygon, rectangle, stroke
from .parts import block, box_body, mudguard
from .plate import plate
from .surfaces import facing, interpolated, resampled
from .tessellate import Fineness, Patch, solid, tessellated, walls
from .wheels import Wheel, wheel

LENGTH, HALF = 4100.0, 870.0
CAB_END = 800.0
BOX_FRONT, BOX_FLOOR, BOX_TOP = 845.0, 800.0, 2450.0
AXLE = 2720.0
WHEEL = Wheel(325.0, 200.0, 185.0, steel=True)
DOOR = Fineness(3.0, 0.5, 260.0, 120.0, 0.30)
GAP = 6.0

# The cab's section (Y, Z) from the sill over the roof, and how its rear corner is rounded in plan: (x, inset).
SECTION = ((822, 470), (840, 560), (852, 720), (856, 900), (857, 1100), (855, 1280), (849, 1400), (838, 1470), (812, 1640),
           (782, 1820), (750, 1990), (728, 2070), (690, 2135), (620, 2172), (500, 2190), (250, 2204), (0, 2208))
CORNER = ((0, 0), (130, 0), (260, 0), (390, 0), (520, 0), (630, 0), (695, 1), (738, 8), (770, 24), (790, 48), (800, 85))
FLAT = 2150.0, 300.0  # Z and Y: above and inside both, the section is roof, which the corner does not draw in


def flank() -> list[Patch]:
    """All patches of both flanks and of what is between them."""
    half = cab() + box_body((BOX_FRONT, LENGTH), HALF, (BOX_FLOOR, BOX_TOP))
    half += [patch.moved((AXLE, HALF - 25.0, WHEEL.radius)) for patch in wheel(WHEEL)]
    half += mudguard(AXLE, (HALF - 300.0, HALF - 15.0), WHEEL.radius)
    half += block((300.0, LENGTH - 250.0), (300.0, 370.0), (560.0, 740.0), "trim")
    half += block((BOX_FRONT, LENGTH - 70.0), (0.0, HALF - 70.0), (740.0, BOX_FLOOR), "trim")
    half += block((AXLE - 30.0, AXLE + 30.0), (0.0, HALF - 200.0), (290.0, 350.0), "trim")
    for z in (430.0, 570.0):
        half += block((1000.0, AXLE - 480.0), (HALF - 50.0, HALF - 20.0), (z, z + 75.0), "steel")
    half += block((LENGTH - 80.0, LENGTH - 20.0), (0.0, HALF - 30.0), (430.0, 530.0), "trim", 12.0)
    half += block((LENGTH - 60.0, LENGTH - 8.0), (HALF - 330.0, HALF - 60.0), (590.0, 700.0), "tail-lamp")
    return half + [patch.mirrored() for patch in half] + plate(LENGTH - 12.0, 640.0, True)


def cab() -> list[Patch]:
    """The right half of the cab behind the driver's eyes."""
    section = resampled(np.array(SECTION, dtype=np.float64), 40)
    points = np.array([[(x, max(y - inset * (z < FLAT[0] or y > FLAT[1]), 0.0), z) for y, z in section] for x, inset in CORNER])
    skin = facing(interpolated(points), 0.0, 1.0, 0.2)
    pane = polygon([(30, 1490), (545, 1490), (520, 1990), (30, 1990)], 40.0)
    door = stroke([(10, 640), (615, 640), (640, 1470), (600, 2060), (10, 2060)], GAP)
    reach = 500.0, HALF
    inlays = [Inlay("trim", "side", rectangle((-50.0, 900.0), (400.0, 590.0)), *reach), Inlay("trim", "side", door, *reach),
              Inlay("gloss", "side", grown(pane, 16.0), *reach), Inlay("glass", "side", pane, *reach),
              Inlay("trim", "side", polygon([(440, 1270), (600, 1270), (600, 1340), (440, 1340)], 20.0), *reach, 12.0)]
    pieces = cut([skin], [tool for inlay in inlays for tool in inlay.sides()])
    relief = imprinted([(piece, "paint") for piece in pieces], inlays)
    handle = bd.Pos(520.0, 856.0, 1308.0) * bd.fillet(bd.Box(150.0, 20.0, 24.0).edges(), 8.0)
    # Dark inside: what closes the cab where it begins, behind, and below.
    end = bd.Face(bd.Wire.make_polygon([(0.0, 0.0, 470.0), *((0.0, float(y), float(z)) for y, z in SECTION)], close=True))
    ends = [(facing(end, -1.0, 0.0, 0.0), "trim"), (facing(bd.Pos(CAB_END, 0, 0) * end, 1.0, 0.0, 0.0), "trim")]
    patches = [*tessellated(relief.faces, DOOR), *walls(relief.seams), *solid(handle, "trim", DOOR), *tessellated(ends, DOOR)]
    return patches + block((0.0, CAB_END), (0.0, 822.0), (440.0, 475.0), "trim")
