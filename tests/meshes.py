"""Meshes that several tests share, with the exact normals of what they stand for."""

from __future__ import annotations

import numpy as np


def unit(vectors: np.ndarray) -> np.ndarray:
    """Rows of length 1."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def icosphere(times: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere: an icosahedron whose facets are cut in four `times` times; outward."""
    t = (1.0 + np.sqrt(5.0)) / 2.0
    vertices = unit(np.array([[-1, t, 0], [1, t, 0], [-1, -t, 0], [1, -t, 0], [0, -1, t], [0, 1, t], [0, -1, -t], [0, 1, -t],
                              [t, 0, -1], [t, 0, 1], [-t, 0, -1], [-t, 0, 1]]))
    faces = np.array([[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6],
                      [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10],
                      [8, 6, 7], [9, 8, 1]])
    for _ in range(times):
        pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        pairs, index = np.unique(pairs, axis=0, return_inverse=True)
        ab, bc, ca = len(vertices) + index.reshape(3, -1)
        vertices = np.concatenate([vertices, unit(vertices[pairs].sum(axis=1))])
        a, b, c = faces.T
        faces = np.concatenate([np.stack(corners, axis=1) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return vertices, faces.astype(np.int32)


def grid(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x and y of the grid's vertices, and two triangles a cell, counter-clockwise in (x, y)."""
    xx, yy = np.meshgrid(x, y, indexing="ij")
    corner = np.arange(xx.size).reshape(xx.shape)[:-1, :-1].ravel()
    row = len(y)
    faces = np.concatenate([np.stack([corner, corner + row, corner + row + 1], axis=1),
                            np.stack([corner, corner + row + 1, corner + 1], axis=1)])
    return xx.ravel(), yy.ravel(), faces.astype(np.int32)


def box(cells: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed box of 2 × 1.3 × 0.9 with `cells`² cells a side, vertices shared; outward."""
    u, v, side = grid(np.linspace(-1.0, 1.0, cells + 1), np.linspace(-1.0, 1.0, cells + 1))
    corners = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            plane = np.zeros((len(u), 3))
            plane[:, (axis + 1) % 3], plane[:, (axis + 2) % 3], plane[:, axis] = u, v, sign
            corners.append((plane * [1.0, 0.65, 0.45])[side if sign > 0.0 else side[:, ::-1]])
    vertices, index = np.unique(np.concatenate(corners).reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    return vertices, index.reshape(-1, 3).astype(np.int32)


def cap(cells: int, uneven: float = 0.0, radius: float = 950.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A mirror of 250 × 380 mm cut from a sphere, its exact vertex normals beside it; an open sheet.

    uneven : by what share of a cell the inner vertices are moved about in x and y.
    """
    x, y, faces = grid(np.linspace(-125.0, 125.0, cells + 1), np.linspace(-190.0, 190.0, cells + 1))
    inner = (np.abs(x) < 124.9) & (np.abs(y) < 189.9)
    shift = np.random.default_rng(cells).uniform(-uneven, uneven, (2, x.size)) * inner * 250.0 / cells
    x, y = x + shift[0], y + shift[1]
    z = np.sqrt(radius**2 - x**2 - y**2)
    return np.stack([x, y, z - radius], axis=1), faces, np.stack([x, y, z], axis=1) / radius
