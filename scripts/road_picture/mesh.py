"""Meshes: implicit functions, profiles and boxes go in, triangle meshes (parts) with a shader come out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .maths import Array, dot, normalised


@dataclass
class Surface:
    """What a surface does with light, per sample."""

    albedo: Array  # (n, 3)
    gloss: Array  # (n,) reflectance at normal incidence of a clear coat, 0 for matt
    inner: Array | None = None  # (n, 3) light from behind glass, independent of the surface's own illumination


Shader = Callable[[Array, Array], Surface]  # (local points, view directions) -> surface


@dataclass
class Part:
    """A triangle mesh with one shader.  Without ``normals`` it is shaded flat."""

    vertices: Array  # (n, 3) world [m]
    faces: Array  # (m, 3)
    shader: Shader
    normals: Array | None = None  # (n, 3)
    origin: Array = field(default_factory=lambda: np.zeros(3))  # of the shader's local coordinates
    scale: Array = field(default_factory=lambda: np.ones(3))
    openness: Array | None = None  # (n,) share of the sky that a vertex sees; None: to be computed


def plain(albedo: Array, gloss: float = 0.0) -> Shader:
    """Shader of one colour."""

    def shade(points: Array, _view: Array) -> Surface:
        return Surface(np.broadcast_to(albedo, points.shape), np.full(len(points), gloss))

    return shade


def surface_nets(function: Callable[[Array], Array], low: Array, high: Array, step: float) -> tuple[Array, Array]:
    """Mesh the zero level of an implicit function (negative inside) with one vertex per mixed grid cell."""
    axes = [np.arange(lo, hi + step, step) for lo, hi in zip(low, high, strict=True)]
    values = function(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    inside = values < 0.0
    corner_offsets = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    count = sum(
        inside[i : i - 1 or None, j : j - 1 or None, k : k - 1 or None].astype(np.int8) for i, j, k in corner_offsets
    )
    cells = np.argwhere((count > 0) & (count < 8))
    index = np.full(np.array(inside.shape) - 1, -1, dtype=np.int64)
    index[tuple(cells.T)] = np.arange(len(cells))

    corners = np.stack([values[tuple((cells + offset).T)] for offset in corner_offsets])
    total, crossings = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for first in range(8):
        for second in range(first + 1, 8):
            if np.abs(corner_offsets[first] - corner_offsets[second]).sum() != 1:
                continue
            crosses = (corners[first] < 0) != (corners[second] < 0)
            t = np.where(crosses, corners[first] / np.where(crosses, corners[first] - corners[second], 1.0), 0.0)
            point = corner_offsets[first] + t[:, None] * (corner_offsets[second] - corner_offsets[first])
            total += point * crosses[:, None]
            crossings += crosses
    vertices = np.asarray(low) + (cells + total / crossings[:, None]) * step

    quads = []
    for axis in range(3):
        side, other = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        start = np.moveaxis(inside, axis, 0)
        edges = np.argwhere(np.moveaxis(start[:-1] != start[1:], 0, axis))
        edges = edges[np.all((edges >= side + other) & (edges < index.shape), axis=1)]
        ring = np.stack([index[tuple((edges - d).T)] for d in (0 * side, side, side + other, other)], axis=1)
        leaving = inside[tuple(edges.T)]
        quads.append(np.where(leaving[:, None], ring, ring[:, ::-1]))
    quad = np.concatenate(quads)
    return vertices, np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])


def gradient(function: Callable[[Array], Array], points: Array, step: float = 0.004) -> Array:
    """Central differences of an implicit function."""
    return np.stack([(function(points + d) - function(points - d)) / (2 * step) for d in np.eye(3) * step], axis=-1)


def implicit_part(
    function: Callable[[Array], Array],
    bounds: tuple[Array, Array],
    step: float,
    origin: Array,
    scale: Array,
    shader: Shader,
) -> Part:
    """Mesh an implicit body given in local coordinates and place it in the world."""
    local, faces = surface_nets(function, bounds[0], bounds[1], step)
    slope = gradient(function, local)
    shift = -function(local)[:, None] * slope / np.maximum(dot(slope, slope), 0.05)[:, None]
    local = local + np.clip(shift, -0.5 * step, 0.5 * step)
    normals = normalised(gradient(function, local) / scale)
    return Part(origin + local * scale, faces, shader, normals, origin, scale)


def lathe(profile: list[tuple[float, float]], axis: int, segments: int) -> tuple[Array, Array]:
    """Surface of revolution of (radius, position along the axis) points."""
    angle = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)
    radius, along = np.array(profile).T
    points = np.empty((len(profile), segments, 3))
    points[..., axis] = along[:, None]
    points[..., (axis + 1) % 3] = radius[:, None] * np.cos(angle)
    points[..., (axis + 2) % 3] = radius[:, None] * np.sin(angle)
    i, j = np.meshgrid(np.arange(len(profile) - 1), np.arange(segments), indexing="ij")
    a, b = i * segments + j, i * segments + (j + 1) % segments
    quads = np.stack([a, b, b + segments, a + segments], axis=-1).reshape(-1, 4)
    return points.reshape(-1, 3), np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[Array, Array]:
    """Axis-parallel box."""
    corners = np.array(
        [[(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def vertex_normals(vertices: Array, faces: Array) -> Array:
    """Area-weighted normals for smooth shading."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    face_normals = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(total, faces[:, i], face_normals)
    return normalised(total)


def merged(meshes: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Several meshes as one."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in meshes[:-1]])
    faces = [f + start for (_, f), start in zip(meshes, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)
