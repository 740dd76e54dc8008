"""The edge of what an eye sees through glass, by where rays pass the sheets, beside every ray asked by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.design_stages import design
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.spec.file import load_spec
from raytrace.kernels.plate_edge import ASK, FOUND, NO_END, SEEN
from raytrace.reflector import Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.plate import Plate
from raytrace.viewing.view import View
from raytrace.visibility.contour import SETTLED, bisect_visibility, ends_of_sight, grid_over, visibility_contour
from raytrace.visibility.plate_edge import last_seen, seen_on_grid
from raytrace.visibility.shows import RIM, shows

Array = NDArray[np.float64]

NAMES = ("progressive-a", "progressive-c", "perspective", "holed", "thick")


def plate_view(name: str) -> View:
    """A preset behind glass; or progressive-b with a hole in its coating and another in its front, or in thick glass."""
    spec = load_spec("progressive-b" if name in ("holed", "thick") else name)
    glass = {"reflecting": "back"} | ({"thickness_mm": 12.0} if name == "thick" else {})
    reflector = Reflector.from_mirror(design(spec.model_copy(update={"glass": spec.glass.model_copy(update=glass)})))
    if name == "holed":
        plate = reflector.surface
        assert isinstance(plate, Plate)
        assert isinstance(plate.front, BSplineFace)
        assert isinstance(plate.back, BSplineFace)
        angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        back = replace(plate.back, loops=(*plate.back.loops, 12.0 * circle + [30.0, -40.0]))
        front = replace(plate.front, loops=(*plate.front.loops, 5.0 * circle + [-20.0, 50.0]))
        reflector = Reflector(replace(plate, front=front, back=back))
    return View(reflector)


@pytest.mark.parametrize("name", NAMES)
def test_a_grid_shows_what_each_of_its_rays_does(name: str) -> None:
    view = plate_view(name)
    plate = view.reflector.surface.plate
    assert plate is not None
    grid = grid_over(view)
    found = seen_on_grid(plate, view.eye_in_mirror, grid, RIM)
    told = found != ASK
    assert told.mean() > 0.99
    assert np.array_equal((found == SEEN)[told], shows(view, grid.reshape(-1, 2)).reshape(found.shape)[told])


@pytest.mark.parametrize("name", NAMES)
def test_what_is_seen_ends_where_halving_finds_it_and_dense_rays_do(name: str) -> None:
    view = plate_view(name)
    plate = view.reflector.surface.plate
    assert plate is not None
    edge = visibility_contour(view)
    along = edge.on_plane[edge.following] - edge.on_plane
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    middles = edge.on_plane + 0.5 * along
    rng = np.random.default_rng(7)
    # Some begin a hundredth of their way before the end, some at the other side of it, and some cross nothing.
    starts, ends = (middles + sign * left * rng.choice([0.01, 0.3, 1.0, 4.0], (len(left), 1)) for sign in (1.0, -1.0))
    ends[::17] = starts[::17] + 0.001 * left[::17]
    starts[5::17], ends[5::17] = ends[5::17].copy(), starts[5::17].copy()
    points, outcome = last_seen(plate, view.eye_in_mirror, starts, ends, RIM, SETTLED)
    crossing = shows(view, starts) & ~shows(view, ends)
    assert np.array_equal(outcome == FOUND, crossing)
    assert (outcome[~crossing] == NO_END).all()
    way = np.linalg.norm(ends - starts, axis=1)
    beyond = points + 2.0 * SETTLED * (ends - starts)
    assert shows(view, points[crossing]).mean() > 0.99  # but for rounding
    assert not shows(view, beyond[crossing]).any()
    halved = bisect_visibility(view, starts[crossing], ends[crossing])
    apart = np.linalg.norm(halved - points[crossing], axis=1)
    once = apart <= 2.0 * SETTLED * way[crossing] + 1e-12
    assert once.mean() > 0.98
    # Where they differ the way crosses edges more than once: rays all along it say so.
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    for k in np.flatnonzero(crossing)[~once]:
        seen = shows(view, starts[k] + share * (ends[k] - starts[k]))
        assert np.count_nonzero(seen[1:] != seen[:-1]) > 1


def test_the_ends_of_sight_are_those_of_rays_that_something_may_stand_before() -> None:
    view = plate_view("progressive-c")
    corners = np.array([[0.0, 0.0, 5e4], [1.0, 0.0, 5e4], [0.0, 1.0, 5e4]])  # behind the eye, which is not known beforehand
    obstacle = SurfaceMesh(corners, np.array([[0, 1, 2]], dtype=np.int32))
    asked = replace(view, reflector=replace(view.reflector, obstacles=obstacle))
    one, two = visibility_contour(view), visibility_contour(asked)
    assert np.array_equal(one.following, two.following)
    assert np.abs(one.on_plane - two.on_plane).max() < 2e-8
    assert ends_of_sight(view, np.empty((0, 2)), np.empty((0, 2)))[0].shape == (0, 2)


def test_what_lies_between_the_sheets_stands_behind_the_front_and_what_lies_before_it_does_not() -> None:
    reflector = plate_view("progressive-c").reflector
    plate = reflector.surface
    assert isinstance(plate, Plate)
    u, v = np.array([-60.0, 0.0, 40.0]), np.array([20.0, -80.0, 100.0])
    front, normals = plate.front_at(u, v)
    for beneath, behind in ((2.0, True), (0.0, True), (-0.5, False)):
        mesh = SurfaceMesh(front - beneath * normals, np.array([[0, 1, 2]], dtype=np.int32))
        assert replace(reflector, obstacles=mesh).obstacles_behind == behind
    beside = SurfaceMesh(front - 2.0 * normals + [500.0, 0.0, 0.0], np.array([[0, 1, 2]], dtype=np.int32))
    assert not replace(reflector, obstacles=beside).obstacles_behind
