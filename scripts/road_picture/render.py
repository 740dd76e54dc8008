"""Rendering: the parts of a scene and its textures go in, bands of linear pixels come out."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from .camera import (
    CAMERA_HEIGHT,
    SUPERSAMPLING,
    Y_VANISH,
    Window,
    ground_points,
    sample_pattern,
    sight_lines,
)
from .ground import ground_colour
from .light import (
    SKY_AMBIENT,
    SUN_COLOUR,
    SUN_DIRECTION,
    ambient,
    backdrop_colour,
    displayable,
    glint,
    hazed,
    reflected_colour,
    sun_direction,
)
from .maths import Array, cosine_directions, dot, normalised
from .mesh import Part, vertex_normals
from .textures import Textures

OCCLUSION_RAYS = 48
OCCLUSION_RANGE = 2.5  # [m]
REFLECTION_RANGE = 2.0  # [m], beyond it reflections show sky, trees and road only
RAY_OFFSET = 2e-3  # [m], keeps secondary rays off the surface they start on


class Scene:
    """All parts in one ray-tracing scene, with the light that reaches them."""

    def __init__(self, parts: list[Part], textures: Textures) -> None:
        """Hand the meshes to the ray tracer and find out how open to the sky their vertices are."""
        self.parts, self.textures = parts, textures
        self.tracer = EmbreeScene(robust=True)
        for part in parts:
            TriangleMesh(self.tracer, part.vertices.astype(np.float32), part.faces.astype(np.int32))
        self.dome = cosine_directions(OCCLUSION_RAYS)
        for part in parts:
            if part.openness is None:
                normals = vertex_normals(part.vertices, part.faces) if part.normals is None else part.normals
                part.openness = self.sky_share(part.vertices, normals)
        self.footprints = [
            (part.vertices.min(axis=0), part.vertices.max(axis=0)) for part in parts if np.ptp(part.vertices[:, 2]) < 20
        ]

    def blocked(self, points: Array, directions: Array, reach: float = 1e4) -> Array:
        """Whether something stands in the way of each ray."""
        rays = np.ascontiguousarray(np.broadcast_to(directions, points.shape), dtype=np.float32)
        limits = np.full(len(points), reach, dtype=np.float32)
        return self.tracer.run(points.astype(np.float32), rays, limits, query="OCCLUDED") >= 0

    def sky_share(self, points: Array, normals: Array) -> Array:
        """Cosine-weighted share of the half-space above each point that is open within OCCLUSION_RANGE."""
        helper = np.where(np.abs(normals[:, :1]) < 0.8, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
        tangent = normalised(np.cross(normals, helper))
        bitangent = np.cross(normals, tangent)
        start = points + normals * 4 * RAY_OFFSET
        total = np.zeros(len(points))
        for u, v, w in self.dome:
            total += ~self.blocked(start, u * tangent + v * bitangent + w * normals, OCCLUSION_RANGE)
        return total / len(self.dome)

    def sunlight(self, points: Array, offset: tuple[float, float]) -> Array:
        """1 in the sun, 0 in shadow; ``offset`` picks a point of the sun's disc."""
        return 1.0 - self.blocked(points, sun_direction(offset))

    def ground_openness(self, a: Array, z: Array) -> Array:
        """Contact shadow: share of the sky that the ground sees."""
        share = np.ones(len(a))
        close = np.zeros(len(a), dtype=bool)
        for low, high in self.footprints:
            margin = min(1.5, high[1])
            close |= (a > low[0] - margin) & (a < high[0] + margin) & (z > low[2] - margin) & (z < high[2] + margin)
        points = np.stack([a[close], np.zeros(close.sum()), z[close]], axis=1)
        share[close] = self.sky_share(points, np.broadcast_to([0.0, 1.0, 0.0], points.shape))
        return share

    def shade_parts(self, hit: dict[str, Array], points: Array, view: Array, offset: tuple[float, float]) -> Array:
        """Colour of mesh hits."""
        count = len(points)
        albedo, inner, normals = np.zeros((count, 3)), np.zeros((count, 3)), normalised(hit["Ng"].astype(float))
        gloss, openness = np.zeros(count), np.zeros(count)
        for number in np.unique(hit["geomID"]):
            chosen = np.flatnonzero(hit["geomID"] == number)
            part = self.parts[number]
            corner = part.faces[hit["primID"][chosen]]
            u, v = hit["u"][chosen, None], hit["v"][chosen, None]
            weights = np.concatenate([1 - u - v, u, v], axis=1)
            if part.normals is not None:
                normals[chosen] = normalised(np.einsum("nk,nki->ni", weights, part.normals[corner]))
            openness[chosen] = np.einsum("nk,nk->n", weights, part.openness[corner])
            surface = part.shader((points[chosen] - part.origin) / part.scale, view[chosen])
            albedo[chosen], gloss[chosen] = surface.albedo, surface.gloss
            if surface.inner is not None:
                inner[chosen] = surface.inner
        normals *= np.where(dot(normals, view) > 0, -1.0, 1.0)[:, None]
        start = points + normals * RAY_OFFSET
        sun = np.maximum(normals @ SUN_DIRECTION, 0.0)
        sun[sun > 0] *= self.sunlight(start[sun > 0], offset)
        colour = albedo * (SUN_COLOUR * sun[:, None] + ambient(normals, openness))

        shiny = np.flatnonzero(gloss > 0)
        facing = np.clip(-dot(normals[shiny], view[shiny]), 0, 1)
        fresnel = (gloss[shiny] + (1 - gloss[shiny]) * 0.8 * (1 - facing) ** 5)[:, None]
        ray = normalised(view[shiny] + 2 * facing[:, None] * normals[shiny])
        mirrored = reflected_colour(ray, self.blocked(start[shiny], ray, REFLECTION_RANGE), self.textures)
        mirrored += SUN_COLOUR * (glint(ray) * (sun[shiny] > 0))[:, None]
        colour[shiny] = (colour[shiny] + inner[shiny]) * (1 - fresnel) + mirrored * fresnel
        return colour

    def trace(self, x: Array, y: Array, openness: Array, offset: tuple[float, float]) -> Array:
        """Linear colours seen at plane coordinates [mm]; ``openness`` is that of the ground there."""
        direction = sight_lines(x, y)
        origin = np.tile(np.array([0, CAMERA_HEIGHT, 0], dtype=np.float32), (len(x), 1))
        hit = self.tracer.run(origin, direction.astype(np.float32), output=True)
        colour = np.empty((len(x), 3))
        depth = hit["tfar"].astype(float)  # the third component of the direction is 1, so this is Z
        on_part = hit["geomID"] >= 0
        on_ground = ~on_part & (direction[:, 1] < 0)
        in_sky = ~on_part & ~on_ground
        unit = normalised(direction)

        colour[in_sky] = backdrop_colour(unit[in_sky], self.textures)
        z = CAMERA_HEIGHT / -direction[on_ground, 1]
        a = direction[on_ground, 0] * z
        depth[on_ground] = z
        albedo = ground_colour(x[on_ground], y[on_ground], a, z, self.textures)
        sun = SUN_DIRECTION[1] * self.sunlight(np.stack([a, np.full_like(a, RAY_OFFSET), z], axis=1), offset)
        colour[on_ground] = albedo * (SUN_COLOUR * sun[:, None] + SKY_AMBIENT * openness[on_ground, None])
        selected = {name: values[on_part] for name, values in hit.items()}
        points = np.array([0, CAMERA_HEIGHT, 0]) + direction[on_part] * depth[on_part, None]
        colour[on_part] = self.shade_parts(selected, points, unit[on_part], offset)
        solid = ~in_sky
        colour[solid] = hazed(colour[solid], depth[solid])
        return colour

    def render_band(self, window: Window, first_row: int, rows: int) -> Array:
        """Linear pixels (rows, columns, 3): the mean of a regular grid of samples in every pixel."""
        x, y = window.pixel_centres(first_row, rows)
        openness = np.ones(len(x))
        below = y < Y_VANISH
        openness[below] = self.ground_openness(*ground_points(x[below], y[below]))
        total = np.zeros((len(x), 3))
        for dx, dy, offset in sample_pattern():
            total += displayable(self.trace(x + dx * window.pixel, y + dy * window.pixel, openness, offset))
        return (total / SUPERSAMPLING**2).reshape(rows, window.columns, 3)
