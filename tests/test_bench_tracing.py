"""The tracing benchmark: its reference is independent, its facts hold at small sizes, and a missing peer is a line."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import NdBSpline
from scipy.optimize import brentq

from mirror_studio.bench import measuring, tracing
from mirror_studio.bench.output import markdown
from mirror_studio.bench.tracers import (
    alone,
    batoid_bicubic,
    mitsuba_mesh,
    occt_shape,
    ours,
    pictures,
    raw_embree,
    sphere,
    trimesh_rays,
)
from mirror_studio.bench.tracers.case import ARCSEC, Case
from mirror_studio.bench.tracers.road import street
from mirror_studio.bench.tracers.tracer import HOW_TO_INSTALL, AbsentError
from raytrace.scene.world import TriangleWorld
from tests.conftest import designed

NEEDS = "compares with {}, which is optional: " + HOW_TO_INSTALL
# The kernel stops at some 1e-14 rad; 1e-7 arcsec is 5e-13 and far below the peers.
OURS_ARCSEC = 1e-7


@pytest.fixture(scope="module", autouse=True)
def one_run() -> Iterator[None]:
    """Every figure timed once: the times are not what a test looks at."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measuring, "RUNS", 0)
        yield


@pytest.fixture(scope="module")
def case() -> Case:
    return Case(designed("progressive-c"))


@pytest.fixture(scope="module")
def rows(case: Case) -> dict[str, dict[str, Any]]:
    return {row["method"]: row for row in tracing.errors_and_rates(case, (1000,)).rows}


def test_the_reference_is_what_root_finding_on_the_spline_gives(case: Case) -> None:
    """Rays aimed at a place, and brentq on scipy's tensor-product spline along each: one reflection, to 1e-9 arcsec."""
    rays = case.rays(400)
    surface = case.mirror.surface
    spline = NdBSpline((surface.knots_u, surface.knots_v), surface.poles[..., 2], (surface.degree_u, surface.degree_v))
    for k in np.flatnonzero(rays.inside)[::20]:
        d = rays.directions[k]

        def above(t: float, d: np.ndarray = d) -> float:
            p = rays.origins + t * d
            return float(p[2] - spline(p[None, :2])[0])

        first, last = ((z - rays.origins[2]) / d[2] for z in (1.0, -80.0))  # planes before and behind the whole mirror
        p = rays.origins + brentq(above, first, last, xtol=1e-12, rtol=1e-15) * d
        slope = [float(spline(p[None, :2], nu=nu)[0]) for nu in ((1, 0), (0, 1))]
        n = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
        assert np.linalg.norm(d - 2.0 * (d @ n) * n - rays.exact[k]) * ARCSEC < 2e-9


def test_ours_is_exact_in_every_use_and_no_ray_leaks(rows: dict[str, dict[str, Any]]) -> None:
    for name in (ours.HEIGHT_FIELD, ours.FRESH, ours.SHUFFLED, ours.PARAMETRIC):
        assert rows[name]["error_max"] < OURS_ARCSEC
        assert rows[name]["error_rms"] <= rows[name]["error_max"]
        assert rows[name]["leaked"] == 0.0
        assert rows[name]["rate"] > 0.0


def test_facets_are_far_worse_than_interpolated_normals(rows: dict[str, dict[str, Any]]) -> None:
    assert rows[raw_embree.FACETS]["error_rms"] > 20.0 * rows[raw_embree.INTERPOLATED]["error_rms"]
    assert rows[raw_embree.INTERPOLATED]["error_rms"] > 1.0
    assert rows[raw_embree.FACETS]["ratio"] == 1.0


def test_the_kernel_agrees_with_the_reference(rows: dict[str, dict[str, Any]]) -> None:
    assert rows[occt_shape.ORACLE]["error_max"] < OURS_ARCSEC


def test_the_parametric_row_does_go_through_the_parametric_kernel(case: Case) -> None:
    assert case.reflector.surface.height_field is not None
    assert ours.parametric(case.mirror).surface.height_field is None


def test_ours_on_a_sphere_is_its_closed_form_up_to_60_degrees() -> None:
    """1e-9 arcsec is 5e-15 rad, some twenty units of rounding."""
    rows = tracing.on_sphere(1000).rows
    assert {row["incidence"] for row in rows} == {"0–20°", "20–40°", "40–60°"}
    errors = {(row["method"], row["incidence"]): row["error_max"] for row in rows}
    for angle in ("0–20°", "20–40°", "40–60°"):
        assert errors[ours.PARAMETRIC, angle] < 1e-9
        assert errors[raw_embree.INTERPOLATED, angle] < 0.1 * errors[raw_embree.FACETS, angle]
    assert all(row["leaked"] == 0.0 for row in rows)


def test_the_rational_patch_is_the_sphere() -> None:
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 23)))
    points = sphere.reflector().surface.surface.evaluate(u, v) + [0.0, 0.0, sphere.RADIUS_MM]
    assert np.abs(np.linalg.norm(points, axis=1) - sphere.RADIUS_MM).max() < 1e-12 * sphere.RADIUS_MM
    assert np.abs(points[:, 0]).max() > sphere.HALF_MM[0]
    assert np.abs(points[:, 1]).max() > sphere.HALF_MM[1]


def test_batoid_is_between_the_meshes_and_ours(rows: dict[str, dict[str, Any]]) -> None:
    pytest.importorskip("batoid", reason=NEEDS.format("batoid"))
    assert 0.01 < rows[batoid_bicubic.BICUBIC]["error_rms"] < rows[raw_embree.INTERPOLATED]["error_rms"]
    assert rows[batoid_bicubic.BICUBIC]["leaked"] == 0.0


def test_trimesh_gives_embrees_facets(rows: dict[str, dict[str, Any]]) -> None:
    pytest.importorskip("trimesh", reason=NEEDS.format("trimesh"))
    # The same mesh in float64 normals: they differ by float32's 0.02″ and by a ray or two beside an edge.
    assert rows[trimesh_rays.TRIMESH]["error_rms"] == pytest.approx(rows[raw_embree.FACETS]["error_rms"], rel=1e-2)


def test_mitsuba_has_the_error_of_interpolated_normals(case: Case, rows: dict[str, dict[str, Any]]) -> None:
    pytest.importorskip("mitsuba", reason=NEEDS.format("Mitsuba"))
    row = next(row for name, row in rows.items() if name.startswith("Mitsuba"))
    assert row["error_rms"] == pytest.approx(rows[raw_embree.INTERPOLATED]["error_rms"], rel=1e-2)


def test_without_llvm_mitsuba_is_traced_one_by_one_and_says_why(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mitsuba", reason=NEEDS.format("Mitsuba"))
    real = mitsuba_mesh.use

    def no_llvm(variant: str) -> Any:
        if variant == mitsuba_mesh.LLVM:
            raise AbsentError(mitsuba_mesh.NO_LLVM)
        return real(variant)

    monkeypatch.setattr(mitsuba_mesh, "use", no_llvm)
    tracer, = mitsuba_mesh.tracers(case, 1000)
    rays = case.rays(60)
    assert tracer.note == mitsuba_mesh.NO_LLVM
    assert rays.errors(tracer.prepare(rays)())[2] == 0.0


def test_missing_peers_are_lines_that_say_how_to_install_them(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    for peer in ("mitsuba", "batoid", "trimesh"):
        monkeypatch.setitem(sys.modules, peer, None)
    table = tracing.errors_and_rates(case, (1000,))
    absent = {row["method"]: row["note"] for row in table.rows if row.get("rays") is None}
    assert set(absent) == {trimesh_rays.TRIMESH, batoid_bicubic.BICUBIC, "Mitsuba, llvm_ad_rgb"}
    assert all(HOW_TO_INSTALL in note for note in absent.values())
    assert markdown(table).count(HOW_TO_INSTALL) == 3
    world = tracing.whole_pictures(case, ((32, 24),))
    assert [row["note"] for row in world.rows if row["method"] == "Mitsuba"] == [f"absent: {HOW_TO_INSTALL}"] * 2


def test_errors_are_of_found_rays_inside_the_outline_only(case: Case) -> None:
    rays = case.rays(1000)
    found = rays.exact.copy()
    found[~rays.inside] = 0.0
    assert rays.errors(found) == (0.0, 0.0, 0.0)
    inside = np.flatnonzero(rays.inside)
    found[inside[:len(inside) // 4]] = np.nan
    assert rays.errors(found)[2] == pytest.approx(0.25, abs=1e-2)
    assert rays.errors(np.full_like(found, np.nan))[2] == 1.0


@pytest.mark.parametrize("of_street", [False, True])
def test_mitsuba_shows_the_same_picture(case: Case, of_street: bool) -> None:
    """Off the frame's middle, so that the pinhole's offsets count. Levels of 255: edges differ by where in its pixel a ray
    goes, by some 5 at this size; a picture that is mirrored or shifted by its twentieth differs by 20 and more."""
    pytest.importorskip("mitsuba", reason=NEEDS.format("Mitsuba"))
    scene = street() if of_street else pictures.reference_plane(case)
    middle = pictures.frame_of(160, 120)
    frame = type(middle)(middle.left, middle.top + 30.0, middle.pixel, middle.columns, middle.rows)
    mine = pictures.ours(case, scene, frame)().astype(np.float64)
    theirs = pictures.mitsuba(case, scene, frame, 10_000, mitsuba_mesh.SCALAR)()
    assert np.abs(theirs - mine).mean() < 8.0
    assert np.abs(theirs[:, ::-1] - mine).mean() > 15.0
    assert np.abs(theirs[::-1] - mine).mean() > 15.0


def test_the_street_is_large_and_has_its_lines_before_the_eye(case: Case) -> None:
    world = street()
    assert isinstance(world, TriangleWorld)
    assert len(world.faces) >= 300_000
    picture = pictures.ours(case, world, pictures.frame_of(320, 240))()
    road = picture[150:].reshape(-1, 3).astype(int)  # the lower part
    white = (road.min(axis=1) > 190).mean()
    asphalt = ((road.max(axis=1) < 110) & (np.ptp(road, axis=1) < 12)).mean()
    assert white > 0.005  # the dashes before the eye and the cars' plates
    assert asphalt > 0.3


def test_rate_over_rays_spans_and_triangles_leaks_no_ray(case: Case) -> None:
    rows = tracing.growth(case, (1000, 3000), ((4, 2), (16, 8)), (1000, 4000)).rows
    assert [row["series"] for row in rows] == ["rays, ours"] * 2 + ["rays, Embree, facets"] * 2 + ["spans, ours"] * 2 + [
        "triangles, raytrace.embree"] * 2
    assert all(row["leaked"] == 0 for row in rows if "leaked" in row)
    assert all(row["rate"] > 0.0 for row in rows)


def test_a_process_of_its_own_reports_its_first_call(case: Case, tmp_path: Path) -> None:
    path = tmp_path / "mirror.step"
    case.mirror.export_step(path)
    found = alone.measured("first", path, 1000)
    assert set(found) == {"import_s", "load_s", "first_s", "second_s"}
    assert all(value > 0.0 for value in found.values())
    assert alone.measured("fill", path, 1000)["peak_mb"] > 50.0


def test_tables_of_the_part_are_made_without_arguments() -> None:
    """As `mirror-cad bench` calls it."""
    assert not inspect.signature(tracing.tables).parameters
