"""A made mirror laid on its design: pose, deviation and verdict, also with outliers, holes and half of it unmeasured."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirror_cad import design, load_spec
from mirror_cad.made import form_error
from mirror_cad.made.alignment import AlignmentError, best_fit
from mirror_cad.made.figures import figures
from mirror_cad.made.form_error import with_form_error
from mirror_cad.made.hidden_form import hidden_form
from mirror_cad.made.inspection import Inspection, _first_of_equal
from mirror_cad.made.inspection import inspect as inspect_over
from mirror_cad.made.measured_surface import measured_surface
from mirror_cad.made.motion import Motion
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.reconstruction import ReconstructionError
from mirror_cad.made.verdict import verdict
from mirror_cad.mirror import Mirror
from mirror_cad.surfaces.differential import principal_curvatures
from mirror_studio.inspect.driver import drivers_view
from mirror_studio.inspect.reference import load_reference
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.reflector import Reflector

Array = NDArray[np.float64]

# 30° about a slanted axis, and 1 m off.
AWAY = Motion(Rotation.from_rotvec(np.radians(30.0) * np.array([1.0, 2.0, -2.0]) / 3.0).as_matrix(),
              np.array([600.0, -700.0, 400.0]))

inspect = partial(inspect_over, gauge_mm=60.0)  # fewer spans than for 38 mm: tests of what holds for any gauge


@lru_cache
def mirror(name: str) -> Mirror:
    return design(load_spec(name))


def nominal(name: str) -> Nominal:
    return Nominal(mirror(name).surface, mirror(name).outline)


def points(name: str) -> Array:
    return mirror(name).grid_points()[:, :3].copy()


@pytest.mark.parametrize("name", ["progressive-a", "progressive-c"])
def test_noiseless_points_of_a_design_in_any_pose_lie_on_it(name: str) -> None:
    """Height to 1e-6 mm and curvature to 0.01 %, and the pose is found: a free surface has but one."""
    found = inspect(nominal(name), AWAY.of_points(points(name)))
    main = figures(found.nominal, found.fields)
    assert np.abs(found.points - points(name)).max() < 1e-6
    assert abs(main.height.largest or 1.0) < 1e-6
    assert all(abs(each.largest or 1.0) < 0.01 for each in main.percent.values())
    assert main.known_share == 1.0
    assert not found.left_out


def test_a_sphere_is_laid_on_itself_though_it_may_turn() -> None:
    """Three directions of motion are not told by a sphere's shape; heights and curvatures need none of them."""
    found = inspect(nominal("sphere-950"), AWAY.of_points(points("sphere-950")))
    main = figures(found.nominal, found.fields)
    assert found.alignment is not None
    assert found.alignment.undetermined == 3
    assert abs(main.height.largest or 1.0) < 1e-6
    assert all(abs(each.largest or 1.0) < 0.01 for each in main.percent.values())


def test_another_radius_is_told_exactly() -> None:
    """A sphere of 931 mm against 950 mm: both curvatures are 950/931 − 1 too large, and nothing is twisted."""
    at = points("sphere-950")
    r = 931.0
    at[:, 2] = np.sqrt(r * r - at[:, 0] ** 2 - at[:, 1] ** 2) - r
    main = figures(nominal("sphere-950"), inspect(nominal("sphere-950"), at, align="none").fields)
    for key in ("k1", "k2", "kx", "ky"):
        assert main.percent[key].rms == pytest.approx(100.0 * (950.0 / 931.0 - 1.0), abs=0.01)  # type: ignore[index]
    assert abs(main.percent["twist"].largest or 1.0) < 0.01


def test_outliers_are_left_out_and_counted() -> None:
    """10 % of the points 2 mm off: the rest tell the mirror as if there were none."""
    rng = np.random.default_rng(3)
    at = points("progressive-c") + 0.005 * rng.standard_normal((len(points("progressive-c")), 3))
    wrong = rng.random(len(at)) < 0.1
    at[wrong] += rng.normal(0.0, 2.0, (int(wrong.sum()), 3))
    found = inspect(nominal("progressive-c"), AWAY.of_points(at))
    main = figures(found.nominal, found.fields)
    assert found.sigma_mm == pytest.approx(0.005, rel=0.1)
    assert 0.8 * wrong.sum() < sum(found.left_out.values()) < 1.1 * wrong.sum()
    assert main.percent["kx"].rms == pytest.approx(main.percent["kx"].sigma, rel=0.35)


def test_equal_points_count_once_and_opposite_ones_are_not_equal() -> None:
    """Whatever signs they have: on a mirror of revolution (x, y, z) and (−x, −y, z) are both measured."""
    rng = np.random.default_rng(4)
    one = np.round(rng.uniform(0.0, 200.0, (400, 3)), 1)
    signs = np.array([[a, b, c] for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)])
    every = (one[:, None] * signs).reshape(-1, 3)
    assert len(_first_of_equal(every)) == len(np.unique(every, axis=0)) == 3200
    twice = np.concatenate([every, every[::3], [[0.0, 1.0, 2.0], [-0.0, 1.0, 2.0]]])
    assert _first_of_equal(twice).tolist() == [*range(3200), len(twice) - 2]


def test_what_was_not_measured_is_not_known() -> None:
    """Of half a mirror half is known, and there it is right; a hole stays one, and height is NaN in it."""
    at = points("progressive-c")
    half = inspect(nominal("progressive-c"), AWAY.of_points(at[at[:, 0] > 0.0]))
    main = figures(half.nominal, half.fields)
    assert 0.4 < main.known_share < 0.5
    assert abs(main.percent["k1"].largest or 1.0) < 0.01
    places = half.fields.lattice.places
    assert np.isnan(half.fields.height[places[:, 0] < -15.0]).all()
    assert np.isnan(half.fields.curvature.k1[places[:, 0] < -15.0]).all()

    hole = inspect(nominal("progressive-c"), at[np.hypot(at[:, 0], at[:, 1]) > 80.0], align="none")
    near = np.hypot(*places.T) < 65.0
    assert np.isnan(hole.fields.height[near]).all()
    assert not hole.fields.known[np.hypot(*places.T) < 85.0].any()
    assert np.nanmax(np.abs(hole.fields.height)) < 1e-6


def test_one_line_of_points_tells_heights_along_it_and_no_curvature() -> None:
    """And no figure is made up."""
    x = np.linspace(-100.0, 100.0, 201)
    line = np.stack([x, np.zeros_like(x), nominal("progressive-c").heights(x, np.zeros_like(x))[0] + 0.02], axis=1)
    found = inspect(nominal("progressive-c"), line, align="none")
    main = figures(found.nominal, found.fields)
    assert main.percent["k1"].largest is None
    assert main.height.largest == pytest.approx(0.02, abs=1e-3)
    assert main.measured_share < 0.15  # a quarter of the gauge to either side
    assert verdict(found.fields, 5.0).outcome == "undecided"


def test_a_wave_of_form_is_found_with_its_amplitude_and_what_it_does_to_the_view() -> None:
    """20 µm at 60 mm on 5 mm points with 2 µm noise: the amplitude to 5 %, nothing left out.

    The turns of the driver's rays are those of rays traced in the exact surface with the wave on it.
    """
    rng = np.random.default_rng(5)
    at = points("progressive-c")
    at[:, 2] += 0.02 * np.sin(2.0 * np.pi * at[:, 0] / 60.0) + 0.002 * rng.standard_normal(len(at))
    found = inspect(nominal("progressive-c"), at, align="none")
    places = found.fields.lattice.places
    wave = np.sin(2.0 * np.pi * places[:, 0] / 60.0)
    assert not found.left_out
    assert wave @ found.fields.height / (wave @ wave) == pytest.approx(0.02, rel=0.05)
    reference = load_reference("progressive-c")
    told = drivers_view(reference, found.fields.lattice, found.reconstruction.smooth, found.reconstruction.sigma_factor)
    of = mirror("progressive-c")
    eye, (x, y) = ViewingSetup.of(of.spec, of.box).eye, np.ascontiguousarray(places.T)
    waved = replace(of, surface=with_form_error(of.surface, form_error.wave(0.02, 60.0, 0.0, 0.0)))
    before, after = (Reflector.from_mirror(each).surface.reflected_at(eye, x, y)[1] for each in (of, waved))
    traced = 10800.0 / np.pi * np.linalg.norm(after - before, axis=1)
    assert traced.max() == pytest.approx(2.0 * 0.02 * 2.0 * np.pi / 60.0 * 10800.0 / np.pi, rel=0.1)  # twice the slope: 14′
    assert np.sqrt(np.nanmean(told.turn**2)) == pytest.approx(np.sqrt(np.mean(traced**2)), rel=0.05)
    # At its place each is within what noise does to it: of two components, and counted against the bias of smoothing.
    assert np.sqrt(np.nanmean((told.turn - traced) ** 2)) < 2.0 * np.sqrt(np.nanmean(told.turn_sigma**2))
    # ... which is a small part of it.
    assert np.sqrt(np.nanmean((told.turn - traced) ** 2)) < 0.15 * np.sqrt(np.mean(traced**2))


def test_what_an_alignment_takes_away_is_the_form_of_its_motion() -> None:
    """Of a sphere that was given shifted: the difference of two spheres, in closed form."""
    found, r = inspect(nominal("sphere-950"), points("sphere-950")[::4], align="none"), 950.0
    shift = np.array([1.5, -0.8, 0.2])
    hidden = hidden_form(found, Motion(np.eye(3), shift)).height
    x, y = found.fields.lattice.places.T
    wanted = shift[2] + np.sqrt(r * r - (x - shift[0]) ** 2 - (y - shift[1]) ** 2) - np.sqrt(r * r - x * x - y * y)
    assert hidden is not None
    assert np.abs(hidden - wanted).max() < 1e-7
    assert hidden_form(found, AWAY).height is None
    assert hidden_form(found, Motion.identity()).sigma is None
    free = inspect(nominal("progressive-c"), points("progressive-c")[::4] + [0.0, 0.0, 0.4])
    both = hidden_form(free, Motion.identity())
    assert both.height is not None
    assert both.sigma is not None
    assert np.abs(both.height + np.nan_to_num(free.fields.height) - 0.4).max() < 1e-5
    assert (both.sigma >= 0.0).all()


def test_the_verdict_passes_fails_and_knows_when_it_cannot_tell() -> None:
    """A radius 2 % off under 1 µm noise: within 5 %, beyond 1 %, and of 2.5 % nobody can say."""
    rng = np.random.default_rng(7)
    at = points("sphere-950")
    r = 950.0 / 1.02
    at[:, 2] = np.sqrt(r * r - at[:, 0] ** 2 - at[:, 1] ** 2) - r + 0.001 * rng.standard_normal(len(at))
    fields = inspect(nominal("sphere-950"), at, np.full(len(at), 0.001), "none").fields
    assert [verdict(fields, limit).outcome for limit in (5.0, 1.0, 2.5)] == ["pass", "fail", "undecided"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["progressive-c", "sphere-1250"])
def test_stated_sigmas_are_the_scatter_of_the_whole_way_and_intervals_cover(name: str) -> None:
    """5 µm on 5 mm points, best fit included: sigma within 10 % of the scatter, 93 to 97 % covered, k1 of a sphere too."""
    rng, at = np.random.default_rng(2), points(name)
    values: dict[str, list[Array]] = {}
    for _ in range(12):
        noisy = at + 0.005 * rng.standard_normal(at.shape)
        fields = inspect_over(nominal(name), noisy, np.full(len(at), 0.005), gauge_mm=38.0).fields
        for key in ("k1", "k2", "kx", "ky", "twist"):
            value, sigma = fields.percent(key)  # type: ignore[arg-type]
            values.setdefault(key, []).append(np.stack([value, sigma])[:, fields.known])
    for key, found in values.items():
        value, sigma = np.concatenate(found, axis=1)
        assert np.sqrt(np.mean(value**2)) == pytest.approx(np.sqrt(np.mean(sigma**2)), rel=0.1), key
        assert 0.93 < float((np.abs(value) < 1.959964 * sigma).mean()) < 0.97, key
        assert np.sqrt(np.mean(value**2)) < 2.1, key


def test_half_a_mirror_cannot_pass_but_it_can_fail() -> None:
    """What was not measured may be anything."""
    at = points("sphere-950")
    at = at[at[:, 0] > 0.0]
    assert verdict(inspect(nominal("sphere-950"), at, align="none").fields, 5.0).outcome == "undecided"
    r = 900.0
    at[:, 2] = np.sqrt(r * r - at[:, 0] ** 2 - at[:, 1] ** 2) - r
    assert verdict(inspect(nominal("sphere-950"), at, align="none").fields, 5.0).outcome == "fail"


def test_three_datum_places_take_height_and_tilt_away_and_nothing_else() -> None:
    """A mirror that stands 2 mm too high and tilted by 0.3° is laid down; one that is 1 mm to the side stays there."""
    tilted = Motion.identity().then(np.radians([0.3, -0.2, 0.0]), np.array([0.0, 0.0, 2.0]), np.zeros(3))
    found = inspect(nominal("sphere-950"), tilted.of_points(points("sphere-950")), align="321")
    main = figures(found.nominal, found.fields)
    assert abs(main.height.largest or 1.0) < 1e-6
    beside = inspect(nominal("progressive-c"), points("progressive-c") + [1.0, 0.0, 0.0], align="321")
    assert beside.motion.translation[:2] == pytest.approx([0.0, 0.0], abs=0.05)
    own = ((-60.0, 100.0), (70.0, 90.0), (10.0, -110.0))
    twisted = points("sphere-950") + np.outer(points("sphere-950")[:, 0] * points("sphere-950")[:, 1], [0.0, 0.0, 1e-5])
    laid = inspect(nominal("sphere-950"), tilted.of_points(twisted), align="321", datums=own)
    places, height = laid.fields.lattice.places, laid.fields.height
    off = [abs(height[np.argmin(np.hypot(*(places - each).T))]) for each in own]
    assert max(off) < 0.005 < np.nanmax(np.abs(height))  # mm: a cell of the lattice beside a datum it slopes by some 1e-3
    with pytest.raises(AlignmentError, match="lie on a line"):
        inspect(nominal("sphere-950"), points("sphere-950"), align="321", datums=((0.0, 0.0), (50.0, 50.0), (80.0, 80.5)))
    with pytest.raises(AlignmentError, match="outside the mirror's outline"):
        inspect(nominal("sphere-950"), points("sphere-950"), align="321", datums=((0.0, 0.0), (50.0, 50.0), (180.0, 0.0)))
    with pytest.raises(AlignmentError, match="datum place"):
        inspect(nominal("sphere-950"), points("sphere-950") + [500.0, 0.0, 0.0], align="321")


def test_the_covariance_of_the_pose_is_the_scatter_of_many() -> None:
    """All six, at the place that they are told about."""
    rng = np.random.default_rng(11)
    design_, at = nominal("progressive-a"), points("progressive-a")[::3]
    found, moved = None, []
    for _ in range(60):
        found = best_fit(design_, at + 0.005 * rng.standard_normal(at.shape), Motion.identity())
        turn = Rotation.from_matrix(found.motion.rotation).as_rotvec()
        moved.append([*(found.motion.of_points(found.centre[None])[0] - found.centre), *turn])
    assert found is not None
    scatter = np.array(moved).std(axis=0)
    stated = 0.005 * np.sqrt(np.diag(found.covariance))
    assert scatter / stated == pytest.approx(np.ones(6), rel=0.3)  # 60 runs know a sigma to 9 %


def test_the_measured_surface_is_the_design_and_the_deviation() -> None:
    """As one B-spline, for designs of another degree too."""
    rng = np.random.default_rng(13)
    for name in ("progressive-c", "sphere-950"):
        at = points(name)
        at[:, 2] += 2e-6 * at[:, 0] ** 2 + 0.002 * rng.standard_normal(len(at))
        found: Inspection = inspect(nominal(name), at, align="none")
        surface = measured_surface(found.nominal, found.reconstruction.fit)
        x, y = rng.uniform(-100.0, 100.0, (2, 500))
        wanted = mirror(name).surface.sag(x, y) + found.reconstruction.fit.heights(x, y)
        assert np.abs(surface.sag(x, y) - wanted).max() < 1e-11
        assert np.isfinite(principal_curvatures(surface, x, y)).all()


def test_points_that_tell_no_mirror_are_refused() -> None:
    """On a straight line, of another thing, of two surfaces: each with its own words."""
    rng = np.random.default_rng(19)
    design_, at = nominal("progressive-c"), points("progressive-c")
    line = np.linspace(0.0, 100.0, 50)[:, None] * np.array([1.0, 0.5, 0.2])
    with pytest.raises(AlignmentError, match="straight line"):
        inspect(design_, line)
    with pytest.raises(AlignmentError, match="no mirror like this one"):
        inspect(design_, rng.uniform(-150.0, 150.0, (500, 3)))
    with pytest.raises((ReconstructionError, AlignmentError), match=r"two surfaces|more than one surface"):
        inspect(design_, np.concatenate([at, at - [0.0, 0.0, 3.0]]), align="none")
