"""The tracer: against an analytic sphere, the kernel's own intersection, and the paper's figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mirror_cad
import raytrace
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.occt.step import GLASS_COLOUR, Part, write_step
from mirror_studio.bench.tracers.ours import parametric
from raytrace.measures.difference import reflected_difference
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.measures.lane import lane_straightness_percent
from raytrace.measures.straight_lane import StraightLane
from raytrace.rays import Status
from raytrace.viewing.eye import eye_position
from tests.conftest import PAPER_MIRRORS, constant, designed, face_of, spec_of

ARCSEC = np.degrees(1.0) * 3600.0
BOX = (-115.0, 115.0, -163.45, 163.45)
EYE = eye_position(762.0, "right", BOX)


def picture_rays(columns: int = 400, rows: int = 560) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-120, 120, columns), np.linspace(-170, 170, rows))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - EYE


def analytic_sphere(directions: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First hits on a sphere that touches z = 0 from below: points, normals, reflected directions."""
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    from_centre = EYE + np.array([0.0, 0.0, radius])
    b, c = d @ from_centre, from_centre @ from_centre - radius**2
    t = -b - np.sqrt(b * b - c)
    normals = (from_centre + t[:, None] * d) / radius
    return EYE + t[:, None] * d, normals, d - 2.0 * np.einsum("ij,ij->i", d, normals)[:, None] * normals


@pytest.fixture(scope="module")
def sphere_step(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cap of a true sphere, R 950, cut out of the kernel's own sphere: a SPHERICAL_SURFACE in the file."""
    from build123d import Box as Block
    from build123d import Pos, Sphere

    cap = Pos(0, 0, -950.0) * Sphere(950.0) & Block(260, 400, 80)
    path = tmp_path_factory.mktemp("sphere") / "sphere.step"
    write_step(path, [Part(cap.wrapped, "sphere", GLASS_COLOUR)], "sphere")
    return path


def test_reflection_off_a_sphere_of_another_program_is_exact(sphere_step: Path) -> None:
    directions = picture_rays()
    trace = raytrace.reflect(raytrace.load_reflector(sphere_step), EYE, directions)
    assert (trace.status == Status.REFLECTED).all()
    points, normals, reflected = analytic_sphere(directions, 950.0)
    # 1e-6 arcsec is promised; some 1e-14 rad of rounding is 2e-9.
    assert np.linalg.norm(trace.directions - reflected, axis=1).max() * ARCSEC <= 1e-7
    assert np.abs(trace.points - points).max() <= 1e-10
    assert np.abs(trace.normals - normals).max() <= 1e-13


def test_height_field_and_parametric_kernels_agree(tmp_path: Path) -> None:
    mirror = designed("progressive-c")
    path = tmp_path / "c.step"
    mirror.export_step(path)
    fast = raytrace.load_reflector(path)
    assert fast.surface.height_field is not None
    slow = raytrace.load_reflector(path)
    slow.surface.__dict__["height_field"] = None  # the cached property, so that the general kernel takes every ray
    directions = picture_rays(120, 160)
    a, b = raytrace.reflect(fast, EYE, directions), raytrace.reflect(slow, EYE, directions)
    assert np.count_nonzero(a.status != b.status) == 0
    hit = a.status == Status.REFLECTED
    assert np.linalg.norm(a.directions[hit] - b.directions[hit], axis=1).max() * ARCSEC < 1e-6
    assert np.abs(a.points[hit] - b.points[hit]).max() < 1e-10
    # What was designed and what the file holds are the same to a trace.
    designed_trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), EYE, directions)
    assert np.linalg.norm(a.directions[hit] - designed_trace.directions[hit], axis=1).max() * ARCSEC < 1e-6


def test_kernel_intersects_at_the_same_points(tmp_path: Path) -> None:
    from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
    from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

    from mirror_cad.occt.step import read_step

    path = tmp_path / "a.step"
    designed("progressive-a").export_step(path)
    finder = IntCurvesFace_ShapeIntersector()
    finder.Load(read_step(path).shape, 1e-7)
    rng = np.random.default_rng(5)
    targets = np.stack([rng.uniform(-110, 110, 200), rng.uniform(-120, 120, 200), np.zeros(200)], axis=1)
    trace = raytrace.reflect(raytrace.load_reflector(path), EYE, targets - EYE)
    for i in range(200):
        d = targets[i] - EYE
        finder.PerformNearest(gp_Lin(gp_Pnt(*EYE), gp_Dir(*d)), 0.0, 1e5)
        theirs = np.array(finder.Pnt(1).Coord())
        assert np.linalg.norm(theirs - trace.points[i]) < 1e-7  # the kernel's own tolerance


def test_statuses_of_front_rim_back_and_bad_rays(tmp_path: Path) -> None:
    path = tmp_path / "b.step"
    designed("progressive-b").export_step(path)
    reflector = raytrace.load_reflector(path)
    origins = np.array([[0.0, 0, 500], [0, 0, -500], [400.0, 0, -7.0], [0, 0, 500], [0, 0, 500], [0, 0, np.nan], [0, 0, 500]])
    directions = np.array([[0.0, 0, -1], [0, 0, 1], [-1.0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, -1], [np.inf, 0, -1]])
    trace = raytrace.reflect(reflector, origins, directions)
    expected = [Status.REFLECTED, Status.BLOCKED, Status.BLOCKED, Status.MISSED, Status.INVALID, Status.INVALID, Status.INVALID]
    assert trace.status.tolist() == expected
    assert trace.directions[0] == pytest.approx([0, 0, 1], abs=1e-6)  # the fit's own slope error is 3e-7
    assert np.isnan(trace.directions[1:]).all()
    alone = raytrace.reflect(raytrace.Reflector.from_mirror(designed("progressive-b")), origins[1], directions[1:2])
    assert alone.status.tolist() == [Status.BEHIND]


def test_results_do_not_depend_on_array_layout_and_are_reused() -> None:
    reflector = raytrace.Reflector.from_mirror(designed("sphere-1050"))
    directions = picture_rays(40, 50)
    reference = raytrace.reflect(reflector, EYE, directions)
    strided = np.repeat(directions, 2, axis=0)[::2]
    read_only = directions.copy()
    read_only.setflags(write=False)
    for other in (np.asfortranarray(directions), strided, read_only, 7.0 * directions):
        same = raytrace.reflect(reflector, np.broadcast_to(EYE, directions.shape), other)
        assert np.nanmax(np.abs(same.directions - reference.directions)) < 1e-13
    again = raytrace.reflect(reflector, EYE, directions, out=reference)
    assert again is reference
    assert raytrace.reflect(reflector, EYE, np.empty((0, 3))).status.shape == (0,)
    for bad in (np.zeros(3), np.zeros((4, 2))):
        with pytest.raises(raytrace.TraceError, match="directions must be"):
            raytrace.reflect(reflector, EYE, bad)
    with pytest.raises(raytrace.TraceError, match="origins must be"):
        raytrace.reflect(reflector, np.zeros((3, 3)), directions)
    with pytest.raises(raytrace.TraceError, match=r"out.status must be .* for 10 rays, not int8 of shape \(2000,\)"):
        raytrace.reflect(reflector, EYE, directions[:10], out=reference)


@settings(max_examples=25)
@given(st.floats(0.0, 89.0), st.floats(0.0, 360.0), st.floats(-90.0, 90.0), st.floats(-120.0, 120.0))
def test_reflection_law_holds_from_every_side(incidence: float, azimuth: float, x: float, y: float) -> None:
    """Whatever the incidence: the hit lies on the surface and on the ray, and angle in equals angle out."""
    mirror = designed("progressive-a")
    target = mirror.surface.evaluate(x, y)
    i, a = np.radians(incidence), np.radians(azimuth)
    d = -np.array([np.sin(i) * np.cos(a), np.sin(i) * np.sin(a), np.cos(i)])
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), target - 600.0 * d, d[None, :])
    if trace.status[0] != Status.REFLECTED:
        # A grazing ray at a curved mirror can only come from below its horizon there.
        derivatives = mirror.surface.derivatives(x, y)
        normal = np.cross(derivatives["u"], derivatives["v"])
        assert d @ normal >= -1e-9 or trace.status[0] == Status.MISSED
        return
    p, n = trace.points[0], trace.normals[0]
    assert np.linalg.norm(mirror.surface.evaluate(p[0], p[1]) - p) < 1e-11
    assert trace.directions[0] @ n == pytest.approx(-(d @ n), abs=1e-14)
    assert np.linalg.norm(np.cross(p - (target - 600.0 * d), d)) < 1e-9


def test_rays_that_diverge_beside_a_steep_sheet_are_data_and_no_crash() -> None:
    """A radius just above the half-height: beside the sheet its tangent planes are steep, and Newton runs away."""
    mirror = mirror_cad.design(spec_of(constant(1250.0), constant(163.5)))
    rng = np.random.default_rng(11)
    targets = np.stack([rng.uniform(-1e4, 1e4, 50_000), rng.uniform(-1e4, 1e4, 50_000), np.zeros(50_000)], axis=1)
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), EYE, targets - EYE)
    assert set(trace.counts()) <= {"reflected", "missed", "behind"}
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), EYE, picture_rays())
    assert trace.counts()["reflected"] > 100_000


def test_rays_at_the_very_edge_of_a_sheet_that_ends_there(tmp_path: Path) -> None:
    """No margin and a blank like the outline: the feet of many rays are clamped to the sheet's last line of knots."""
    mirror = mirror_cad.design(spec_of(constant(1250.0), constant(1250.0), blank={"width_mm": 230.0, "height_mm": 340.0},
                                       export={"surface_margin_mm": 0.0}))
    assert mirror.surface.domain[1] == 115.0
    first = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), EYE, picture_rays())
    again = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), EYE, picture_rays())
    wide = raytrace.reflect(raytrace.Reflector.from_mirror(mirror_cad.design(spec_of(constant(1250.0), constant(1250.0)))), EYE,
                            picture_rays())
    assert first.counts() == again.counts() == wide.counts()


def test_step_placements_are_applied_once(tmp_path: Path) -> None:
    import build123d

    block = build123d.Solid.make_box(230, 300, 10).moved(build123d.Location((-115, -150, -10)))
    build123d.export_step(block, str(tmp_path / "block.step"))
    reflector = raytrace.load_reflector(tmp_path / "block.step")
    trace = raytrace.reflect(reflector, EYE, np.array([[-115.0, 0.0, -EYE[2]], [-10.0, 149.0, -EYE[2]]]))
    assert trace.status.tolist() == [0, 0]
    assert trace.points == pytest.approx(np.array([[0.0, 0.0, 0.0], [105.0, 149.0, 0.0]]), abs=1e-9)


def test_fields_of_view_of_table_1() -> None:
    for name, v in (("progressive-a", 49.4), ("progressive-b", 46.8), ("progressive-c", 42.8)):
        section = np.degrees(designed(name).section_fields_of_view())
        assert section == pytest.approx([44.8, v], abs=0.1)
    assert np.degrees(designed("sphere-950").section_fields_of_view()[0]) == pytest.approx(44.8, abs=0.1)


def test_traced_fields_of_view_with_the_eye_where_it_sits() -> None:
    for name, v in (("progressive-a", 45.3), ("progressive-b", 43.0), ("progressive-c", 39.6)):
        mirror = designed(name)
        traced = np.degrees(traced_fields_of_view(face_of(mirror), EYE, mirror.box, mirror.left_height_mm))
        assert traced == pytest.approx([44.6, v], abs=0.1)


def test_lane_straightness_of_table_1() -> None:
    lane = StraightLane(0.0, 2400.0, 0.6, float(EYE[2]) + 8200.0)
    for name, percent in (("progressive-a", 27.57), ("progressive-b", 28.28), ("progressive-c", 40.91)):
        mirror = designed(name)
        assert lane_straightness_percent(face_of(mirror), EYE, lane, mirror.box) == pytest.approx(percent, abs=0.05)


def test_a_plane_mirror_keeps_lanes_straight_and_shows_the_flat_field_of_view() -> None:
    mirror = mirror_cad.design(spec_of(constant(np.inf), constant(np.inf)))
    lane = StraightLane(0.0, 300.0, 0.1, float(EYE[2]) + 8200.0)
    assert lane_straightness_percent(face_of(mirror), EYE, lane, mirror.box) == pytest.approx(0.0, abs=1e-6)
    h, _ = traced_fields_of_view(face_of(mirror), EYE, mirror.box, 270.0)
    assert h == pytest.approx(np.arctan2(230.0, EYE[2]), abs=1e-12)


@pytest.mark.parametrize("name", PAPER_MIRRORS)
def test_every_paper_mirror_reflects_all_rays_inside_its_outline(name: str) -> None:
    mirror = designed(name)
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), EYE, picture_rays(200, 280))
    inside = mirror.outline.contains(*np.nan_to_num(trace.points[:, :2], nan=1e6).T)
    assert set(trace.counts()) == {"reflected", "missed"}
    assert (inside == (trace.status == Status.REFLECTED)).all()


def test_a_mirror_that_turns_turns_the_ray_twice_as_far() -> None:
    def tilted(angle: float) -> raytrace.Reflector:
        corners = np.array([[-200.0, -200, 0], [200, -200, 0], [200, 200, 0], [-200, 200, 0]])
        corners[:, 2] = np.tan(angle) * corners[:, 0]
        return raytrace.Reflector.of_mesh(SurfaceMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))

    angle = np.radians(0.25)
    eye = np.array([0.0, 100.0, 762.0])
    apart = reflected_difference(tilted(0.0), tilted(angle), eye, float(eye[2]) + 8200.0, BOX)
    # Rays in the plane that the mirror turns in turn by 2α, others by a little less (the ray's height over that plane's).
    assert apart.turn_max_arcmin == pytest.approx(2.0 * 15.0, abs=1e-3)
    assert apart.turn_rms_arcmin is not None
    assert 29.0 < apart.turn_rms_arcmin <= apart.turn_max_arcmin


@pytest.mark.parametrize("kind", ["height field", "parametric", "glass", "an origin a ray"])
def test_rays_in_random_order_find_what_they_find_in_a_pictures_order(kind: str) -> None:
    """Those that lie apart are sorted by where they go: the results are theirs, hopeless ones among them too."""
    laws = {"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": 0.5865}, constant(1300.0)
    mirror = mirror_cad.design(spec_of(*laws, glass={"reflecting": "back" if kind == "glass" else "front"}))
    reflector = parametric(mirror) if kind == "parametric" else raytrace.Reflector.from_mirror(mirror)
    rays = picture_rays(90, 110) * 10.0 ** np.linspace(-2.0, 2.0, 9900)[:, None]
    rays[::501], rays[7::900] = 0.0, [0.3, 0.0, 1.0]
    rays[11::1000, 1] = np.nan
    origins = np.broadcast_to(EYE, rays.shape).copy() if kind == "an origin a ray" else EYE
    ordered = raytrace.reflect(reflector, origins, rays)
    assert len(ordered.counts()) >= 3
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(rays))
        mixed = raytrace.reflect(reflector, origins if origins.ndim == 1 else origins[order], rays[order])
        assert (mixed.status == ordered.status[order]).all()
        # Rounding of coordinates of some 1000 mm: blocks of other rays begin Newton elsewhere.
        assert mixed.points == pytest.approx(ordered.points[order], abs=1e-12, nan_ok=True)
        assert mixed.normals == pytest.approx(ordered.normals[order], abs=1e-14, nan_ok=True)
        assert mixed.directions == pytest.approx(ordered.directions[order], abs=1e-14, nan_ok=True)
        assert mixed.distances == pytest.approx(ordered.distances[order], abs=1e-12, nan_ok=True)
