"""What the built-in picture shows beyond its edges: the same scene, wherever a mirror of the paper looks."""

from __future__ import annotations

import numpy as np
import pytest

import mirror_cad
import raytrace
from mirror_cad.spec.file import preset_names
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.image import landing_points
from raytrace.scene.reference import BESIDE, BEYOND_MM, ROAD_MM, ReferencePlane, load_picture
from raytrace.viewing.driver_view import driver_view
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View
from tests.conftest import designed


def plane(width_mm: float = 9000.0, centre_mm: tuple[float, float] = (-2300.0, 0.0)) -> ReferencePlane:
    return ReferencePlane.of_image("road", load_picture("road"), 8962.0, width_mm, centre_mm)


def colours_at(scene: ReferencePlane, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Colours of points of the plane, by rays straight at them."""
    points = np.stack([x, y, np.zeros_like(x)], axis=1)
    trace = raytrace.Trace.empty(len(x))
    trace.status[:] = 0
    trace.points[:], trace.directions[:] = points, [0.0, 0.0, 1.0]
    sums = np.zeros((len(x), 3))
    scene.add_colours(trace, np.zeros(3), trace.directions, sums, 1)
    return sums


def test_the_picture_is_where_it_was_and_goes_on_about_it() -> None:
    scene = plane()
    assert scene.bounds() == pytest.approx(ROAD_MM)
    assert scene.beyond is not None
    assert scene.beyond.bounds() == pytest.approx(BEYOND_MM)
    narrow = plane(4500.0, (100.0, 50.0))
    assert narrow.beyond is not None
    assert narrow.beyond.bounds() == pytest.approx([(x + shift) / 2 + at for x, shift, at in zip(
        BEYOND_MM, (2300.0, 2300.0, 0.0, 0.0), (100.0, 100.0, 50.0, 50.0), strict=True)])


def test_both_pictures_show_the_same_scene() -> None:
    """Along the edges, 40 mm within and beyond them: one scene, so the coarser picture has nearly the finer one's colours."""
    x = np.linspace(-6700.0, 2100.0, 400)
    for y in (5350.0, -5350.0):
        inner, outer = (colours_at(scene, x, np.full_like(x, y)) for scene in (plane(), plane().beyond))
        assert np.median(np.abs(inner - outer)) < 4.0  # of 255: what JPEG and elements of 8 mm blur
    for y in (5360.0, -5360.0):
        near, far = (colours_at(plane(), x, np.full_like(x, sign * y)) for sign in (1.0, 1.015))
        assert np.median(np.abs(near - far)) < 6.0
    assert np.array_equal(colours_at(plane(), np.array([5000.0, -9100.0]), np.array([0.0, 0.0])), np.stack([BESIDE, BESIDE]))


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_sees_the_scene_all_over(name: str) -> None:
    mirror = designed(name)
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(*mirror.box[:2], 101), np.linspace(*mirror.box[2:], 101)))
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), setting.eye,
                             np.stack([x, y, np.zeros_like(x)], axis=1) - setting.eye)
    landed = landing_points(trace, setting.plane_z_mm)[trace.status == 0]
    assert len(landed) > 8500
    assert (landed[:, 0] > BEYOND_MM[0]).all()
    assert (landed[:, 0] < BEYOND_MM[1]).all()
    assert (np.abs(landed[:, 1]) < BEYOND_MM[3]).all()


def test_a_picture_of_one_s_own_ends_at_its_edges() -> None:
    mirror = mirror_cad.design(mirror_cad.load_spec("sphere-950"))
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    view = View(raytrace.Reflector.from_mirror(mirror), Pose.identity(), setting.eye)
    built_in = driver_view(view, "road", width_px=200, samples=1)
    own = driver_view(view, load_picture("road"), width_px=200, samples=1)
    assert not (built_in.picture == np.rint(BESIDE)).all(axis=2).any()
    dark = (own.picture == np.rint(BESIDE)).all(axis=2)
    assert dark.any()
    assert np.array_equal(built_in.picture[~dark], own.picture[~dark])
