"""A mirror, alone or on a vehicle, in; the quantities that rules ask for, each worked out once, out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError
from mirror_studio.rules import sizes
from mirror_studio.rules.ground import OBSTRUCTED_OVER_MM, MissingGround, RequiredGround, hidden_share, missing_ground
from mirror_studio.rules.obstruction import Body, obstructed_share
from mirror_studio.rules.radii import Radii
from mirror_studio.rules.schema import FieldSection, RuleFile
from mirror_studio.rules.spherometer import Stands, read_surface, reading_error, readings_where_it_stands, stands_at, turned
from raytrace.errors import TraceError
from raytrace.measures.eye_fields import extent, eye_fields
from raytrace.measures.ghost import Ghost, ghost, reflectance
from raytrace.measures.ground import side_of
from raytrace.reflector import Reflector
from raytrace.surfaces.base import BoundedFace, box_of_points
from raytrace.surfaces.cut import outboard_of
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.visibility.orientation import orientation

Array = NDArray[np.float64]

BOX_ALONE = Body()
ARC_SAMPLES = 1025  # of an arc through the centre: the chords between them leave 1e-7 of its length
GRID = 9  # places a direction over the visible surface
WITHIN = 0.98  # of the box, from its middle, that these reach
DIRECTIONS = 4  # in which the least radius is looked for at each
REFLECTANCE_DEG = 25.0  # of incidence, at which the rules have reflectances measured
SPHERE_MM = 0.02  # off its best sphere, that a face may be and be one: what the rule files have of a surface
RECTANGLE_MM = 40.0  # high, whatever the class
ALONG_X, ALONG_Y = np.array([1.0, 0.0]), np.array([0.0, 1.0])
# What of a mirror hangs neither on the rule nor on the spherometer, and what only on how far apart the rule has the eyes.
OF_SHAPE = ("outline", "centre", "_grid", "sphere_departure", "rectangle", "segment", "circle", "box_sides", "aspheric_outline",
            "_spherical_face")
OF_VIEWS = ("views", "shows_twice", "_fields", "_hidden")


@dataclass(frozen=True, eq=False)
class Mounted:
    """A mirror on a vehicle whose driver looks into it."""

    pose: Pose
    eyes: Eyes
    host: HostVehicle
    body: Body = BOX_ALONE

    @property
    def on_drivers_side(self) -> bool:
        """Whether the mirror is on the side of the median plane where the eyes are."""
        return (self.eyes.middle[1] < 0.0) == (self.pose.hand == "left")


@dataclass(frozen=True, slots=True)
class Told:
    """What the shape of a mirror does not tell, None where nobody says it.

    reflectance_percent, reflectance_night_percent : as its maker measured them.   transition_mm : x of the upright line beyond
    which, outboard, the aspheric part lies, in mirror coordinates.
    """

    reflectance_percent: float | None = None
    reflectance_night_percent: float | None = None
    transition_mm: float | None = None


NOTHING_TOLD = Told()


def _grid_within(outline: Array) -> Array:
    """Places (n, 2) of an even grid over a polygon's box that it holds."""
    x_min, x_max, y_min, y_max = box_of_points(outline)
    share = np.linspace(-WITHIN, WITHIN, GRID)
    middle, half = 0.5 * np.array([x_min + x_max, y_min + y_max]), 0.5 * np.array([x_max - x_min, y_max - y_min])
    at_xy = middle + half * np.stack(np.meshgrid(share, share), axis=2).reshape(-1, 2)
    sides = sizes.Polygon.of(outline)
    return at_xy[[sides.contains(*place) for place in at_xy]]


@dataclass(frozen=True, eq=False)
class Measured:
    """What rules ask of one mirror.

    leg_mm : between the spherometer's outer feet.   told : what is known of it beside its shape.
    Raises: SpecError for a face with holes; TraceError for a mirror that an eye does not see.
    """

    reflector: Reflector
    rule: RuleFile
    leg_mm: float
    mounted: Mounted | None = None
    told: Told = NOTHING_TOLD

    def by_rule(self, rule: RuleFile, leg_mm: float | None = None) -> Measured:
        """The same mirror by another rule: what does not hang on the rule is not measured again."""
        other = replace(self, rule=rule, leg_mm=self.leg_mm if leg_mm is None else leg_mm)
        shared = set(OF_SHAPE)
        if other.leg_mm == self.leg_mm:
            shared |= {"centre_radii", "least_radius", *(["radii"] if rule.readings == self.rule.readings else [])}
        if rule.eyes.separation_mm == self.rule.eyes.separation_mm:
            shared |= set(OF_VIEWS)
        vars(other).update({name: value for name, value in vars(self).items() if name in shared})
        if "main" in vars(self) and self.main is not self:
            vars(other)["main"] = self.main.by_rule(rule, leg_mm)
        return other

    # --- its parts ----------------------------------------------------------------------------------------------------

    @cached_property
    def main(self) -> Measured:
        """The main part alone: itself, where neither a transition line nor an edge of faces parts it from an aspheric one."""
        if self.told.transition_mm is None:
            face = self._spherical_face
            return self if face is None else replace(self, reflector=replace(self.reflector, surface=face))
        inboard = replace(self.reflector, surface=self.reflector.surface.inboard_of(self.told.transition_mm))
        return replace(self, reflector=inboard, told=replace(self.told, transition_mm=None))

    @cached_property
    def aspheric_outline(self) -> Array | None:
        """The polygon (n, 2) around the aspheric part, mm; None where it is not known."""
        if (line := self.told.transition_mm) is not None:
            return outboard_of(self.outline, line)
        if self._spherical_face is None:
            return None
        others = [face for face in self.reflector.surface.uncoated().bounding_faces if face is not self._spherical_face]
        return others[0].rim[0].points[:, :2] if len(others) == 1 and len(others[0].rim) == 1 else None

    @cached_property
    def _spherical_face(self) -> BoundedFace | None:
        """Of several faces that are no sphere together, the largest that is one by itself: the main part."""
        faces = self.reflector.surface.uncoated().bounding_faces
        if len(faces) < 2 or self.sphere_departure <= SPHERE_MM:
            return None
        found = [face for face in faces if len(face.rim) == 1 and replace(
            self, reflector=replace(self.reflector, surface=face)).sphere_departure <= SPHERE_MM]
        return max(found, key=lambda face: abs(sizes.area_of(face.rim[0].points[:, :2])), default=None)

    @property
    def aspheric_width(self) -> float | None:
        """The longest level piece of the aspheric part, from the transition line to the edge, mm."""
        if self.aspheric_outline is None:
            return None
        found = sizes.longest_rectangle(self.aspheric_outline, 0.0)
        return 0.0 if found is None else found.width

    # --- radii --------------------------------------------------------------------------------------------------------

    @cached_property
    def outline(self) -> Array:
        """The polygon (n, 2) that bounds the visible surface, mm."""
        return sizes.outline_of(self.reflector)

    @cached_property
    def centre(self) -> Array:
        """The middle (2,) of its box."""
        x_min, x_max, y_min, y_max = box_of_points(self.outline)
        return np.array([0.5 * (x_min + x_max), 0.5 * (y_min + y_max)])

    @cached_property
    def radii(self) -> Radii:
        """The readings that the rule asks for."""
        return self._at_three_points() if self.rule.readings == "annex 7" else self._at_five_places()

    @cached_property
    def centre_radii(self) -> Radii:
        """The two readings at the centre."""
        return self._read(self.centre[None], ALONG_X)

    def _at_three_points(self) -> Radii:
        """At 1/3, 1/2 and 2/3 of the upright arc through the centre, or of the level one where that is longer.

        Along it and across (UN Regulation No. 46, Annex 7).
        """
        arcs = [self._arc(axis) for axis in (ALONG_Y, ALONG_X)]
        lengths = [float(length[-1]) for _, length in arcs]
        which = 1 if lengths[1] > lengths[0] else 0
        at_xy, length = arcs[which]
        wanted = length[-1] * np.array([1.0, 1.5, 2.0]) / 3.0
        at = np.stack([np.interp(wanted, length, at_xy[:, k]) for k in (0, 1)], axis=1)
        return self._read(at, (ALONG_Y, ALONG_X)[which])

    def _at_five_places(self) -> Radii:
        """At the centre, and half way from it to the edge on each side; level and upright."""
        x_min, x_max, y_min, y_max = box_of_points(np.concatenate([self._through_centre(axis) for axis in (ALONG_X, ALONG_Y)]))
        x, y = self.centre
        at = np.array([[x, y], [0.5 * (x + x_min), y], [0.5 * (x + x_max), y], [x, 0.5 * (y + y_min)], [x, 0.5 * (y + y_max)]])
        return self._read(at, ALONG_X)

    def _read(self, at: Array, axis: Array) -> Radii:
        surface = self.reflector.surface
        stands = stands_at(surface, at, axis)
        return Radii(at, np.stack([read_surface(surface, each, self.leg_mm) for each in (stands, turned(stands))], axis=1))

    def _through_centre(self, axis: Array) -> Array:
        """Both ends (2, 2) of the piece of the level or upright line through the centre that the outline holds about it."""
        along = 0 if axis[0] else 1
        a, b = self.outline, np.roll(self.outline, -1, axis=0)
        across = 1 - along
        cut = (a[:, across] <= self.centre[across]) != (b[:, across] <= self.centre[across])
        a, b = a[cut], b[cut]
        at = a[:, along] + (self.centre[across] - a[:, across]) * (b - a)[:, along] / (b - a)[:, across]
        before, after = at[at <= self.centre[along]], at[at > self.centre[along]]
        if len(before) % 2 == 0 or len(after) % 2 == 0:
            raise SpecError(f"the middle of the outline's box, ({self.centre[0]:.1f}, {self.centre[1]:.1f}) mm, is not on the "
                            "mirror: the rule reads radii along arcs through it")
        ends = np.tile(self.centre, (2, 1))
        ends[:, along] = before.max(), after.min()
        return ends

    def _arc(self, axis: Array) -> tuple[Array, Array]:
        """Places (m, 2) along an arc through the centre, and how long it is up to each, mm (m,)."""
        ends = self._through_centre(axis)
        inset = self.reflector.surface.edge_inset
        at_xy = ends[0] + np.linspace(inset, 1.0 - inset, ARC_SAMPLES)[:, None] * (ends[1] - ends[0])
        points = self.reflector.surface.points_over(at_xy[:, 0].copy(), at_xy[:, 1].copy())
        known = np.isfinite(points).all(axis=1)
        at_xy, points = at_xy[known], points[known]
        return at_xy, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])

    @cached_property
    def _grid(self) -> Array:
        """Places (n, 2) over the visible surface."""
        return _grid_within(self.outline)

    @cached_property
    def least_radius(self) -> float:
        """The least radius that the spherometer reads where it can stand, in DIRECTIONS directions; hollow ones left out.

        On the aspheric part alone, where a transition line says which that is.
        """
        grid = self._grid if self.aspheric_outline is None else _grid_within(self.aspheric_outline)
        stands = stands_at(self.reflector.surface, grid, ALONG_X)
        found = np.concatenate([readings_where_it_stands(self.reflector.surface, self._turned(stands, k), self.leg_mm)
                                for k in range(DIRECTIONS)])
        return float(found[found > 0.0].min(initial=math.inf))

    @staticmethod
    def _turned(stands: Stands, k: int) -> Stands:
        return turned(stands, math.pi * k / DIRECTIONS)

    @cached_property
    def sphere_departure(self) -> float:
        """The largest distance of the visible surface from its best sphere or plane, mm.

        Least squares on a·|p|² + b·p + c = 0, |(a, b, c)| scaled to distances by the gradient 2a·p + b.
        """
        p = self.reflector.surface.points_over(self._grid[:, 0].copy(), self._grid[:, 1].copy())
        p = p[np.isfinite(p).all(axis=1)]
        size = float(np.ptp(p, axis=0).max())
        p = (p - p.mean(axis=0)) / size
        terms = np.concatenate([np.sum(p * p, axis=1, keepdims=True), p, np.ones((len(p), 1))], axis=1)
        a, *b, _ = np.linalg.svd(terms)[2][-1]
        off = terms @ np.linalg.svd(terms)[2][-1]
        return size * float(np.abs(off / np.linalg.norm(2.0 * a * p + np.array(b), axis=1)).max())

    @cached_property
    def facets_percent(self) -> float:
        """By how much of a radius facets may spoil a reading, percent.

        Their sag e²/(8R), twice, over the instrument's C²/(8R).
        """
        facet = 0.5 * self.reflector.surface.resolution_mm
        return 200.0 * (facet / self.leg_mm) ** 2

    def dial_error(self, radius_mm: float) -> float:
        """What a dial of 2 µm leaves open of a radius, mm."""
        return reading_error(radius_mm, self.leg_mm)

    # --- the glass before it ------------------------------------------------------------------------------------------

    @property
    def front_percent(self) -> float:
        """What the front of the glass reflects by itself at REFLECTANCE_DEG, percent. Raises: TraceError without glass."""
        return 100.0 * float(reflectance(np.cos(np.radians([REFLECTANCE_DEG])), self.reflector.surface.glass.index)[0])

    @cached_property
    def ghost(self) -> Ghost | None:
        """Its reflection beside the image, for an eye between the driver's two; None on no vehicle, and of other glass."""
        if self.mounted is None:
            return None
        plate = self.reflector.surface.glass
        try:
            return ghost(plate.untrimmed(), self.views.middle.eye_in_mirror, self._grid[:, 0], self._grid[:, 1])
        except TraceError:  # whose front is no B-spline
            return None

    # --- sizes --------------------------------------------------------------------------------------------------------

    @cached_property
    def rectangle(self) -> sizes.Inscribed | None:
        """The longest level rectangle 40 mm high on the visible surface."""
        return sizes.longest_rectangle(self.outline, RECTANGLE_MM)

    @cached_property
    def segment(self) -> sizes.Inscribed:
        """The longest upright segment on it."""
        return sizes.longest_upright(self.outline)

    @cached_property
    def circle(self) -> float:
        """The largest circle's diameter."""
        return sizes.inscribed_circle(self.outline)

    @cached_property
    def box_sides(self) -> tuple[float, float]:
        """The shorter and the longer side of the outline's box."""
        x_min, x_max, y_min, y_max = box_of_points(self.outline)
        short, long = sorted((x_max - x_min, y_max - y_min))
        return short, long

    # --- on the vehicle -----------------------------------------------------------------------------------------------

    @property
    def on_vehicle(self) -> Mounted:
        """Raises: ValueError where it is on none."""
        if self.mounted is None:
            raise ValueError("this quantity is one of a mirror on a vehicle")
        return self.mounted

    @cached_property
    def views(self) -> EyeViews:
        """Seen by both eyes, as far apart as the rule has them. Raises: TraceError for an eye that the mirror does not face."""
        there = self.on_vehicle
        return EyeViews.of(self.reflector, there.pose, Eyes(there.eyes.middle, self.rule.eyes.separation_mm))

    @cached_property
    def shows_twice(self) -> bool:
        """Whether some things are seen twice: then no field is bounded by the mirror's edge."""
        return orientation(self.views.middle).twice

    def required(self, asked: FieldSection) -> RequiredGround:
        """A field on this vehicle."""
        return RequiredGround.of(asked, self.on_vehicle.host, side_of(self.views.middle))

    def missing(self, asked: FieldSection) -> MissingGround:
        """What of a field is not seen."""
        if asked not in self._fields:
            self._fields[asked] = missing_ground(self.views.left, self.views.right, self.required(asked))
        return self._fields[asked]

    def obstructed_percent(self, asked: FieldSection, upright: bool = False) -> float:
        """How much of a field the vehicle's body hides: exactly where that is a box, else on a grid.

        upright : whether areas are those of the field projected on an upright plane across the road.
        """
        there, at = self.on_vehicle, (asked, upright)
        if at not in self._hidden:
            ground = self.required(asked)
            if there.body.plain and not upright:
                self._hidden[at] = hidden_share(self.views.left, self.views.right, ground, there.host)
            else:
                self._hidden[at] = obstructed_share(self.views.left, self.views.right, ground, there.host, there.body, upright,
                                                    OBSTRUCTED_OVER_MM)
        return 100.0 * self._hidden[at]

    @cached_property
    def _fields(self) -> dict[FieldSection, MissingGround]:
        return {}

    @cached_property
    def _hidden(self) -> dict[tuple[FieldSection, bool], float]:
        return {}

    @property
    def angle_deg(self) -> float:
        """Between the median plane and the upright plane through the mirror's centre and the middle between the eyes."""
        to_mirror = self.on_vehicle.pose.to_vehicle(self._centre_point) - self.on_vehicle.eyes.middle
        return math.degrees(math.atan2(abs(to_mirror[1]), abs(to_mirror[0])))

    @property
    def height_m(self) -> float:
        """Of the mirror's lowest point above the ground."""
        return 1e-3 * float(self.on_vehicle.pose.to_vehicle(self.reflector.outline())[:, 2].min())

    @property
    def horizon_deg(self) -> float:
        """What either eye sees of the horizon."""
        return extent(eye_fields(self.views).horizon.either)

    @property
    def _centre_point(self) -> Array:
        point: Array = self.reflector.surface.points_over(self.centre[:1].copy(), self.centre[1:].copy())[0]
        return point
