"""The picture loop: what it shows, where it spends its rays, and that it can be stopped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import mirror_cad
import raytrace
from mirror_studio.viewing_setup import ViewingSetup
from raytrace import parallel
from raytrace.image import photograph
from raytrace.kernels.lanes import pitch
from raytrace.rays import Trace
from raytrace.scene.reference import BACKGROUND, Picture, ReferencePlane, load_picture
from raytrace.surfaces.polynomials import height_field_of
from raytrace.viewing.camera import Frame
from tests.conftest import constant, designed, spec_of

Array = NDArray[np.float64]


def scene_of(name: str) -> tuple[raytrace.Reflector, np.ndarray, ReferencePlane, Frame]:
    mirror = designed(name)
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    return (raytrace.Reflector.from_mirror(mirror), setting.eye, setting.scene(load_picture("road"), mirror.spec),
            Frame.around(mirror.box, 480))


def test_rays_go_where_the_picture_needs_them() -> None:
    reflector, eye, scene, frame = scene_of("progressive-c")
    view, rays = photograph(reflector, frame.camera(eye), scene)
    fine, _ = photograph(reflector, frame.camera(eye), replace(scene), samples=4)
    assert np.array_equal(view, fine)  # 4 is the default
    reference = sampled_everywhere(reflector, eye, scene, frame, 8)
    off = np.abs(view.astype(int) - reference).max(axis=2) > 8
    assert off.mean() < 0.004  # 16 rays everywhere leave as many; 4 everywhere twice as many
    assert sum(rays.values()) < 5.0 * frame.rows * frame.columns


def sampled_everywhere(reflector: raytrace.Reflector, eye: np.ndarray, scene: ReferencePlane, frame: Frame,
                       samples: int) -> np.ndarray:
    """The mean of plain pictures, each shifted by part of a pixel."""
    total = np.zeros((frame.rows, frame.columns, 3))
    for i in range(samples):
        for j in range(samples):
            shifted = replace(frame, left=frame.left + ((j + 0.5) / samples - 0.5) * frame.pixel,
                              top=frame.top - ((i + 0.5) / samples - 0.5) * frame.pixel)
            total += photograph(reflector, shifted.camera(eye), scene, samples=1)[0]
    return total / samples**2


def test_picture_does_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    reflector, eye, scene, frame = scene_of("progressive-a")
    two, counts = photograph(reflector, frame.camera(eye), scene)
    monkeypatch.setattr(parallel, "THREADS", 1)
    monkeypatch.setattr(parallel, "_pools", [])
    one, again = photograph(reflector, frame.camera(eye), scene)
    assert np.array_equal(one, two)
    assert counts == again


def test_progress_rises_to_one_and_stops_the_work_when_it_raises() -> None:
    reflector, eye, scene, frame = scene_of("progressive-a")
    shares: list[float] = []
    photograph(reflector, frame.camera(eye), scene, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) > 10

    class EnoughError(Exception):
        pass

    def stop(share: float) -> None:
        if share > 0.1:
            raise EnoughError

    with pytest.raises(EnoughError):
        photograph(reflector, frame.camera(eye), scene, stop)
    view, _ = photograph(reflector, frame.camera(eye), scene, samples=1)  # the threads are free again
    assert np.array_equal(view[0, 0], np.rint(BACKGROUND))


def test_a_pixel_of_a_flat_mirror_shows_the_picture_where_it_lies() -> None:
    """Closed form: a plane mirror shows the plane behind the eye as from the eye's image, at the element (row, column)."""
    mirror = mirror_cad.design(spec_of(constant(np.inf), constant(np.inf)))
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    picture = np.zeros((90, 160, 3), dtype=np.uint8)
    picture[..., 0] = np.arange(160)[None, :]
    picture[..., 1] = np.arange(90)[:, None] * 2
    scene = ReferencePlane(picture, setting.plane_z_mm, 4000.0, (0.0, 0.0))
    frame = Frame.around(mirror.box, 300)
    view, _ = photograph(raytrace.Reflector.from_mirror(mirror), frame.camera(setting.eye), scene, samples=1)
    eye = setting.eye
    for row, column in ((200, 150), (150, 120), (230, 180)):
        x, y = frame.place(np.array(column + 0.5), np.array(row + 0.5))
        # The ray goes on from (x, y, 0) as it came, but for the sign of z.
        scale = setting.plane_z_mm / eye[2]
        across, up = x + (x - eye[0]) * scale, y + (y - eye[1]) * scale
        wanted_column = (2000.0 - across) * 160 / 4000.0 - 0.5
        wanted_row = (4000.0 * 90 / 160 / 2 - up) * 160 / 4000.0 - 0.5
        assert view[row, column, 0] == pytest.approx(np.clip(wanted_column, 0, 159), abs=0.51)
        assert view[row, column, 1] == pytest.approx(2 * np.clip(wanted_row, 0, 89), abs=0.51)


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (3, 7), (4, 4), (9, 5), (5, 1), (48, 35)])
def test_every_pixel_is_looked_through_once_in_its_own_place(rows: int, columns: int) -> None:
    camera = Frame(-0.5 * columns, 0.5 * rows, 1.0, columns, rows).camera(np.array([0.0, 0.0, 100.0]))
    seen: list[Array] = []

    class Directions:
        def add_colours(self, trace: Trace, eye: Array, rays: Array, sums: Array, samples: int) -> None:
            at = rays / -rays[:, 2:] * 100.0 + [0.5 * columns, -0.5 * rows, 0.0]
            sums[:, 0], sums[:, 1], sums[:, 2] = np.floor(at[:, 0]), np.floor(-at[:, 1]), 7.0
            seen.append(rays.copy())

        def to_display(self, means: Array) -> Picture:
            return means.astype(np.uint8)

    picture, _ = photograph(None, camera, Directions(), samples=1)
    assert sum(len(rays) for rays in seen) == rows * columns
    np.testing.assert_array_equal(picture[..., 0], np.broadcast_to(np.arange(columns), (rows, columns)))
    np.testing.assert_array_equal(picture[..., 1], np.broadcast_to(np.arange(rows)[:, None], (rows, columns)))


@pytest.mark.parametrize("name", ["progressive-c", "sphere-950"])
def test_polynomials_of_a_height_field_are_the_surface(name: str) -> None:
    surface = designed(name).surface
    field = height_field_of(surface)
    assert field is not None
    sheet = field.cells
    rng = np.random.default_rng(3)
    x, y = (rng.uniform(low, high, 500) for low, high in (surface.domain[:2], surface.domain[2:]))
    i, j = (np.searchsorted(ends[:-1], at, side="right") - 1 for ends, at in ((sheet.ends_u, x), (sheet.ends_v, y)))
    n = sheet.powers
    cells = sheet.coefficients.reshape(len(sheet.middle_u), len(sheet.middle_v), n, pitch(n))[i, j, :, :n]
    a, b = (x - sheet.middle_u[i])[:, None] ** np.arange(n)[::-1], (y - sheet.middle_v[j])[:, None] ** np.arange(n)[::-1]
    z = np.einsum("na,nba,nb->n", a, cells, b)
    # Rounding of coordinates of some 100 mm.
    np.testing.assert_allclose(z, surface.evaluate(x, y)[:, 2], rtol=0, atol=1e-13)
