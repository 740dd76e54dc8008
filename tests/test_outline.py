"""What is true of outlines: truck outlines, closed loops, and which points lie inside."""

import math
import time

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mirror_cad.errors import OutlineError
from mirror_cad.outline import Arc, Line, Spline, closed_outline, truck_outline
from tests.outline_helpers import SEGMENTS, assert_same_outline, distance_to, examples, loop, trucks


def truck_area(width: float, left: float, right: float, radius: float) -> float:
    """Trapezium less, at every corner of angle a, the kite r^2 / tan(a/2) less the sector r^2 (pi - a) / 2."""
    tilt = math.atan2((left - right) / 2, width)
    area = width * (left + right) / 2
    for turn in (math.pi / 2 + tilt, math.pi / 2 - tilt):
        area -= 2 * radius**2 * (math.tan(turn / 2) - turn / 2)
    return area


# ---------------------------------------------------------------------------------------------------- truck outlines


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
