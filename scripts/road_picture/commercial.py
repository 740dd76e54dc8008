"""Commercial vehicles: a place goes in, the meshes of a van or a truck with its wheels come out.

Local coordinates of a vehicle: x across (picture's right positive), y up from the ground, z back from the bumper.
"""

from __future__ import annotations

import numpy as np

from .fittings import cabin_view, lamp_colours, wheel
from .materials import BLACK_TRIM, CAB_PAINT, WHITE_PAINT
from .maths import Array, box_distance, polygon_distance, smooth_max, smooth_min
from .mesh import Part, Surface, implicit_part

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
