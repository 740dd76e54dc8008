"""Mark the lane's image in the driver's picture, with the tangent that it is judged by."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.interpolate import CubicSpline

from mirror_studio.report.tables import Table
from mirror_studio.report.typeface import typeface
from raytrace.measures.lane import lane_height
from raytrace.measures.straight_lane import StraightLane
from raytrace.scene.reference import Picture
from raytrace.surfaces.base import OpticalSurface
from raytrace.viewing.camera import Frame

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

COLUMNS = 25  # at which the lane is traced; its image is smooth between them
DRAWN = 241  # points of a drawn line
CURVE, TANGENT = (0, 90, 181), (220, 50, 32)  # apart for the colour-blind, and neither on the road
SUPERSAMPLING = 2
# Wide enough for half a screen at twice its pixels; the picture itself lies beside the report without loss.
PICTURE_PX = 1280, 4000


@dataclass(frozen=True, slots=True, eq=False)
class LaneImage:
    """The lane's image on the mirror: heights y (n,) over x (n,), right to left, and those of the tangent at the right edge."""

    x: Array
    y: Array
    tangent: Array

    def table(self) -> Table:
        """A row a column of the mirror."""
        return Table("lane", {"x_mm": self.x, "lane_y_mm": self.y, "tangent_y_mm": self.tangent})


def lane_image(surface: OpticalSurface, eye: Array, lane: StraightLane, box: Box,
               straightness_percent: float | None) -> LaneImage | None:
    """Traced in COLUMNS columns between the box's edges; None where `lane_straightness` found none.

    straightness_percent : as `lane_straightness` gives it. The tangent rises by |Δy_line| = |Δy_curve|/(1 + s/100), which is
    how s was defined, to the side to which the image leaves the right edge.
    """
    if straightness_percent is None:
        return None
    x = np.linspace(box[1], box[0], COLUMNS)
    found = [lane_height(surface, eye, lane, float(at), surface.domain[2], surface.domain[3]) for at in x]
    if any(height is None for height in found):
        return None
    y = np.array(found, dtype=np.float64)
    rise = abs(y[-1] - y[0]) / (1.0 + 0.01 * straightness_percent) * np.sign(y[1] - y[0])
    return LaneImage(x, y, y[0] + rise * (x[0] - x) / (x[0] - x[-1]))


def marked_view(seen: Picture, frame: Frame, image: LaneImage | None, surface: OpticalSurface, eye: Array) -> bytes:
    """The driver's view as JPEG, at most PICTURE_PX, with the lane's image and its tangent drawn into it."""
    picture = Image.fromarray(seen)
    smaller = min(1.0, PICTURE_PX[0] / picture.width, PICTURE_PX[1] / picture.height)
    if smaller < 1.0:
        size = max(1, round(smaller * picture.width)), max(1, round(smaller * picture.height))
        picture = picture.resize(size, Image.Resampling.LANCZOS)
    if image is not None:
        # Every pixel as a block of equal ones, and the blocks averaged again: what is not drawn on stays as it is.
        scale = SUPERSAMPLING * picture.width / frame.columns
        picture = picture.resize((SUPERSAMPLING * picture.width, SUPERSAMPLING * picture.height), Image.Resampling.NEAREST)
        pen = ImageDraw.Draw(picture)
        thick = max(2, round(0.0045 * picture.width))
        x = np.linspace(image.x[0], image.x[-1], DRAWN)
        curve = CubicSpline(image.x[::-1], image.y[::-1])(x)
        line = np.interp(x[::-1], image.x[::-1], image.tangent[::-1])[::-1]
        for y, colour in ((curve, CURVE), (line, TANGENT)):
            pixels = scale * _pixels(frame, surface, eye, x, y)
            drawn = [(float(a), float(b)) for a, b in pixels[np.isfinite(pixels).all(axis=1)]]
            for spread, shade in ((thick + 4, (255, 255, 255)), (thick, colour)):
                pen.line(drawn, fill=shade, width=spread, joint="curve")
        ends = scale * _pixels(frame, surface, eye, np.full(2, image.x[-1]), np.array([image.y[-1], image.tangent[-1]]))
        _letters(pen, ends, picture.width, ("lane", "tangent"))
        picture = picture.reduce(SUPERSAMPLING)
    file = io.BytesIO()
    # A tenth of the PNG's bytes, and nothing in it that a reader measures.
    picture.save(file, "JPEG", quality=88, subsampling=0)
    return file.getvalue()


def _pixels(frame: Frame, surface: OpticalSurface, eye: Array, x: Array, y: Array) -> Array:
    """Columns and rows (n, 2) of the picture at which the eye sees the points (x, y) of the mirror; NaN beyond its sheet."""
    u_min, u_max, v_min, v_max = surface.domain
    beyond = (y < v_min) | (y > v_max) | (x < u_min) | (x > u_max)
    x, y = np.clip(x, u_min, u_max), np.clip(y, v_min, v_max)
    ray = surface.eye_rays(eye, x, y)
    on_plane = eye + ray * (-eye[2] / ray[:, 2])[:, None]
    pixels = np.stack([(on_plane[:, 0] - frame.left) / frame.pixel, (frame.top - on_plane[:, 1]) / frame.pixel], axis=1)
    pixels[beyond] = np.nan
    return pixels


def _letters(pen: ImageDraw.ImageDraw, ends: Array, width: int, names: tuple[str, str]) -> None:
    """The lines' names beside their left ends, the upper one above, the lower one below."""
    font = typeface("DejaVuSans-Bold.ttf", max(10, round(0.024 * width)))
    for k, (name, colour) in enumerate(zip(names, (CURVE, TANGENT), strict=True)):
        column, row = ends[k]
        if not np.isfinite(ends[k]).all():
            continue
        above = row < ends[1 - k, 1] or not np.isfinite(ends[1 - k]).all()
        beside = float(column) + 0.012 * width, float(row) + (-0.016 if above else 0.016) * width
        pen.text(beside, name, font=font, fill=colour, anchor="ls" if above else "lt",
                 stroke_width=max(2, round(0.004 * width)), stroke_fill=(255, 255, 255))
