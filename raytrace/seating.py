"""The frame of the face that reflects: where the origin, normal and up of a mirror are in the coordinates of its file.

The frame belongs to the part, so that a part that is moved takes it along. Its parts, and what decides where the part does not:

* Side. What has a front (a face named so) has its front. A sheet faces the way that it bulges, for mirrors beside the driver
  are convex; a flat or saddle-shaped one the way that its face or its facets do. Of a body whose faces all reflect, the side
  that bulges outwards, else the larger one, else the one that comes first in the file.
* Origin and normal. The point of the face at the centre of its outline's box, seen along the normal at that same point: a fixed
  point, found by iteration.
* Up. Where the outline (its convex hull) is its own mirror image about an axis, that axis or the one across it, whichever of
  their four directions is nearest to the file's up; else, and for a round one, the file's up itself, laid across the normal.
  The file's up is +z, as in vehicle coordinates, where the normal lies within 30° of the horizontal plane; else +y, as in
  mirror coordinates.

A file whose face stands in mirror coordinates already, with its box about the origin and its normal along z, is left as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from raytrace.errors import TraceError
from raytrace.placement import Hand, Placement
from raytrace.reflector import Reflector
from raytrace.surfaces.area_samples import AreaSamples
from raytrace.trace import reflect

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Mask = NDArray[np.bool_]
Place = Placement | Literal["auto", "face", "file"]

MIN_FACING_SHARE = 0.5  # least share of a sheet's area that its mean normal carries; a closed body's carries nothing
SIDE_COSINE = 0.5  # cosine: facets within 60° of a side's direction belong to it
# Of the size of what reflects, and radians. A face that is no farther from mirror coordinates stands in them: above what
# float32 vertices are rounded by, below what is seen.
IN_PLACE = 1e-6
NEARLY_IN_PLACE = 1e-2  # the same, where only the side that reflects is asked
LEVEL_SINE = 0.5  # sine of 30°: a normal that is no farther from horizontal is that of a mirror in vehicle coordinates
MIN_SAG_SHARE = 1e-6  # of the size: a smaller sag is flat
MIN_ROUND_SHARE = 0.3  # of what a face bends by: a smaller share that is alike in all directions makes no bulge, but a saddle
MIN_MOMENT_SHARE = 1e-3  # of an outline's second or fourth moment: below it, rounding would decide where its axes lie
SYMMETRIC_SHARE = 2e-3  # of the outline's size: what its two halves may differ by
EQUAL_DECIMALS = 3  # of a side's share of all area: what a grid of samples knows of it
DIRECTIONS = 128  # in which two halves are compared
FIXED_POINT = 1e-15  # of the size, and radians: the fixed point is found
SYMMETRY_STEP = 2  # the step at which the normal is near enough to its end to judge whether the outline is symmetric
MAX_STEPS = 60  # of its iteration, each of which leaves a twentieth of the error, or less


def seated(reflector: Reflector, ours: bool, place: Place = "auto", hand: Hand = "left") -> Reflector:
    """Bring the reflector of a file to the coordinates that are asked for, and note its placement.

    A right-hand mirror is reflected into the left-hand one's mirror coordinates, unless its file's own are asked for.

    Parameters
    ----------
    reflector : in the coordinates of the file.
    ours : whether our own `build` wrote the file, as `mirror_cad.own_files` tells.
    place : a Placement; "face", its own frame; "file", the file's coordinates as they are; "auto", the latter for our own
        files, which are in mirror coordinates, and the former for all others.
    hand : of the mirror in the file.

    Returns
    -------
    Reflector

    Raises
    ------
    TraceError
        For another `place`, or where a face's frame cannot be found.
    """
    if isinstance(place, Placement):
        return reflector.moved(replace(place, source="stated", hand=hand))
    if place not in ("auto", "face", "file"):
        raise TraceError(f"place = {place!r}: a Placement, \"auto\", \"face\" or \"file\" says where the mirror is")
    if place == "file":
        return reflector.moved(Placement.identity("file"))
    if place == "auto" and ours:
        return reflector.moved(Placement.identity("file", hand))
    return reflector.moved(replace(find_placement(reflector), hand=hand))


def place_from(text: str) -> Place:
    """Read what a command line says of a placement.

    Parameters
    ----------
    text : auto, face, file, or nine numbers: origin (mm of the file), normal and up.

    Returns
    -------
    What `seated` takes.

    Raises
    ------
    TraceError
        For anything else.
    """
    said = text.strip()
    if said in ("auto", "face", "file"):
        return said  # type: ignore[return-value]
    try:
        numbers = [float(part) for part in said.replace(",", " ").replace(";", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != 9:
        raise TraceError(f"place = {text!r}: must be auto, face, file, or nine numbers: origin x,y,z in mm of the file, normal "
                         "x,y,z towards the driver, up x,y,z")
    return Placement.of(numbers[:3], numbers[3:6], numbers[6:])


def find_placement(reflector: Reflector) -> Placement:
    """Find the frame of the face that reflects; the module says by which rules.

    Parameters
    ----------
    reflector : in any coordinates.

    Returns
    -------
    Placement
        In these.

    Raises
    ------
    TraceError
        Where what reflects has no extent.
    """
    samples = reflector.surface.area_samples()
    middle = 0.5 * (samples.points.min(axis=0) + samples.points.max(axis=0))
    size = _size(samples)
    if not size > 0.0 or not samples.sizes.sum() > 0.0:
        raise TraceError("what reflects is a point or a line: it has no normal that its place could be told from")
    direction, side, samples = _side(reflector, samples)
    face = _Face.of(reflector, samples, side, size)
    if _stands(face, np.zeros(3), IN_PLACE):
        return Placement.identity("face")
    # Counted from its middle: facets are met in float32.
    centred = Placement(middle, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
    return face.moved(centred).placement(direction, middle)


def _size(samples: AreaSamples) -> float:
    """Of what reflects, mm, about: the diagonal of its samples' box, or of a single facet the root of its area."""
    return float(np.linalg.norm(np.ptp(samples.points, axis=0))) or float(np.sqrt(samples.sizes.sum()))


# --- side -------------------------------------------------------------------------------------------------------------


def _side(reflector: Reflector, samples: AreaSamples) -> tuple[Array, Mask, AreaSamples]:
    """The direction (3,), about, in which the mirror looks, and which samples are of the side that looks there.

    And the samples, turned outwards where they were not.
    """
    sizes, total = samples.sizes, samples.areas.sum(axis=0)
    everything = np.ones(len(sizes), dtype=np.bool_)
    if np.linalg.norm(total) >= MIN_FACING_SHARE * sizes.sum():
        direction = total / np.linalg.norm(total)
        if reflector.surface.looks_outward:
            return direction, everything, samples
        return direction * _sheet_side(reflector, samples, direction), everything, samples
    with np.errstate(invalid="ignore", divide="ignore"):
        tensor = np.einsum("ni,nj->ij", np.nan_to_num(samples.areas / sizes[:, None]), samples.areas)
    axis = np.linalg.eigh(tensor)[1][:, -1]
    if reflector.surface.is_loose:
        # A sheet whose facets turn now one way and now the other.
        turned = replace(samples, areas=samples.areas * np.sign(samples.areas @ axis)[:, None])
        return axis * _sheet_side(reflector, turned, axis), everything, turned
    if np.einsum("ni,ni->", samples.points - samples.points.mean(axis=0), samples.areas) < 0.0:
        samples = replace(samples, areas=-samples.areas)  # a body that is inside out
    along = samples.areas @ axis
    first = np.flatnonzero(np.abs(along) > SIDE_COSINE * sizes)
    turn = float(np.sign(along[first[0]])) if first.size else 1.0
    axis, along = turn * axis, turn * along
    sides = [(sign * axis, sign * along > SIDE_COSINE * sizes) for sign in (1.0, -1.0)]
    sides = [(direction, side) for direction, side in sides if side.any()] or [(axis, everything)]
    size = _size(samples)
    for direction, side in sides:
        if direction[2] > 1.0 - NEARLY_IN_PLACE and _stands(
                _Face.of(reflector, samples, side, size), np.zeros(3), NEARLY_IN_PLACE):
            return direction, side, samples
    # Outwards before inwards, then the larger; equal ones stay in the file's order.
    best = max(sides, key=lambda one: (-_bulge(samples.those(one[1]), one[0]),
                                       round(float(sizes[one[1]].sum() / sizes.sum()), EQUAL_DECIMALS)))
    return *best, samples


def _sheet_side(reflector: Reflector, samples: AreaSamples, direction: Array) -> float:
    """1 or −1: whether a sheet that looks in a direction by its facets or its face reflects there, or on its other side."""
    size = _size(samples)
    if abs(direction[2]) > 1.0 - NEARLY_IN_PLACE and _stands(
            _Face.of(reflector, samples, np.ones(len(samples.points), dtype=np.bool_), size), np.zeros(3), NEARLY_IN_PLACE):
        return float(np.sign(direction[2]))  # in mirror coordinates it looks along z, however it is bent
    return -1.0 if _bulge(samples, direction) > 0 else 1.0


def _bulge(samples: AreaSamples, direction: Array) -> int:
    """−1 where a side is convex as seen from a direction, 1 where it is hollow, 0 where it is neither.

    Least squares h = a + b·x + c·y + d·(x² + y²), weighted by area: the sign of d, where d bends it by more than MIN_SAG_SHARE
    of its size and by MIN_ROUND_SHARE of all that it bends.
    """
    x_axis, y_axis = _across(direction)
    p = samples.points - samples.points.mean(axis=0)
    x, y, h = p @ x_axis, p @ y_axis, p @ direction
    weight = np.sqrt(samples.sizes)
    plane = np.stack([np.ones_like(x), x, y], axis=1) * weight[:, None]
    square, height = (x * x + y * y) * weight, h * weight
    for_plane = np.linalg.lstsq(plane, np.stack([square, height], axis=1), rcond=None)[0]
    square, height = square - plane @ for_plane[:, 0], height - plane @ for_plane[:, 1]
    norm = float(np.linalg.norm(square))
    if not norm > 0.0:
        return 0
    bend = float(square @ height) / norm  # RMS of what the round part bends, times √(Σ weight²)
    size, total = float(np.hypot(np.ptp(x), np.ptp(y))), float(np.linalg.norm(weight))
    if abs(bend) <= MIN_SAG_SHARE * size * total or abs(bend) <= MIN_ROUND_SHARE * float(np.linalg.norm(height)):
        return 0
    return 1 if bend > 0.0 else -1


# --- frame ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Face:
    """What reflects on the chosen side, without obstacles and glass, and the same untrimmed where it is one face.

    points (n, 3) : its outline and its bulges are among them.   size : mm.
    """

    lead: Reflector
    sheet: Reflector
    points: Array
    size: float

    @staticmethod
    def of(reflector: Reflector, samples: AreaSamples, side: Mask, size: float) -> _Face:
        surface, points = reflector.surface.one_side(samples, side)
        lead = Reflector(surface)
        return _Face(lead, lead.untrimmed, points, size)

    def moved(self, placement: Placement) -> _Face:
        return _Face(self.lead.moved(placement), self.sheet.moved(placement), placement.to_mirror(self.points), self.size)

    def met(self, above: Array, normal: Array) -> tuple[Array, Array] | None:
        """The point and the unit normal, towards `normal`, where the face is first met from above a point along −normal."""
        start = above + (float((self.points @ normal).max()) - float(above @ normal) + self.size) * normal
        for reflector in (self.lead, self.sheet):
            trace = reflect(reflector, start, -normal[None])
            if np.isfinite(trace.normals[0]).all():
                return trace.points[0], trace.normals[0]
        return None

    def placement(self, direction: Array, origin: Array) -> Placement:
        """The frame at the fixed point, for an origin that these coordinates have in the file's."""
        normal, point, fold = direction, np.zeros(3), 0
        for step in range(MAX_STEPS):
            if step in (0, SYMMETRY_STEP):
                fold = _fold(*_in_plane(self.points, normal))
            up = _up(self.points, normal, fold)
            right = np.cross(up, normal)
            x, y = self.points @ right, self.points @ up
            centre = 0.5 * (x.min() + x.max()) * right + 0.5 * (y.min() + y.max()) * up
            found = self.met(centre, normal)
            if found is None:  # a hole in the middle: the height that the outline has on the average
                point = centre + float((self.points @ normal).mean()) * normal
                break
            change = float(np.linalg.norm(found[1] - normal)) + float(np.linalg.norm(found[0] - point)) / self.size
            point, normal = found
            if change <= FIXED_POINT:
                break
        return Placement.of(point + origin, normal, _up(self.points, normal, fold), "face")


def _stands(face: _Face, origin: Array, tolerance: float) -> bool:
    """Whether a face is in mirror coordinates: its box about the origin, the face there, and its normal along z."""
    box = 0.5 * (face.points[:, :2].min(axis=0) + face.points[:, :2].max(axis=0))
    if np.abs(box).max() > tolerance * face.size:
        return False
    found = face.met(origin, np.array([0.0, 0.0, 1.0]))
    return found is not None and abs(found[0][2]) <= tolerance * face.size and float(np.hypot(*found[1][:2])) <= tolerance


def _across(direction: Array) -> tuple[Array, Array]:
    """Two unit directions across another, and each other."""
    x = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    x /= np.linalg.norm(x)
    return x, np.cross(direction, x)


def _up(points: Array, normal: Array, fold: int) -> Array:
    """Up (3,), unit, across the normal, where the outline is symmetric as `_fold` says; see the module."""
    right, file_up = _file_axes(normal)
    if fold == 0:
        return file_up
    hull, _ = _in_plane(points, normal)
    angles = float(np.angle(_moment(hull, fold))) / fold + np.pi / fold * np.arange(2 * fold)
    nearest = angles[np.argmax(np.sin(angles))]
    up = np.cos(nearest) * right + np.sin(nearest) * file_up
    result: Array = up / np.linalg.norm(up)
    return result


def _file_axes(normal: Array) -> tuple[Array, Array]:
    """To the right as one looks against the normal, and the file's up across it."""
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) <= LEVEL_SINE else np.array([0.0, 1.0, 0.0])
    up = up - (up @ normal) * normal
    up /= np.linalg.norm(up)
    return np.cross(up, normal), up


def _in_plane(points: Array, normal: Array) -> tuple[Complex, float]:
    """The convex hull of points as seen along a normal, about its centroid, and its area; nothing and 0 of points on a line.

    Counter-clockwise, the file's up being the imaginary axis.
    """
    right, up = _file_axes(normal)
    seen = np.stack([points @ right, points @ up], axis=1)
    try:
        hull = seen[ConvexHull(seen).vertices] @ np.array([1.0, 1.0j])
    except QhullError:
        return np.zeros(0, dtype=np.complex128), 0.0
    hull = hull - hull.mean()
    after = np.roll(hull, -1)
    double = (np.conj(hull) * after).imag
    area = 0.5 * float(double.sum())
    return hull - (double * (hull + after)).sum() / (6.0 * area), area


def _fold(hull: Complex, area: float) -> int:
    """Of which moment, ∫ z^k dA, the argument tells the axes of an outline that is its own mirror image.

    2, or 4 where that of 2 vanishes, as a square's does; 0 of an outline without such axes, and of a circle, of which every
    line is one.
    """
    size = float(np.abs(hull).max(initial=0.0))
    for fold in (2, 4):
        moment = _moment(hull, fold)
        if abs(moment) > MIN_MOMENT_SHARE * area * size**fold:
            axes = float(np.angle(moment)) / fold + np.pi / fold * np.arange(fold)
            return fold if any(_is_symmetric(hull, float(axis), SYMMETRIC_SHARE * size) for axis in axes) else 0
    return 0


def _moment(polygon: Complex, order: int) -> complex:
    """∫ z^k dA over a polygon: of the triangles (0, a, b), 2A/((k + 1)(k + 2))·Σ_j a^j·b^(k−j)."""
    a, b = polygon, np.roll(polygon, -1)
    terms = np.stack([a**j * b**(order - j) for j in range(order + 1)]).sum(axis=0)
    return complex(((np.conj(a) * b).imag * terms).sum() / ((order + 1) * (order + 2)))


def _is_symmetric(hull: Complex, axis: float, tolerance: float) -> bool:
    """Whether a convex polygon about its centroid is its own reflection about an axis: by its support function."""
    turn = np.linspace(0.0, math.pi, DIRECTIONS)
    reach = [np.max([x * hull.real + y * hull.imag for x, y in zip(np.cos(angle), np.sin(angle), strict=True)], axis=1)
             for angle in (axis + turn, axis - turn)]
    return bool(np.abs(reach[0] - reach[1]).max() <= tolerance)
