"""A street behind the driver as coloured triangles: what the picture loop is timed on.

Mirror coordinates, mm: x to the driver's right, y up with the ground at GROUND_MM, z backwards along the road.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.scene.world import TriangleWorld

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

GROUND_MM = -1200.0  # the eye, at y = 0, is this high above it
SUN = (-0.36, 0.72, -np.sqrt(1.0 - 0.36**2 - 0.72**2))  # before the driver, so that what follows him is lit in front
ASPHALT, LINE, GRASS, WALL = (92, 93, 97), (238, 238, 232), (98, 126, 70), (176, 160, 140)
BARK, LEAVES, SHADE = (92, 74, 58), (70, 112, 58), (58, 58, 62)
GLASS, TYRE, LAMP, PLATE, GRILLE = (34, 42, 52), (28, 28, 30), (250, 246, 224), (236, 236, 228), (40, 40, 44)
PAINTS: tuple[Colour, ...] = ((186, 34, 36), (36, 82, 160), (226, 226, 222), (54, 58, 64), (206, 160, 44), (48, 112, 86))

LANES_MM = (-7500.0, -4000.0, -500.0, 3000.0)  # lines between and beside three lanes; ours is the rightmost
LINE_MM, SHOULDER_MM = 150.0, 700.0
BEHIND_MM, AHEAD_MM = 300_000.0, -12_000.0
STEP_MM, DASH_STEPS, DASH_EVERY = 1000.0, 4, 10  # a dash is 4 m of every 10
FAR_MM = 1_500_000.0


@dataclass(slots=True)
class _Builder:
    """Triangles as they are gathered."""

    rng: np.random.Generator
    vertices: list[Array] = field(default_factory=list)
    faces: list[NDArray[np.int32]] = field(default_factory=list)
    colours: list[NDArray[np.uint8]] = field(default_factory=list)
    count: int = 0

    def add(self, vertices: Array, faces: NDArray[Any], colours: Array | Colour, mottled: float = 0.0) -> None:
        """Triangles of one colour or one each (m, 3), lighter and darker by `mottled` at random."""
        shade = 1.0 + mottled * self.rng.uniform(-1.0, 1.0, (len(faces), 1))
        self.vertices.append(vertices)
        self.faces.append((faces + self.count).astype(np.int32))
        self.colours.append(np.clip(np.broadcast_to(colours, faces.shape) * shade, 0, 255).astype(np.uint8))
        self.count += len(vertices)

    def ground(self, x: Array, z: Array, colours: Array | Colour, mottled: float, lift_mm: float = 0.0) -> None:
        """A level grid over x (m,) and z (n,); colours for all, or of its cells (m − 1, n − 1, 3)."""
        xx, zz = np.meshgrid(x, z, indexing="ij")
        corner = np.arange(xx.size).reshape(xx.shape)[:-1, :-1].ravel()
        row = len(z)
        faces = np.stack([corner, corner + 1, corner + row + 1, corner, corner + row + 1, corner + row], axis=1).reshape(-1, 3)
        cells = np.broadcast_to(colours, (len(x) - 1, len(z) - 1, 3)).reshape(-1, 3)
        self.add(np.stack([xx, np.full(xx.shape, GROUND_MM + lift_mm), zz], axis=-1).reshape(-1, 3), faces,
                 np.repeat(cells, 2, axis=0), mottled)


def street(seed: int = 7) -> TriangleWorld:
    """Three lanes with traffic, the host vehicle's flank, verges, trees and houses: some 400,000 triangles."""
    b = _Builder(np.random.default_rng(seed))
    _road(b)
    _block(b, (1300.0, -450.0, 1500.0), (900.0, 480.0, 2300.0), 180.0, 24, (120, 24, 30))  # the host vehicle's flank
    _block(b, (1300.0, 180.0, 1900.0), (760.0, 330.0, 1500.0), 150.0, 16, GLASS, taper=0.25)
    lanes = [0.5 * (a + c) for a, c in pairwise(LANES_MM)]
    positions = ((1, 9_000.0), (0, 15_000.0), (2, 17_000.0), (1, 27_000.0), (0, 38_000.0), (1, 52_000.0), (2, 44_000.0),
              (0, 70_000.0), (1, 85_000.0), (2, 95_000.0), (0, 120_000.0), (1, 140_000.0))
    for i, (lane, z) in enumerate(positions):
        (_lorry if i in (4, 9) else _car)(b, lanes[lane] + b.rng.uniform(-150.0, 150.0), z, PAINTS[i % len(PAINTS)])
    for z in np.arange(6_000.0, 240_000.0, 7_000.0):
        for x in (-13_500.0, 9_000.0):
            _tree(b, x + b.rng.uniform(-1200.0, 1200.0), z + b.rng.uniform(-1500.0, 1500.0))
    for z in np.arange(12_000.0, 280_000.0, 24_000.0):
        for x in (-28_000.0, 24_000.0):
            _house(b, x, z, float(b.rng.uniform(5_000.0, 11_000.0)))
    return TriangleWorld(np.concatenate(b.vertices), np.concatenate(b.faces), np.concatenate(b.colours),
                         sun=(float(SUN[0]), float(SUN[1]), float(SUN[2])))


def _road(b: _Builder) -> None:
    left, right = LANES_MM[0] - SHOULDER_MM, LANES_MM[-1] + SHOULDER_MM
    lines = np.array([[x - 0.5 * LINE_MM, x + 0.5 * LINE_MM] for x in LANES_MM])
    x = np.unique(np.concatenate([lines.ravel(), np.arange(left, right, STEP_MM), [right]]))
    z = np.arange(AHEAD_MM, BEHIND_MM + STEP_MM, STEP_MM)
    middle = 0.5 * (x[:-1] + x[1:])
    on_line = np.abs(middle[:, None] - np.array(LANES_MM)).min(axis=1) < 0.5 * LINE_MM
    edge = (middle < LANES_MM[0] + LINE_MM) | (middle > LANES_MM[-1] - LINE_MM)
    dash = np.arange(len(z) - 1) % DASH_EVERY < DASH_STEPS
    white = on_line[:, None] & (edge[:, None] | dash)
    b.ground(x, z, np.where(white[..., None], LINE, ASPHALT), 0.03)
    verge = np.arange(AHEAD_MM, BEHIND_MM + 1.0, 3000.0)
    b.ground(np.arange(left - 60_000.0, left + 1.0, 3000.0), verge, GRASS, 0.1)
    b.ground(np.arange(right, right + 60_001.0, 3000.0), verge, GRASS, 0.1)
    b.ground(np.linspace(-FAR_MM, FAR_MM, 41), np.linspace(BEHIND_MM, FAR_MM, 21), GRASS, 0.03, lift_mm=-30.0)
    for side in (-1.0, 1.0):
        b.ground(np.sort(side * np.linspace(60_000.0, FAR_MM, 21)), np.linspace(AHEAD_MM, BEHIND_MM, 21), GRASS, 0.03, -60.0)


def _block(b: _Builder, centre: tuple[float, float, float], half: tuple[float, float, float], radius_mm: float, cells: int,
           colour: Colour, taper: float = 0.0, mottled: float = 0.0, rough_mm: float = 0.0) -> None:
    """A box with rounded edges, each side cells × cells squares; towards its top narrower by `taper`."""
    vertices, faces = _cube(cells)
    size = np.array(half)
    inner = np.clip(vertices * size, radius_mm - size, size - radius_mm)
    outward = vertices * size - inner
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    vertices = inner + np.divide(radius_mm * outward, length, out=np.zeros_like(outward), where=length > 0.0)
    if rough_mm:
        vertices += rough_mm * b.rng.normal(size=vertices.shape)
    shrink = 1.0 - taper * np.clip(0.5 + 0.5 * vertices[:, 1:2] / size[1], 0.0, 1.0)
    b.add(vertices * np.hstack([shrink, np.ones_like(shrink), shrink]) + np.array(centre), faces, colour, mottled)


def _cube(cells: int) -> tuple[Array, NDArray[np.int64]]:
    """The cube [−1, 1]³ with cells × cells squares a side; vertices on edges are there once a side."""
    at = np.tan(np.linspace(-1.0, 1.0, cells + 1) * 0.25 * np.pi)  # denser at the edges once it is rounded
    s, t = (g.ravel() for g in np.meshgrid(at, at, indexing="ij"))
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)[:-1, :-1].ravel()
    row = cells + 1
    quads = np.stack([corner, corner + row, corner + row + 1, corner, corner + row + 1, corner + 1], axis=1).reshape(-1, 3)
    sides: list[Array] = []
    faces: list[NDArray[np.int64]] = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            side = np.empty((s.size, 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign, s, t
            faces.append((quads if sign > 0.0 else quads[:, ::-1]) + len(sides) * s.size)
            sides.append(side)
    return np.concatenate(sides), np.concatenate(faces)


def _wheels(b: _Builder, x: float, ends: tuple[float, ...], half_track: float, radius: float) -> None:
    for z in ends:
        for side in (-half_track, half_track):
            angle = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
            rim = np.stack([np.zeros(32), radius * np.sin(angle), radius * np.cos(angle)], axis=1)
            vertices = np.concatenate([rim + [x + side + w, GROUND_MM + radius, z] for w in (-110.0, 110.0)]
                                    + [np.array([[x + side + w, GROUND_MM + radius, z]]) for w in (-110.0, 110.0)])
            i, j = np.arange(32), (np.arange(32) + 1) % 32
            faces = np.concatenate([np.stack([i, i + 32, j], axis=1), np.stack([j, i + 32, j + 32], axis=1),
                                    np.stack([np.full(32, 64), i, j], axis=1),
                                    np.stack([np.full(32, 65), j + 32, i + 32], axis=1)])
            b.add(vertices, faces, TYRE)


def _car(b: _Builder, x: float, z: float, paint: Colour) -> None:
    """Its front, towards us, at z."""
    _shade(b, x, z, 950.0, 4400.0)
    _block(b, (x, GROUND_MM + 560.0, z + 2150.0), (890.0, 310.0, 2150.0), 190.0, 22, paint)
    _block(b, (x, GROUND_MM + 1080.0, z + 2450.0), (800.0, 330.0, 1350.0), 140.0, 18, GLASS, taper=0.28)
    _block(b, (x, GROUND_MM + 1400.0, z + 2450.0), (610.0, 35.0, 1010.0), 30.0, 8, paint)
    _front(b, x, z, 640.0, 650.0)
    _wheels(b, x, (z + 850.0, z + 3450.0), 800.0, 320.0)


def _lorry(b: _Builder, x: float, z: float, paint: Colour) -> None:
    _shade(b, x, z, 1300.0, 9500.0)
    _block(b, (x, GROUND_MM + 1550.0, z + 1000.0), (1200.0, 1150.0, 1000.0), 160.0, 22, paint)
    _block(b, (x, GROUND_MM + 1950.0, z + 60.0), (1020.0, 420.0, 90.0), 60.0, 8, GLASS)
    _block(b, (x, GROUND_MM + 2150.0, z + 5700.0), (1240.0, 1450.0, 3600.0), 60.0, 22, (218, 220, 224))
    _front(b, x, z, 900.0, 700.0)
    _wheels(b, x, (z + 1100.0, z + 5900.0, z + 7400.0), 1050.0, 480.0)


def _front(b: _Builder, x: float, z: float, lamps: float, height: float) -> None:
    """Lamps, grille and number plate."""
    for side in (-lamps, lamps):
        _block(b, (x + side, GROUND_MM + height, z + 25.0), (150.0, 75.0, 50.0), 35.0, 8, LAMP)
    _block(b, (x, GROUND_MM + height - 60.0, z + 10.0), (340.0, 85.0, 30.0), 20.0, 6, GRILLE)
    _block(b, (x, GROUND_MM + height - 240.0, z - 5.0), (260.0, 55.0, 15.0), 8.0, 4, PLATE)


def _shade(b: _Builder, x: float, z: float, half: float, length: float) -> None:
    b.ground(np.linspace(x - half, x + half, 5), np.linspace(z - 100.0, z + length, 9), SHADE, 0.0, lift_mm=10.0)


def _tree(b: _Builder, x: float, z: float) -> None:
    height = float(b.rng.uniform(2_600.0, 3_800.0))
    _block(b, (x, GROUND_MM + 0.5 * height, z), (160.0, 0.5 * height, 160.0), 60.0, 4, BARK, mottled=0.1)
    size = float(b.rng.uniform(1_500.0, 2_300.0))
    _block(b, (x, GROUND_MM + height + 0.7 * size, z), (size, 1.2 * size, size), 0.98 * size, 14, LEAVES, mottled=0.2,
           rough_mm=60.0)


def _house(b: _Builder, x: float, z: float, height: float) -> None:
    shade = float(b.rng.uniform(0.75, 1.1))
    wall = (int(WALL[0] * shade), int(WALL[1] * shade), int(WALL[2] * shade))
    _block(b, (x, GROUND_MM + 0.5 * height, z), (6_000.0, 0.5 * height, 8_000.0), 50.0, 10, wall, mottled=0.02)
    for floor in np.arange(1_500.0, height - 1_200.0, 2_800.0):
        for along in np.linspace(-6_000.0, 6_000.0, 5):
            side = np.sign(-x)
            _block(b, (x + side * 6_000.0, GROUND_MM + floor, z + along), (60.0, 700.0, 550.0), 20.0, 3, GLASS)
