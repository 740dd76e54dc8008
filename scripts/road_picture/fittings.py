"""What vehicles share: places and sizes go in, wheels and number plates or the look of lamps and cabins come out.

Local coordinates of a vehicle: x across (picture's right positive), y up from the ground, z back from the bumper.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .materials import BLACK_TRIM, DRIVER_CLOTHES, DRIVER_SKIN, RUBBER, SEAT_FABRIC
from .maths import Array, blend, box_distance, smoothstep
from .mesh import Part, Surface, box, lathe, vertex_normals

WHEEL_RADIUS, WHEEL_WIDTH = 0.325, 0.215  # [m]
PLATE_TEXT = "MC 2014"
PLATE_SIZE = (0.52, 0.125)  # [m]


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
