"""Rectangles and segments within outlines: closed forms, polygons against a dense search, and where verdicts turn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mirror_cad.errors import SpecError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.quadric import Quadric
from mirror_studio.rules.sizes import area_of, contains, inscribed_circle, longest_rectangle, longest_upright, outline_of
from mirror_studio.rules.verdicts import judged
from raytrace.reflector import Reflector
from raytrace.surfaces.quadric import QuadricFace
from tests.conftest import designed
from tests.rule_mirrors import TOWARDS_Z, measured, plane, rectangle, sphere
from tests.test_spherometer import line

Array = NDArray[np.float64]

SEARCH_MM = 1e-6  # what a search between samples is promised to


def ellipse(a: float, b: float, count: int = 4096) -> Array:
    t = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.stack([a * np.cos(t), b * np.sin(t)], axis=1)


def test_rectangle_in_an_ellipse() -> None:
    """Of height h it is 2a√(1 − (h/2b)²) long, and the longest upright segment is 2b."""
    found = longest_rectangle(ellipse(110.0, 70.0), 40.0)
    assert found is not None
    assert found.width == pytest.approx(220.0 * np.sqrt(1.0 - (20.0 / 70.0) ** 2), abs=2e-4)  # the polygon's chords: a/n²
    assert longest_upright(ellipse(110.0, 70.0)).height == pytest.approx(140.0, abs=SEARCH_MM)
    assert longest_rectangle(ellipse(110.0, 19.9), 40.0) is None


def test_rectangle_in_a_trapezium_lies_on_its_base() -> None:
    trapezium = np.array([[-100.0, 0.0], [100.0, 0.0], [50.0, 100.0], [-50.0, 100.0]])
    found = longest_rectangle(trapezium, 40.0)
    assert found is not None
    assert (found.x_min, found.x_max, found.y_min) == pytest.approx((-80.0, 80.0, 0.0), abs=SEARCH_MM)


def test_a_notch_is_not_spanned() -> None:
    """A polygon like a U: no rectangle over the gap."""
    u = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 100.0], [140.0, 100.0], [140.0, 30.0], [70.0, 30.0], [70.0, 100.0],
                  [0.0, 100.0]])
    found = longest_rectangle(u, 40.0)
    assert found is not None
    assert found.width == pytest.approx(70.0, abs=SEARCH_MM)
    low = longest_rectangle(u, 30.0)
    assert low is not None
    assert low.width == pytest.approx(200.0, abs=SEARCH_MM)
    assert longest_upright(u).height == pytest.approx(100.0, abs=SEARCH_MM)


@given(st.lists(st.floats(30.0, 100.0), min_size=5, max_size=12), st.floats(5.0, 40.0))
@settings(max_examples=15)
def test_star_shaped_outlines_against_a_dense_search(radii: list[float], height: float) -> None:
    """No rectangle of a fine, dumb search is longer, and the found one holds no point of the outline."""
    angle = np.linspace(0.0, 2.0 * np.pi, len(radii), endpoint=False) + 0.1
    corners = np.array(radii)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = longest_rectangle(corners, height)
    side = np.concatenate([a + np.linspace(0.0, 1.0, 400)[:, None] * (b - a) for a, b in
                           zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    length = 0.0
    for y in np.linspace(corners[:, 1].min(), corners[:, 1].max() - height, 150):
        x = np.sort(side[(side[:, 1] > y) & (side[:, 1] < y + height), 0])
        for gap in np.flatnonzero(np.diff(x) > length + 1.5):
            middle = 0.5 * (x[gap] + x[gap + 1])
            if contains(corners, float(middle), float(y + 0.5 * height)):
                length = max(length, float(x[gap + 1] - x[gap]) - 1.0)
    if found is None:
        assert length == 0.0
        return
    assert found.width >= length - 1e-9
    within = (side[:, 0] > found.x_min + 1e-6) & (side[:, 0] < found.x_max - 1e-6)
    assert not (within & (side[:, 1] > found.y_min + 1e-6) & (side[:, 1] < found.y_max - 1e-6)).any()
    assert contains(corners, 0.5 * (found.x_min + found.x_max), 0.5 * (found.y_min + found.y_max))


def test_circle_within() -> None:
    assert inscribed_circle(rectangle(120.0, 78.0)) == pytest.approx(78.0, abs=1e-4)
    assert inscribed_circle(ellipse(50.0, 50.0, 720)) == pytest.approx(100.0 * np.cos(np.pi / 720), abs=1e-3)


# --- verdicts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "numerator"), [("I", 150.0), ("II", 170.0), ("III", 130.0)])
@pytest.mark.parametrize(("too_short", "verdict"), [(0.05, "missed"), (-0.05, "met"), (0.0, "met")])
def test_rectangle_of_each_class(name: str, numerator: float, too_short: float, verdict: str) -> None:
    """a = numerator/(1 + 1000/r) at r = 1500; a cap's rectangle 40 mm high is as wide as the cap at y = ±20."""
    r = 1500.0
    a = numerator / (1.0 + 1000.0 / r)
    angle = 2.0 * np.arcsin(0.5 * (a - too_short) / r / np.cos(np.arcsin(20.0 / r)))
    m = measured(sphere(r, float(angle) * r, 220.0))
    found = line(judged(m, name), "rectangle_mm")
    assert found.value == pytest.approx(a - too_short, abs=1e-5)
    assert found.limit[0] == pytest.approx(a, rel=1e-9)
    assert found.verdict == verdict


@pytest.mark.parametrize(("name", "b"), [("II", 200.0), ("III", 70.0)])
@pytest.mark.parametrize(("change", "verdict"), [(-0.05, "missed"), (0.05, "met"), (0.0, "met")])
def test_segment_of_each_class(name: str, b: float, change: float, verdict: str) -> None:
    m = measured(plane(220.0, b + change))
    found = line(judged(m, name), "segment_b_mm")
    assert found.value == pytest.approx(b + change, abs=1e-9)
    assert found.verdict == verdict


def test_flat_mirror_has_the_longest_rectangle() -> None:
    assert line(judged(measured(plane()), "II"), "rectangle_mm").limit[0] == 170.0


def test_outline_is_that_of_the_design() -> None:
    mirror = designed("progressive-c")
    corners = outline_of(Reflector.from_mirror(mirror))
    assert abs(area_of(corners)) == pytest.approx(mirror.outline.area_mm2(), rel=1e-7)


def test_outline_of_a_mesh_is_its_edge() -> None:
    x, y = np.meshgrid(np.linspace(-90.0, 90.0, 19), np.linspace(-60.0, 60.0, 13))
    vertices = np.stack([x.ravel(), y.ravel(), -(x**2 + y**2).ravel() / 2400.0], axis=1)
    k = np.arange(19 * 13).reshape(13, 19)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)
    reflector = Reflector.of_mesh(SurfaceMesh(vertices, faces))
    corners = outline_of(reflector)
    assert np.ptp(corners, axis=0) == pytest.approx([180.0, 120.0], abs=0.01)
    found = longest_rectangle(corners, 40.0)
    assert found is not None
    assert found.width == pytest.approx(180.0, abs=0.02)


def test_face_with_a_hole_is_refused() -> None:
    face = QuadricFace(Quadric("plane", np.zeros(3), np.eye(3), 0.0), (rectangle(200.0, 100.0), rectangle(20.0, 20.0)))
    with pytest.raises(SpecError, match="bounded by 2 curves, around 20000, 400 mm²: a face with holes"):
        outline_of(Reflector(face))


def test_two_faces_are_one_mirror() -> None:
    """A sphere in two faces side by side, as aspheric mirrors come: outline and radius are those of the whole."""
    r = 1250.0

    def part(low: float, high: float) -> QuadricFace:
        loop = np.array([[low, -60.0], [high, -60.0], [high, 60.0], [low, 60.0]]) / r
        return QuadricFace(Quadric("sphere", np.array([0.0, 0.0, -r]), TOWARDS_Z, r), (loop,))

    m = measured(Reflector.of_faces((part(-90.0, 30.0), part(30.0, 90.0))))
    of = judged(m, "III")
    assert line(of, "rectangle_mm").value == pytest.approx(2.0 * r * np.sin(0.072) * np.sqrt(1.0 - (20.0 / r) ** 2), abs=1e-5)
    assert line(of, "segment_b_mm").value == pytest.approx(2.0 * r * np.sin(0.048), abs=1e-5)
    assert line(of, "radius_r_mm").value == pytest.approx(r, abs=1e-6)
