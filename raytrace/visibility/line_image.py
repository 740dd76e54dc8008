"""The image of a straight line of the world in a mirror, as an eye sees it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirror_cad.vectors import cross
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import Mask, View
from raytrace.visibility.edge import Edge
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.image_points import follow_image_points, image_points
from raytrace.visibility.occlusion import unhidden
from raytrace.visibility.plan import beside
from raytrace.visibility.ray_function import RayFunction

Array = NDArray[np.float64]
Index = NDArray[np.intp]
End = Literal["line", "edge", "hidden"]
Known = tuple[Array, Array] | None

SAMPLES = 65
GRID_SHAPE = 17  # samples of each part that the mirror shows, ends included, between which the vehicle's edges are looked for
PAST_STOP_RAD = 1e-4  # of φ: so far past a stop it is looked at what lies behind it; some 0.01 mm of the picture
FAR_MM = 1e9  # what the vanishing point counts as where the vehicle may stand before it
REARWARD = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class StraightLine:
    """The points start + s·direction, 0 ≤ s ≤ length_mm, in vehicle coordinates.

    Parameters
    ----------
    start : (3,), mm.
    direction : (3,), unit.
    length_mm : mm; inf for a line that goes on to its vanishing point.
    """

    start: Array
    direction: Array
    length_mm: float

    def at(self, along_mm: Array) -> Array:
        """Points (n, 3), mm, at finite distances (n,), mm, from the start."""
        return self.start + along_mm[:, None] * self.direction


def road_line(y_mm: float, near_mm: float = 0.0, far_mm: float = np.inf) -> StraightLine:
    """A line on the road along it: Y = y_mm, Z = 0, from X = near_mm to far_mm, inf for the vanishing point."""
    return StraightLine(np.array([near_mm, y_mm, 0.0]), REARWARD, far_mm - near_mm)


def column(x_mm: float, y_mm: float, height_mm: float) -> StraightLine:
    """A vertical line that stands on the ground at (x_mm, y_mm), height_mm high."""
    return StraightLine(np.array([x_mm, y_mm, 0.0]), UP, height_mm)


@dataclass(frozen=True, slots=True, eq=False)
class LineImage:
    """A part of a line that an eye sees in a mirror, sampled from the nearer end of the line to the farther.

    Attributes
    ----------
    along_mm : (n,), mm, of the points on the line, from its start; inf for the vanishing point.
    on_plane : (n, 2), mm, of the picture plane.
    directions : (n, 3), unit, from the eye, in vehicle coordinates: where they are seen.
    on_mirror : (n, 3), mm, where the mirror reflects them, in mirror coordinates.
    ends : why it ends at either end: the line does, the mirror does at its edge, or the host vehicle hides the rest.
    """

    along_mm: Array
    on_plane: Array
    directions: Array
    on_mirror: Array
    ends: tuple[End, End]

    @property
    def extent(self) -> float:
        """The angle between what is seen of its two ends, radians."""
        a, b = self.directions[0], self.directions[-1]
        return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


@dataclass(frozen=True, slots=True, eq=False)
class LineView:
    """A line as the mirror sees it: its points are told by the angle φ at which they are seen from the mirror, about.

    It is measured from the foot of the perpendicular: s = foot + away·tan φ. So samples are spread over the picture, and the
    vanishing point, φ = 90°, is a point like others.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    edge : of what it sees reflecting.
    line : of the world.
    foot_mm : of the perpendicular from the middle of the edge, mm from the line's start.
    away_mm : the perpendicular's length, mm.
    """

    view: View
    edge: Edge
    line: StraightLine
    foot_mm: float
    away_mm: float

    @staticmethod
    def of(view: View, line: StraightLine) -> LineView:
        """The line in a view, with the perpendicular from the middle of the edge."""
        edge = edge_of(view)
        mirror = edge.points.mean(axis=0) - line.start
        foot = float(mirror @ line.direction)
        return LineView(view, edge, line, foot, float(np.linalg.norm(mirror - foot * line.direction)))

    @property
    def ends(self) -> Array:
        """φ at the line's two ends, (2,)."""
        return self.angle(np.array([0.0, self.line.length_mm]))

    def angle(self, along_mm: Array) -> Array:
        """φ of points of the line, radians: along_mm (n,) from its start."""
        result: Array = np.arctan2(along_mm - self.foot_mm, self.away_mm)
        return result

    def along(self, angle: Array) -> Array:
        """Where on the line φ (n,), radians, is: mm from its start, inf for the vanishing point."""
        endless = np.isinf(self.line.length_mm) & (angle >= self.ends[1])
        return np.where(endless, np.inf, self.foot_mm + self.away_mm * np.tan(angle))

    def image_points(self, angle: Array) -> tuple[Array, Mask]:
        """Find the points of the picture plane that show points of the line.

        Parameters
        ----------
        angle : (n,), φ, radians.

        Returns
        -------
        on_plane : (n, 2), mm; NaN where the sheet shows none.
        seen : (n,), whether inside the outline.
        """
        along = self.along(angle)
        far = np.isinf(along)
        on_plane, seen = np.empty((len(angle), 2)), np.empty(len(angle), dtype=np.bool_)
        on_plane[~far], seen[~far] = image_points(self.view, self.line.at(along[~far]))
        on_plane[far], seen[far] = image_points(self.view, np.tile(self.line.direction, (int(far.sum()), 1)), at_infinity=True)
        return on_plane, seen

    def crossings(self) -> tuple[Array, Array, Array]:
        """Find where the line's image meets the edge.

        A ray from q along d and the line are in one plane where (q − start)·(direction × d) = 0.

        Returns
        -------
        angle : (k,), φ, radians, rising.
        on_plane : (k, 2), mm, of the picture plane.
        on_mirror : (k, 3), mm, in mirror coordinates.
        """
        start, u = self.line.start, self.line.direction
        _, on_plane, traced = self.edge.crossings(RayFunction.of(direction=-cross(start, u), moment=-u))
        across = cross(u, traced.directions)
        from_start = traced.points - start
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.einsum("ij,ij->i", across, across)
            along = np.einsum("ij,ij->i", cross(from_start, traced.directions), across) / scale
            ahead = np.einsum("ij,ij->i", cross(from_start, u), across) / scale
        angle = self.angle(along)
        met = (ahead > 0.0) & (angle > self.ends[0]) & (angle < self.ends[1])
        order = np.argsort(angle[met])
        return angle[met][order], on_plane[met][order], traced.on_mirror[met][order]

    def inside(self, stops: Array, at: Array) -> Mask:
        """Find whether the mirror shows the parts of the line between its ends and the crossings.

        Parameters
        ----------
        stops : (k + 2,), φ of the ends and of the crossings, rising.
        at : (k, 2), mm, where the crossings are seen.

        Returns
        -------
        (k + 1,).
        """
        if len(at) == 0 or not self.edge.beyond:
            return self.image_points(0.5 * (stops[1:] + stops[:-1]))[1]
        # A little behind each crossing, which Newton reaches from there; before the first it is the other way round.
        behind = np.minimum(stops[1:-1] + PAST_STOP_RAD, 0.5 * (stops[1:-1] + stops[2:]))
        on_plane, _ = follow_image_points(self.edge.view, at, self.line.at(self.along(behind)))
        shows = self.view.trace_points(on_plane).seen
        return np.concatenate([~shows[:1], shows])

    def segments(self, angle: Array, starts: Array) -> tuple[Array, Array, Array]:
        """Find the segments from the mirror to points of the line, by Newton from near by.

        Parameters
        ----------
        angle : (n,), φ, radians.
        starts : (n, 2), mm, of the picture plane, near those that show them.

        Returns
        -------
        on_plane : (n, 2), mm, that show them.
        points : (n, 3), mm, where their rays leave the mirror.
        targets : (n, 3), mm, the points of the line, those far away FAR_MM away.
        """
        target = self.line.at(np.minimum(self.along(angle), FAR_MM))
        on_plane, points = follow_image_points(self.edge.view, starts, target)
        return on_plane, points, target

    def image(self, low: float, high: float, ends: tuple[End, End], known: tuple[Known, Known], samples: int) -> LineImage:
        """Sample a part of the image.

        Parameters
        ----------
        low, high : φ of its ends, radians.
        ends : why it ends there.
        known : of each end, where it is seen and where on the mirror it is, where that is known.
        samples : even in φ.

        Returns
        -------
        LineImage
            Of the samples that are shown.
        """
        angle = np.linspace(low, high, samples)
        on_plane, _ = self.image_points(angle)
        traced = self.edge.view.trace_points(on_plane)
        kept, on_mirror = traced.seen, traced.on_mirror
        for k, end in zip((0, -1), known, strict=True):
            if end is not None:
                on_plane[k], on_mirror[k], kept[k] = end[0], end[1], True
        return LineImage(self.along(angle)[kept], on_plane[kept], self.view.towards(on_plane[kept]), on_mirror[kept], ends)


def line_images(view: View, line: StraightLine, host: HostVehicle | None = None, samples: int = SAMPLES,
                ) -> tuple[LineImage, ...]:
    """Find the parts of a line that the eye sees in the mirror and the host vehicle does not hide.

    Each is sampled at points evenly spread over the picture, both ends among them. Ends at the edge and at what the vehicle
    hides are exact. Meshes show nothing beyond their edge: of theirs, samples within 0.2 % of the mirror's width from the edge
    may be missing, the ends not.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    line : of the world.
    host : what hides; None for nothing.
    samples : of each part.

    Returns
    -------
    tuple of LineImage
        The largest first.
    """
    if len(edge_of(view).on_plane) == 0:
        return ()
    seen = LineView.of(view, line)
    low, high = (float(end) for end in seen.ends)
    crossings, at, on_mirror = seen.crossings()
    stops = np.concatenate([[low], crossings, [high]])
    known: list[Known] = [None, *zip(at, on_mirror, strict=True), None]
    inside = seen.inside(stops, at)
    images = []
    for begin, end in _runs(inside):
        ends: tuple[End, End] = ("line" if begin == 0 else "edge", "line" if end == len(inside) else "edge")
        images += _unhidden(seen, host, stops[begin], stops[end], ends, (known[begin], known[end]), samples)
    return tuple(sorted((image for image in images if len(image.along_mm) > 1), key=lambda image: -image.extent))


Unmeasured = Literal["not shown", "hidden by the host vehicle", "too short", "level or upright at its far end"]


def why_unmeasured(view: View, line: StraightLine, host: HostVehicle | None, least_samples: int) -> Unmeasured | None:
    """Tell why a line has no image of so many samples.

    Parameters
    ----------
    view, line, host : as in `line_images`.
    least_samples : of the largest part.

    Returns
    -------
    None where it has one.
    """
    images = line_images(view, line, host)
    if images:
        return None if len(images[0].along_mm) >= least_samples else "too short"
    return "hidden by the host vehicle" if host is not None and line_images(view, line) else "not shown"


def _unhidden(seen: LineView, host: HostVehicle | None, low: float, high: float, ends: tuple[End, End],
              known: tuple[Known, Known], samples: int) -> list[LineImage]:
    """The images of the parts between two φ that the host vehicle does not hide."""
    ends_at = seen.line.at(np.minimum(seen.along(np.array([low, high])), FAR_MM))
    if host is None or beside(*seen.edge.extent[1:], host, ends_at[:, None, :2])[0]:
        return [seen.image(low, high, ends, known, samples)]
    angle = np.linspace(low, high, GRID_SHAPE)
    near, _ = seen.image_points(angle)
    for k, end in zip((0, -1), known, strict=True):
        if end is not None:
            near[k] = end[0]
    near = near[(shown := np.isfinite(near).all(axis=1))]
    angle = angle[shown]
    on_plane, starts, targets = seen.segments(angle, near)
    met = np.isfinite(starts).all(axis=1)  # not where a mesh ends beside a place
    angle, on_plane, starts, targets = angle[met], on_plane[met], starts[met], targets[met]

    def rays(cell: Index, share: Array) -> tuple[Array, Array]:
        _, start, target = seen.segments(angle[cell] + share * (angle[cell + 1] - angle[cell]),
                                         on_plane[cell] + share[:, None] * (on_plane[cell + 1] - on_plane[cell]))
        return start, target

    open_parts = unhidden(host, np.zeros(len(angle), dtype=np.intp), angle, (starts, targets), rays)
    images = []
    for begin, end in zip(open_parts.low, open_parts.high, strict=True):
        first, last = begin == angle[0], end == angle[-1]
        images.append(seen.image(low if first else begin, high if last else end,
                                 (ends[0] if first else "hidden", ends[1] if last else "hidden"),
                                 (known[0] if first else None, known[1] if last else None), samples))
    return images


def _runs(inside: Mask) -> list[tuple[int, int]]:
    """Where flags hold in a row: (first, one after the last)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
