"""What is true of outlines and of the files they are read from."""

import math
import random
import re
import time
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from ezdxf.math import OCS
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from svgpathtools import parse_path

from mirror_cad.errors import OutlineError
from mirror_cad.outline import Arc, Line, Outline, Spline, arc_between, closed_outline, truck_outline
from mirror_cad.outline_files import read_outline, write_dxf

PX = 25.4 / 96.0
# tmp_path is shared between the examples of one test; each example overwrites its one file.
examples = settings(deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])


def truck_area(width: float, left: float, right: float, radius: float) -> float:
    """Trapezium less, at every corner of angle a, the kite r^2 / tan(a/2) less the sector r^2 (pi - a) / 2."""
    tilt = math.atan2((left - right) / 2, width)
    area = width * (left + right) / 2
    for turn in (math.pi / 2 + tilt, math.pi / 2 - tilt):
        area -= 2 * radius**2 * (math.tan(turn / 2) - turn / 2)
    return area


def distance_to(points: np.ndarray, outline: Outline, tolerance: float = 1e-4) -> float:
    """Largest distance in mm from the points (n, 2) to the outline's polygon."""
    start = outline.polyline(tolerance)
    direction = np.roll(start, -1, axis=0) - start
    offset = points[:, None] - start
    along = np.clip((offset * direction).sum(-1) / (direction**2).sum(-1), 0, 1)
    return float(np.linalg.norm(offset - along[..., None] * direction, axis=-1).min(axis=1).max())


def assert_same_outline(a: Outline, b: Outline, relative: float = 1e-12) -> None:
    size = max(abs(value) for value in a.bounding_box())
    assert len(a.segments) == len(b.segments)
    # A file keeps the order of the segments, but a reader may begin with another one.
    turn = min(range(len(b.segments)), key=lambda i: math.dist(b.segments[i].start, a.segments[0].start))
    s = np.linspace(0, 1, 9)
    for one, other in zip(a.segments, b.segments[turn:] + b.segments[:turn], strict=True):
        assert type(one) is type(other)
        np.testing.assert_allclose(other.point(s), one.point(s), rtol=0, atol=relative * size)
    np.testing.assert_allclose(b.bounding_box(), a.bounding_box(), rtol=0, atol=relative * size)
    assert b.area_mm2() == pytest.approx(a.area_mm2(), rel=1e-12)


def dxf(tmp_path: Path, draw, units: int = 4, name: str = "outline.dxf") -> Path:
    document = ezdxf.new("R2010", units=units)
    draw(document.modelspace())
    document.saveas(tmp_path / name)
    return tmp_path / name


def svg(tmp_path: Path, body: str, root: str = "", head: str = "") -> Path:
    path = tmp_path / "outline.svg"
    path.write_text(f'{head}<svg xmlns="http://www.w3.org/2000/svg" {root}>{body}</svg>')
    return path


def square(space, size: float = 100.0, x: float = 0.0, y: float = 0.0, **attributes) -> None:
    corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]
    for i in range(4):
        space.add_line(corners[i], corners[(i + 1) % 4], attributes)


def wavy_spline(weights: np.ndarray | None = None, degree: int = 3) -> Spline:
    """A closed star-shaped spline about the origin, with inner knots one of which is double."""
    angle = np.linspace(0, 2 * np.pi, 12)
    radius = 60 + 15 * np.cos(3 * angle)
    poles = np.column_stack([radius * np.cos(angle), 1.3 * radius * np.sin(angle)])
    poles[-1] = poles[0]
    count = len(poles) - degree - 1
    inner = np.linspace(0, 2, count + 2)[1:-1]
    if count > 3:
        inner[3] = inner[2]
    return Spline(degree, np.concatenate([np.zeros(degree + 1), inner, np.full(degree + 1, 2.0)]), poles, weights)


WEIGHTS = np.array([1.0, 2, 0.5, 1, 3, 1, 0.7, 1, 1, 2, 1, 1])
SEGMENTS = [
    Line((1, 2), (-3, 4)),
    Arc((1, -2), 5.0, 0.3, 4.0),
    Arc((1, -2), 5.0, 0.3, -2.5),
    wavy_spline(),
    wavy_spline(WEIGHTS),
    wavy_spline(WEIGHTS, degree=2),
]


# ---------------------------------------------------------------------------------------------------------- segments


@pytest.mark.parametrize("segment", SEGMENTS, ids=lambda s: type(s).__name__)
def test_a_segment_runs_from_its_start_to_its_end_and_reversed_runs_back(segment):
    s = np.linspace(0, 1, 101).reshape(-1, 1)
    points = segment.point(s)
    assert points.shape == (101, 1, 2)
    np.testing.assert_allclose(points[0, 0], segment.start, atol=1e-12)
    np.testing.assert_allclose(points[-1, 0], segment.end, atol=1e-12)
    np.testing.assert_allclose(segment.reversed().point(1 - s), points, atol=1e-12)
    np.testing.assert_allclose(segment.moved(3, -4).point(s), points + [3, -4], atol=1e-12)


@pytest.mark.parametrize("segment", SEGMENTS, ids=lambda s: type(s).__name__)
def test_bounds_hold_every_point_and_are_reached(segment):
    points = segment.point(np.linspace(0, 1, 200_001))
    dense = np.array([points[:, 0].min(), points[:, 0].max(), points[:, 1].min(), points[:, 1].max()])
    excess = (np.array(segment.bounds()) - dense) * [-1, 1, -1, 1]
    assert (excess > -1e-12).all()
    assert (excess < 1e-6).all()


@given(st.integers(1, 9), st.integers(0, 2**32 - 1), st.booleans())
@settings(deadline=None, max_examples=40)
def test_bounds_of_splines_of_any_degree_hold_every_point_and_are_reached(degree, seed, rational):
    rng = np.random.default_rng(seed)
    count = degree + 1 + rng.integers(0, 5)
    # Evenly spread knots: between crowded ones a curve turns more sharply than the points below can follow.
    inner = np.linspace(0, 1, count - degree + 1)[1:-1]
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    weights = rng.uniform(0.2, 5, count) if rational else None
    spline = Spline(degree, knots, rng.uniform(-100, 100, (count, 2)), weights)
    points = spline.point(np.sort(np.append(rng.uniform(0, 1, 5_000), knots)))
    dense = np.array([points[:, 0].min(), points[:, 0].max(), points[:, 1].min(), points[:, 1].max()])
    excess = (np.array(spline.bounds()) - dense) * [-1, 1, -1, 1]
    assert (excess > -1e-11).all()
    assert (excess < 0.05).all()


@pytest.mark.parametrize("tolerance", [1.0, 1e-2, 1e-4])
@pytest.mark.parametrize("segment", SEGMENTS, ids=lambda s: type(s).__name__)
def test_samples_stay_within_the_chord_tolerance(segment, tolerance):
    samples = segment.samples(tolerance)
    assert tuple(samples[0]) == segment.start
    assert tuple(samples[-1]) == segment.end
    points = segment.point(np.linspace(0, 1, 301))
    direction = np.diff(samples, axis=0)
    worst = 0.0
    for point in points:
        offset = point - samples[:-1]
        along = np.clip((offset * direction).sum(-1) / (direction**2).sum(-1), 0, 1)
        worst = max(worst, np.hypot(*(offset - along[:, None] * direction).T).min())
    assert worst <= tolerance * 1.001


def test_an_arc_of_three_quarters_is_bounded_by_its_quadrant_points():
    assert Arc((10, 20), 5, -math.pi / 4, 1.5 * math.pi).bounds() == pytest.approx(
        (5, 15, 20 - 5 * math.sqrt(0.5), 25), abs=1e-14
    )


def test_an_arc_between_two_points_has_the_sweep_and_the_ends_asked_for():
    for sweep in (-6.0, -math.pi, -0.1, 1e-3, 1.0, math.pi, 5.5):
        arc = arc_between((3, 4), (-7, 12), sweep)
        assert arc.sweep == sweep
        np.testing.assert_allclose([arc.start, arc.end], [(3, 4), (-7, 12)], atol=1e-10)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Line((0, math.nan), (1, 1)), "finite"),
        (lambda: Line((0, 0, 0), (1, 1)), "two finite numbers"),
        (lambda: Arc((0, 0), 0.0, 0, 1), "not above 0"),
        (lambda: Arc((0, 0), math.inf, 0, 1), "finite"),
        (lambda: Arc((0, 0), 1, 0, 7), "full turn"),
        (lambda: Arc((0, 0), 1, 0, 0), "must not be 0"),
        (lambda: Spline(0, np.zeros(2), np.zeros((2, 2))), "degree"),
        (lambda: Spline(2, np.zeros(5), np.zeros((2, 2))), "poles"),
        (lambda: Spline(1, np.array([0, 0, 1]), np.zeros((2, 2))), "knots"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.full((2, 2), np.nan)), "finite"),
        (lambda: Spline(1, np.array([0, 0, -1, -1]), np.zeros((2, 2))), "decrease"),
        (lambda: Spline(1, np.array([0, 0.5, 1, 1]), np.zeros((2, 2))), "clamped"),
        (lambda: Spline(1, np.array([0, 0, 0.5, 0.5, 1, 1]), np.zeros((4, 2))), "broken"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.zeros((2, 2)), np.array([1, 0])), "weights"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.ones((2, 2)), np.array([1, 1e-13])), "factor"),
        (lambda: Spline(1, np.array([0, 0, 1e-300, 1, 1]), np.ones((3, 2))), "differ"),
        (lambda: Spline(1, np.array([0, 0, 1e-300, 1e-300]), np.ones((2, 2))), "span"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.full((2, 2), 1e300)), "finite"),
        (lambda: Spline(26, np.repeat([0, 1], 27), np.ones((27, 2))), "degree"),
        (lambda: arc_between((0, 0), (0, 0), 1.0), "no arc"),
        (lambda: Line((0, 0), (1, 1)).samples(0), "tolerance"),
        (lambda: wavy_spline().samples(-1), "tolerance"),
        (lambda: Arc((0, 0), 1e5, 0, 6).samples(1e-12), "edges"),
    ],
)
def test_a_segment_that_is_not_one_is_refused(make, said):
    with pytest.raises(OutlineError, match=said):
        make()


def test_a_spline_is_not_broken_into_more_edges_than_the_limit(monkeypatch):
    monkeypatch.setattr("mirror_cad.outline.MAXIMUM_EDGES", 1000)
    assert len(wavy_spline().samples(1e-2)) < 1000
    with pytest.raises(OutlineError, match="more than 1000 edges"):
        wavy_spline().samples(1e-8)


# ---------------------------------------------------------------------------------------------------- truck outlines


@st.composite
def trucks(draw):
    width, left, right = (draw(st.floats(60, 400)) for _ in range(3))
    fraction = draw(st.floats(0, 1))
    try:
        truck_outline(width, left, right, 1e9)
    except OutlineError as error:
        largest = float(re.search(r"fits is ([0-9.e+-]+) mm", str(error))[1])
    return width, left, right, max(0.01, fraction * largest * 0.9999)


@given(trucks())
@examples
def test_a_truck_outline_has_the_closed_form_area_and_bounds(truck):
    width, left, right, radius = truck
    outline = truck_outline(*truck)
    assert outline.area_mm2() == pytest.approx(truck_area(*truck), rel=1e-12)
    tilt = math.atan2((left - right) / 2, width)
    # The arc at the higher side passes its top, the one at the lower side does not.
    y_max = max(
        left / 2 - radius * (math.tan((math.pi / 2 + tilt) / 2) - 1) if left >= right else -1,
        right / 2 - radius * (math.tan((math.pi / 2 - tilt) / 2) - 1) if right >= left else -1,
    )
    np.testing.assert_allclose(
        outline.bounding_box(), (-width / 2, width / 2, -y_max, y_max), rtol=0, atol=1e-12 * max(truck)
    )


@given(trucks())
@examples
def test_the_corner_arcs_of_a_truck_outline_are_tangent_to_the_sides(truck):
    segments = truck_outline(*truck).segments
    assert sum(isinstance(segment, Arc) and segment.radius_mm == truck[3] for segment in segments) == 4
    for one, other in zip(segments, segments[1:] + segments[:1], strict=True):
        assert math.dist(one.end, other.start) <= 1e-12 * max(truck)
        line, arc, at = (one, other, one.end) if isinstance(one, Line) else (other, one, one.end)
        if isinstance(line, Line) and isinstance(arc, Arc) and math.dist(line.start, line.end) > 1:
            along = np.subtract(line.end, line.start) / math.dist(line.start, line.end)
            assert abs(along @ np.subtract(at, arc.centre)) <= 1e-10 * truck[3] + 1e-9


def test_arcs_that_just_touch_leave_no_zero_length_lines():
    circle = truck_outline(200, 200, 200, 100)
    assert [type(segment) for segment in circle.segments] == [Arc] * 4
    assert circle.area_mm2() == pytest.approx(math.pi * 1e4, rel=1e-14)
    slot = truck_outline(300, 200, 200, 100)
    assert sorted(type(segment).__name__ for segment in slot.segments) == ["Arc"] * 4 + ["Line"] * 2


def test_a_truck_outline_without_radius_has_sharp_corners():
    outline = truck_outline(250, 400, 360, 0)
    assert all(isinstance(segment, Line) for segment in outline.segments)
    assert outline.area_mm2() == pytest.approx(250 * 380, rel=1e-14)
    assert outline.bounding_box() == (-125, 125, -200, 200)


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        ((250, 380, 380, 126), "largest radius that fits is 125 mm"),
        ((250, 380, 100, 90), "right corners"),
        ((250, 100, 380, 90), "left corners"),
        ((0, 380, 380, 10), "width_mm"),
        ((250, -1, 380, 10), "left_height_mm"),
        ((250, 380, math.nan, 10), "right_height_mm"),
        ((250, 380, 380, -1), "corner_radius_mm"),
        ((250, 380, 380, 1e-9), "corner_radius_mm"),
        ((250, 380, 380, math.inf), "corner_radius_mm"),
        ((0.5, 380, 380, 0), "0.5 mm wide"),
    ],
)
def test_a_truck_outline_that_cannot_be_is_refused_with_the_reason(sizes, said):
    with pytest.raises(OutlineError, match=said):
        truck_outline(*sizes)


# ------------------------------------------------------------------------------------------------------------- loops


@given(trucks(), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
@examples
def test_area_does_not_change_when_an_outline_is_moved(truck, dx, dy):
    outline = truck_outline(*truck)
    moved = outline.moved(dx, dy)
    assert moved.area_mm2() == pytest.approx(outline.area_mm2(), rel=1e-9)
    np.testing.assert_allclose(
        moved.bounding_box(), np.array(outline.bounding_box()) + [dx, dx, dy, dy], rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("spline", SEGMENTS[3:])
def test_the_area_of_a_spline_outline_is_that_of_its_polygon(spline):
    outline = closed_outline([spline], "spline")
    x, y = outline.polyline(1e-4).T
    polygon = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    assert outline.area_mm2() == pytest.approx(polygon, rel=1e-5)
    assert outline.area_mm2() == pytest.approx(spline.moved(500, 300).swept_area((7, 8)), rel=1e-12)


def test_a_clockwise_loop_is_turned_counter_clockwise():
    outline = truck_outline(250, 400, 360, 30)
    clockwise = [segment.reversed() for segment in reversed(outline.segments)]
    again = closed_outline(clockwise, "test")
    assert_same_outline(outline, again)
    assert closed_outline([Arc((0, 0), 10, 1, -2 * math.pi)], "test").area_mm2() == pytest.approx(100 * math.pi)


def test_a_polyline_is_counter_clockwise_and_does_not_repeat_its_first_vertex():
    polygon = truck_outline(250, 400, 360, 30).polyline(0.01)
    x, y = polygon.T
    assert np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0
    assert (np.hypot(*(polygon - np.roll(polygon, 1, axis=0)).T) > 0).all()


def test_small_gaps_are_joined_exactly_and_larger_ones_named():
    gap = 5e-4
    pieces = [
        Line((0, 0), (100, -gap)),
        Arc((100, 50), 50, -math.pi / 2, math.pi / 2),
        Arc((100 + gap / 2, 50 + gap / 2), 50, 0, math.pi / 2),
        Spline(1, np.array([0, 0, 1, 1]), np.array([(100, 100), (gap / 2, 100)])),
        Line((0, 100), (gap / 2, gap / 2)),
    ]
    outline = closed_outline(pieces, "file", 1e-3)
    for one, other in zip(outline.segments, outline.segments[1:] + outline.segments[:1], strict=True):
        assert math.dist(one.end, other.start) < 1e-12
    with pytest.raises(OutlineError, match=r"file: .* gap of 0.0005 mm between the end of segment 1 at \(100"):
        closed_outline(pieces, "file")
    with pytest.raises(OutlineError, match=r"gap of 10 mm .*segment 4 at \(0, 10\) mm and the start of segment 1"):
        closed_outline(
            [Line((0, 0), (50, 0)), Line((50, 0), (50, 50)), Line((50, 50), (0, 50)), Line((0, 50), (0, 10))], "x"
        )


def test_two_long_arcs_with_a_gap_move_by_no_more_than_the_gap():
    whole = Arc((0, 0), 100, 0, 1.9 * math.pi)
    rest = Arc((4e-4, 4e-4), 100, 1.9 * math.pi, 0.1 * math.pi)
    outline = closed_outline([whole, rest], "file", 1e-3)
    assert distance_to(whole.point(np.linspace(0, 1, 200)), outline) < 1e-3
    for one, other in zip(outline.segments, outline.segments[::-1], strict=True):
        assert math.dist(one.end, other.start) < 1e-9


BOW_TIE = [(0, 0), (100, 100), (100, 0), (0, 60)]


def loop(points):
    return [Line(a, b) for a, b in zip(points, [*points[1:], points[0]], strict=True)]


@pytest.mark.parametrize(
    ("segments", "said"),
    [
        (loop(BOW_TIE), r"crosses or touches itself at \(37.5, 37.5\)"),
        (loop([(0, 0), (100, 0), (100, 100), (50, 0), (0, 100)]), r"crosses or touches itself at \(50, 0\)"),
        (loop([(0, 0), (100, 0), (100, 100), (100, 150), (100, 100), (0, 100)]), r"folds .* \(100, 150\)"),
        (loop([(0, 0), (100, 0)]), "0 mm high|folds"),
        (loop([(0, 0), (100, 0), (50, 0.5)]), "0.5 mm high"),
        (loop([(0, 0), (2e5, 0), (50, 50)]), "200000 mm wide"),
        ([Arc((0, 0), 50, 0, math.pi), Line((-50, 0), (80, -40)), Line((80, -40), (-40, 40)),
          Line((-40, 40), (50, 0))], "crosses"),
        ([], "no segments"),
    ],
)  # fmt: skip
def test_a_loop_that_is_not_simple_or_has_no_size_is_refused(segments, said):
    with pytest.raises(OutlineError, match=said):
        closed_outline(segments, "test")


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)), min_size=3, max_size=9, unique=True))
@settings(deadline=None, max_examples=100)
def test_a_polygon_is_refused_exactly_when_two_of_its_edges_meet(points):
    count = len(points)
    edges = [(points[i], points[(i + 1) % count]) for i in range(count)]

    def side(a, b, c):
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    def on(a, b, c):
        return side(a, b, c) == 0 and min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(
            a[1], b[1]
        )  # fmt: skip

    def meet(one, other):
        (a, b), (c, d) = one, other
        if any((on(a, b, c), on(a, b, d), on(c, d, a), on(c, d, b))):
            return True
        return (side(a, b, c) > 0) != (side(a, b, d) > 0) and (side(c, d, a) > 0) != (side(c, d, b) > 0)

    bad = False
    for i in range(count):
        for j in range(i + 1, count):
            if j == i + 1 or (i == 0 and j == count - 1):
                first, second = (edges[i], edges[j]) if j == i + 1 else (edges[j], edges[i])
                bad |= on(*first, second[1]) or on(*second, first[0])
            else:
                bad |= meet(edges[i], edges[j])
    x, y = np.array(points, dtype=float).T
    assume(np.ptp(x) > 1 and np.ptp(y) > 1)
    try:
        outline = closed_outline(loop(points), "polygon")
    except OutlineError:
        assert bad
    else:
        assert not bad
        assert outline.area_mm2() == pytest.approx(abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2)


def test_a_tangle_of_many_lines_is_refused_quickly():
    angle = np.arange(3_001) * (math.pi - 1e-3)
    points = [tuple(point) for point in 100 * np.column_stack([np.cos(angle), np.sin(angle)])]
    began = time.perf_counter()
    with pytest.raises(OutlineError, match="tangled|crosses"):
        closed_outline(loop(points), "star")
    assert time.perf_counter() - began < 10


# ---------------------------------------------------------------------------------------------------------- contains


@given(st.floats(2, 300), st.floats(-500, 500), st.floats(-500, 500), st.integers(0, 2**32 - 1))
@examples
def test_contains_agrees_with_the_closed_form_of_a_circle(radius, cx, cy, seed):
    outline = closed_outline([Arc((cx, cy), radius, 0.3, 2 * math.pi)], "circle")
    x, y = np.random.default_rng(seed).uniform(-1.2 * radius, 1.2 * radius, (2, 50, 20))
    distance = np.hypot(x, y) - radius
    clear = np.abs(distance) > 1.01e-4
    np.testing.assert_array_equal(outline.contains(cx + x, cy + y)[clear], (distance < 0)[clear])


def test_contains_broadcasts_and_holds_at_the_heights_of_vertices():
    outline = closed_outline(loop([(0, 0), (10, 0), (10, 10), (5, 5), (0, 10)]), "notched")
    inside = outline.contains(np.array([1.0, 5.0, 9.0, 11.0, -1.0]), np.array([[5.0], [8.0], [0.0001]]))
    assert inside.tolist() == [[True, True, True, False, False], [True, False, True, False, False],
                               [True, True, True, False, False]]  # fmt: skip
    assert outline.contains(3, 3).shape == ()
    assert not outline.contains(math.nan, 3)
    assert not outline.contains(3, math.nan)
    assert outline.contains(np.zeros(0), np.zeros(0)).shape == (0,)


def test_contains_takes_a_million_points_in_seconds():
    outline = truck_outline(250, 400, 360, 60)
    x, y = np.random.default_rng(1).uniform(-220, 220, (2, 1_000_000))
    began = time.perf_counter()
    inside = outline.contains(x, y)
    assert time.perf_counter() - began < 3
    assert inside.mean() * 440**2 == pytest.approx(outline.area_mm2(), rel=5e-3)


# --------------------------------------------------------------------------------------------------------------- DXF


@given(trucks(), st.floats(-300, 300), st.floats(-300, 300))
@examples
def test_a_truck_outline_written_to_dxf_reads_back_the_same(tmp_path, truck, dx, dy):
    outline = truck_outline(*truck).moved(dx, dy)
    assume(all(math.dist(segment.start, segment.end) > 0.01 for segment in outline.segments))
    write_dxf(outline, tmp_path / "o.dxf")
    assert_same_outline(outline, read_outline(tmp_path / "o.dxf"))


@pytest.mark.parametrize("segment", [Arc((3, 4), 50, 0, 2 * math.pi), *SEGMENTS[3:]], ids=lambda s: type(s).__name__)
def test_a_closed_segment_written_to_dxf_reads_back_the_same(tmp_path, segment):
    outline = closed_outline([segment], "test")
    write_dxf(outline, tmp_path / "o.dxf")
    assert_same_outline(outline, read_outline(tmp_path / "o.dxf"))


def test_a_clockwise_arc_in_an_outline_reads_back_clockwise(tmp_path):
    bitten = loop([(0, 0), (100, 0), (100, 100), (0, 100)])
    bitten[1:2] = [
        Line((100, 0), (100, 20)),
        Arc((100, 50), 30, 1.5 * math.pi, -math.pi),
        Line((100, 80), (100, 100)),
    ]
    outline = closed_outline(bitten, "test")
    assert outline.area_mm2() == pytest.approx(1e4 - 450 * math.pi, rel=1e-14)
    write_dxf(outline, tmp_path / "o.dxf")
    assert_same_outline(outline, read_outline(tmp_path / "o.dxf"))


def test_the_written_dxf_is_r2010_in_mm_on_the_layer_outline(tmp_path):
    write_dxf(truck_outline(250, 400, 360, 30), tmp_path / "o.dxf")
    document = ezdxf.readfile(tmp_path / "o.dxf")
    assert (document.dxfversion, document.header["$INSUNITS"]) == ("AC1024", 4)
    assert {entity.dxf.layer for entity in document.modelspace()} == {"OUTLINE"}
    assert not document.audit().has_errors


def test_two_writes_are_byte_identical_when_source_date_epoch_is_set(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    outline = closed_outline([wavy_spline(WEIGHTS)], "test")
    write_dxf(outline, tmp_path / "a.dxf")
    time.sleep(0.01)
    write_dxf(outline, tmp_path / "b.dxf")
    assert (tmp_path / "a.dxf").read_bytes() == (tmp_path / "b.dxf").read_bytes()
    assert ezdxf.options.write_fixed_meta_data_for_testing is False


def test_a_dxf_that_cannot_be_written_or_would_lose_a_segment_is_an_error(tmp_path):
    with pytest.raises(OutlineError, match="cannot be written"):
        write_dxf(truck_outline(250, 400, 360, 30), tmp_path / "missing" / "o.dxf")
    tiny = closed_outline(loop([(0, 0), (100, 0), (100, 100), (100 - 5e-4, 100), (0, 100)]), "test")
    with pytest.raises(OutlineError, match="segment 3 at .* not longer than 0.001 mm"):
        write_dxf(tiny, tmp_path / "o.dxf")


@pytest.mark.parametrize(
    ("unit", "mm"), [(0, 1), (1, 25.4), (2, 304.8), (4, 1), (5, 10), (6, 1000), (9, 0.0254), (10, 914.4), (14, 100)]
)
def test_dxf_units_are_converted_to_mm(tmp_path, unit, mm):
    size = 200 / mm

    def draw(space):
        space.add_line((0, 0), (size, 0))
        space.add_arc((size, size / 2), size / 2, -90, 90)
        space.add_spline(degree=1).set_open_uniform([(size, size), (0, size)], degree=1)
        space.add_lwpolyline([(0, size, 0, 0, 1), (0, 0)])

    outline = read_outline(dxf(tmp_path, draw, units=unit))
    assert outline.bounding_box() == pytest.approx((-100, 300, 0, 200), abs=1e-9)
    assert outline.area_mm2() == pytest.approx(200 * 200 + math.pi * 100**2, rel=1e-12)


def test_an_unknown_dxf_unit_is_an_error_naming_the_code(tmp_path):
    for code in (18, 99):
        path = dxf(tmp_path, square)
        path.write_text(re.sub(r"(\$INSUNITS\s+70\s+)4\b", rf"\g<1>{code}", path.read_text()))
        with pytest.raises(OutlineError, match=rf"\$INSUNITS = {code}"):
            read_outline(path)


@given(st.randoms(use_true_random=False), trucks())
@examples
def test_dxf_pieces_are_chained_in_any_order_and_direction(tmp_path, shuffler: random.Random, truck):
    outline = truck_outline(*truck)
    assume(all(math.dist(segment.start, segment.end) > 0.01 for segment in outline.segments))
    pieces = list(outline.segments)
    shuffler.shuffle(pieces)

    def draw(space):
        for piece in pieces:
            # Half the allowed gap, to both sides.
            noise = [shuffler.uniform(-2e-4, 2e-4) for _ in range(4)]
            if isinstance(piece, Arc):
                turn = np.degrees([piece.start_angle, piece.start_angle + piece.sweep])
                space.add_arc(piece.centre, piece.radius_mm, *turn)
            else:
                ends = [np.add(piece.start, noise[:2]), np.add(piece.end, noise[2:])]
                shuffler.shuffle(ends)
                space.add_line(*ends)

    again = read_outline(dxf(tmp_path, draw))
    assert again.area_mm2() == pytest.approx(outline.area_mm2(), abs=1e-3 * sum(truck))
    for one, other in zip(again.segments, again.segments[1:] + again.segments[:1], strict=True):
        assert math.dist(one.end, other.start) < 1e-9


def test_a_dxf_ellipse_is_an_exact_rational_spline(tmp_path):
    outline = read_outline(dxf(tmp_path, lambda space: space.add_ellipse((10, 20), (30, 40), 0.5)))
    assert [type(segment) for segment in outline.segments] == [Spline]
    assert outline.area_mm2() == pytest.approx(math.pi * 50 * 25, rel=1e-13)
    x, y = (outline.segments[0].point(np.linspace(0, 1, 500)) - [10, 20]).T
    u, v = (0.6 * x + 0.8 * y) / 50, (0.6 * y - 0.8 * x) / 25
    np.testing.assert_allclose(u**2 + v**2, 1, atol=1e-13)
    half_width, half_height = math.hypot(30, 20), math.hypot(40, 15)
    assert outline.bounding_box() == pytest.approx(
        (10 - half_width, 10 + half_width, 20 - half_height, 20 + half_height), abs=1e-12
    )


def test_a_dxf_ellipse_of_ratio_one_is_an_arc_and_half_an_ellipse_closes_with_a_line(tmp_path):
    outline = read_outline(dxf(tmp_path, lambda space: space.add_ellipse((0, 0), (0, 40), 1)))
    assert [type(segment) for segment in outline.segments] == [Arc]

    def draw(space):
        space.add_ellipse((0, 0), (50, 0), 0.4, 0, math.pi)
        space.add_line((-50, 0), (50, 0))

    half = read_outline(dxf(tmp_path, draw))
    assert half.area_mm2() == pytest.approx(math.pi * 50 * 20 / 2, rel=1e-13)
    assert half.bounding_box() == pytest.approx((-50, 50, 0, 20), abs=1e-12)


@pytest.mark.parametrize("old", [False, True], ids=["LWPOLYLINE", "POLYLINE"])
def test_polyline_bulges_are_arcs(tmp_path, old):
    # A bulge of 1 is half a circle, of -1 one that bites into the square, of tan(pi/8) a quarter circle.
    points = [(0, 0, 1), (100, 0, 0), (100, 100, -1), (0, 100, math.tan(math.pi / 8))]

    def draw(space):
        if old:
            space.add_polyline2d(points, format="xyb", close=True)
        else:
            space.add_lwpolyline([*points, points[-1]], format="xyb", close=True)

    outline = read_outline(dxf(tmp_path, draw))
    radius = 100 / math.sqrt(2)
    assert outline.area_mm2() == pytest.approx(1e4 + radius**2 / 2 * (math.pi / 2 - 1), rel=1e-13)
    assert outline.bounding_box() == pytest.approx((50 - radius, 100, -50, 100), abs=1e-12)
    assert sorted(type(segment).__name__ for segment in outline.segments) == ["Arc", "Arc", "Arc", "Line"]


def test_a_flat_3d_polyline_is_an_outline_and_a_hilly_one_is_not(tmp_path):
    corners = [(0, 0, 5), (100, 0, 5), (50, 80, 5)]
    outline = read_outline(dxf(tmp_path, lambda space: space.add_polyline3d(corners, close=True)))
    assert outline.area_mm2() == pytest.approx(4000)
    with pytest.raises(OutlineError, match=r"z = 5 mm .* but 6 mm at POLYLINE with handle"):
        read_outline(dxf(tmp_path, lambda space: space.add_polyline3d([*corners[:2], (50, 80, 6)], close=True)))


@pytest.mark.parametrize("rational", [False, True])
def test_an_unclamped_dxf_spline_becomes_the_clamped_one_of_the_same_curve(tmp_path, rational):
    angle = np.arange(11) * 2 * math.pi / 8
    poles = np.column_stack([90 * np.cos(angle), 60 * np.sin(angle), np.full(11, 3.0)])
    weights = np.array([1, 2, 1, 0.5, 1, 3, 1, 1, 1, 2, 1]) if rational else np.ones(11)
    knots = np.arange(15.0)

    def draw(space):
        spline = space.add_spline(degree=3)
        spline.control_points, spline.knots = poles, knots
        if rational:
            spline.weights = weights

    outline = read_outline(dxf(tmp_path, draw))
    t = np.linspace(3, 11, 200)
    # De Boor's algorithm in homogeneous coordinates, on its own.
    expected = []
    for u in t:
        k = min(int(u), 10)
        d = [np.append(poles[j, :2] * weights[j], weights[j]) for j in range(k - 3, k + 1)]
        for r in range(1, 4):
            for j in range(3, r - 1, -1):
                a = (u - knots[j + k - 3]) / (knots[j + 1 + k - r] - knots[j + k - 3])
                d[j] = (1 - a) * d[j - 1] + a * d[j]
        expected.append(d[3][:2] / d[3][2])
    np.testing.assert_allclose(outline.segments[0].point((t - 3) / 8), expected, atol=1e-11)


def test_dxf_entities_seen_from_below_are_mirrored(tmp_path):
    below = {"extrusion": (0, 0, -1)}

    def draw(space):
        space.add_arc((-100, 50, -7), 50, 90, 270, dxfattribs=below)
        space.add_lwpolyline(
            [(-100, 0, 0), (0, 0, -1), (0, 100, 0), (-100, 100, 0)], "xyb", dxfattribs={**below, "elevation": -7}
        )

    ocs = OCS((0, 0, -1))
    assert ocs.to_wcs((-100, 50, -7)) == (100, 50, 7)
    outline = read_outline(dxf(tmp_path, draw))
    # The arc bulges to the right of x = 100, the polyline's to the left of x = 0 or into the square as OCS has it.
    arcs = [segment for segment in outline.segments if isinstance(segment, Arc)]
    assert outline.bounding_box() == pytest.approx((0, 150, 0, 100), abs=1e-12)
    assert sorted(np.sign(arc.sweep) for arc in arcs) == [-1, 1]
    assert outline.area_mm2() == pytest.approx(1e4, rel=1e-13)

    def draw_half(space):
        space.add_ellipse((0, 0), (50, 0), 0.4, 0, math.pi, dxfattribs=below)
        space.add_line((-50, 0), (50, 0))

    # Of an ellipse the extrusion turns only the sense of its angle.
    assert read_outline(dxf(tmp_path, draw_half)).bounding_box() == pytest.approx((-50, 50, -20, 0), abs=1e-12)


def test_entities_seen_from_below_agree_with_the_points_of_the_reading_library(tmp_path):
    def draw(space):
        space.add_arc((-20, 5), 40, 30, 250, dxfattribs={"extrusion": (0, 0, -1)})
        arc = space[0]
        space.add_line(arc.start_point, arc.end_point)

    outline = read_outline(dxf(tmp_path, draw))
    sector, triangle = 40**2 / 2 * math.radians(220), 40**2 / 2 * math.sin(math.radians(220))
    assert outline.area_mm2() == pytest.approx(sector - triangle, rel=1e-12)


def test_knots_that_differ_by_rounding_only_are_one_knot(tmp_path):
    spline = wavy_spline()
    knots = spline.knots + 1e-14 * np.arange(len(spline.knots))

    def draw(space):
        entity = space.add_spline(degree=3)
        entity.control_points, entity.knots = np.pad(spline.poles, ((0, 0), (0, 1))), knots

    outline = read_outline(dxf(tmp_path, draw))
    assert len(np.unique(outline.segments[0].knots)) == len(np.unique(spline.knots))
    s = np.linspace(0, 1, 50)
    np.testing.assert_allclose(outline.segments[0].point(s), spline.point(s), atol=1e-9)


def test_annotations_are_ignored(tmp_path):
    def draw(space):
        square(space)
        space.add_text("mirror")
        space.add_mtext("mirror")
        space.add_point((50, 50))
        space.add_linear_dim(base=(0, -20), p1=(0, 0), p2=(100, 0)).render()

    assert read_outline(dxf(tmp_path, draw)).area_mm2() == pytest.approx(1e4)


def test_pieces_without_length_are_dropped(tmp_path):
    def draw(space):
        square(space)
        space.add_line((100, 0), (100, 0))
        space.add_line((100, 100), (100, 100 + 5e-4))
        space.add_circle((0, 0), 1e-4)

    assert len(read_outline(dxf(tmp_path, draw)).segments) == 4


def spline_with_fit_points(space):
    space.add_spline([(0, 0), (10, 10), (20, 0)])


def hatch(space):
    square(space)
    space.add_hatch().paths.add_polyline_path([(0, 0), (1, 0), (1, 1)])


def insert(space):
    space.doc.blocks.new("B")
    space.add_blockref("B", (0, 0))


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        (hatch, "HATCH with handle .* not supported"),
        (insert, "INSERT with handle .* not supported"),
        (spline_with_fit_points, "SPLINE with handle .* no poles"),
        (lambda space: space.add_3dface([(0, 0), (9, 0), (9, 9)]), "3DFACE with handle .* not supported"),
        (lambda space: space.add_polyface(), "POLYLINE with handle .* meshes"),
        (lambda space: space.add_circle((0, 0), 50, {"extrusion": (0, 1, 1)}), r"CIRCLE .* \(0, 1, 1\)"),
        (lambda space: space.add_ellipse((0, 0), (50, 0, 10), 0.5), "not in one plane"),
        (lambda space: None, "no outline found"),
        (lambda space: space.add_text("only"), "no outline found"),
        (lambda space: space.add_line((0, 0), (1e-4, 0)), "check the units"),
        (lambda space: [square(space), square(space, x=200)], r"2 closed loops and 0 leftover .*x 200 to 300"),
        (lambda space: [square(space), space.add_circle((50, 50), 10)], r"2 closed loops .*x 40 to 60 and y 40 to 60"),
        (lambda space: [square(space), space.add_line((20, 20), (30, 30))],
         r"1 closed loop and 1 leftover open piece found.*x 20 to 30"),
        (lambda space: [square(space), square(space)], r"4 pieces end at .*: LINE with handle .* duplicates"),
        (lambda space: [square(space), space.add_line((0, 0), (-5, -5))], r"3 pieces end at \(0, 0\)"),
        (lambda space: space.add_lwpolyline([(0, 0), (100, 0), (100, 100), (0, 100), (0, 0.25)]),
         r"gap of 0.25 mm between \(0, 0\) mm .* and \(0, 0.25\) mm"),
        (lambda space: [space.add_lwpolyline([(0, 0), (100, 0), (100, 100)]),
                        space.add_lwpolyline([(100, 103), (0, 100), (0, 0.5)])],
         r"gap of 0.5 mm between \(0, 0\) .*; gap of 3 mm between \(100, 100\)"),
        (lambda space: space.add_lwpolyline([(0, 0), (100, 100), (100, 0), (0, 60)], close=True), "crosses"),
        (lambda space: [space.add_line((0, 0), (math.cos(i), math.sin(i))) for i in range(50)], "50 pieces end at"),
        (lambda space: [square(space), space[0].dxf.set("start", (0, 0, 3))], "one plane"),
        (lambda space: square(space, size=0.5), "0.5 mm wide"),
    ],
)  # fmt: skip
def test_a_dxf_that_is_not_one_plane_closed_loop_is_an_error_saying_why(tmp_path, draw, said):
    with pytest.raises(OutlineError, match=said) as caught:
        read_outline(dxf(tmp_path, draw))
    assert "outline.dxf" in str(caught.value)


GARBAGE = [
    b"", b"\0", b"garbage", bytes(range(256)) * 40, b"0\nSECTION\n",
    b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n 10\nx\n",
    b"AutoCAD Binary DXF\r\n\x1a\0" + bytes(range(256)), b"0\nSECTION\n2\nENTITIES\n0\nARC\n8\n0\n0\nENDSEC\n0\nEOF\n",
    b"<svg", b"<svg xmlns='http://www.w3.org/2000/svg'/>", b"<html/>", b"\xff\xfe<\0s\0",
    b"<?xml version='1.0' encoding='no'?><svg/>",
]  # fmt: skip


@pytest.mark.parametrize("suffix", [".dxf", ".svg", ".DXF", ".Svg"])
@pytest.mark.parametrize("data", GARBAGE)
def test_garbage_is_an_outline_error(tmp_path, data, suffix):
    path = tmp_path / f"garbage{suffix}"
    path.write_bytes(data)
    with pytest.raises(OutlineError, match="garbage"):
        read_outline(path)


@given(st.data())
@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_read_or_is_an_outline_error(tmp_path, data):
    suffix = data.draw(st.sampled_from([".dxf", ".svg"]))
    whole = tmp_path / f"whole{suffix}"
    if not whole.exists():
        if suffix == ".dxf":
            write_dxf(truck_outline(250, 400, 360, 30), whole)
        else:
            whole.write_text(
                '<svg width="9cm" viewBox="0 0 90 90"><path d="M1 1H60A9 8 7 0 1 60 60C5 6 7 8 1 40z"/></svg>'
            )
    raw = bytearray(whole.read_bytes())
    # Damage the entities rather than the many tables before them.
    first = raw.index(b"ENTITIES") if suffix == ".dxf" else 0
    last = raw.index(b"OBJECTS") if suffix == ".dxf" else len(raw)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(first, last - 1))
        raw[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=4))
    path = tmp_path / f"damaged{suffix}"
    path.write_bytes(raw)
    try:
        read_outline(path)
    except OutlineError as error:
        assert "damaged" in str(error)


def test_files_that_are_missing_large_or_of_another_kind_are_errors(tmp_path):
    with pytest.raises(OutlineError, match=r"nothing\.dxf: cannot be read: No such file"):
        read_outline(tmp_path / "nothing.dxf")
    with pytest.raises(OutlineError, match=r"must end in \.dxf or \.svg, not '\.step'"):
        read_outline(tmp_path / "outline.step")
    (tmp_path / "folder.svg").mkdir()
    with pytest.raises(OutlineError, match="not a file"):
        read_outline(tmp_path / "folder.svg")
    large = tmp_path / "large.svg"
    with large.open("wb") as stream:
        stream.truncate(20_000_001)
    with pytest.raises(OutlineError, match="20000001 bytes"):
        read_outline(large)


def test_more_than_20000_segments_are_an_error_and_20000_are_read(tmp_path):
    angle = np.linspace(0, 2 * math.pi, 20_001)
    points = 100 * np.column_stack([np.cos(angle), np.sin(angle)])
    text = " ".join(f"{x!r},{y!r}" for x, y in points[:-1].tolist())
    assert len(read_outline(svg(tmp_path, f'<polygon points="{text}"/>')).segments) == 20_000
    with pytest.raises(OutlineError, match="more than 20000 segments"):
        read_outline(svg(tmp_path, f'<polygon points="{text} 101,-0.01"/>'))


# --------------------------------------------------------------------------------------------------------------- SVG

TRIANGLE = '<path d="M10 20 L110 20 L10 70 Z"/>'


@pytest.mark.parametrize(
    ("root", "scale"),
    [
        ("", (1, 1)),
        ('viewBox="-125 -190 250 380"', (1, 1)),
        ('width="250mm" height="380mm" viewBox="-125 -190 250 380"', (1, 1)),
        ('width="250" height="380" viewBox="-125 -190 250 380"', (1, 1)),
        ('width="100%" height="100%" viewBox="-125 -190 250 380"', (1, 1)),
        ('width="25cm" height="38cm" viewBox="0 0 500 760"', (0.5, 0.5)),
        ('width="10in" viewBox="0,0,127,5"', (2, 2)),
        ('height="10in" viewBox="0 0 5 127"', (2, 2)),
        ('width="960px" height="480px" viewBox="0 0 127 63.5"', (2, 2)),
        ('width="960px" height="480px"', (PX, PX)),
        ('width="72pt" height="6pc" viewBox="0 0 25.4 25.4"', (1, 1)),
        ('width="100mm" height="300mm" viewBox="0 0 100 100"', (1, 1)),
        ('width="100mm" height="300mm" viewBox="0 0 100 100" preserveAspectRatio="xMinYMax slice"', (3, 3)),
        ('width="100mm" height="300mm" viewBox="0 0 100 100" preserveAspectRatio="none"', (1, 3)),
    ],
)
def test_svg_size_and_view_box_give_the_scale_and_the_user_origin_is_the_mirrors(tmp_path, root, scale):
    outline = read_outline(svg(tmp_path, TRIANGLE, root))
    assert outline.bounding_box() == pytest.approx(
        (10 * scale[0], 110 * scale[0], -70 * scale[1], -20 * scale[1]), rel=1e-14
    )
    assert outline.area_mm2() == pytest.approx(2500 * scale[0] * scale[1])


@pytest.mark.parametrize(
    ("root", "said"),
    [
        ('width="500" height="760" viewBox="0 0 250 380"', 'write width="500mm"'),
        ('width="500mm" height="760" viewBox="0 0 250 380"', "both have a unit"),
        ('width="5em" viewBox="0 0 250 380"', "unit 'em' is not supported"),
        ('width="-5mm" viewBox="0 0 250 380"', "above 0"),
        ('width="wide" viewBox="0 0 250 380"', "not a length"),
        ('width="5mm" viewBox="0 0 250"', "viewBox"),
        ('width="5mm" viewBox="0 0 0 380"', "viewBox"),
        ('width="5mm" viewBox="0 0 5 5" preserveAspectRatio="middle"', "preserveAspectRatio"),
        ('width="5mm" viewBox="0 0 5 5" transform="scale(2)"', "transform"),
    ],
)
def test_an_svg_whose_scale_is_not_clear_is_an_error(tmp_path, root, said):
    with pytest.raises(OutlineError, match=said):
        read_outline(svg(tmp_path, TRIANGLE, root))


@pytest.mark.parametrize(
    ("transform", "box"),
    [
        ("translate(5)", (15, 115, -70, -20)),
        ("translate(5,-10)", (15, 115, -60, -10)),
        ("scale(2)", (20, 220, -140, -40)),
        ("scale(2 -1)", (20, 220, 20, 70)),
        ("rotate(90)", (-70, -20, -110, -10)),
        ("rotate(90 10 20)", (-40, 10, -120, -20)),
        ("matrix(0 1 -1 0 3 4)", (-67, -17, -114, -14)),
        ("skewX(45)", (30, 130, -70, -20)),
        ("skewY(45)", (10, 110, -130, -30)),
        (" translate(5 0) , scale(2)\n", (25, 225, -140, -40)),
        ("scale(2)translate(5 0)", (30, 230, -140, -40)),
    ],
)
def test_svg_transforms_apply_to_what_they_enclose(tmp_path, transform, box):
    on_path = svg(tmp_path, TRIANGLE.replace("/>", f' transform="{transform}"/>'))
    assert read_outline(on_path).bounding_box() == pytest.approx(box, abs=1e-12)
    on_group = svg(tmp_path, f'<g transform="scale(0.5)"><a><g transform="{transform}">{TRIANGLE}</g></a></g>')
    assert read_outline(on_group).bounding_box() == pytest.approx(np.array(box) / 2, abs=1e-12)


@pytest.mark.parametrize(
    ("body", "area", "kinds"),
    [
        ('<circle cx="5" cy="6" r="40"/>', 1600 * math.pi, {Arc}),
        ('<ellipse cx="5" cy="6" rx="40" ry="20"/>', 800 * math.pi, {Spline}),
        ('<ellipse rx="40"/>', 1600 * math.pi, {Arc}),
        ('<circle r="40" transform="rotate(30) scale(2 1)"/>', 3200 * math.pi, {Spline}),
        ('<circle r="40" transform="rotate(30) scale(2 -2)"/>', 6400 * math.pi, {Arc}),
        ('<rect x="5" y="6" width="80" height="40"/>', 3200, {Line}),
        ('<rect x="5" y="6" width="80" height="40" rx="10"/>', 3200 - 100 * (4 - math.pi), {Line, Arc}),
        ('<rect width="80" height="40" rx="10" ry="5"/>', 3200 - 50 * (4 - math.pi), {Line, Spline}),
        ('<rect width="80" height="40" rx="100"/>', 800 * math.pi, {Spline}),
        ('<rect width="80" height="40" ry="20"/>', 1600 + 400 * math.pi, {Line, Arc}),
        ('<polygon points="0,0 80,0,80-40"/>', 1600, {Line}),
        ('<polyline points="0,0 80,0 80,40 0 0"/>', 1600, {Line}),
        ('<line x2="80"/><line x1="80" x2="80" y2="40"/><polyline points="80 40 0 0"/>', 1600, {Line}),
        ('<path d="M0 0h80v40H0V0"/>', 3200, {Line}),
        ('<path d="m0 0 80 0 0 40-80 0z"/>', 3200, {Line}),
        ('<path d="M0,0A40,40,0,0,1,80,0A40 40 0 01 0 0Z"/>', 1600 * math.pi, {Arc}),
        ('<path d="M0 0a40 20 0 1080 0a40 20 0 10-80 0z"/>', 800 * math.pi, {Spline}),
        ('<path d="M0 0A1 1 0 0 0 80 0z"/>', 800 * math.pi, {Line, Arc}),
        ('<path d="M0 0A0 1 0 0 0 80 0L80 40z"/>', 1600, {Line}),
        ('<path d="M0 0Q40 60 80 0z"/>', 80 * 30 * 2 / 3, {Line, Spline}),
        ('<path d="M0 0C0 40 80 40 80 0z"/>', 80 * 30 * 0.8, {Line, Spline}),
        ('<path d="M0 0Q20 30 40 0T80 0L80 100L0 100z"/>', 8000, {Line, Spline}),
    ],
)
def test_every_svg_shape_has_its_area(tmp_path, body, area, kinds):
    outline = read_outline(svg(tmp_path, body))
    assert outline.area_mm2() == pytest.approx(area, rel=1e-12)
    assert {type(segment) for segment in outline.segments} == kinds


@given(st.data())
@examples
def test_svg_path_curves_agree_with_an_independent_reader(tmp_path, data):
    number = st.floats(-30, 30).map(lambda value: round(value, 3))

    def numbers(count):
        return " ".join(repr(data.draw(number)) for _ in range(count))

    # A fan of curves bulging outwards by little is simple whatever the numbers: each piece stays in its own sector.
    text, corner = "M 300 0", (300.0, 0.0)
    for i in range(1, 7):
        end = (300 * math.cos(i * math.pi / 3), 300 * math.sin(i * math.pi / 3)) if i < 6 else (300.0, 0.0)
        kind = data.draw(st.sampled_from("CcSsQqTtAaLlHhVv"))
        dx, dy = (end[0] - corner[0], end[1] - corner[1]) if kind.islower() else end
        third = [(corner[0] + (end[0] - corner[0]) * k / 3, corner[1] + (end[1] - corner[1]) * k / 3) for k in (1, 2)]
        inner = [(x + data.draw(number), y + data.draw(number)) for x, y in third]
        if kind.islower():
            inner = [(x - corner[0], y - corner[1]) for x, y in inner]
        first, second = (f"{x!r} {y!r}" for x, y in inner)
        upper = kind.upper()
        if upper == "C":
            text += f"{kind}{first},{second},{dx!r},{dy!r}"
        elif upper in "SQ":
            text += f"{kind}{second} {dx!r} {dy!r}"
        elif upper == "A":
            rx, ry = (data.draw(st.floats(200, 900)) for _ in range(2))
            text += f"{kind}{rx!r} {ry!r} {data.draw(number)!r} 0 {data.draw(st.integers(0, 1))} {dx!r} {dy!r}"
        else:
            text += f"L{end[0]!r} {end[1]!r}"
        corner = end
    try:
        outline = read_outline(svg(tmp_path, f'<path d="{text}Z"/>'))
    except OutlineError as error:
        assert "crosses" in str(error) or "folds" in str(error)
        assume(False)
    theirs = [piece.point(t) for piece in parse_path(text) for t in np.linspace(0, 1, 9)]
    points = np.column_stack([np.real(theirs), -np.imag(theirs)])
    assert distance_to(points, outline) < 2e-4


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (TRIANGLE + '<circle r="3" cx="500" id="spot"/>', r"2 closed loops .*\(from <circle id='spot'>\)"),
        ('<path d="M0 0H50V50H0z m10 10h5v5h-5z"/>', "2 closed loops"),
        ('<path id="p" d="M0 0H50V50H0V1"/>', r"gap of 1 mm between \(0, .*0\) mm \(<path id='p'>\) and \(0, -1\) mm"),
        ('<path d="M0 0L50 50V0L0 30z"/>', "crosses"),
        ('<use href="#a"/>', "<use>: .* not supported"),
        ('<image href="a.png"/>', "<image>"),
        ('<svg><circle r="5"/></svg>', "<svg>"),
        ('<g clip-path="url(#a)"><circle r="5"/></g>', "clip-path"),
        ('<circle r="5" style="transform: scale(2)"/>', "'transform' by CSS"),
        ('<style>circle{r:5}</style><circle r="9"/>', "'r' by CSS"),
        ('<circle r="50%"/>', "user units"),
        ('<circle r="5mm"/>', "user units"),
        ('<circle r="-5"/>', "negative"),
        ('<circle r="5" transform="scale(0)"/>', "flat"),
        ('<circle r="5" transform="spin(3)"/>', "transform spin"),
        ('<circle r="5" transform="scale(3"/>', "not understood"),
        ('<path d="L0 0"/>', "begins with 'L'"),
        ('<path d="M0 0L5 foo"/>', "'foo'"),
        ('<path d="M0 0L5"/>', "L has 1 numbers"),
        ('<path d="M0 0L5 6,"/>', "ends in ','"),
        ('<path d="M0 0A5 5 0 2 0 9 9"/>', "'2 0 9 9'"),
        ('<path d="M0 0H1e999"/>', "not a finite number"),
        ('<polygon points="0 0 1 1 2"/>', "an x without a y"),
        ("<text>outline</text><defs><circle r='9'/></defs>", "no outline found"),
        ('<g style="display:none">' + TRIANGLE + "</g>", "no outline found"),
    ],
)
def test_an_svg_that_is_not_one_closed_path_is_an_error_saying_why(tmp_path, body, said):
    with pytest.raises(OutlineError, match=said) as caught:
        read_outline(svg(tmp_path, body))
    assert "outline.svg" in str(caught.value)


def test_lengths_with_units_in_an_svg_of_physical_size_are_true(tmp_path):
    outline = read_outline(svg(tmp_path, '<circle r="5mm"/>', f'width="100mm" viewBox="0 0 {100 / PX} 9"'))
    assert outline.bounding_box() == pytest.approx((-5, 5, -5, 5), rel=1e-12)


def test_what_is_not_drawn_in_an_svg_is_ignored(tmp_path):
    body = (
        "<title>t</title><defs><circle r='5'/></defs><circle r='7' display='none'/><!-- c --><?pi?>"
        "<n:view xmlns:n='urn:n'><circle r='6'/></n:view><text>t</text><style>path{fill:none}</style>" + TRIANGLE
    )
    assert read_outline(svg(tmp_path, body)).area_mm2() == pytest.approx(2500)


def test_entities_in_a_document_type_are_refused_and_a_plain_one_is_not(tmp_path):
    laughs = "<!DOCTYPE svg [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;'>]>"
    external = "<!DOCTYPE svg [<!ENTITY a SYSTEM 'file:///etc/hostname'>]>"
    parameter = "<!DOCTYPE svg [<!ENTITY % a SYSTEM 'http://localhost/'> %a;]>"
    for head in (laughs, external, parameter):
        with pytest.raises(OutlineError, match="declares the entity '[ab]'"):
            read_outline(svg(tmp_path, TRIANGLE, head=head))
    plain = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    assert read_outline(svg(tmp_path, TRIANGLE, head=plain)).area_mm2() == pytest.approx(2500)


def test_deeply_nested_groups_are_read(tmp_path):
    depth = 5000
    outline = read_outline(svg(tmp_path, "<g>" * depth + TRIANGLE + "</g>" * depth))
    assert outline.area_mm2() == pytest.approx(2500)
