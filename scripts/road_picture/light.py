"""Light and tone: directions, distances and linear colours go in, the light of sun, sky and air or pixels come out."""

from __future__ import annotations

import numpy as np

from .materials import ASPHALT
from .maths import Array, blend, normalised, smoothstep
from .textures import Textures

# --- light (linear RGB; sunlit level ground reflects about its albedo) --------------------------------------------
SUN_DIRECTION = np.array([-0.56, 0.64, -0.53]) / np.linalg.norm([-0.56, 0.64, -0.53])
SUN_COLOUR = np.array([1.20, 1.13, 1.00])
SUN_SPREAD = 0.008  # radius of the sun's disc [rad], a little wider than the real one for soft shadow edges
SKY_AMBIENT = np.array([0.23, 0.28, 0.36])
GROUND_BOUNCE = np.array([0.11, 0.11, 0.10])
ZENITH_COLOUR = np.array([0.13, 0.30, 0.68])
HORIZON_COLOUR = np.array([0.60, 0.74, 0.88])
CLOUD_COLOUR = np.array([0.93, 0.94, 0.96])
CLOUD_SHIFT = 200.0  # which part of the cloud texture is overhead [texels]
HAZE_DISTANCE, HAZE_LIMIT = 2000.0, 500.0  # [m]


def sun_direction(offset: tuple[float, float]) -> Array:
    """Direction to a point of the sun's disc; ``offset`` is its place on the unit disc."""
    side = normalised(np.cross(SUN_DIRECTION, np.array([0.0, 1.0, 0.0])))
    up = np.cross(side, SUN_DIRECTION)
    return SUN_DIRECTION + SUN_SPREAD * (offset[0] * side + offset[1] * up)


def ambient(normals: Array, openness: Array) -> Array:
    """Light (n, 3) from the sky and the ground on surfaces that see a share ``openness`` of their surroundings."""
    return blend(GROUND_BOUNCE, SKY_AMBIENT, 0.5 + 0.5 * normals[:, 1]) * openness[:, None]


def sky_colour(direction: Array, textures: Textures) -> Array:
    """Clear sky with soft clouds; unit directions with g > 0."""
    rise = np.maximum(direction[:, 1], 0.0)
    colour = blend(HORIZON_COLOUR, ZENITH_COLOUR, np.clip(rise * 2.3, 0, 1) ** 0.62)
    depth = rise + 0.30
    u, v = direction[:, 0] / depth * 26.0, direction[:, 2] / depth * 70.0
    u, v = u + 1.6 * textures.cloudy(u, v), v + 1.6 * textures.cloudy(v + 300, u)
    density = textures.cloudy(u + CLOUD_SHIFT, v) + 0.10 * textures.patchy(u * 3, v * 3)
    cover = smoothstep(0.35, 2.0, density) * smoothstep(0.010, 0.07, rise)
    relief = density - textures.cloudy(u + CLOUD_SHIFT + 2, v - 5)
    cloud = CLOUD_COLOUR * (1.0 - 0.16 * smoothstep(-0.1, 0.6, -relief))[:, None]
    return blend(colour, cloud, 0.92 * cover)


def backdrop_colour(direction: Array, textures: Textures) -> Array:
    """Sky with two rows of distant hills and a far wood before it."""
    colour = sky_colour(direction, textures)
    bearing, rise = direction[:, 0] / direction[:, 2], direction[:, 1] / direction[:, 2]
    row = np.full_like(bearing, 100.0)
    hills = (
        (0.030 + 0.0075 * textures.cloudy(bearing * 90 + 10, row), np.array([0.30, 0.42, 0.52])),
        (0.016 + 0.0050 * textures.cloudy(bearing * 170 + 400, row + 211), np.array([0.15, 0.26, 0.24])),
        (0.006 + 0.0012 * textures.patchy(bearing * 900, row), np.array([0.075, 0.135, 0.085])),
    )
    for height, hill in hills:
        colour = blend(colour, hill, smoothstep(-0.0002, 0.0002, height - rise))
    return colour


def reflected_colour(direction: Array, blocked: Array, textures: Textures) -> Array:
    """What a glossy surface mirrors: sky, a dark band of trees, the road, or another part of a vehicle."""
    colour = sky_colour(direction, textures)
    colour = blend(colour, np.array([0.06, 0.09, 0.06]), smoothstep(0.26, 0.10, direction[:, 1]))
    colour = blend(colour, ASPHALT * 0.95, smoothstep(0.004, -0.004, direction[:, 1]))
    return np.where(blocked[:, None], 0.03, colour)


def glint(ray: Array) -> Array:
    """Strength of the sun's mirror image, with its glow, in unit directions."""
    return 14.0 * np.maximum(ray @ SUN_DIRECTION, 0) ** 700 + 0.8 * np.maximum(ray @ SUN_DIRECTION, 0) ** 40


def hazed(colour: Array, depth: Array) -> Array:
    """Colours of solid things as the air between lets them through; ``depth`` is their distance Z [m]."""
    return blend(colour, HORIZON_COLOUR * 0.9, 1.0 - np.exp(-np.minimum(depth, HAZE_LIMIT) / HAZE_DISTANCE))


def displayable(colour: Array) -> Array:
    """Roll highlights off towards 1; everything darker stays as it is."""
    knee = 0.75
    return np.where(colour < knee, colour, knee + (1 - knee) * np.tanh((colour - knee) / (1 - knee)))


def encoded(linear: Array) -> Array:
    """8-bit sRGB."""
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * np.clip(curve, 0, 1)).astype(np.uint8)
