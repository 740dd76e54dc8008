"""Family cars: a place, a paint and a scale go in, the meshes of a car with its wheels come out.

Local coordinates of a vehicle: x across (picture's right positive), y up from the ground, z back from the bumper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from .fittings import WHEEL_RADIUS, cabin_view, lamp_colours, wheel
from .materials import BLACK_TRIM
from .maths import Array, box_distance, polygon_distance, smooth_max, smooth_min, smoothstep
from .mesh import Part, Shader, Surface, implicit_part

CAR_LENGTH, CAR_WIDTH, CAR_HEIGHT = 4.35, 1.80, 1.46
WHEEL_TRACK = 0.775
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
