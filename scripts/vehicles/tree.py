"""A seed and a size in, a broad-leaved tree out: trunk and branches as tapered tubes, its leaves as clusters of small cards.

The crown is a heap of rounded lobes at the branches' ends. A card stands for a tuft of leaves; it faces away from its
lobe's middle, more or less, and its vertices' normals are those of the lobe, so that light and shade follow the lobes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .tessellate import Patch

Array = NDArray[np.float64]

SIDES = 7  # of a branch's section
TUFT = 190.0  # mm, half a card's greatest length
ROUGH = 0.55  # how far a card leans from its lobe's normal
LEAVES = ("leaf-1", "leaf-2", "leaf-3")


@dataclass(frozen=True, slots=True)
class Tree:
    """Height, height of the lowest leaves and the crown's radius [mm]; lobes and cards in all; seed."""

    height: float
    clear: float
    radius: float
    lobes: int
    cards: int
    seed: int


def tree(size: Tree) -> list[Patch]:
    rng = np.random.default_rng(size.seed)
    centres, radii = _lobes(size, rng)
    patches = _wood(size, centres, rng)
    share = radii**2 / (radii**2).sum()
    lobe = rng.choice(len(centres), size.cards, p=share)
    out = rng.normal(size=(size.cards, 3))
    out[:, 2] = np.abs(out[:, 2]) * np.where(rng.random(size.cards) < 0.62, 1.0, -1.0)
    out /= np.linalg.norm(out, axis=1)[:, None]
    depth = rng.uniform(0.72, 1.05, size.cards)
    middle = centres[lobe] + (depth * radii[lobe])[:, None] * out * (1.0, 1.0, 0.82)
    lean = out + ROUGH * rng.normal(size=out.shape)
    lean /= np.linalg.norm(lean, axis=1)[:, None]
    first = np.cross(lean, rng.normal(size=out.shape))
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(lean, first)
    length = TUFT * rng.uniform(0.55, 1.1, (size.cards, 1))
    width = length * rng.uniform(0.5, 0.85, (size.cards, 1))
    skew = rng.uniform(-0.35, 0.35, (size.cards, 1))
    across = width * second + skew * length * first
    bent = middle + length * first - 0.25 * length * lean
    corners = np.stack([middle - length * first, middle + across, bent, middle - across], axis=1)
    heart = np.array([0.0, 0.0, size.clear + 0.45 * (size.height - size.clear)])
    outward = out + 0.55 * (middle - heart) / size.radius
    normals = np.repeat((outward / np.linalg.norm(outward, axis=1)[:, None])[:, None], 4, axis=1)
    normals = normals + 0.6 * lean[:, None]
    normals /= np.linalg.norm(normals, axis=2)[..., None]
    kind = rng.choice(3, len(centres), p=(0.4, 0.35, 0.25))[lobe]
    kind = np.where(rng.random(size.cards) < 0.25, rng.integers(0, 3, size.cards), kind)
    quad = np.array([(0, 1, 2), (0, 2, 3)])
    for number, leaf in enumerate(LEAVES):
        mine = kind == number
        count = int(mine.sum())
        faces = (quad[None] + 4 * np.arange(count)[:, None, None]).reshape(-1, 3)
        patches.append(Patch(leaf, corners[mine].reshape(-1, 3), normals[mine].reshape(-1, 3), faces))
    return [patch.wound() for patch in patches]


def _lobes(size: Tree, rng: np.random.Generator) -> tuple[Array, Array]:
    """Centres (n, 3) and radii (n,) of the crown's lobes."""
    middle = 0.5 * (size.clear + size.height)
    half = 0.5 * (size.height - size.clear)
    k = np.arange(size.lobes)
    level = 0.92 - 1.75 * (k + 0.5) / size.lobes  # from the top to near the bottom
    spin = k * 2.399963 + rng.uniform(0.0, 0.7, size.lobes)  # the golden angle: no two one above the other
    reach = np.sqrt(np.maximum(1.0 - level**2, 0.05)) * rng.uniform(0.55, 0.72, size.lobes)
    flat = size.radius * reach[:, None] * np.column_stack([np.cos(spin), np.sin(spin)])
    centres = np.column_stack([flat, middle + 0.68 * level * half])
    return centres, size.radius * rng.uniform(0.30, 0.46, size.lobes)


def _wood(size: Tree, centres: Array, rng: np.random.Generator) -> list[Patch]:
    """The trunk, and a branch from it to each lobe."""
    top = size.clear + 0.55 * (size.height - size.clear)
    sway = rng.normal(scale=0.02 * size.height, size=(2,))
    girth = 0.019 * size.height

    def trunk(z: float) -> Array:
        t = z / top
        return np.array([sway[0] * t * t, sway[1] * np.sin(2.2 * t) * 0.5, z])

    heights = np.concatenate([[0.0, 0.04, 0.12], np.linspace(0.25, 1.0, 6)]) * top
    flare = np.interp(heights / top, [0.0, 0.04, 0.12, 1.0], [1.55, 1.2, 1.0, 0.42])
    patches = [_tube(np.array([trunk(z) for z in heights]), girth * flare)]
    for centre in centres:
        start = float(np.clip(centre[2] - 0.75 * np.hypot(*centre[:2]), 0.8 * size.clear, top))
        root = trunk(start)
        t = np.linspace(0.0, 1.0, 5)[:, None]
        bow = np.array([0.0, 0.0, 0.12 * float(np.linalg.norm(centre - root))])
        path = root + t * (centre - root) + 4.0 * t * (1.0 - t) * (bow + rng.normal(scale=60.0, size=3))
        patches.append(_tube(path, girth * np.linspace(0.42, 0.10, 5)))
    return patches


def _tube(path: Array, radii: Array) -> Patch:
    """A tapered tube along a path."""
    tangents = np.gradient(path, axis=0)
    if path[0, 2] == 0.0:
        tangents[0] = 0.0, 0.0, 1.0  # out of the ground upright
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    side = np.cross(tangents, (0.31, 0.95, 0.02))
    side /= np.linalg.norm(side, axis=1)[:, None]
    other = np.cross(tangents, side)
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    normals = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * other[:, None]
    points = path[:, None] + radii[:, None, None] * normals
    ring, k = (index.ravel() for index in np.meshgrid(np.arange(len(path) - 1), np.arange(SIDES), indexing="ij"))
    a, b = SIDES * ring + k, SIDES * ring + (k + 1) % SIDES
    faces = np.vstack([np.column_stack([a, b, a + SIDES]), np.column_stack([b, b + SIDES, a + SIDES])])
    return Patch("bark", points.reshape(-1, 3), normals.reshape(-1, 3), faces)
