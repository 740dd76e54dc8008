"""A car's lines and its face in; the outlines of windows, lamps, grille, gaps and wheel arches on its faces out."""

from __future__ import annotations

from dataclasses import dataclass

import build123d as bd
import numpy as np
from numpy.typing import NDArray

from .car_lines import Lines
from .imprint import Inlay, disc, grown, polygon, rectangle, stroke

Array = NDArray[np.float64]
Points = tuple[tuple[float, float], ...]

GAP = 7.0  # mm: a shut line with its shadow
BORDER = 14.0  # mm of a window's black edge
WELL = 450.0  # mm from the median plane: the wheel houses' inner side
HOUSE = 330.0  # mm: their depth


@dataclass(frozen=True, slots=True)
class Face:
    """What the front and the rear show. Outlines are (share of the half width, z [mm]); those that begin at 0 are halves.

    lamp, daylight, lenses (share, z, radius) : a head lamp's housing, its strip of daytime light, its lenses.
    grille, slats : its outline and the distance of its bars [mm].   intake, fog : the lower air intake, the fog lamp's place.
    plate, rear_plate : z of their middles.   fold, sill : z up to which bumpers and sills are unpainted.
    """

    lamp: Points
    daylight: Points
    lenses: tuple[tuple[float, float, float], ...]
    grille: Points
    slats: float
    intake: Points
    fog: Points
    plate: float
    tail_lamp: Points
    rear_plate: float
    fold: float
    sill: float


def mirrored(points: Array, radius: float) -> bd.Face:
    """The region of an outline whose right half is given."""
    return polygon(np.vstack([points, (points * (-1.0, 1.0))[::-1]]), radius)


def front(lines: Lines, face: Face) -> list[Inlay]:
    """Lamps, grille and air intake."""
    h = lines.half

    def scaled(points: Points) -> Array:
        return np.array(points) * (h, 1.0)

    def inlay(material: str, region: bd.Face, depth: float = 0.0) -> Inlay:
        return Inlay(material, "front", region, -60.0, 1000.0, depth)

    out = [inlay("trim", polygon(scaled(face.lamp), 12.0), 30.0), inlay("lamp", stroke(scaled(face.daylight), 14.0), 9.0)]
    for share, z, radius in face.lenses:
        centre = share * h, z
        out += [inlay("chrome", disc(centre, radius), 13.0), inlay("lamp", disc(centre, 0.76 * radius), 6.0)]
    grille = mirrored(scaled(face.grille), 14.0)
    out += [inlay("chrome", grown(grille, 9.0), -4.0), inlay("trim", grille, 40.0)]
    low, high = (extreme(z for _, z in face.grille) for extreme in (min, max))
    for z in np.arange(low + 0.7 * face.slats, high - 12.0, face.slats):
        bar = rectangle((-0.6 * h, 0.6 * h), (z, z + 9.0)) & grille
        out += [inlay("chrome", piece, 9.0) for piece in bar.faces()]
    low, high = (extreme(z for _, z in face.intake) for extreme in (min, max))
    middle = 0.5 * (low + high)
    out += [inlay("trim", mirrored(scaled(face.intake), 14.0), 50.0),
            inlay("trim", rectangle((-0.44 * h, 0.44 * h), (middle - 5.0, middle + 5.0)), 14.0)]
    fog = scaled(face.fog)
    centre = float(fog[:, 0].mean()), float(fog[:, 1].mean())
    return [*out, inlay("trim", polygon(fog, 12.0), 28.0), inlay("lamp", disc(centre, 27.0), 14.0)]


def rear(lines: Lines, face: Face) -> list[Inlay]:
    """Tail lamps, the boot lid's gap and the place of the number plate."""
    h = lines.half
    reach = (lines.axles[1] + 100.0, lines.car.length + 60.0)
    lamp = np.array(face.tail_lamp) * (h, 1.0)
    low, high = lamp[:, 1].min(), lamp[:, 1].max()
    edge = face.fold + 150.0
    below, above = face.rear_plate - 75.0, face.rear_plate + 75.0
    return [Inlay("tail-lamp", "rear", polygon(lamp, 16.0), *reach, -4.0),
            Inlay("paint", "rear", polygon([(-300, below), (300, below), (320, above), (-320, above)], 15.0), *reach, 10.0),
            Inlay("trim", "rear", stroke([(-10.0, edge), (0.70 * h, edge), (0.72 * h, low - 20.0)], GAP), *reach),
            Inlay("trim", "rear", stroke([(0.60 * h, high + 8.0), (0.60 * h, high + 60.0)], GAP), *reach)]


def flank(lines: Lines, face: Face, windows: tuple[float, ...], doors: int) -> list[Inlay]:
    """Unpainted lower edges, shut lines of doors and bonnet, and the trough before the windscreen."""
    size, h = lines.car, lines.half
    fore, aft = lines.axles
    low, high = face.sill + 25.0, size.cowl[1]
    behind = size.length + 100.0
    skirt = polygon([(-100, 100), (behind, 100), (behind, face.fold), (aft, face.fold), (aft, face.sill), (fore, face.sill),
                     (fore, face.fold), (-100, face.fold)])
    arch, radius = size.wheel.radius + 75.0, size.wheel.radius
    first, post = fore + arch + 70.0, windows[0] + 62.0
    shut = [[(first, low), (first - 15.0, 0.5 * (low + high)), (first + 20.0, high)], [(post, low), (post - 17.0, high)],
            [(first, low), (post, low)]]
    if doors > 1:
        last = aft - arch - 30.0
        shut += [[(last, low), (last, radius + 60.0), (last + 220.0, radius + 0.82 * arch + 60.0), (last + 290.0, high)],
                 [(post, low), (last, low)]]
    out = [Inlay("trim", "side", skirt, -10.0, h + 60.0)]
    out += [Inlay("trim", "side", stroke(line, GAP), 500.0, h + 60.0) for line in shut]
    top = size.nose_height - 40.0, size.cowl[1] + 60.0
    tip = float(lines.nose(size.nose_height)) + 45.0
    edge = [(tip + size.front.recess(float(q)), q * h) for q in np.linspace(0.0, 0.76, 7)]
    bonnet = [(tip, -20.0), *edge, (edge[-1][0] + 120.0, 0.79 * h), (size.cowl[0] + 60.0, 0.80 * h)]
    half = float(lines.cabin_half(size.cowl[1]))
    foot = [(float(lines.screen(size.cowl[1], abs(float(q)))), q * half) for q in np.linspace(-0.05, 0.93, 9)]
    trough = [*((x - 75.0, y) for x, y in foot), *((x + 200.0, y) for x, y in foot[::-1])]
    return [*out, Inlay("trim", "top", stroke(bonnet, GAP), *top), Inlay("trim", "top", polygon(trough), *top)]


def arches(lines: Lines, cladding: bool) -> tuple[list[Inlay], list[Inlay]]:
    """The wheel arches' raised rims, of plastic where there is cladding, and the wheel houses."""
    radius = lines.car.wheel.radius + 40.0
    reach = WELL, lines.half + 60.0
    material, wide = ("trim", 62.0) if cladding else ("paint", 16.0)
    centres = [(axle, lines.car.wheel.radius + 10.0) for axle in lines.axles]
    return ([Inlay(material, "side", disc(centre, radius + wide), *reach, -5.0) for centre in centres],
            [Inlay("trim", "side", disc(centre, radius), *reach, HOUSE) for centre in centres])


def glazing(lines: Lines, windows: tuple[float, ...]) -> list[Inlay]:
    """Windscreen, side windows and rear window with their black borders, and the pillars between the side windows."""
    size = lines.car
    foot = size.cowl[1]
    levels = np.linspace(foot - 60.0, size.glass[0], 7)
    screen = mirrored(np.array([(0.87 * float(lines.cabin_half(z)), z) for z in levels]), 25.0)
    reach = size.cowl[0] - 200.0, 0.5 * (windows[0] + float(lines.screen(size.glass[0])))
    out = [Inlay("gloss", "front", screen, *reach), Inlay("glass", "front", grown(screen, -BORDER), *reach)]
    out += [Inlay(material, "front", region, *reach) for material, region in _seen_through(lines, len(windows) > 1)]
    levels = np.linspace(foot + 30.0, size.glass[1] - 30.0, 6)
    fore = [(float(lines.screen(z, 0.985)) + 25.0, z) for z in levels]
    lean = 0.6 / np.tan(np.radians(size.back_rake))
    aft = [(windows[-1] - lean * (z - levels[0]), z) for z in levels]
    x = np.linspace(fore[-1][0] + 60.0, aft[-1][0] - 60.0, 4)
    upper = size.glass[1] + lines.roof(x, np.zeros_like(x)) - size.height
    side = polygon([*fore, *zip(x, upper, strict=True), *aft[::-1]], 20.0)
    reach = 300.0, lines.half
    out += [Inlay("gloss", "side", grown(side, BORDER), *reach), Inlay("glass", "side", side, *reach)]
    for at in windows[:-1]:
        post = polygon([(at, foot), (at + 92, foot), (at + 64, size.height), (at - 14, size.height)]) & side
        out += [Inlay("gloss", "side", piece, *reach) for piece in post.faces()]
    levels = np.linspace(size.deck[1] + 30.0, size.glass[2], 5)
    window = mirrored(np.array([(0.80 * float(lines.cabin_half(z)), z) for z in levels]), 35.0)
    return [*out, Inlay("glass", "rear", window, float(lines.back(size.glass[2], 0.82)) - 60.0, size.length)]


def _seen_through(lines: Lines, through: bool) -> list[tuple[str, bd.Face]]:
    """What shows in the windscreen: the rear window's light if one looks through, two people, the instrument panel."""
    foot, h = lines.car.cowl[1], lines.half
    rise = lines.car.glass[0] - foot
    seat, middle = 0.38 * h, foot + 0.52 * rise
    width = 0.62 * float(lines.cabin_half(middle))
    light = mirrored(np.array([(width, foot + 0.40 * rise), (0.86 * width, foot + 0.80 * rise)]), 30.0)
    body = polygon([(seat - 230, foot + 20), (seat + 230, foot + 20), (seat + 215, middle - 50), (seat + 120, middle - 5),
                    (seat - 120, middle - 5), (seat - 215, middle - 50)], 35.0)
    panel = rectangle((-0.75 * h, 0.75 * h), (foot - 80.0, foot + 30.0))
    seen = [("seen-dark", body), ("seen-person", disc((seat, middle + 75.0), 88.0)), ("seen-dark", panel)]
    return [("seen-light", light), *seen] if through else seen
