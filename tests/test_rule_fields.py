"""Fields on the ground that rules ask for: areas, closed forms of planes and spheres, the horizon, and two eyes together."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from mirror_cad.surfaces.quadric import Quadric
from mirror_studio.rules.ground import RequiredGround, hidden_share, missing_ground, seen_lines
from mirror_studio.rules.schema import FieldSection, load_rule
from raytrace.reflector import Reflector
from raytrace.surfaces.quadric import QuadricFace
from raytrace.trace import reflect
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.image_points import image_points
from raytrace.visibility.intervals import IntervalSet, combined
from tests.rule_mirrors import plane, sphere, torus

Array = NDArray[np.float64]

HOST = HostVehicle(870.0, -200.0, 3900.0, 2450.0)
EYES = Eyes(np.array([0.0, -490.0, 1900.0]))
CENTRE = np.array([-540.0, -1010.0, 1760.0])
AT_MM = np.array([4_000.0, 20_000.0, 30_000.0, 60_000.0])
CLOSED_MM = 1e-3  # 1e-6 m


def views(reflector: Reflector, yaw_deg: float = 22.0, pitch_deg: float = 3.0) -> tuple[View, View]:
    pose = Pose(CENTRE, np.zeros(3), np.radians(yaw_deg), np.radians(pitch_deg))
    return View(reflector, pose, EYES.left), View(reflector, pose, EYES.right)


def field(rows: list[list[float]], **keys: object) -> FieldSection:
    return FieldSection(rows_m=tuple(tuple(row) for row in rows), **keys)  # type: ignore[arg-type]


def fields_of(name: str) -> list[FieldSection]:
    return [line.field for line in load_rule("R46").lines_of(name) if line.quantity == "field_missing_m2" and line.field]


def required(of: FieldSection, side: float = -1.0) -> RequiredGround:
    return RequiredGround.of(of, HOST, side)


# --- areas ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "area", "to"), [("IV", 307.9, 0.05), ("V", 5.5, 1e-9)])
def test_area_is_that_of_the_directive(name: str, area: float, to: float) -> None:
    """Class IV's comes out only where its two widths are joined by a straight line: 225 + (4.5 + 15)/2 · 8.5 m²."""
    assert required(fields_of(name)[0]).area_m2 == pytest.approx(area, abs=to)


def test_area_of_class_vi_with_its_round_corner() -> None:
    """2 m ahead over the vehicle's width, and a quarter of a circle of 2 m beyond it."""
    assert required(fields_of("VI")[0], 1.0).area_m2 == pytest.approx(2.0 * 1.74 + np.pi, abs=1e-6)


def test_fields_lie_on_the_mirrors_side() -> None:
    of = field([[4.0, 0.0, 1.0], [20.0, 0.0, 4.0]])
    left, right = (required(of, side).between(np.array([4000.0, 12000.0])) for side in (-1.0, 1.0))
    assert np.stack([left.low, left.high]).ravel() == pytest.approx([-1870.0, -3370.0, -870.0, -870.0])
    assert np.stack([right.low, right.high]).ravel() == pytest.approx([870.0, 870.0, 1870.0, 3370.0])


# --- closed forms -----------------------------------------------------------------------------------------------------


def off_plane(view: View, place: Array) -> tuple[Array, Array]:
    """Where and whither the eye's ray to a place of the mirror's own z = 0 is reflected: by the eye's image behind the
    plane."""
    image = view.eye_in_mirror * [1.0, 1.0, -1.0]
    point = np.array([*place, 0.0])
    return view.pose.to_vehicle(point), view.pose.directions_to_vehicle(point - image)


def off_sphere(view: View, radius: float, angles: Array) -> tuple[Array, Array]:
    """The same at (u, v) of the sphere, by d − 2(d·n)n."""
    u, v = angles
    normal = np.array([np.cos(v) * np.sin(u), np.sin(v), np.cos(v) * np.cos(u)])
    point = radius * (normal - [0.0, 0.0, 1.0])
    way = point - view.eye_in_mirror
    return view.pose.to_vehicle(point), view.pose.directions_to_vehicle(way - 2.0 * (way @ normal) * normal)


def along_edge(ray: object, corners: Array, x: float) -> list[float]:
    """Every Y at which rays through straight pieces between corners meet the ground on the line X = x."""

    def over(a: Array, b: Array, t: float) -> float:
        point, way = ray(a + t * (b - a))  # type: ignore[operator]
        return float((x - point[0]) * way[2] + point[2] * way[0])  # 0 where the ray meets the line in Z = 0

    found = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        t = np.linspace(0.0, 1.0, 41)
        values = np.array([over(a, b, each) for each in t])
        for k in np.flatnonzero(values[:-1] * values[1:] < 0.0):
            root = brentq(lambda each, a=a, b=b: over(a, b, each), t[k], t[k + 1], xtol=1e-15, rtol=1e-14)
            point, way = ray(a + root * (b - a))  # type: ignore[operator]
            if way[2] < 0.0 < way[0]:
                found.append(float(point[1] + (x - point[0]) / way[0] * way[1]))
    return sorted(found)


@pytest.mark.parametrize("radius", [np.inf, 1200.0, 800.0])
def test_widths_of_planes_and_spheres(radius: float) -> None:
    """At 4, 20, 30 and 60 m, to 1e-6 m, for both eyes."""
    corners = np.array([[-90.0, -110.0], [90.0, -110.0], [90.0, 110.0], [-90.0, 110.0]])
    pair = views(plane(180.0, 220.0) if np.isinf(radius) else sphere(radius, 180.0, 220.0))
    seen = seen_lines(edge_of(pair[0]), edge_of(pair[1]), AT_MM)
    for view, spans in zip(pair, (seen.left, seen.right), strict=True):
        for row, x in enumerate(AT_MM):
            if np.isinf(radius):
                ends = along_edge(lambda place, view=view: off_plane(view, place), corners, x)
            else:
                ends = along_edge(lambda angles, view=view: off_sphere(view, radius, angles), corners / radius, x)
            assert spans.of(row).ravel() == pytest.approx(ends, abs=CLOSED_MM), (x, radius)
    assert len(seen.left.row) >= 3


@pytest.mark.parametrize("inside_mm", [1e-4, -1e-4])
def test_horizon_turns_where_its_last_ray_leaves_the_edge(inside_mm: float) -> None:
    """A plane shows the direction straight back at the place where the eye's ray along its image meets it: with the upper edge
    0.1 µm above that the strip is seen to the horizon, with it as far below it is not."""
    wide = views(plane(400.0, 400.0))
    edges = []
    for view in wide:
        back = view.pose.directions_to_mirror(np.array([1.0, 0.0, 0.0])) * [1.0, 1.0, -1.0]
        place = view.eye_in_mirror + back * (-view.eye_in_mirror[2] / back[2])
        edges.append(place[1])
    top = min(edges) + inside_mm  # where the first of the two eyes begins to see it
    loop = np.array([[-200.0, -200.0], [200.0, -200.0], [200.0, top], [-200.0, top]])
    cut = Reflector(QuadricFace(Quadric("plane", np.zeros(3), np.eye(3), 0.0), (loop,)))
    found = missing_ground(*views(cut), required(field([[20.0, 0.0, 4.0], [np.inf, 0.0, 4.0]])))
    assert found.horizon is (inside_mm > 0.0)


def test_missing_area_of_a_plane_by_its_polygon() -> None:
    """A plane mirror shows a quadrangle of the ground, its corners' images: what a field lacks is an area of polygons."""
    small = plane(60.0, 40.0)
    left, right = views(small, 22.0, -2.0)
    corners = np.array([[-30.0, -20.0], [30.0, -20.0], [30.0, 20.0], [-30.0, 20.0]])

    def on_ground(view: View) -> Array:
        rays = [off_plane(view, place) for place in corners]
        return np.array([(point - point[2] / way[2] * way)[:2] for point, way in rays])

    x = np.linspace(3000.0, 12_000.0, 400_001)
    x = 0.5 * (x[1:] + x[:-1])
    ends = []
    for polygon in (on_ground(left), on_ground(right)):
        # A convex polygon's slice: where its sides cross the line.
        a, b = polygon, np.roll(polygon, -1, axis=0)
        at = np.full((4, len(x)), np.nan)
        for k in range(4):
            share = (x - a[k, 0]) / (b[k, 0] - a[k, 0])
            at[k] = np.where((share >= 0.0) & (share < 1.0), a[k, 1] + share * (b[k, 1] - a[k, 1]), np.nan)
        low, high = np.nanmin(np.vstack([at, np.full(len(x), 0.0)]), axis=0), np.fmax.reduce(at, axis=0)
        seen_any = np.isfinite(high)
        ends.append((np.where(seen_any, np.clip(low, -6870.0, -870.0), -870.0),
                     np.where(seen_any, np.clip(high, -6870.0, -870.0), -870.0)))
    (low_a, high_a), (low_b, high_b) = ends
    shared = np.maximum(np.minimum(high_a, high_b) - np.maximum(low_a, low_b), 0.0)
    whole = (high_a - low_a) + (high_b - low_b) - shared
    found = missing_ground(left, right, required(field([[3.0, 0.0, 6.0], [12.0, 0.0, 6.0]])))
    assert 1.0 < found.missing_m2 < 53.0
    assert found.missing_m2 == pytest.approx(54.0 - whole.mean() * 9e-3, abs=1e-5)
    assert found.missing_to_both_m2 == pytest.approx(54.0 - shared.mean() * 9e-3, abs=1e-5)

    def area(polygon: Array) -> float:
        after = np.roll(polygon, -1, axis=0)
        return 0.5e-6 * abs(float(np.sum(polygon[:, 0] * after[:, 1] - after[:, 0] * polygon[:, 1])))

    assert sum(map(area, found.missing)) == pytest.approx(found.missing_m2, rel=2e-3)  # polygons on 241 lines


def test_field_short_by_a_millimetre_is_missing_ground() -> None:
    """A field that ends where the seen ground does, and one that begins 1 mm nearer or is 1 mm wider."""
    pair = views(sphere(1200.0, 180.0, 220.0))
    x = np.array([4000.0, 6000.0])
    outer = float((-870.0 - seen_lines(edge_of(pair[0]), edge_of(pair[1]), x).either.low).min() / 1e3)
    met = field([[4.0, 0.0, outer - 0.001], [6.0, 0.0, outer - 0.001]])
    short = field([[4.0, 0.0, outer + 0.001], [6.0, 0.0, outer + 0.001]])
    assert missing_ground(*pair, required(met)).missing_m2 == 0.0
    found = missing_ground(*pair, required(short))
    assert 0.0 < found.missing_m2 < 0.01
    assert found.margin_m == pytest.approx(-0.001, abs=1e-6)


def test_vehicle_hides_what_lies_behind_it() -> None:
    """Of a field beside the flank nothing; of one behind the vehicle's back a part."""
    pair = views(sphere(1200.0, 180.0, 220.0))
    assert hidden_share(*pair, required(field([[4.0, 0.0, 4.0], [20.0, 0.0, 4.0]])), HOST) == 0.0
    behind = field([[4.0, -1.0, 0.0], [8.0, -1.0, 0.0]])
    assert 0.1 < hidden_share(*pair, required(behind), HOST) <= 1.0


# --- two eyes ---------------------------------------------------------------------------------------------------------


def nothing_left(inner: IntervalSet, outer: IntervalSet) -> bool:
    """Whether one set of intervals holds another."""
    left = combined(lambda a, b: a & ~b, inner, outer)
    return bool((left.high - left.low < 1e-9).all())


def check_two_eyes(seed: int) -> None:
    """Union ⊇ each ⊇ intersection, and a point by point search by inverse rays finds the same."""
    random = np.random.default_rng(seed)
    r, tube = random.uniform(400.0, 2000.0, 2)
    shape = [lambda: sphere(r, 160.0, 200.0), lambda: plane(160.0, 200.0), lambda: torus(r, tube, 160.0, 200.0)][seed % 3]()
    left, right = views(shape, random.uniform(10.0, 35.0), random.uniform(-4.0, 8.0))
    x = np.sort(random.uniform(2_000.0, 60_000.0, 6))
    seen = seen_lines(edge_of(left), edge_of(right), x)
    for each in (seen.left, seen.right):
        assert nothing_left(each, seen.either), seed
        assert nothing_left(seen.both, each), seed
    assert seen.either.total + seen.both.total == pytest.approx(seen.left.total + seen.right.total, rel=1e-12)
    y = np.linspace(-30_000.0, 3_000.0, 23)
    points = np.stack([np.repeat(x, len(y)), np.tile(y, len(x)), np.zeros(len(x) * len(y))], axis=1)
    for view, spans in ((left, seen.left), (right, seen.right)):
        _, inside = image_points(view, points)
        assert (spans.mask(len(x), y).ravel() == inside).all(), seed


@pytest.mark.parametrize("seed", range(25))
def test_two_eyes_of_random_mirrors(seed: int) -> None:
    check_two_eyes(seed)


@pytest.mark.long
def test_two_eyes_of_five_hundred_random_mirrors() -> None:
    for seed in range(500):
        check_two_eyes(seed)


# --- and by brute force -----------------------------------------------------------------------------------------------

GRID = 61  # rays a direction over the mirror
NEAR_END_MM = 1e-3  # of a field's end: there rays of a grid, which lie inside the mirror, may land on either side of rounding


def check_against_rays(seed: int) -> tuple[int, float]:
    """A grid of rays from each eye over the mirror, forward to the ground: each lands in what is told to be seen on its line,
    and the ends of what is told lie no farther from the nearest landed rays than these are from each other. Nothing of the
    search for ends or image points is in it. Returns how many rays landed, and the largest gap in shares of a spacing."""
    random = np.random.default_rng(10_000 + seed)
    r, tube = random.uniform(400.0, 2000.0, 2)
    half = 80.0, 100.0
    shape = [lambda: sphere(r, 160.0, 200.0), lambda: plane(160.0, 200.0), lambda: torus(r, tube, 160.0, 200.0)][seed % 3]()
    pair = views(shape, random.uniform(10.0, 35.0), random.uniform(-10.0, 2.0))
    landed, widest = 0, 0.0
    lines = []
    for view in pair:
        edge = half if seed % 3 else (r * np.sin(half[0] / r), r * np.sin(half[1] / r))
        x, y = ((1.0 - 1e-7) * np.linspace(-each, each, GRID) for each in edge)  # 10 nm inside
        places = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2)
        eye = view.eye_in_mirror
        on_mirror = shape.surface.points_over(places[:, 0].copy(), places[:, 1].copy())
        trace = reflect(shape, eye, on_mirror - eye)
        start, way = view.pose.to_vehicle(trace.points), view.pose.directions_to_vehicle(trace.directions)
        down = (trace.status == 0) & (way[:, 2] < 0.0)
        ground = start[down] - (start[down, 2] / way[down, 2])[:, None] * way[down]
        ground = ground[(ground[:, 0] > 1000.0) & (ground[:, 0] < 80_000.0) & (np.abs(ground[:, 1]) < 500_000.0)]
        lines.append(ground[np.argsort(ground[:, 0])])
    for number, ground in enumerate(lines):
        seen = seen_lines(edge_of(pair[0]), edge_of(pair[1]), ground[:, 0])
        spans = (seen.left, seen.right)[number]
        inside = np.zeros(len(ground), dtype=np.bool_)
        for k in range(len(ground)):
            ends = spans.of(k)
            inside[k] = bool(((ends[:, 0] - NEAR_END_MM <= ground[k, 1]) & (ground[k, 1] <= ends[:, 1] + NEAR_END_MM)).any())
            assert inside[k], (seed, number, ground[k], ends)
        landed += len(ground)
        if len(ground) < 200:
            continue
        # The other way round: an end of what is seen has a landed ray near by, as near as the grid is fine there.
        tree = cKDTree(ground[:, :2])
        spacing = tree.query(ground[:, :2], 2)[0][:, 1]
        for k in range(0, len(ground), max(1, len(ground) // 60)):
            for low, high in spans.of(k):
                for y_end in (low, high):
                    if abs(y_end) < 400_000.0 and 1500.0 < ground[k, 0] < 40_000.0:
                        away, nearest = tree.query([ground[k, 0], y_end])
                        widest = max(widest, float(away / max(spacing[nearest], 1.0)))
    return landed, widest


@pytest.mark.parametrize("seed", range(6))
def test_rays_of_a_grid_land_in_what_is_seen(seed: int) -> None:
    landed, widest = check_against_rays(seed)
    assert landed > 100
    assert widest < 40.0


@pytest.mark.long
def test_rays_of_five_hundred_grids_land_in_what_is_seen() -> None:
    landed = sum(check_against_rays(seed)[0] for seed in range(500))
    assert landed > 500_000
