"""The ground: places on the picture plane and on the ground go in, the albedo of asphalt, paint and verge comes out.

One solid yellow line is painted at a = h / 0.6 = 4166.67 mm, h being the height of the camera.  Its centre is therefore
exactly Y = 2400 + 0.6 * X on the picture, and nothing yellow is drawn above it.  It is the line that distortion is
measured on.
"""

from __future__ import annotations

import numpy as np

from .camera import CAMERA_HEIGHT, X_VANISH, Y_VANISH
from .materials import ASPHALT, CAST_IRON, GRASS, GRAVEL, WHITE_PAINT, YELLOW_PAINT
from .maths import Array, blend, polygon_distance, smoothstep
from .textures import Textures

# --- reference line on the picture plane --------------------------------------------------------------------------
LINE_SLOPE = 0.6  # of the reference line on the plane
MIN_LINE_THICKNESS = 11.0  # vertical thickness of the reference line on the plane, at least

# --- road cross-section, lateral offsets a [m] --------------------------------------------------------------------
REFERENCE_LINE = CAMERA_HEIGHT / LINE_SLOPE
OWN_LANE_LINE = 0.67
DASHED_LINE = REFERENCE_LINE + 3.5
EDGE_LINE = 9.25
ASPHALT_EDGE = 9.62
GRAVEL_EDGE = 9.95
YELLOW_WIDTH = 0.17
WHITE_WIDTH = 0.14
DASH_LENGTH, DASH_PERIOD, DASH_START = 3.0, 6.0, 0.8
JOINT_PERIOD, JOINT_FIRST, JOINT_WIDTH = 4.0, 2.9, 0.030
ARROW_OFFSET, ARROW_TIP, ARROW_LENGTH = 2.42, 3.9, 4.2  # lane arrow: centre, nearest point, length
MANHOLE, MANHOLE_RADIUS = (2.95, 3.35), 0.33  # (a, Z) of its centre
PATCH_BOUNDS = (1.15, 3.55, 12.5, 17.0)  # repaired asphalt: a from, a to, Z from, Z to


def lane_arrow(a: Array, z: Array) -> Array:
    """Where the straight-on arrow in the adjacent lane is painted.  It points the way the traffic drives."""
    u, v = np.abs(a - ARROW_OFFSET), z - ARROW_TIP
    head = polygon_distance(u, v, [(-1.0, 0.0), (0.0, 0.0), (0.34, 1.5), (-1.0, 1.5)]) < 0
    return head | ((u < 0.075) & (v >= 1.4) & (v < ARROW_LENGTH))


def manhole_colour(a: Array, z: Array, asphalt: Array) -> Array:
    """Cast-iron manhole cover with a chequered tread in the adjacent lane."""
    u, v = a - MANHOLE[0], z - MANHOLE[1]
    radius = np.hypot(u, v)
    tread = (np.sin(u * 2 * np.pi / 0.11) * np.sin(v * 2 * np.pi / 0.11) > 0.15) & (radius < MANHOLE_RADIUS - 0.075)
    ring = np.abs(radius - MANHOLE_RADIUS + 0.045) < 0.016
    iron = CAST_IRON * np.where(tread | ring, 1.7, 1.0)[:, None]
    colour = np.where((radius < MANHOLE_RADIUS)[:, None], iron, asphalt)
    return np.where((np.abs(radius - MANHOLE_RADIUS) < 0.012)[:, None], 0.3 * CAST_IRON, colour)


def asphalt_colour(a: Array, z: Array, textures: Textures) -> Array:
    """Worn asphalt with wheel tracks, joints, a repaired patch and a sealed crack."""
    fine = 1.0 / (1.0 + (z / 9.0) ** 2)
    tone = 1.0 + 0.070 * fine * textures.grain.nearest(a / 0.006, z / 0.009)
    tone += 0.035 / (1.0 + (z / 40.0) ** 2) * textures.patchy(a / 0.02, z / 0.05)
    tone += 0.030 * textures.patchy(a / 0.11 + 77, z / 0.7)
    lane = (a - OWN_LANE_LINE) % 3.5 - 1.75
    tone -= 0.075 * np.exp(-(((np.abs(lane) - 0.82) / 0.30) ** 2)) - 0.03
    tone -= 0.050 * np.exp(-((lane / 0.22) ** 2))
    joint = np.abs((z - JOINT_FIRST + 0.5 * JOINT_PERIOD) % JOINT_PERIOD - 0.5 * JOINT_PERIOD)
    half = np.maximum(0.5 * JOINT_WIDTH, 3e-4 * z**2)  # far away a joint is spread over a pixel and gets fainter
    sealed = smoothstep(1.15, 0.85, joint / half) * 0.5 * JOINT_WIDTH / half
    wander = 0.06 * textures.cloudy(z / 0.08, np.full_like(z, 300.0))
    crack = (np.abs(a - 1.05 - wander) < 0.010) & (z > 4.5)
    sealed = np.maximum(sealed, 0.8 * crack / (1.0 + (z / 25.0) ** 2))
    a_from, a_to, z_from, z_to = PATCH_BOUNDS
    patch = np.maximum(
        np.abs(a - 0.5 * (a_from + a_to)) - 0.5 * (a_to - a_from),
        np.abs(z - 0.5 * (z_from + z_to)) - 0.5 * (z_to - z_from),
    )
    tone *= np.where(patch < 0, 0.80, 1.0)
    sealed = np.maximum(sealed, 0.7 * (np.abs(patch) < 0.025))
    return manhole_colour(a, z, ASPHALT * (tone * (1.0 - 0.55 * sealed))[:, None])


def verge_colour(a: Array, z: Array, textures: Textures) -> Array:
    """Gravel strip, mown grass and, far off, fields."""
    near = 1.0 / (1.0 + (np.hypot(a, z) / 30.0) ** 2)
    tone = 1.0 + 0.20 * near * textures.grain(a / 0.04, z / 0.20) + 0.10 * textures.patchy(a / 0.10, z / 0.7 + 40)
    tone += 0.07 * textures.cloudy(a / 0.12, z / 0.9)
    grass = GRASS * np.maximum(tone, 0.35)[:, None]
    hue = 0.5 + 0.5 * textures.cloudy(a / 0.5 + 90, z / 1.2)
    grass = blend(grass, grass * np.array([1.25, 1.05, 1.2]), np.clip(hue, 0, 1))
    fields = smoothstep(0.2, 0.5, textures.cloudy(np.floor(a / 60.0) * 31, np.floor(z / 170.0) * 57)) * (a > 70.0)
    grass = blend(grass, grass * np.array([1.15, 1.25, 0.95]), fields)
    stones = GRAVEL * (1.0 + 0.20 * near * textures.grain.nearest(a / 0.02, z / 0.03))[:, None]
    rim = GRAVEL_EDGE + 0.06 * textures.patchy(a / 0.02, z / 0.06)
    return blend(stones, grass, smoothstep(-0.06, 0.10, a - rim))


def ground_colour(x: Array, y: Array, a: Array, z: Array, textures: Textures) -> Array:
    """Albedo of the ground at world (a, z), which is seen at plane (x, y) [mm]."""
    colour = asphalt_colour(a, z, textures)
    wear = 1.0 + 0.03 * textures.patchy(a / 0.012, z / 0.03) / (1.0 + (z / 15.0) ** 2)
    paint = WHITE_PAINT * wear[:, None] * 0.93
    dashed = (np.abs(a - DASHED_LINE) < 0.5 * WHITE_WIDTH) & ((z - DASH_START) % DASH_PERIOD < DASH_LENGTH)
    white = dashed | (np.abs(a - EDGE_LINE) < 0.5 * WHITE_WIDTH) | lane_arrow(a, z)
    colour = np.where(white[:, None], paint, colour)
    # The reference line is laid out on the plane, symmetric about Y = 2400 + 0.6 X column by column.  Far away, where
    # true-size paint would be too thin to find, it is kept MIN_LINE_THICKNESS high.
    drop = LINE_SLOPE * (X_VANISH - x)
    thickness = np.maximum(drop * YELLOW_WIDTH / REFERENCE_LINE, MIN_LINE_THICKNESS)
    yellow = (np.abs(Y_VANISH - drop - y) < 0.5 * thickness) | (np.abs(a - OWN_LANE_LINE) < 0.5 * YELLOW_WIDTH)
    colour = np.where((yellow & (a > 0))[:, None], YELLOW_PAINT * wear[:, None], colour)
    off_road = a > ASPHALT_EDGE
    colour[off_road] = verge_colour(a[off_road], z[off_road], textures)
    return colour
