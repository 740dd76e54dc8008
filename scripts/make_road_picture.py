"""Render the built-in reference picture: the road as a rear-facing camera on a truck's left side sees it.

The picture lies on a vertical plane ``PLANE_DISTANCE`` = 8200 mm behind the camera.  On it, X points to the right
as the driver looks at the mirror and Y points up.  It covers X = -6800 ... +2200 mm and Y = -5400 ... +5400 mm.  It is
stored as a rear-facing camera takes it, so the LEFT edge of the file is X = +2200 and its RIGHT edge is X = -6800;
the first row is the top.  A driver sees it flipped left to right in the mirror.

The camera is a pinhole with a shifted lens, ``CAMERA_HEIGHT`` = 2500 mm above a flat, straight road.  The vanishing
point of the road is X_v = +2200, Y_v = +3720, which is also the height of the horizon.  A world point at lateral
offset a (to the left of the camera), height g above the ground and distance Z behind the camera is seen at

    X = X_v - D * a / Z,        Y = Y_v - D * (h - g) / Z.

One solid yellow line is painted at a = h / 0.6 = 4166.67 mm.  Its centre is therefore exactly Y = 2400 + 0.6 * X on the
picture, and nothing yellow is drawn above it.  It is the line that distortion is measured on.

World coordinates in this script are metres in the order (a, g, Z): to the picture's right, up, away from the
camera.  Traffic drives towards the camera.  The truck that carries the camera is neither drawn nor casts a shadow.

Usage: ``python scripts/make_road_picture.py [OUT.jpg]``
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from PIL import Image, ImageDraw, ImageFont
from scipy.interpolate import PchipInterpolator

DEFAULT_OUTPUT = Path(__file__).resolve().parents[1] / "raytrace" / "scene" / "assets" / "road.jpg"

# --- picture plane [mm] -------------------------------------------------------------------------------------------
PLANE_DISTANCE = 8200.0
X_LEFT_EDGE, X_RIGHT_EDGE = 2200.0, -6800.0  # of the stored file
Y_TOP, Y_BOTTOM = 5400.0, -5400.0
X_VANISH, Y_VANISH = 2200.0, 3720.0
PIXEL_SIZE = 4.0
COLUMNS = round((X_LEFT_EDGE - X_RIGHT_EDGE) / PIXEL_SIZE)
ROWS = round((Y_TOP - Y_BOTTOM) / PIXEL_SIZE)
LINE_SLOPE = 0.6  # of the reference line on the plane
MIN_LINE_THICKNESS = 11.0  # vertical thickness of the reference line on the plane, at least

# --- road cross-section, lateral offsets a [m] --------------------------------------------------------------------
CAMERA_HEIGHT = 2.5
REFERENCE_LINE = CAMERA_HEIGHT / LINE_SLOPE
OWN_LANE_LINE = 0.67
DASHED_LINE = REFERENCE_LINE + 3.5
EDGE_LINE = 9.25
ASPHALT_EDGE = 9.62
GRAVEL_EDGE = 9.95
RAIL_OFFSET = 11.3
YELLOW_WIDTH = 0.17
WHITE_WIDTH = 0.14
DASH_LENGTH, DASH_PERIOD, DASH_START = 3.0, 6.0, 0.8
JOINT_PERIOD, JOINT_FIRST, JOINT_WIDTH = 4.0, 2.9, 0.030
ARROW_OFFSET, ARROW_TIP, ARROW_LENGTH = 2.42, 3.9, 4.2  # lane arrow: centre, nearest point, length
MANHOLE, MANHOLE_RADIUS = (2.95, 3.35), 0.33  # (a, Z) of its centre
PATCH_BOUNDS = (1.15, 3.55, 12.5, 17.0)  # repaired asphalt: a from, a to, Z from, Z to

COLUMN_OFFSET, COLUMN_DISTANCE, COLUMN_DIAMETER, COLUMN_HEIGHT = 10.1, 12.0, 0.44, 9.0

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

# --- albedos ------------------------------------------------------------------------------------------------------
YELLOW_PAINT = np.array([0.84, 0.48, 0.008])
WHITE_PAINT = np.array([0.74, 0.74, 0.72])
ASPHALT = np.array([0.150, 0.149, 0.150])
GRAVEL = np.array([0.25, 0.24, 0.225])
GRASS = np.array([0.070, 0.150, 0.028])
LEAF_DARK, LEAF_LIGHT = np.array([0.034, 0.090, 0.020]), np.array([0.085, 0.170, 0.042])
LEAF_SHADE = np.array([0.012, 0.030, 0.008])
CAST_IRON = np.array([0.060, 0.058, 0.056])
CONCRETE = np.array([0.33, 0.33, 0.325])
GALVANISED = np.array([0.40, 0.42, 0.44])
GREEN_PAINT, RED_PAINT = np.array([0.010, 0.205, 0.036]), np.array([0.400, 0.012, 0.040])
BLUE_PAINT, CAB_PAINT = np.array([0.020, 0.060, 0.210]), np.array([0.030, 0.085, 0.260])
RUBBER = np.array([0.018, 0.018, 0.019])
BLACK_TRIM = np.array([0.020, 0.020, 0.021])
# Behind glass, as light that reaches the windscreen:
SEAT_FABRIC = np.array([0.026, 0.026, 0.028])
DRIVER_CLOTHES = np.array([0.012, 0.014, 0.020])
DRIVER_SKIN = np.array([0.038, 0.026, 0.021])

# --- rendering ----------------------------------------------------------------------------------------------------
SUPERSAMPLING = 3  # samples per pixel and direction
BAND_ROWS = 45
OCCLUSION_RAYS = 48
OCCLUSION_RANGE = 2.5  # [m]
REFLECTION_RANGE = 2.0  # [m], beyond it reflections show sky, trees and road only
RAY_OFFSET = 2e-3  # [m], keeps secondary rays off the surface they start on
SEED = 2014
MAX_BYTES = 1_000_000
JPEG_QUALITIES = (93, 92, 91, 90, 89, 88, 86, 84, 82, 80)

PLATE_TEXT = "MC 2014"
PLATE_SIZE = (0.52, 0.125)  # [m]

Array = np.ndarray


# === small mathematics ============================================================================================


def normalised(vectors: Array) -> Array:
    """Unit vectors along the last axis."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def dot(first: Array, second: Array) -> Array:
    """Scalar product along the last axis."""
    return np.einsum("...i,...i->...", first, second)


def smoothstep(low: float, high: float, value: Array) -> Array:
    """0 below ``low``, 1 above ``high``, smooth in between."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def blend(first: Array, second: Array, weight: Array) -> Array:
    """Colours ``first`` to ``second`` by a weight per sample."""
    return first + (second - first) * weight[..., None]


def smooth_max(*values: Array, radius: float) -> Array:
    """Maximum of implicit functions with edges rounded over about ``radius``."""
    result = values[0]
    for value in values[1:]:
        overlap = np.maximum(radius - np.abs(result - value), 0.0)
        result = np.maximum(result, value) + overlap * overlap / (4.0 * radius)
    return result


def smooth_min(*values: Array, radius: float) -> Array:
    """Minimum of implicit functions with hollows filled over about ``radius``."""
    return -smooth_max(*(-value for value in values), radius=radius)


def box_distance(u: Array, v: Array, half_u: float, half_v: float, corner: float = 0.0) -> Array:
    """Signed distance to a rectangle with rounded corners about the origin."""
    du, dv = np.abs(u) - (half_u - corner), np.abs(v) - (half_v - corner)
    outside = np.hypot(np.maximum(du, 0.0), np.maximum(dv, 0.0))
    return outside + np.minimum(np.maximum(du, dv), 0.0) - corner


def polygon_distance(u: Array, v: Array, corners: list[tuple[float, float]]) -> Array:
    """Signed distance (exact inside) to a convex polygon given counter-clockwise."""
    distance = np.full(np.shape(u), -np.inf)
    for (u0, v0), (u1, v1) in zip(corners, corners[1:] + corners[:1], strict=True):
        length = np.hypot(u1 - u0, v1 - v0)
        distance = np.maximum(distance, ((u - u0) * (v1 - v0) - (v - v0) * (u1 - u0)) / length)
    return distance


class NoiseTile:
    """Periodic random texture with zero mean and unit deviation, made from a power-law spectrum."""

    def __init__(self, rng: np.random.Generator, slope: float, size: int = 512, low_cut: float = 2.0) -> None:
        """Make a tile of ``size`` squared texels; shapes repeat at least ``low_cut`` times across it."""
        frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :]) * size
        spectrum = np.where(frequency >= low_cut, np.maximum(frequency, 1.0) ** -slope, 0.0)
        values = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) * spectrum)
        self.size = size
        self.values = (values / values.std()).astype(np.float32)

    def __call__(self, u: Array, v: Array) -> Array:
        """Bilinear value at texel coordinates."""
        u0, v0 = np.floor(u), np.floor(v)
        fu, fv = (u - u0).astype(np.float32), (v - v0).astype(np.float32)
        i0, j0 = u0.astype(np.int64) % self.size, v0.astype(np.int64) % self.size
        i1, j1 = (i0 + 1) % self.size, (j0 + 1) % self.size
        near = self.values[i0, j0] * (1 - fv) + self.values[i0, j1] * fv
        far = self.values[i1, j0] * (1 - fv) + self.values[i1, j1] * fv
        return near * (1 - fu) + far * fu

    def nearest(self, u: Array, v: Array) -> Array:
        """Value of the nearest texel, for grain that supersampling averages anyway."""
        return self.values[np.rint(u).astype(np.int64) % self.size, np.rint(v).astype(np.int64) % self.size]


# === meshes =======================================================================================================


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


# === cars =========================================================================================================
# Local coordinates of a vehicle: x across (picture's right positive), y up from the ground, z back from the bumper.

CAR_LENGTH, CAR_WIDTH, CAR_HEIGHT = 4.35, 1.80, 1.46
WHEEL_RADIUS, WHEEL_WIDTH, WHEEL_TRACK = 0.325, 0.215, 0.775
FRONT_AXLE, REAR_AXLE = 0.86, 3.48
ARCH_RADIUS = 0.375
BONNET_LINE = PchipInterpolator(
    [-0.5, 0.0, 0.25, 0.6, 1.1, 1.6, 3.4, 4.2, 5.0], [0.62, 0.70, 0.77, 0.86, 0.945, 0.975, 1.00, 0.99, 0.95]
)


@dataclass
class CarFields:
    """The implicit half-spaces a car body is cut from (all negative inside), kept apart to place the trim by."""

    front: Array
    deck: Array
    side: Array
    screen: Array
    roof: Array
    cabin_side: Array
    back_screen: Array
    arch: Array
    body: Array
    cabin: Array


def car_fields(points: Array) -> CarFields:
    """Evaluate the half-spaces and their rounded combinations for a family car."""
    x, y, z = np.abs(points[..., 0]), points[..., 1], points[..., 2]
    wheel = np.minimum(np.hypot(y - WHEEL_RADIUS, z - FRONT_AXLE), np.hypot(y - WHEEL_RADIUS, z - REAR_AXLE))
    flare = 0.022 * np.exp(-(((wheel - ARCH_RADIUS) / 0.06) ** 2))
    crease = 0.012 * np.tanh((y - 0.76) / 0.02) * smoothstep(0.7, 1.3, z)
    taper = 0.10 * np.clip((1.0 - z) / 1.0, 0, 2) ** 2 + 0.08 * np.clip((z - 3.5) / 0.85, 0, 2) ** 2
    half_width = 0.5 * CAR_WIDTH - 0.02 - 0.17 * (y - 0.62) ** 2 - crease - taper + flare
    side = x - half_width
    nose = 0.07 * (x / 0.9) ** 2 + 0.20 * (x / 0.9) ** 5 + 1.3 * np.maximum(y - 0.50, 0) ** 2
    nose = nose + 1.2 * np.maximum(0.34 - y, 0) ** 2 + 0.014 * np.tanh((y - 0.53) / 0.012)
    nose = nose - 0.012 * np.exp(-(((y - 0.235) / 0.03) ** 2))
    front = nose - z
    power_bulge = 0.014 * np.exp(-(((x - 0.48) / 0.10) ** 2)) * smoothstep(0.15, 0.5, z)
    deck = y - BONNET_LINE(z) + 0.085 * (x / 0.85) ** 2 - power_bulge
    rear = z - (CAR_LENGTH - 0.06 * (x / 0.9) ** 2 - 0.15 * (x / 0.9) ** 6 - 0.10 * np.maximum(y - 0.5, 0))
    body = smooth_max(smooth_max(front, side, radius=0.16), smooth_max(deck, rear, 0.19 - y, radius=0.10), radius=0.11)

    bowed = 0.15 * (x / 0.75) ** 2
    screen = (1.02 + bowed + 1.65 * (y - 0.93) + 0.25 * (y - 0.93) ** 2 - z) / 1.95
    roof = y - (CAR_HEIGHT - 0.055 * (x / 0.6) ** 2 - 0.040 * ((z - 2.3) / 1.0) ** 2)
    back_screen = (z - (4.12 - bowed - 0.9 * (y - 0.95) - 0.6 * (y - 0.95) ** 2)) / 1.4
    cabin_side = x - (0.80 - 0.30 * (y - 0.95) - 0.14 * (y - 0.95) ** 2 - 0.05 * ((z - 2.4) / 1.3) ** 2)
    cabin = smooth_max(smooth_max(screen, back_screen, cabin_side, radius=0.07), roof, 0.6 - y, radius=0.09)
    arch = smooth_max(wheel - ARCH_RADIUS, 0.56 - x, radius=0.02)
    return CarFields(front, deck, side, screen, roof, cabin_side, back_screen, arch, body, cabin)


def car_mirrors(points: Array) -> Array:
    """Implicit door mirrors with their arms."""
    x, y, z = np.abs(points[..., 0]) - 0.985, points[..., 1] - 1.02, points[..., 2] - 1.50
    shell = np.sqrt((x / 0.125) ** 2 + (y / 0.085) ** 2 + (z / 0.09) ** 2)
    arm = np.sqrt((np.maximum(np.abs(x + 0.12) - 0.07, 0)) ** 2 + (y + 0.04) ** 2 + z**2) - 0.03
    return smooth_min((shell - 1.0) * 0.085, arm, radius=0.03)


def car_shape(points: Array) -> Array:
    """Implicit car without its wheels."""
    fields = car_fields(points)
    shell = smooth_min(fields.body, fields.cabin, radius=0.045)
    shell = smooth_max(shell, -fields.arch, radius=0.02)
    return np.minimum(shell, car_mirrors(points))


def cabin_view(points: Array, view: Array, seat_plane: float) -> Array:
    """Light (n, 3) that comes through the windscreen: seats, head rests and a driver before a dark cabin."""
    along = (seat_plane - points[:, 2]) / np.maximum(view[:, 2], 0.05)
    x, y = points[:, 0] + along * view[:, 0], points[:, 1] + along * view[:, 1]
    seat_x = np.abs(x) - 0.37
    seat = np.minimum(
        box_distance(seat_x, y - 0.78, 0.23, 0.30, 0.16), box_distance(seat_x, y - 1.17, 0.12, 0.085, 0.06)
    )
    light = blend(np.broadcast_to(BLACK_TRIM * 0.4, points.shape), SEAT_FABRIC, smoothstep(0.015, -0.015, seat))
    head = np.hypot((x - 0.36) / 0.078, (y - 1.19) / 0.108) - 1.0
    torso = np.hypot((x - 0.36) / 0.25, np.maximum(y - 0.80, 0) / 0.25) - 1.0
    light = blend(light, DRIVER_CLOTHES, smoothstep(0.06, -0.06, torso))
    return blend(light, DRIVER_SKIN, smoothstep(0.06, -0.06, head))


def lamp_colours(u: Array, v: Array) -> Array:
    """Look of a headlight: dark housing, two lens lamps in bright rings, a light strip below.  u, v about it [m]."""
    colour = np.broadcast_to(np.array([0.10, 0.105, 0.115]), (*u.shape, 3))
    for centre, size in ((-0.080, 1.0), (0.055, 1.15)):
        radius = np.hypot(u - centre, v - 0.006) / size
        colour = blend(colour, np.array([0.62, 0.64, 0.68]), smoothstep(0.044, 0.042, radius))
        colour = blend(colour, np.array([0.16, 0.18, 0.22]), smoothstep(0.035, 0.033, radius))
        shine = np.hypot(u - centre + 0.008, v - 0.018) / size
        colour = blend(colour, np.array([0.95, 0.97, 1.0]), smoothstep(0.016, 0.008, shine))
    strip = np.abs(v + 0.045 - 0.16 * np.maximum(u - 0.02, 0)) - 0.006
    return blend(colour, np.array([1.1, 1.1, 1.12]), smoothstep(0.001, -0.001, strip))


def painted(paint: Array) -> Shader:
    """Shader of a car body: paint, windows, lamps, grille, air intakes, gaps and sills."""

    def shade(points: Array, view: Array) -> Surface:
        fields = car_fields(points)
        x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
        albedo = np.tile(paint, (len(points), 1))
        gloss = np.full(len(points), 0.04)
        inner = np.zeros_like(albedo)
        mirror = car_mirrors(points) < 0.01
        facing = (fields.front > -0.10) & (fields.deck < 0.02) & ~mirror & (z < 0.62)

        def paint_over(where: Array, colour: Array, shine: float) -> None:
            albedo[where] = colour[where] if colour.ndim == 2 else colour
            gloss[where] = shine

        # Air intakes, grille with slats, fog lamps.
        trim = np.broadcast_to(BLACK_TRIM, albedo.shape)
        intake = polygon_distance(x, y, [(-1.0, 0.225), (0.46, 0.225), (0.52, 0.335), (-1.0, 0.335)])
        paint_over(facing & (intake < 0), trim * (0.5 + 0.9 * (np.sin(y * 2 * np.pi / 0.028) > 0.2))[:, None], 0.02)
        pocket = polygon_distance(x, y, [(0.58, 0.25), (0.76, 0.28), (0.76, 0.36), (0.61, 0.37)])
        paint_over(facing & (pocket < 0), trim, 0.02)
        fog = np.hypot(x - 0.675, y - 0.315)
        paint_over(facing & (fog < 0.036), np.array([0.60, 0.62, 0.66]), 0.08)
        grille = polygon_distance(x, y, [(-1.0, 0.555), (0.34, 0.555), (0.40, 0.645), (-1.0, 0.645)])
        paint_over(facing & (grille < 0.012), np.array([0.55, 0.56, 0.58]), 0.30)
        paint_over(facing & (grille < 0), trim * (0.5 + 1.6 * (np.sin(y * 2 * np.pi / 0.030) > 0.3))[:, None], 0.03)

        # Headlights.
        lamp = polygon_distance(x, y, [(0.455, 0.545), (0.74, 0.560), (0.80, 0.665), (0.70, 0.680), (0.455, 0.632)])
        paint_over(facing & (lamp < 0.008), trim, 0.04)
        paint_over(facing & (lamp < 0), lamp_colours(x - 0.625, y - 0.602 - 0.10 * (x - 0.625)), 0.06)

        # Gaps: bonnet, doors, sills; black lower edge.
        bonnet_gap = (np.abs(fields.front + 0.115) < 0.005) & (x < 0.60) & (y > 0.66) & (z < 1.0)
        wing_gap = (np.abs(x - 0.70 - 0.06 * (z - 0.6)) < 0.004) & (fields.deck > -0.05) & (z > 0.30) & (z < 1.15)
        side = (fields.side > -0.03) & (y < 0.97)
        doors = (y > 0.27) & ((np.abs(z - 1.36) < 0.005) | (np.abs(z - 2.42) < 0.005) | (np.abs(z - 3.22) < 0.005))
        handle = box_distance(np.minimum(np.abs(z - 2.22), np.abs(z - 3.05)), y - 0.84, 0.09, 0.016, 0.012) < 0
        paint_over((bonnet_gap | wing_gap | (side & doors)) & ~mirror, trim, 0.0)
        paint_over(side & handle & ~mirror, paint * 0.55, 0.08)
        paint_over((y < 0.225) | (fields.arch < 0.006) & (x < 0.845), trim * 0.7, 0.0)

        # Windows with a black surround.
        cabin = (fields.cabin < 0.02) & (fields.cabin < fields.body - 0.01) & ~mirror
        screen = np.maximum(np.maximum(fields.cabin_side + 0.055, fields.roof + 0.045), -(fields.deck - 0.005))
        on_screen = cabin & (fields.screen > -0.035)
        panes = np.maximum(np.maximum(fields.roof + 0.075, fields.screen + 0.075), fields.back_screen + 0.10)
        panes = np.maximum(panes, 0.985 + 0.012 * (z - 1.6) - y)
        on_side = cabin & (fields.cabin_side > -0.025) & ~(on_screen & (screen < 0))
        paint_over(on_screen & (screen < 0.0), trim * 0.5, 0.05)
        paint_over(on_side & (panes < 0.022) & (y > 0.965), trim, 0.04)
        paint_over(on_side & (panes < 0.0) & (np.abs(z - 2.42) > 0.045), trim * 0.6, 0.06)
        clear = on_screen & (screen < -0.020)
        inner[clear] = cabin_view(points[clear], view[clear], 2.1)
        wiper = np.abs(y - 0.985 - 0.05 * np.sin(2.2 * (points[:, 0] + 0.9)) - 0.03 * (points[:, 0] > 0.05)) < 0.007
        inner[clear & wiper] = 0.01
        return Surface(albedo, gloss, inner)

    return shade


def wheel_surface(points: Array, _view: Array) -> Surface:
    """Tyre with a five-spoke light-alloy rim; local x = 0 is the wheel's centre plane."""
    radius, angle = np.hypot(points[:, 1], points[:, 2]), np.arctan2(points[:, 1], points[:, 2])
    spoke = np.abs((angle * 5 / (2 * np.pi) + 0.3) % 1.0 - 0.5) * radius * 2 * np.pi / 5 < 0.028 + 0.06 * radius
    rim = (radius < 0.225) & (spoke | (radius > 0.198) | (radius < 0.06))
    albedo = np.where(rim[:, None], np.array([0.46, 0.47, 0.49]), RUBBER * np.where(radius < 0.225, 0.5, 1.0)[:, None])
    return Surface(albedo, np.where(rim, 0.10, 0.0))


def wheel(origin: Array, scale: float, width: float = WHEEL_WIDTH) -> Part:
    """One wheel about an axle along x."""
    half, r = 0.5 * width, WHEEL_RADIUS
    section = [(0.02, 0.62), (0.19, 0.55), (0.222, 0.80), (0.235, 0.94), (r - 0.05, 1.0), (r - 0.018, 0.93), (r, 0.72)]
    profile = [(radius, -along * half) for radius, along in section]
    profile += [(radius, along * half) for radius, along in reversed(section)]
    vertices, faces = lathe(profile, 0, 64)
    normals = vertex_normals(vertices, faces)
    return Part(origin + vertices * scale, faces, wheel_surface, normals, origin, np.full(3, scale))


def car(centre: float, distance: float, paint: Array, step: float, scale: tuple[float, float, float]) -> list[Part]:
    """A car whose front bumper is ``distance`` metres behind the camera; ``scale`` is its (width, height, length)."""
    origin, factor = np.array([centre, 0.0, distance]), np.array(scale)
    bounds = (np.array([-1.20, 0.10, -0.10]), np.array([1.20, 1.55, CAR_LENGTH + 0.1]))
    parts = [implicit_part(car_shape, bounds, step, origin, factor, painted(paint))]
    for side in (-1.0, 1.0):
        for axle in (FRONT_AXLE, REAR_AXLE):
            hub = origin + np.array([side * WHEEL_TRACK * factor[0], WHEEL_RADIUS * factor[1], axle * factor[2]])
            parts.append(wheel(hub, factor[1]))
    return parts


def plate(centre: float, distance: float, height: float) -> Part:
    """Number plate that stands ``distance`` metres behind the camera."""
    width, tall = PLATE_SIZE
    pixels = 2000  # per metre
    image = Image.new("L", (round(width * pixels), round(tall * pixels)), 255)
    pen = ImageDraw.Draw(image)
    font = ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf", 236)
    left, top, right, bottom = font.getbbox(PLATE_TEXT)
    text = Image.new("L", (int(right - left), int(bottom - top)), 255)
    ImageDraw.Draw(text).text((-left, -top), PLATE_TEXT, fill=0, font=font)
    text = text.resize((round(0.87 * image.width), round(0.68 * image.height)), Image.Resampling.BOX)
    image.paste(text, ((image.width - text.width) // 2, (image.height - text.height) // 2))
    pen.rounded_rectangle((5, 5, image.width - 6, image.height - 6), radius=18, outline=0, width=8)
    pattern = np.asarray(image, dtype=np.float32) / 255.0

    def shade(points: Array, _view: Array) -> Surface:
        column = np.clip(((points[:, 0] + 0.5 * width) * pixels).astype(int), 0, image.width - 1)
        row = np.clip(((0.5 * tall - points[:, 1]) * pixels).astype(int), 0, image.height - 1)
        light = np.where(points[:, 2] < -0.004, 0.02 + 0.86 * pattern[row, column], 0.02)
        return Surface(light[:, None] * np.ones(3), np.zeros(len(points)))

    origin = np.array([centre, height, distance])
    vertices, faces = box((-0.5 * width, -0.5 * tall, -0.008), (0.5 * width, 0.5 * tall, 0.05))
    return Part(origin + vertices, faces, shade, None, origin)


# === commercial vehicles ==========================================================================================

VAN_LENGTH, VAN_WIDTH, VAN_HEIGHT = 5.1, 1.98, 2.30
CAB_WIDTH, CAB_HEIGHT, CAB_LENGTH = 2.46, 3.35, 2.1
TRAILER_HEIGHT, TRAILER_FLOOR, TRAILER_START, TRAILER_END = 3.85, 1.15, 2.6, 14.5


def van_screen(points: Array) -> Array:
    """Implicit windscreen plane of the van."""
    x, y, z = np.abs(points[..., 0]), points[..., 1], points[..., 2]
    return (0.72 + 0.10 * (x / 0.9) ** 2 + 0.95 * (y - 1.20) + 0.25 * (y - 1.2) ** 2 - z) / 1.38


def van_shape(points: Array) -> Array:
    """Implicit panel van without its wheels."""
    x, y, z = np.abs(points[..., 0]), points[..., 1], points[..., 2]
    taper = 0.08 * np.clip(1.0 - z, 0, 2) ** 2
    side = x - (0.5 * VAN_WIDTH - 0.05 * (y - 0.9) ** 2 - taper)
    nose = 0.06 * x**2 + 0.16 * x**6 + 0.7 * np.maximum(y - 0.62, 0) ** 2 - z
    bonnet = y - (0.98 + 0.30 * np.clip(z, 0, 1.2) - 0.08 * x**2)
    load = smooth_max(van_screen(points), y - (VAN_HEIGHT - 0.06 * x**2), radius=0.12)
    upper = smooth_max(smooth_min(bonnet, load, radius=0.05), z - VAN_LENGTH, side, nose, radius=0.12)
    wheels = np.minimum(np.hypot(y - 0.34, z - 0.95), np.hypot(y - 0.34, z - 4.1))
    arch = np.maximum(wheels - 0.40, 0.6 - x)
    mirror = np.sqrt(((x - 1.10) / 0.13) ** 2 + ((y - 1.42) / 0.19) ** 2 + ((z - 0.95) / 0.08) ** 2) - 1.0
    return np.minimum(smooth_max(upper, 0.22 - y, -arch, radius=0.05), 0.08 * mirror)


def van_surface(points: Array, view: Array) -> Surface:
    """White paint, dark glass, grey bumper, lamps and grille."""
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    albedo, gloss = np.tile(WHITE_PAINT, (len(points), 1)), np.full(len(points), 0.05)
    inner = np.zeros_like(albedo)
    glass = (van_screen(points) > -0.03) & (y > 1.28) & (y < 2.06) & (x < 0.88 - 0.06 * (y - 1.2))
    window = (x > 0.86) & (z > 1.05 + 0.75 * (y - 1.25)) & (z < 1.95) & (y > 1.27) & (y < 1.88)
    front = z < 0.5
    bumper = (y < 0.52) & (front | (y < 0.36))
    grille = front & (box_distance(x, y - 0.75, 0.40, 0.07, 0.03) < 0)
    lamp = front & (polygon_distance(x, y, [(0.52, 0.68), (0.86, 0.72), (0.88, 0.96), (0.66, 0.92)]) < 0)
    mirror = x > 1.0
    for where, colour in (
        (bumper, BLACK_TRIM * 3),
        (grille, BLACK_TRIM),
        (glass | window, BLACK_TRIM * 0.6),
        (mirror, BLACK_TRIM),
    ):
        albedo[where] = colour
    albedo[lamp] = lamp_colours(x - 0.72, y - 0.82)[lamp]
    inner[glass] = cabin_view(points[glass] - np.array([0.0, 0.45, 0.0]), view[glass], 1.7)
    return Surface(albedo, gloss, inner)


def van(centre: float, distance: float) -> list[Part]:
    """A white panel van."""
    origin = np.array([centre, 0.0, distance])
    bounds = (np.array([-1.3, 0.15, -0.1]), np.array([1.3, 2.4, VAN_LENGTH + 0.1]))
    parts = [implicit_part(van_shape, bounds, 0.04, origin, np.ones(3), van_surface)]
    hubs = [(side * 0.86, 0.34, axle) for side in (-1, 1) for axle in (0.95, 4.1)]
    return parts + [wheel(origin + np.array(hub), 1.05) for hub in hubs]


def truck_shape(points: Array) -> Array:
    """Implicit cab-over tractor with a box trailer."""
    x, y, z = np.abs(points[..., 0]), points[..., 1], points[..., 2]
    lean = 0.10 * np.maximum(y - 1.8, 0) ** 2 + 0.05 * x**4
    cab = smooth_max(x - 0.5 * CAB_WIDTH, lean - z, z - CAB_LENGTH, y - CAB_HEIGHT, 0.30 - y, radius=0.22)
    arch = np.maximum(np.hypot(y - 0.52, z - 1.25) - 0.62, 0.7 - x)
    cab = smooth_max(cab, -arch, radius=0.04)
    trailer = smooth_max(x - 1.27, TRAILER_START - z, z - TRAILER_END, radius=0.05)
    trailer = smooth_max(trailer, y - TRAILER_HEIGHT, TRAILER_FLOOR - y, radius=0.05)
    skirt = np.maximum(np.maximum(x - 1.2, 0.45 - y), np.maximum(y - 1.2, np.abs(z - 7.0) - 2.2))
    mirror = box_distance(x - 1.42, y - 2.15, 0.10, 0.28, 0.05)
    mirror = np.maximum(mirror, np.abs(z - 0.45) - 0.08)
    return np.minimum(np.minimum(cab, trailer), np.minimum(skirt, mirror))


def truck_surface(points: Array, view: Array) -> Surface:
    """Blue cab with screen, visor, grille and lamps; light grey trailer."""
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    albedo, gloss = np.tile(CAB_PAINT, (len(points), 1)), np.full(len(points), 0.05)
    inner = np.zeros_like(albedo)
    front = z < 0.45
    glass = front & (box_distance(x, y - 2.36, 1.06, 0.40, 0.10) < 0)
    window = (x > 1.15) & (np.abs(y - 2.30) < 0.36) & (z > 0.35) & (z < 1.25)
    visor = front & (np.abs(y - 2.84) < 0.075) & (x < 1.12)
    grille = front & (box_distance(x, y - 1.33, 0.72, 0.40, 0.06) < 0)
    slats = np.sin(y * 2 * np.pi / 0.16) > -0.2
    bumper = (y < 0.86) & (z < CAB_LENGTH)
    lamp = front & (box_distance(x - 0.93, y - 0.66, 0.22, 0.10, 0.04) < 0)
    trailer = (z > TRAILER_START - 0.1) & (y > TRAILER_FLOOR - 0.05)
    chassis = ((z > CAB_LENGTH - 0.05) & ~trailer) | (x > 1.26) & (z < 0.6)
    for where, colour in (
        (trailer, np.array([0.60, 0.61, 0.62])),
        (chassis, BLACK_TRIM * 2),
        (bumper, np.array([0.10, 0.11, 0.13])),
        (grille, BLACK_TRIM),
        (grille & slats, BLACK_TRIM * 4),
        (visor, BLACK_TRIM),
        (glass | window, BLACK_TRIM * 0.6),
    ):
        albedo[where] = colour
    albedo[lamp] = WHITE_PAINT
    inner[glass] = cabin_view(points[glass] - np.array([0.0, 1.30, 0.0]), view[glass], 1.3)
    return Surface(albedo, gloss, inner)


def truck(centre: float, distance: float) -> list[Part]:
    """A tractor with a box trailer."""
    origin = np.array([centre, 0.0, distance])
    bounds = (np.array([-1.65, 0.2, -0.15]), np.array([1.65, 4.0, TRAILER_END + 0.15]))
    parts = [implicit_part(truck_shape, bounds, 0.06, origin, np.ones(3), truck_surface)]
    hubs = [(side * 1.02, 0.52, axle) for side in (-1, 1) for axle in (1.25, 3.9, 11.0, 12.3)]
    return parts + [wheel(origin + np.array(hub), 1.6, 0.19) for hub in hubs]


# === roadside =====================================================================================================


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


# === ground and sky ===============================================================================================


@dataclass
class Textures:
    """Random textures of the scene."""

    grain: NoiseTile  # no correlation from texel to texel
    patchy: NoiseTile  # blotches of many sizes
    cloudy: NoiseTile  # smooth, dominated by large shapes


def make_textures(rng: np.random.Generator) -> Textures:
    """All textures from one random stream."""
    return Textures(NoiseTile(rng, 0.15), NoiseTile(rng, 1.1), NoiseTile(rng, 1.75, 1024, 4.0))


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


# === rendering ====================================================================================================


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
        side = normalised(np.cross(SUN_DIRECTION, np.array([0.0, 1.0, 0.0])))
        up = np.cross(side, SUN_DIRECTION)
        return 1.0 - self.blocked(points, SUN_DIRECTION + SUN_SPREAD * (offset[0] * side + offset[1] * up))

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
        ambient = blend(GROUND_BOUNCE, SKY_AMBIENT, 0.5 + 0.5 * normals[:, 1]) * openness[:, None]
        colour = albedo * (SUN_COLOUR * sun[:, None] + ambient)

        shiny = np.flatnonzero(gloss > 0)
        facing = np.clip(-dot(normals[shiny], view[shiny]), 0, 1)
        fresnel = (gloss[shiny] + (1 - gloss[shiny]) * 0.8 * (1 - facing) ** 5)[:, None]
        ray = normalised(view[shiny] + 2 * facing[:, None] * normals[shiny])
        mirrored = reflected_colour(ray, self.blocked(start[shiny], ray, REFLECTION_RANGE), self.textures)
        glint = 14.0 * np.maximum(ray @ SUN_DIRECTION, 0) ** 700 + 0.8 * np.maximum(ray @ SUN_DIRECTION, 0) ** 40
        mirrored += SUN_COLOUR * (glint * (sun[shiny] > 0))[:, None]
        colour[shiny] = (colour[shiny] + inner[shiny]) * (1 - fresnel) + mirrored * fresnel
        return colour

    def trace(self, x: Array, y: Array, openness: Array, offset: tuple[float, float]) -> Array:
        """Linear colours seen at plane coordinates [mm]; ``openness`` is that of the ground there."""
        direction = np.stack(
            [(X_VANISH - x) / PLANE_DISTANCE, (y - Y_VANISH) / PLANE_DISTANCE, np.ones_like(x)], axis=1
        )
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
        colour[solid] = blend(
            colour[solid], HORIZON_COLOUR * 0.9, 1.0 - np.exp(-np.minimum(depth[solid], HAZE_LIMIT) / HAZE_DISTANCE)
        )
        return colour

    def render_band(self, first_row: int, rows: int) -> Array:
        """Linear pixels (rows, COLUMNS, 3): the mean of a regular grid of samples in every pixel."""
        row, column_index = np.meshgrid(np.arange(first_row, first_row + rows), np.arange(COLUMNS), indexing="ij")
        x = X_LEFT_EDGE - (column_index.ravel() + 0.5) * PIXEL_SIZE
        y = Y_TOP - (row.ravel() + 0.5) * PIXEL_SIZE
        openness = np.ones(len(x))
        below = y < Y_VANISH
        z = CAMERA_HEIGHT * PLANE_DISTANCE / (Y_VANISH - y[below])
        openness[below] = self.ground_openness((X_VANISH - x[below]) / PLANE_DISTANCE * z, z)
        total = np.zeros((len(x), 3))
        for dx, dy, offset in sample_pattern():
            total += displayable(self.trace(x + dx * PIXEL_SIZE, y + dy * PIXEL_SIZE, openness, offset))
        return (total / SUPERSAMPLING**2).reshape(rows, COLUMNS, 3)


def cosine_directions(count: int) -> Array:
    """Evenly spread directions about the third axis, denser towards it (Vogel's spiral on the disc)."""
    radius = np.sqrt((np.arange(count) + 0.5) / count)
    angle = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)


def sample_pattern() -> Iterator[tuple[float, float, tuple[float, float]]]:
    """Sample offsets in a pixel [pixels], each with its own point of the sun's disc."""
    disc = cosine_directions(SUPERSAMPLING**2)[:, :2]
    for number in range(SUPERSAMPLING**2):
        row, column_index = divmod(number, SUPERSAMPLING)
        dx, dy = ((i + 0.5) / SUPERSAMPLING - 0.5 for i in (column_index, row))
        yield dx, dy, (float(disc[number, 0]), float(disc[number, 1]))


def displayable(colour: Array) -> Array:
    """Roll highlights off towards 1; everything darker stays as it is."""
    knee = 0.75
    return np.where(colour < knee, colour, knee + (1 - knee) * np.tanh((colour - knee) / (1 - knee)))


def encoded(linear: Array) -> Array:
    """8-bit sRGB."""
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * np.clip(curve, 0, 1)).astype(np.uint8)


def build_scene() -> Scene:
    """The road's furniture and traffic."""
    rng = np.random.default_rng(SEED)
    textures = make_textures(rng)
    beyond, between = REFERENCE_LINE + 1.75, OWN_LANE_LINE + 1.75  # lane centres, beyond and before the reference line
    parts = [
        *car(beyond, 8.6, GREEN_PAINT, 0.012, (1.0, 1.0, 1.0)),
        plate(beyond, 8.578, 0.44),
        *car(beyond - 0.1, 23.0, RED_PAINT, 0.03, (1.03, 1.10, 1.02)),
        *van(beyond, 38.0),
        *truck(beyond + 0.1, 58.0),
        # So far back and so close to its lane's edge that it hides the reference line only at X > 1950.
        *car(between - 0.55, 96.0, BLUE_PAINT, 0.05, (1.0, 1.0, 1.0)),
        column(textures.patchy),
        guard_rail(),
        *forest(rng, textures.patchy),
    ]
    return Scene(parts, textures)


def save(pixels: Array, path: Path) -> None:
    """Write the JPEG at the best quality that stays below MAX_BYTES."""
    image = Image.fromarray(pixels)
    for quality in JPEG_QUALITIES:
        buffer = BytesIO()
        image.save(buffer, "JPEG", quality=quality, subsampling=0, optimize=True)
        if len(buffer.getvalue()) < MAX_BYTES:
            path.write_bytes(buffer.getvalue())
            return
    raise RuntimeError(f"the picture takes more than {MAX_BYTES} bytes at every quality tried")


def main(arguments: list[str]) -> None:
    """Render the picture to the path given, or to the package's asset."""
    path = Path(arguments[0]) if arguments else DEFAULT_OUTPUT
    scene = build_scene()
    bands = [scene.render_band(row, min(BAND_ROWS, ROWS - row)) for row in range(0, ROWS, BAND_ROWS)]
    save(encoded(np.concatenate(bands)), path)


if __name__ == "__main__":
    main(sys.argv[1:])
