"""A truck's dimensions in; its cab, box body, chassis and wheels as patches out.

The cab is one dome as a car's lower body is one: a wall around, rounded into the roof. Half of the truck is modelled.
"""

from __future__ import annotations

from dataclasses import dataclass

import build123d as bd
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .car_outlines import mirrored
from .domes import End, dome, half_plan
from .imprint import Inlay, cut, disc, grown, imprinted, polygon, rectangle, stroke
from .parts import PLAIN, block, box_body, mudguard
from .plate import plate
from .surfaces import facing, height_field, interpolated
from .tessellate import Fineness, Patch, solid, tessellated, walls
from .wheels import Wheel, wheel

Array = NDArray[np.float64]

CAB = Fineness(4.0, 0.5, 300.0, 170.0, 0.33)
GAP = 9.0


@dataclass(frozen=True, slots=True)
class Truck:
    """Dimensions [mm]: of the whole; cab length, width, height and floor; x of the box's front and z of its floor; axles."""

    length: float
    width: float
    height: float
    cab_length: float
    cab_width: float
    cab_height: float
    cab_floor: float
    box_front: float
    box_floor: float
    axles: tuple[float, float]
    wheel: Wheel


def truck(size: Truck) -> list[Patch]:
    """All patches of a truck."""
    body = box_body((size.box_front, size.length), 0.5 * size.width, (size.box_floor, size.height))
    half = cab(size) + body + chassis(size)
    twin = wheel(size.wheel)
    behind = [patch for patch in twin if patch.material == "tyre"]  # of the inner wheel nothing else shows
    outer = 0.5 * size.width - 30.0
    places = [(twin, size.axles[0], 0.5 * size.cab_width - 15.0), (twin, size.axles[1], outer),
              (behind, size.axles[1], outer - size.wheel.width - 25.0)]
    half += [patch.moved((x, y, size.wheel.radius)) for patches, x, y in places for patch in patches]
    half += mirrors(size)
    plates = plate(0.0, size.cab_floor + 210.0, False) + plate(size.length - 20.0, 760.0, True)
    return half + [patch.mirrored() for patch in half] + plates


def cab(size: Truck) -> list[Patch]:
    """Half of the cab: its skin with windows, lamps, grille and wheel house."""
    half, floor, top = 0.5 * size.cab_width, size.cab_floor, size.cab_height
    nose = PchipInterpolator([300, floor, floor + 90, floor + 240, 1000, 1420, 1800, 2300, 2700, 3100],
                             [140, 60, 22, 8, 14, 38, 92, 178, 262, 360])
    side = PchipInterpolator([300, floor, 700, 1300, 1700, 2400, 3100], half - np.array([70, 40, 8, 0, 8, 70, 140]))
    ends = End(330.0, 3.6, 55.0), End(70.0, 5.0, 0.0)

    def plan(z: float) -> Array:
        return half_plan(float(nose(z)), size.cab_length, float(side(z)), ends)

    def roof(x: Array, y: Array) -> Array:
        return np.asarray(top - 26.0 * (y / half) ** 2 - 70.0 * np.exp(-(x - 250.0) / 260.0))

    ring = half_plan(760.0, size.cab_length - 330.0, half - 420.0, (End(200.0, 2.6, 10.0), End(120.0, 2.6, 10.0)))
    grid = dome(plan, lambda points, share: 0.0 * share, roof, (floor, top + 60.0), ring, 120.0, np.linspace(0.0, 1.0, 15),
                np.array([0.0, 0.2, 0.45, 0.7, 1.0]))
    skin = facing(interpolated(grid), 0.0, 1.0, 0.2)
    # What lies within the ring: a little lower, so that the two do not meet.
    x, y = np.linspace(700.0, size.cab_length - 200.0, 12), np.linspace(0.0, half - 380.0, 8)
    panel = facing(height_field(x, y, roof(*np.meshgrid(x, y, indexing="ij")) - 4.0), 0.0, 0.0, 1.0)
    inlays = _front(size, half) + _side(size, half)
    pieces = cut([skin], [tool for inlay in inlays for tool in inlay.sides()])
    relief = imprinted([(piece, "paint") for piece in pieces], inlays)
    bar = bd.Pos(120.0, 0.0, 2318.0) * bd.Rot(0, 16, 0) * bd.Box(190.0, 1.32 * half, 26.0)
    right = bd.Box(9000.0, 3000.0, 9000.0, align=(bd.Align.CENTER, bd.Align.MIN, bd.Align.CENTER))
    visor = bd.fillet(bar.edges(), 11.0) & right
    return [*tessellated(relief.faces, CAB), *walls(relief.seams), *solid(panel, "paint", CAB), *solid(visor, "trim", PLAIN)]


def _front(size: Truck, half: float) -> list[Inlay]:
    def inlay(material: str, region: bd.Face, depth: float = 0.0) -> Inlay:
        return Inlay(material, "front", region, -60.0, 900.0, depth)

    def right(*points: tuple[float, float]) -> Array:
        return np.array(points) * (half, 1.0)

    low = size.cab_floor
    pane = mirrored(right((0.80, 1470.0), (0.90, 1560.0), (0.865, 2280.0)), 40.0)
    person = right((0.24, 1540.0), (0.66, 1540.0), (0.64, 1790.0), (0.52, 1850.0), (0.38, 1850.0), (0.26, 1790.0))
    out = [inlay("gloss", grown(pane, 26.0)), inlay("glass", pane),
           inlay("seen-dark", rectangle((-0.75 * half, 0.75 * half), (1490.0, 1560.0))),
           inlay("seen-dark", polygon(person, 40.0)), inlay("seen-person", disc((0.45 * half, 1945.0), 98.0))]
    grille = mirrored(right((0.0, 800.0), (0.50, 800.0), (0.60, 1330.0), (0.0, 1340.0)), 35.0)
    out.append(inlay("trim", grille, 45.0))
    for z in np.arange(870.0, 1320.0, 92.0):
        bar = rectangle((-0.7 * half, 0.7 * half), (z - 24.0, z + 24.0)) & grille
        out += [inlay("paint", piece, 12.0) for piece in bar.faces()]
    lamp = right((0.56, low + 170.0), (0.90, low + 170.0), (0.925, low + 330.0), (0.58, low + 330.0))
    out.append(inlay("trim", polygon(lamp, 28.0), 30.0))
    for y in (0.65 * half, 0.81 * half):
        out += [inlay("chrome", disc((y, low + 250.0), 66.0), 16.0), inlay("lamp", disc((y, low + 250.0), 54.0), 10.0)]
    intake = mirrored(right((0.0, low + 50.0), (0.45, low + 50.0), (0.43, low + 110.0), (0.0, low + 110.0)), 15.0)
    step = rectangle((-0.30 * half, 0.30 * half), (low + 330.0, low + 362.0))
    return [*out, inlay("trim", step), inlay("trim", intake, 40.0)]


def _side(size: Truck, half: float) -> list[Inlay]:
    reach = 0.72 * half, half + 60.0
    behind = size.cab_length + 60.0
    skirt = polygon([(-100, 300), (behind, 300), (behind, 640), (800, 640), (700, 540), (-100, 540)])
    door = stroke([(430, 1130), (425, 1480), (590, 2330), (1360, 2330), (1360, 1130)], GAP)
    pane = polygon([(500, 1500), (1290, 1540), (1290, 2250), (640, 2250)], 45.0)
    house = disc((size.axles[0], size.wheel.radius + 10.0), size.wheel.radius + 75.0)
    return [Inlay("trim", "side", skirt, -10.0, half + 60.0), Inlay("trim", "side", door, *reach),
            Inlay("gloss", "side", grown(pane, 18.0), *reach), Inlay("glass", "side", pane, *reach),
            Inlay("trim", "side", house, 450.0, half + 60.0, 420.0)]


def chassis(size: Truck) -> list[Patch]:
    """Half of what lies below: frame, side guard, tank, mudguards, axles, tail lamps, bumper."""
    half, radius, end = 0.5 * size.width, size.wheel.radius, size.length
    front, back = size.axles
    out = block((900.0, end - 300.0), (330.0, 410.0), (760.0, 1010.0), "trim")
    out += block((size.box_front, end - 70.0), (0.0, half - 120.0), (1010.0, size.box_floor), "trim")
    out += block((300.0, size.cab_length - 60.0), (0.0, 560.0), (440.0, 900.0), "trim")
    for z in (560.0, 830.0):
        out += block((front + 1250.0, back - radius - 170.0), (half - 60.0, half - 25.0), (z, z + 110.0), "steel")
    out += block((front + 1300.0, front + 2350.0), (560.0, half - 90.0), (520.0, 1000.0), "rim", 70.0)
    out += mudguard(back, (half - 700.0, half - 20.0), radius)
    for axle in size.axles:
        out += block((axle - 30.0, axle + 30.0), (0.0, half - 400.0), (radius - 60.0, radius + 60.0), "trim")
    out += block((end - 90.0, end - 20.0), (0.0, half - 40.0), (480.0, 600.0), "trim", 15.0)
    return out + block((end - 60.0, end - 12.0), (half - 480.0, half - 110.0), (690.0, 820.0), "tail-lamp")


def mirrors(size: Truck) -> list[Patch]:
    """The right-hand mirrors on their arms."""
    half = 0.5 * size.cab_width
    x, y = 260.0, half + 125.0
    turn = bd.Rot(0, 0, -10)
    upper = bd.Pos(x, y, 1960.0) * turn * bd.fillet(bd.Box(120.0, 225.0, 420.0).edges(), 50.0)
    lower = bd.Pos(x, y, 1610.0) * turn * bd.fillet(bd.Box(110.0, 215.0, 190.0).edges(), 45.0)
    out = solid(upper, "trim", PLAIN) + solid(lower, "trim", PLAIN)
    for z in (1530.0, 2190.0):
        out += block((x + 35.0, x + 85.0), (half - 155.0, half + 175.0), (z - 22.0, z + 22.0), "trim")
    return out + solid(bd.Pos(x + 62.0, y, 1960.0) * turn * bd.Box(4.0, 165.0, 340.0), "glass", PLAIN)
