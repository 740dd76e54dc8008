"""The roadside: random streams and textures go in, the meshes of the column, the guard rail and the trees come out."""

from __future__ import annotations

import numpy as np

from .materials import CONCRETE, GALVANISED, LEAF_DARK, LEAF_LIGHT, LEAF_SHADE
from .maths import Array, blend, normalised
from .mesh import Part, Shader, Surface, box, lathe, merged, plain, vertex_normals
from .textures import NoiseTile

# Lateral offsets a, distances Z and sizes [m].
RAIL_OFFSET = 11.3
COLUMN_OFFSET, COLUMN_DISTANCE, COLUMN_DIAMETER, COLUMN_HEIGHT = 10.1, 12.0, 0.44, 9.0


def concrete_surface(noise: NoiseTile) -> Shader:
    """Grey concrete with faint vertical streaks."""

    def shade(points: Array, _view: Array) -> Surface:
        around = np.arctan2(points[:, 2], points[:, 0]) * 40
        streaks = 1 + 0.045 * noise(around, points[:, 1] * 6) + 0.03 * noise(points[:, 1] * 90, around * 2)
        return Surface(CONCRETE * streaks[:, None], np.zeros(len(points)))

    return shade


def column(noise: NoiseTile) -> Part:
    """The straight vertical column on the verge, on a low plinth."""
    r = 0.5 * COLUMN_DIAMETER
    profile = [(r + 0.10, -0.05), (r + 0.10, 0.17), (r + 0.098, 0.18), (r + 0.08, 0.20), (r, 0.21)]
    profile += [(r, height) for height in np.linspace(0.22, COLUMN_HEIGHT, 40)]
    vertices, faces = lathe(profile, 1, 120)
    origin = np.array([COLUMN_OFFSET, 0.0, COLUMN_DISTANCE])
    return Part(vertices + origin, faces, concrete_surface(noise), vertex_normals(vertices, faces), origin)


def guard_rail() -> Part:
    """Steel guard rail along the verge: a W-shaped beam on posts."""
    beam = [(0.0, 0.45), (-0.08, 0.50), (-0.08, 0.55), (0.0, 0.60), (-0.08, 0.65), (-0.08, 0.70), (0.0, 0.75)]
    near, far = 5.0, 300.0
    vertices = np.array([(RAIL_OFFSET + a, g, z) for z in (near, far) for a, g in beam])
    i = np.arange(len(beam) - 1)
    quads = np.stack([i, i + 1, i + 1 + len(beam), i + len(beam)], axis=1)
    strip = (vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    posts = [
        box((RAIL_OFFSET + 0.005, 0.0, z - 0.06), (RAIL_OFFSET + 0.09, 0.72, z + 0.06))
        for z in np.arange(near + 1.0, far, 4.0)
    ]
    vertices, faces = merged([strip, *posts])
    return Part(vertices, faces, plain(GALVANISED), openness=np.full(len(vertices), 0.8))


def foliage_surface(noise: NoiseTile) -> Shader:
    """Leaf green that varies from tree to tree and from twig to twig."""

    def shade(points: Array, _view: Array) -> Surface:
        tone = 0.16 * noise(points[:, 0] * 0.9, points[:, 2] * 0.9)
        tone = tone + 0.16 * noise(points[:, 0] * 9 + points[:, 2] * 5, points[:, 1] * 9)
        return Surface(blend(LEAF_DARK, LEAF_LIGHT, np.clip(0.5 + tone, 0, 1)), np.zeros(len(points)))

    return shade


def crown(rng: np.random.Generator, centre: Array, radii: Array, leaf_size: float) -> tuple[Array, Array, Array, Array]:
    """Leaves of one clump: vertices, faces, normals and openness.  Leaves crowd near its ellipsoidal surface."""
    leaves = int(30.0 * radii[0] * radii[1] / leaf_size**2)
    outward = normalised(rng.standard_normal((leaves, 3)))
    depth = 1.0 - 0.42 * rng.random(leaves) ** 1.3
    lumps = 1.0 + 0.13 * np.sin(outward @ rng.normal(0, 4.0, (3, 3)) + rng.uniform(0, 6, 3)).sum(axis=1)
    middle = centre + outward * radii * (depth * lumps)[:, None]
    spread = normalised(rng.standard_normal((leaves, 3, 3))) * leaf_size * rng.uniform(0.5, 1.1, (leaves, 1, 1))
    vertices = (middle[:, None, :] + spread).reshape(-1, 3)
    normals = normalised(outward / radii * radii[0] + 0.45 * rng.standard_normal((leaves, 3)))
    shade = np.clip(0.30 + 1.6 * (depth - 0.55) + 0.12 * rng.standard_normal(leaves), 0.1, 1.0)
    shade *= 0.75 + 0.25 * outward[:, 1]
    faces = np.arange(3 * leaves).reshape(-1, 3)
    return vertices, faces, np.repeat(normals, 3, axis=0), np.repeat(shade, 3)


def ball(centre: Array, radii: Array) -> tuple[Array, Array]:
    """Ellipsoid that fills the inside of a clump."""
    turn = np.linspace(0.02, np.pi - 0.02, 9)
    vertices, faces = lathe([(np.sin(t), np.cos(t)) for t in turn], 1, 12)
    return centre + vertices * radii, faces


def forest(rng: np.random.Generator, noise: NoiseTile) -> list[Part]:
    """Loose belt of trees and bushes that runs along the road behind the verge."""
    clumps, cores, trunks = [], [], []
    distance = 26.0
    while distance < 420.0:
        offset = rng.uniform(40.0, 50.0) + 0.02 * distance
        height = rng.uniform(5.0, 8.5)
        leaf_size = 0.0017 * np.hypot(distance, offset)
        width = rng.uniform(0.30, 0.40) * height
        for _ in range(11):
            shift = normalised(rng.standard_normal(3)) * np.array([0.75 * width, 0.26 * height, 0.75 * width])
            radii = np.array([0.52 * width, 0.16 * height, 0.52 * width]) * rng.uniform(0.8, 1.15)
            middle = np.array([offset, 0.62 * height, distance]) + shift
            clumps.append(crown(rng, middle, radii, leaf_size))
            cores.append(ball(middle, 0.62 * radii))
        cores.append(ball(np.array([offset, 0.62 * height, distance]), np.array([0.40, 0.45, 0.40]) * width))
        bush = np.array([offset - rng.uniform(2, 5), 0.7, distance + rng.uniform(-3, 3)])
        radii = np.array([1.9, 1.2, 1.9]) * rng.uniform(0.7, 1.1)
        clumps.append(crown(rng, bush, radii, leaf_size))
        cores.append(ball(bush, 0.62 * radii))
        trunk, trunk_faces = lathe([(0.035 * height, -0.1), (0.02 * height, 0.6 * height)], 1, 10)
        trunks.append((trunk + np.array([offset, 0.0, distance]), trunk_faces))
        distance += rng.uniform(3.0, 7.5) * (1.0 + distance / 160.0)
    vertices, faces = merged([(clump[0], clump[1]) for clump in clumps])
    normals, openness = (np.concatenate([clump[i] for clump in clumps]) for i in (2, 3))
    wood, wood_faces = merged(trunks)
    inside, inside_faces = merged(cores)
    leaves, wood_colour = foliage_surface(noise), np.array([0.060, 0.050, 0.042])
    return [
        Part(vertices, faces, leaves, normals, openness=openness),
        Part(inside, inside_faces, plain(LEAF_SHADE), openness=np.full(len(inside), 0.5)),
        Part(wood, wood_faces, plain(wood_colour), vertex_normals(wood, wood_faces), openness=np.full(len(wood), 0.4)),
    ]
