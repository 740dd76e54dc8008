"""Characters in, a number plate's picture and its patches out."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .tessellate import Patch

CHARACTERS = "MC 2014"
WIDTH, HEIGHT = 520.0, 112.0  # mm, ISO 7591's long plate
DOTS = 448, 96  # of the picture
INK, GROUND = (18, 18, 20), (236, 236, 230)


def picture() -> bytes:
    """The plate as a PNG file: a dark border and CHARACTERS as high as fit."""
    plate = Image.new("RGB", DOTS, GROUND)
    draw = ImageDraw.Draw(plate)
    draw.rounded_rectangle((2, 2, DOTS[0] - 3, DOTS[1] - 3), radius=9, outline=INK, width=4)
    font = ImageFont.load_default(size=86)
    left, top, right, bottom = draw.textbbox((0, 0), CHARACTERS, font=font, stroke_width=2)
    place = 0.5 * (DOTS[0] - left - right), 0.5 * (DOTS[1] - top - bottom)
    draw.text(place, CHARACTERS, INK, font=font, stroke_width=2, stroke_fill=INK)
    file = io.BytesIO()
    plate.save(file, "PNG", optimize=True)
    return file.getvalue()


def plate(x: float, z: float, rearward: bool, lean: float = 0.0) -> list[Patch]:
    """A plate whose middle is at (x, 0, z) and that faces forward or rearward, its top leaning back by an angle [°]."""
    sign = 1.0 if rearward else -1.0
    across = np.array([0.0, sign, 0.0])  # to the right as its reader sees it
    up = np.array([-sign * np.sin(np.radians(lean)), 0.0, np.cos(np.radians(lean))])
    normal = np.cross(across, up)
    corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    face = np.array([x, 0.0, z]) + corners[:, :1] * WIDTH * across + corners[:, 1:] * HEIGHT * up
    two = np.array([(0, 1, 2), (0, 2, 3)])
    patches = [Patch("plate", face, np.tile(normal, (4, 1)), two, np.column_stack([corners[:, 0] + 0.5, 0.5 - corners[:, 1]]))]
    # The carrier behind it, a little larger.
    big = face - normal + 14.0 * (corners[:, :1] * across + corners[:, 1:] * up)
    patches.append(Patch("trim", big, np.tile(normal, (4, 1)), two))
    for k in range(4):
        a, b = big[k], big[(k + 1) % 4]
        side = np.array([a, a - 40.0 * normal, b - 40.0 * normal, b])
        out = np.cross(side[1] - side[0], side[2] - side[0])
        patches.append(Patch("trim", side, np.tile(out / np.linalg.norm(out), (4, 1)), two))
    return patches
