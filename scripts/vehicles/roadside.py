"""Dimensions of what stands beside a road in, its patches out: column, lamp post, guard rail and noise wall.

Column and post have their axis at the origin. Rail and wall are elements of LENGTH, x = 0 … LENGTH, to be set one behind the
other; their face lies at Y = 0 and looks to the right, what carries them stands to the left.
"""

from __future__ import annotations

import build123d as bd
import numpy as np

from .imprint import polygon
from .tessellate import Fineness, Patch, solid

LENGTH = 4000.0  # of an element of rail or wall
ROUND = Fineness(2.0, 0.2, 900.0)
ALONG = 33  # points of a rail's section
PLAIN = Fineness(2.0, 0.5, 1500.0)


def _turned(profile: bd.Face) -> bd.Solid:
    """A profile (radius, height) turned about the vertical axis."""
    return bd.revolve(bd.Plane.XZ * profile, axis=bd.Axis.Z)


def column(diameter: float = 600.0, height: float = 6000.0, taper: float = 30.0) -> list[Patch]:
    """A round column of concrete, thinner by taper at its top, on a base."""
    r, top = 0.5 * diameter, 0.5 * (diameter - taper)
    base = polygon([(r - 20, 0), (1.45 * r, 0), (1.45 * r, 180), (1.38 * r, 210), (r - 20, 210)])
    # A node not far above the base, so that what it hides of the sky does not darken the whole shaft.
    low = r - (r - top) * 270.0 / (height - 235.0)
    shaft = polygon([(0, 210), (r, 210), (low, 480), (top, height - 25), (top - 25, height), (0, height)])
    return solid(_turned(base), "concrete", ROUND) + solid(_turned(shaft), "concrete", ROUND)


def lamp_post(height: float = 9000.0, reach: float = 1500.0) -> list[Patch]:
    """A steel post, its arm to the right and the lamp at its end."""
    bend = 700.0
    foot = _turned(polygon([(0, 0), (105, 0), (105, 900), (92, 930), (0, 930)]))
    post = _turned(polygon([(0, 930), (85, 930), (46, height - bend), (0, height - bend)]))
    arc = bd.Edge.make_three_point_arc((0, 0, height - bend), (0, 0.29 * bend, height - 0.29 * bend), (0, bend, height))
    path = bd.Wire([arc, bd.Edge.make_line((0, bend, height), (0, reach, height + 60.0))])
    arm = bd.sweep(bd.Pos(0, 0, height - bend) * bd.Circle(44.0), path=path, transition=bd.Transition.ROUND)
    head = bd.Pos(0, reach + 250.0, height + 62.0) * bd.fillet(bd.Box(280.0, 640.0, 110.0).edges(), 45.0)
    light = bd.Pos(0, reach + 270.0, height + 6.0) * bd.Box(200.0, 420.0, 12.0)
    steel = [(foot, ROUND), (post, ROUND), (arm, PLAIN), (head, PLAIN)]
    return [patch for shape, fine in steel for patch in solid(shape, "steel", fine)] + solid(light, "lamp", PLAIN)


def guard_rail(top: float = 750.0) -> list[Patch]:
    """An element of a steel guard rail: a W-beam 310 mm high, with one post."""
    middle = top - 155.0
    # The W, from below: flange, first wave, the valley between, second wave, flange.
    wave = np.array([(-155, -75), (-140, -80), (-118, -72), (-96, -14), (-75, 0), (-54, -6), (-22, -58), (0, -66)], dtype=float)
    wave = np.vstack([wave, wave[-2::-1] * (-1.0, 1.0)])
    curve = bd.Edge.make_spline([bd.Vector(0.0, y, middle + z) for z, y in wave])
    channel = bd.Box(55.0, 100.0, top - 20.0) - bd.Pos(12.0, 0, 0) * bd.Box(50.0, 90.0, top)
    post = bd.Pos(0.5 * LENGTH, -150.0, 0.5 * (top - 20.0)) * channel
    spacer = bd.Pos(0.5 * LENGTH, -90.0, middle) * bd.Box(60.0, 30.0, 200.0)
    return [*_beam(curve), *solid(post, "steel", PLAIN), *solid(spacer, "steel", PLAIN)]


def _beam(curve: bd.Edge) -> list[Patch]:
    """Both sides of a sheet 3 mm thick, the curve in the plane X = 0 swept along the element."""
    at = np.linspace(0.0, 1.0, ALONG)
    line = np.array([tuple(curve @ float(t)) for t in at])
    tangents = np.array([tuple(curve % float(t)) for t in at])
    normals = np.cross(tangents, (1.0, 0.0, 0.0))
    normals *= np.sign(normals[:, 1].sum())
    span = np.array([LENGTH, 0.0, 0.0])
    k = np.arange(ALONG - 1)
    faces = np.vstack([np.column_stack([k, k + 1, k + ALONG]), np.column_stack([k + 1, k + 1 + ALONG, k + ALONG])])
    both = np.vstack([normals, normals])
    outside = np.vstack([line, line + span])
    return [Patch("steel", outside, both, faces).wound(), Patch("steel", outside - 3.0 * both, -both, faces).wound()]


def noise_wall(height: float = 3500.0) -> list[Patch]:
    """An element of a noise wall: ribbed concrete panels on a plinth between steel posts."""
    rib = 125.0
    ribs = [(0.0, 400.0)]
    while ribs[-1][1] + rib <= height - 150.0:
        z = ribs[-1][1]
        ribs += [(-45.0, z + 20.0), (-45.0, z + 45.0), (0.0, z + 65.0), (0.0, z + rib)]
    section = polygon([*ribs, (0.0, height), (-160.0, height), (-160.0, 400.0)])
    panel = bd.extrude(bd.Plane.YZ * section, amount=LENGTH)
    plinth = bd.Pos(0.5 * LENGTH, -90.0, 200.0) * bd.Box(LENGTH, 200.0, 400.0)
    post = bd.Pos(0.0, -80.0, 0.5 * (height + 60.0)) * bd.Pos(80.0, 0, 0) * bd.Box(160.0, 240.0, height + 60.0)
    return [*solid(panel, "concrete", PLAIN), *solid(plinth, "concrete", PLAIN), *solid(post, "steel", PLAIN)]
