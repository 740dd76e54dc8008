"""The tracer's kernels: exact against extended precision, right on the hard rays, and the same for any arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_cad
import raytrace
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.quadric import Quadric
from raytrace.rays import Status, Trace
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.faces import FaceSet
from raytrace.surfaces.quadric import QuadricFace
from raytrace.viewing.eye import eye_position
from tests.conftest import constant, designed, spec_of
from tests.extended import ARCSEC, reflected

BOX = (-115.0, 115.0, -163.45, 163.45)
EYE = eye_position(762.0, "right", BOX)


def towards(surface: BSplineSurface, x: np.ndarray, y: np.ndarray, incidence: np.ndarray, azimuth: np.ndarray,
            length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions of rays that meet a height field at (x, y) under given angles."""
    d = surface.derivatives(x, y)
    normal = np.cross(d["u"], d["v"])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    one = np.cross(normal, [0.3, 0.2, 1.0])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    across = np.cos(azimuth)[:, None] * one + np.sin(azimuth)[:, None] * np.cross(normal, one)
    directions = -np.cos(incidence)[:, None] * normal + np.sin(incidence)[:, None] * across
    return d["s"] - length[:, None] * directions, directions


def as_parametric(mirror: mirror_cad.Mirror) -> raytrace.Reflector:
    """The same face on parameters that are not x and y: 0 to 1 and 0 to 3, turned against each other."""
    surface = mirror.surface
    (u0, u1, v0, v1) = surface.domain
    turned = BSplineSurface(surface.degree_v, surface.degree_u, 3.0 * (surface.knots_v - v0) / (v1 - v0),
                            (surface.knots_u - u0) / (u1 - u0), np.ascontiguousarray(surface.poles.transpose(1, 0, 2)))
    loop = mirror.outline.polyline(1e-5)
    uv = np.stack([3.0 * (loop[:, 1] - v0) / (v1 - v0), (loop[:, 0] - u0) / (u1 - u0)], axis=1)
    return raytrace.Reflector(BSplineFace(turned, (uv,), sign=-1.0))


def searched(reflector: raytrace.Reflector) -> raytrace.Reflector:
    """The same without the way that needs no search."""
    for surface in reflector.surface.bounding_faces:
        surface.__dict__["patches"] = surface.patches._replace(sheet=np.empty(0))
    return reflector


# Rounding of what the results are made of: 1e-9 arc seconds are 5e-15 rad; a grazing ray's place is less certain by 1/cos i.
@pytest.mark.parametrize("way", ["height field", "parametric", "searched"])
@pytest.mark.parametrize(("low", "high"), [(0.0, 60.0), (60.0, 85.0), (85.0, 89.9)])
def test_reflected_rays_are_exact_at_any_incidence(way: str, low: float, high: float) -> None:
    mirror = designed("progressive-c")
    rng = np.random.default_rng(4)
    n = 2000
    origins, directions = towards(mirror.surface, rng.uniform(-100, 100, n), rng.uniform(-110, 110, n),
                                  np.radians(rng.uniform(low, high, n)), rng.uniform(0, 2 * np.pi, n),
                                  rng.uniform(300, 1200, n))
    reflector = raytrace.Reflector.from_mirror(mirror) if way == "height field" else as_parametric(mirror)
    trace = raytrace.reflect(searched(reflector) if way == "searched" else reflector, origins, directions)
    assert trace.counts() == {"reflected": n}
    _, expected, cosine = reflected(mirror.surface, origins, directions, trace.points[:, 0], trace.points[:, 1])
    error = np.linalg.norm((trace.directions - expected).astype(np.float64), axis=1) * ARCSEC
    assert (error * (cosine if low else 1.0)).max() <= 1e-9


@pytest.mark.parametrize("degree", [3, 4, 5, 6, 7])
def test_every_degree_and_uneven_spans_are_exact(degree: int) -> None:
    mirror = mirror_cad.design(spec_of({"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": 0.5},
                                       constant(1100.0), surface={"degree": degree, "spans": [13, 5]}))
    rng = np.random.default_rng(degree)
    targets = np.stack([rng.uniform(-100, 100, 1500), rng.uniform(-100, 100, 1500), np.zeros(1500)], axis=1)
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), EYE, targets - EYE)
    assert trace.counts() == {"reflected": 1500}
    _, expected, _ = reflected(mirror.surface, EYE, targets - EYE, trace.points[:, 0], trace.points[:, 1])
    assert np.linalg.norm((trace.directions - expected).astype(np.float64), axis=1).max() * ARCSEC <= 1e-9


def test_rational_surfaces_are_exact() -> None:
    """A quarter of a torus-like surface of revolution: weights in both directions."""
    root = np.sqrt(0.5)
    arc = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])  # a quarter circle's poles, its weights 1, √½, 1
    poles = np.array([[[(300 + 80 * b[0]) * a[0], (300 + 80 * b[0]) * a[1], 80 * b[1]] for b in arc] for a in arc])
    surface = BSplineSurface(2, 2, np.array([0.0, 0, 0, 1, 1, 1]), np.array([0.0, 0, 0, 1, 1, 1]), poles,
                             np.outer([1.0, root, 1.0], [1.0, root, 1.0]))
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    reflector = raytrace.Reflector(BSplineFace(surface, (square,), one_sided=False))
    rng = np.random.default_rng(0)
    uv = rng.uniform(0.02, 0.98, (1000, 2))
    eye = np.array([500.0, 500.0, 400.0])
    trace = raytrace.reflect(reflector, eye, surface.evaluate(uv[:, 0], uv[:, 1]) - eye)
    hit = trace.status == Status.REFLECTED
    assert hit.all()
    radius = np.hypot(np.hypot(trace.points[:, 0], trace.points[:, 1]) - 300.0, trace.points[:, 2])
    assert np.abs(radius - 80.0).max() < 1e-11  # on the torus in closed form


# --- hard rays --------------------------------------------------------------------------------------------------------


def flat_mirror() -> mirror_cad.Mirror:
    return mirror_cad.design(spec_of(constant(np.inf), constant(np.inf), outline={
        "width_mm": 200.0, "left_height_mm": 200.0, "right_height_mm": 200.0, "corner_radius_mm": 1.0}))


def test_rays_a_billionth_beside_the_edge_miss_and_inside_it_do_not() -> None:
    reflector = raytrace.Reflector.from_mirror(flat_mirror())
    x = np.array([100.0 - 1e-9, 100.0 + 1e-9, -100.0 + 1e-9, -100.0 - 1e-9])
    y = np.array([10.0, 10.0, -20.0, -20.0])
    down = np.broadcast_to([0.0, 0.0, -1.0], (8, 3))
    origins = np.concatenate([np.stack([x, y, np.full(4, 500.0)], axis=1), np.stack([y, x, np.full(4, 500.0)], axis=1)])
    status = raytrace.reflect(reflector, origins, down).status
    assert status.tolist() == [0, 1, 0, 1, 0, 1, 0, 1]


def test_a_ray_tangent_to_the_edge_is_met_or_missed_but_never_lost() -> None:
    mirror = designed("progressive-c")
    loop = mirror.outline.polyline(1e-3)
    inside = loop[(np.abs(loop[:, 0]) < 114) & (np.abs(loop[:, 1]) < 160)]
    points = mirror.surface.evaluate(inside[:, 0], inside[:, 1])
    along = np.roll(points, -1, axis=0) - points
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    for reflector in (raytrace.Reflector.from_mirror(mirror), as_parametric(mirror)):
        status = raytrace.reflect(reflector, points - 300.0 * along, along).status
        assert set(np.unique(status)) <= {Status.REFLECTED, Status.MISSED, Status.BEHIND}


@pytest.mark.parametrize("parametric", [False, True])
def test_rays_from_behind_through_knots_and_from_the_surface_itself(parametric: bool) -> None:
    mirror = designed("progressive-c")
    reflector = as_parametric(mirror) if parametric else raytrace.Reflector.from_mirror(mirror)
    x, y = np.meshgrid(np.unique(mirror.surface.knots_u), np.unique(mirror.surface.knots_v))
    inside = mirror.outline.contains(x.ravel(), y.ravel()) & (np.abs(x.ravel()) < 114.0)  # knots lie on the edges, too
    points = mirror.surface.evaluate(x.ravel(), y.ravel())[inside]
    normal = mirror.surface.derivatives(x.ravel(), y.ravel())
    normal = np.cross(normal["u"], normal["v"])[inside]
    knots = raytrace.reflect(reflector, EYE, points - EYE)
    assert knots.counts() == {"reflected": len(points)}
    assert np.abs(knots.points - points).max() < 1e-11
    assert raytrace.reflect(reflector, points - 200.0 * normal, normal).counts() == {"behind": len(points)}
    # From the surface outwards there is nothing to meet; the place itself does not count.
    assert raytrace.reflect(reflector, points, normal).counts() == {"missed": len(points)}
    assert raytrace.reflect(reflector, knots.points, knots.directions).counts() == {"missed": len(points)}


def test_a_deep_bowl_is_met_at_the_first_of_two_places() -> None:
    # Concave, radius 150 over a half-width of 115: the far wall rises into rays that come in flat.
    mirror = mirror_cad.design(spec_of(constant(-150.0), constant(-150.0), outline={
        "width_mm": 200.0, "left_height_mm": 160.0, "right_height_mm": 160.0, "corner_radius_mm": 20.0}))
    rng = np.random.default_rng(8)
    n = 4000
    targets = mirror.surface.evaluate(rng.uniform(-90, 90, n), rng.uniform(-70, 70, n))
    # Flat rays from outside the rim: the outer wall's back hides the inside.
    azimuth = rng.uniform(0, 2 * np.pi, n)
    origins = np.stack([400.0 * np.cos(azimuth), 400.0 * np.sin(azimuth), rng.uniform(-10.0, 120.0, n)], axis=1)
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), origins, targets - origins)
    assert not np.any((trace.status == Status.LOST) | (trace.status == Status.MISSED))
    # Against a dense look along each ray: no crossing of the trimmed sheet before the one found.
    d = (targets - origins) / np.linalg.norm(targets - origins, axis=1, keepdims=True)
    found = trace.distances
    share = np.linspace(0.0, 1.0, 1500)[:-3]
    x0, x1, y0, y1 = mirror.surface.domain
    for i in range(0, n, 40):
        p = origins[i] + share[:, None] * found[i] * d[i]
        on = (p[:, 0] > x0) & (p[:, 0] < x1) & (p[:, 1] > y0) & (p[:, 1] < y1)
        on &= mirror.outline.contains(p[:, 0], p[:, 1])
        side = np.zeros(len(p))
        side[on] = np.sign(p[on, 2] - mirror.surface.evaluate(p[on, 0], p[on, 1])[:, 2])
        crossings = (side[1:] * side[:-1] < 0) & on[1:] & on[:-1]
        assert not crossings.any()
    assert {Status.REFLECTED, Status.BEHIND} <= set(np.unique(trace.status).tolist())


def test_a_sign_changing_sheet_is_met_first_where_it_rises_first() -> None:
    mirror = mirror_cad.design(spec_of({"law": "expression", "curvature": "0.02*sin(6*pi*t)"}, constant(np.inf), outline={
        "width_mm": 200.0, "left_height_mm": 100.0, "right_height_mm": 100.0, "corner_radius_mm": 5.0}))
    rng = np.random.default_rng(1)
    n = 3000
    x, y = rng.uniform(-90, 90, n), rng.uniform(-40, 40, n)
    targets = mirror.surface.evaluate(x, y)
    flat = rng.uniform(np.radians(80), np.radians(89.5), n)
    d = np.stack([np.sin(flat), np.zeros(n), -np.cos(flat)], axis=1)
    origins = targets - 500.0 * d
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(mirror), origins, d)
    assert set(np.unique(trace.status)) <= {Status.REFLECTED, Status.BEHIND, Status.MISSED}
    met = np.isfinite(trace.distances)
    assert (trace.distances[met] <= 500.0 + 1e-9).all()
    share = np.linspace(0.0, 1.0, 4000)[:-10]
    for i in np.flatnonzero(met)[::60]:
        p = origins[i] + share[:, None] * trace.distances[i] * d[i]
        on = mirror.outline.contains(p[:, 0], p[:, 1])
        above = p[on, 2] - mirror.surface.evaluate(p[on, 0], p[on, 1])[:, 2]
        assert (above > -1e-6).all() or (above < 1e-6).all()


def test_no_ray_one_ray_and_parts_of_a_block() -> None:
    reflector = raytrace.Reflector.from_mirror(designed("progressive-c"))
    assert raytrace.reflect(reflector, EYE, np.empty((0, 3))).counts() == {}
    one = raytrace.reflect(reflector, EYE, -EYE[None])
    assert one.counts() == {"reflected": 1}
    for n in (2, 15, 16, 17, 33):
        rays = np.broadcast_to(-EYE, (n, 3))
        many = raytrace.reflect(reflector, EYE, rays)
        assert (many.directions == many.directions[0]).all()
        assert np.abs(many.directions[0] - one.directions[0]).max() < 1e-15


def test_odd_rays_have_a_status_of_their_own_and_spoil_no_other() -> None:
    for reflector in (raytrace.Reflector.from_mirror(designed("progressive-c")), as_parametric(designed("progressive-c"))):
        good = np.array([[-90.0, 20.0, 0.0]]) - EYE
        plain = raytrace.reflect(reflector, EYE, good)
        odd = [np.full(3, np.nan), [np.inf, 0, -1], [0.0, 0, 0], good[0] * 1e-250, good[0] * 1e250, good[0] * 1e-310,
               [0.0, 0, 1], [1.0, 0, 0]]
        rays = np.concatenate([np.repeat(good, 9, axis=0), odd, np.repeat(good, 30, axis=0)])
        trace = raytrace.reflect(reflector, EYE, rays)
        expected = [0] * 9 + [5, 5, 5, 0, 0, 0, 1, 1] + [0] * 30
        assert trace.status.tolist() == expected
        hit = trace.status == 0
        hit[14] = False  # a subnormal direction has few digits of its own
        assert np.abs(trace.directions[hit] - plain.directions).max() < 2e-15
        assert np.isnan(trace.directions[trace.status != 0]).all()
        far = raytrace.reflect(reflector, np.array([[np.inf, 0, 0], [0, 0, 500.0]]), np.array([[0.0, 0, -1], [0, 0, -1]]))
        assert far.status.tolist() == [5, 0]


def test_arrays_of_any_layout_give_the_same_and_wrong_ones_are_refused() -> None:
    reflector = raytrace.Reflector.from_mirror(designed("progressive-b"))
    rng = np.random.default_rng(3)
    rays = np.stack([rng.uniform(-110, 110, 500), rng.uniform(-120, 120, 500), np.zeros(500)], axis=1) - EYE
    plain = raytrace.reflect(reflector, EYE, rays)
    frozen = rays.copy()
    frozen.setflags(write=False)
    for other in (np.asfortranarray(rays), np.repeat(rays, 2, axis=0)[::2], frozen, rays.tolist(), rays[:, ::-1][:, ::-1]):
        same = raytrace.reflect(reflector, EYE.tolist(), other)
        assert np.array_equal(same.status, plain.status)
        assert np.array_equal(same.directions, plain.directions, equal_nan=True)
    single = raytrace.reflect(reflector, EYE, rays.astype(np.float32))
    assert np.array_equal(single.status, raytrace.reflect(reflector, EYE, rays.astype(np.float32).astype(np.float64)).status)
    for wrong, message in ((rays.astype(complex), "real numbers"), (np.full((3, 3), "a"), "real numbers"),
                           (rays[:, :2], r"shape \(n, 3\)"), (rays[0], r"shape \(n, 3\)")):
        with pytest.raises(raytrace.TraceError, match=message):
            raytrace.reflect(reflector, EYE, wrong)
    with pytest.raises(raytrace.TraceError, match="origins"):
        raytrace.reflect(reflector, np.zeros((4, 3)), rays)
    room = Trace.empty(500)
    read_only = Trace(room.status, room.points, room.normals, room.directions, frozen[:, 0])
    with pytest.raises(raytrace.TraceError, match=r"out.distances must be a contiguous, writeable"):
        raytrace.reflect(reflector, EYE, rays, out=read_only)


def test_one_thread_and_two_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    reflector = raytrace.Reflector.from_mirror(designed("progressive-c"))
    x, y = np.meshgrid(np.linspace(-130, 130, 500), np.linspace(-180, 180, 500))
    rays = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - EYE
    two = raytrace.reflect(reflector, EYE, rays)
    monkeypatch.setattr("raytrace.surfaces.bspline.parallel_for", lambda work, n: work(0, n))
    one = raytrace.reflect(reflector, EYE, rays)
    assert np.array_equal(one.status, two.status)
    # A run's first block starts from elsewhere than inside a longer run: the last bits may differ, no more.
    assert np.nanmax(np.abs(one.directions - two.directions)) < 2e-15


# --- planes, spheres, cylinders, and several faces --------------------------------------------------------------------


def test_whole_sphere_reflects_at_seam_poles_and_limb() -> None:
    rectangle = np.array([[0.0, -np.pi / 2], [2 * np.pi, -np.pi / 2], [2 * np.pi, np.pi / 2], [0.0, np.pi / 2]])
    centre = np.array([1e5, -2e5, 3e4])
    ball = QuadricFace(Quadric("sphere", centre, np.eye(3), 100.0), (rectangle,))
    eye = centre + [500.0, 0.0, 0.0]  # looks at the seam u = 0
    reflector = raytrace.Reflector(ball)
    limb = np.arcsin(100.0 / 500.0)
    angles = np.concatenate([np.linspace(0.0, limb * (1 - 1e-12), 500), limb * (1 + np.geomspace(1e-12, 1e-2, 100))])
    for across in ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]):
        rays = -np.cos(angles)[:, None] * [1.0, 0, 0] + np.sin(angles)[:, None] * np.array(across)
        trace = raytrace.reflect(reflector, eye, rays)
        assert (trace.status[:500] == Status.REFLECTED).all()
        assert (trace.status[500:] == Status.MISSED).all()
        assert np.abs(np.linalg.norm(trace.points[:500] - centre, axis=1) - 100.0).max() < 1e-10  # ulps of 2e5 mm
    poles = raytrace.reflect(reflector, centre + [[0.0, 0, 300], [0, 0, -300]], np.array([[0.0, 0, -1], [0, 0, 1]]))
    assert np.array_equal(poles.directions, [[0, 0, 1], [0, 0, -1]])
    inside = raytrace.reflect(reflector, centre, np.eye(3))
    assert inside.counts() == {"behind": 3}


def test_nearest_of_several_faces_reflects(tmp_path: Path) -> None:
    from build123d import Box, Cylinder, Pos, Sphere

    from mirror_cad.occt.step import Part, write_step

    scene = Pos(0, 0, -50) * Box(200, 200, 20) + Pos(-40, 0, 0) * Sphere(30) + Pos(50, 0, 0) * Cylinder(20, 90)
    path = tmp_path / "several.step"
    write_step(path, [Part(scene.wrapped, "several")], "several")
    reflector = raytrace.load_reflector(path)
    assert {surface.quadric.kind for surface in reflector.surface.faces} == {"plane", "sphere", "cylinder"}
    eye = np.array([0.0, -30.0, 400.0])
    x, y = np.meshgrid(np.linspace(-110, 110, 60), np.linspace(-110, 110, 60))
    rays = np.stack([x.ravel(), y.ravel(), np.full(x.size, -40.0)], axis=1) - eye
    trace = raytrace.reflect(reflector, eye, rays)
    agree_with_the_kernel(path, trace, eye, rays)


def agree_with_the_kernel(path: Path, trace: Trace, eye: np.ndarray, rays: np.ndarray) -> None:
    """Every ray's place is that of the CAD kernel's own intersection with the shape read back."""
    from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
    from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

    from mirror_cad.occt.step import read_step

    finder = IntCurvesFace_ShapeIntersector()
    finder.Load(read_step(path).shape, 1e-7)
    for i, ray in enumerate(rays):
        finder.PerformNearest(gp_Lin(gp_Pnt(*eye), gp_Dir(*ray)), 0.0, 1e5)
        met = finder.IsDone() and finder.NbPnt() > 0
        assert met == (trace.status[i] == Status.REFLECTED), (i, ray, trace.status[i])
        if met:
            assert np.linalg.norm(np.array(finder.Pnt(1).Coord()) - trace.points[i]) < 1e-6  # ten times the kernel's own


def test_faces_of_another_program_agree_with_the_kernel(tmp_path: Path) -> None:
    from build123d import Axis, Box, Cone, Cylinder, Pos, Rot, Torus

    from mirror_cad.occt.step import Part, write_step

    shapes = {
        "torus": Torus(80, 30), "cone": Pos(10, 5, 0) * Rot(20, 10, 0) * Cone(80, 0, 90), "half": Cone(60, 20, 50),
        "hole": Box(150, 150, 20) - Cylinder(30, 40) - Pos(50, 50, 0) * Box(20, 20, 60),
        "revolved": (Pos(60, 0, 0) * Rot(90, 0, 0) * Cylinder(15, 30)).rotate(Axis.Z, 30),
    }
    eye = np.array([37.0, -83.0, 400.0])
    rng = np.random.default_rng(6)
    for name, shape in shapes.items():
        path = tmp_path / f"{name}.step"
        write_step(path, [Part(shape.wrapped, name)], name)
        rays = np.stack([rng.uniform(-120, 120, 300), rng.uniform(-120, 120, 300), np.zeros(300)], axis=1) - eye
        trace = raytrace.reflect(raytrace.load_reflector(path), eye, rays)
        agree_with_the_kernel(path, trace, eye, rays)


# --- which face reflects ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def painted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block whose top is named and whose colour is another than its own."""
    from build123d import Box

    from mirror_cad.occt.step import OPTICAL_FACE, Part, write_step

    block = Box(100, 80, 10)
    path = tmp_path_factory.mktemp("painted") / "block.step"
    top = block.faces().sort_by()[-1].wrapped
    write_step(path, [Part(block.wrapped, "block", (1.0, 0.0, 0.0), {OPTICAL_FACE: top})], "block")
    return path


def test_a_face_is_chosen_by_name_number_or_colour(painted: Path) -> None:
    from mirror_cad.cad_file import read_cad
    from mirror_cad.occt.step import OPTICAL_COLOUR

    faces = read_cad(painted).faces
    number = next(face.number for face in faces if face.name == "optical face")
    colours = [face.colour for face in faces]
    assert colours[number - 1] == tuple(round(255 * c) for c in OPTICAL_COLOUR)
    assert {c for k, c in enumerate(colours) if k != number - 1} == {(255, 0, 0)}
    down = np.array([[0.0, 0.0, -1.0]])
    for face in (None, "optical face", number, colours[number - 1]):
        reflector = raytrace.load_reflector(painted, face)
        assert isinstance(reflector.surface, QuadricFace)
        assert raytrace.reflect(reflector, np.array([10.0, 5.0, 50.0]), down).points[0, 2] == pytest.approx(5.0, abs=1e-12)
    sides = raytrace.load_reflector(painted, (255, 0, 0))
    assert isinstance(sides.surface, FaceSet)
    assert len(sides.surface.faces) == 5
    assert raytrace.reflect(sides, np.array([10.0, 5.0, 50.0]), down).status.tolist() == [Status.BLOCKED]


def test_a_face_that_is_not_there_is_refused_with_what_is(painted: Path) -> None:
    for face, named in (("mirror", "'optical face'"), (7, "1 to 6"), (0, "1 to 6"), ((1, 2, 3), r"\(255, 0, 0\)")):
        with pytest.raises(raytrace.TraceError, match=named):
            raytrace.load_reflector(painted, face)  # type: ignore[arg-type]


# --- hard surfaces ----------------------------------------------------------------------------------------------------


def test_nearly_flat_sliver_and_far_surfaces_are_exact() -> None:
    flat = mirror_cad.design(spec_of(constant(1e9), constant(1e9)))
    rng = np.random.default_rng(12)
    targets = np.stack([rng.uniform(-90, 90, 800), rng.uniform(-90, 90, 800), np.zeros(800)], axis=1)
    trace = raytrace.reflect(raytrace.Reflector.from_mirror(flat), EYE, targets - EYE)
    _, expected, _ = reflected(flat.surface, EYE, targets - EYE, trace.points[:, 0], trace.points[:, 1])
    assert np.linalg.norm((trace.directions - expected).astype(np.float64), axis=1).max() * ARCSEC <= 1e-9

    # A knot inserted a micrometre beside another: the same surface, with a row of sliver cells.
    own = designed("progressive-c").surface
    from scipy.interpolate import insert

    at = float(np.unique(own.knots_u)[5]) + 1e-3
    knots, poles = own.knots_u, own.poles
    columns = []
    for part in range(3):
        for j in range(poles.shape[1]):
            padded = np.concatenate([poles[:, j, part], np.zeros(own.degree_u + 1)])
            new_knots, new, _ = insert(at, (knots, padded, own.degree_u))
            columns.append(new[:poles.shape[0] + 1])
    sliver = BSplineSurface(own.degree_u, own.degree_v, new_knots, own.knots_v,
                            np.stack(columns).reshape(3, poles.shape[1], -1).transpose(2, 1, 0).copy())
    square = np.array([[-100.0, -100], [100, -100], [100, 100], [-100, 100]])
    for shift in (np.zeros(3), np.array([1.5e6, -2e6, 4e5])):
        moved = BSplineSurface(own.degree_u, own.degree_v, sliver.knots_u, sliver.knots_v, sliver.poles + shift)
        trace = raytrace.reflect(raytrace.Reflector(BSplineFace(moved, (square,))), EYE + shift, targets - EYE)
        assert trace.counts() == {"reflected": 800}
        _, expected, _ = reflected(moved, EYE + shift, targets - EYE, trace.points[:, 0] - shift[0],
                                   trace.points[:, 1] - shift[1])
        error = np.linalg.norm((trace.directions - expected).astype(np.float64), axis=1).max() * ARCSEC
        # 2 km from the origin poles are rounded to 2e-10 mm, which makes the sliver's polynomials rough, with larger terms.
        assert error <= (1e-8 if shift.any() else 1e-9)


# --- faces beside each other, seams, folds, creases -------------------------------------------------------------------


def sheet_over(z: np.ndarray, x: np.ndarray, y: np.ndarray, degree: int = 3, scale: float = 1.0) -> BSplineSurface:
    """A B-spline with u = scale·x, v = scale·y through heights z (len x, len y)."""
    from scipy.interpolate import make_interp_spline

    along_x = make_interp_spline(x, z, degree)
    both = make_interp_spline(y, along_x.c.T, degree)
    gx = np.array([along_x.t[i + 1:i + degree + 1].mean() for i in range(len(x))])
    gy = np.array([both.t[i + 1:i + degree + 1].mean() for i in range(len(y))])
    poles = np.stack([np.repeat(gx[:, None], len(y), 1), np.repeat(gy[None], len(x), 0), both.c.T], axis=2)
    return BSplineSurface(degree, degree, scale * along_x.t, scale * both.t, poles)


def rectangle(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def test_faces_that_share_a_surface_do_not_hide_each_other() -> None:
    surface = designed("progressive-c").surface
    halves = (rectangle(-100, 3, -120, 120), rectangle(3, 100, -120, 120))
    reflector = raytrace.Reflector.of_faces(tuple(BSplineFace(surface, (loop,)) for loop in halves))
    rng = np.random.default_rng(3)
    targets = surface.evaluate(rng.uniform(-3, 9, 3000), rng.uniform(-110, 110, 3000))
    trace = raytrace.reflect(reflector, EYE, targets - EYE)
    assert trace.counts() == {"reflected": 3000}
    assert np.abs(trace.points - targets).max() < 1e-11


@pytest.mark.parametrize(("amplitude", "waves"), [(1.0, 10), (10.0, 10), (3.0, 24), (0.3, 48)])
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_waves_are_met_at_the_first_place(amplitude: float, waves: int, scale: float) -> None:
    """Against a dense look along each ray at the sheet's own heights."""
    x, y = np.linspace(-100, 100, 12 * waves + 1), np.linspace(-100, 100, 9)
    surface = sheet_over(amplitude * np.sin(2 * np.pi * waves * x / 200.0)[:, None] * np.ones(9), x, y, scale=scale)
    reflector = raytrace.Reflector(BSplineFace(surface, (scale * rectangle(-100, 100, -100, 100),), one_sided=False))
    rng = np.random.default_rng(waves)
    n = 30
    low = np.radians(rng.uniform(2, 50, n))
    d = np.stack([np.cos(low) * np.cos(0.3), np.cos(low) * np.sin(0.3), -np.sin(low)], axis=1)
    targets = np.stack([rng.uniform(-50, 50, n), rng.uniform(-30, 30, n), np.zeros(n)], axis=1)
    origins = targets - 300.0 * d
    trace = raytrace.reflect(reflector, origins, d)
    share = np.linspace(0.0, 600.0, 20_001)
    for i in range(n):
        p = origins[i] + share[:, None] * d[i]
        on = (np.abs(p[:, 0]) < 100) & (np.abs(p[:, 1]) < 100)
        above = p[on, 2] - surface.evaluate(scale * p[on, 0], scale * p[on, 1])[:, 2]
        crossing = np.flatnonzero(above[1:] * above[:-1] <= 0.0)
        assert (trace.status[i] == Status.REFLECTED) == bool(crossing.size)
        if crossing.size:
            assert share[on][crossing[0]] - 1e-9 <= trace.distances[i] <= share[on][crossing[0] + 1] + 1e-9


def test_a_torus_has_no_leak_at_its_seams_and_no_ray_is_lost_beside_it(tmp_path: Path) -> None:
    from build123d import Torus

    from mirror_cad.occt.step import Part, write_step

    path = tmp_path / "torus.step"
    write_step(path, [Part(Torus(80, 30).wrapped, "torus")], "torus")
    reflector = raytrace.load_reflector(path)
    rng = np.random.default_rng(0)
    eye = np.array([300.0, 20.0, 40.0])
    angle = rng.uniform(-np.pi, np.pi, (1500, 2))
    angle[:500, 0] = rng.normal(0.0, 1e-5, 500)  # beside the seams u = 0 and v = 0
    angle[500:1000, 1] = rng.normal(0.0, 1e-5, 500)
    ring = 80.0 + 30.0 * np.cos(angle[:, 1])
    aimed = np.stack([ring * np.cos(angle[:, 0]), ring * np.sin(angle[:, 0]), 30.0 * np.sin(angle[:, 1])], axis=1)
    beside = rng.uniform(-130, 130, (3000, 3))
    rays = np.concatenate([aimed, beside]) - eye
    trace = raytrace.reflect(reflector, eye, rays)
    d = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    for k in range(0, len(rays), 5):
        # (|p|² + R² − r²)² = 4R²(x² + y²) along the ray: a quartic.
        o, q = eye, d[k]
        s = np.polynomial.Polynomial([o @ o + 80.0**2 - 30.0**2, 2.0 * o @ q, 1.0])
        xy = np.polynomial.Polynomial([o[:2] @ o[:2], 2.0 * o[:2] @ q[:2], q[:2] @ q[:2]])
        roots = (s * s - 4.0 * 80.0**2 * xy).roots()
        real = roots[np.abs(roots.imag) < 1e-5].real
        if np.any((np.abs(roots.imag) < 1e-2) & (np.abs(roots.imag) > 1e-6)):
            continue  # the quartic itself does not say
        assert (trace.status[k] == Status.REFLECTED) == bool(real.size)
        if real.size:
            assert trace.distances[k] == pytest.approx(real.min(), abs=1e-5)


def test_creases_and_twisted_caps_are_met() -> None:
    x, y = np.linspace(-100, 100, 9), np.linspace(-100, 100, 9)
    rng = np.random.default_rng(5)
    valley = sheet_over(0.4 * np.abs(x)[:, None] * np.ones(9), x, y, degree=1)
    a, b, c = 0.005, 0.005, 0.00995
    cap = sheet_over(-(a * x[:, None] ** 2 + b * y[None] ** 2 + c * x[:, None] * y[None]), x, y)
    for surface in (valley, cap):
        reflector = raytrace.Reflector(BSplineFace(surface, (rectangle(-100, 100, -100, 100),), one_sided=False))
        targets = surface.evaluate(rng.uniform(-99, 99, 2000), rng.uniform(-99, 99, 2000))
        low, around = np.radians(rng.uniform(3, 60, 2000)), rng.uniform(0, 2 * np.pi, 2000)
        d = np.stack([np.cos(low) * np.cos(around), np.cos(low) * np.sin(around), -np.sin(low)], axis=1)
        trace = raytrace.reflect(reflector, targets - 800.0 * d, d)
        assert trace.counts() == {"reflected": 2000}
        assert (trace.distances <= 800.0 + 1e-9).all()


def test_faces_of_several_turns_and_rays_in_a_seam_are_met() -> None:
    tube = Quadric("cylinder", np.zeros(3), np.eye(3), 50.0)
    strip = np.array([[0.0, 0.0], [4 * np.pi, 40.0], [4 * np.pi, 45.0], [0.0, 5.0]])  # two turns of a helix
    reflector = raytrace.Reflector(QuadricFace(tube, (strip,)))
    u = np.random.default_rng(1).uniform(0.01, 4 * np.pi - 0.01, 500)
    z = 40.0 * u / (4 * np.pi) + 2.5
    out = np.stack([np.cos(u), np.sin(u), np.zeros(500)], axis=1)
    trace = raytrace.reflect(reflector, 200.0 * out + z[:, None] * [0, 0, 1], -out)
    assert trace.counts() == {"reflected": 500}
    whole = raytrace.Reflector(QuadricFace(tube, (rectangle(0.0, 2 * np.pi, -10, 10),)))
    for beside in (0.0, -0.0, 1e-17, -1e-17, -1e-16, 1e-12, -1e-12):
        trace = raytrace.reflect(whole, np.array([100.0, beside, 0.0]), np.array([[-1.0, 0.0, 0.0]]))
        assert trace.distances[0] == pytest.approx(50.0, abs=1e-9)


def test_a_mirror_of_another_program_has_no_slit_along_its_seam(tmp_path: Path) -> None:
    """A sphere's cap cut out by a box: the pole in its middle, the seam from there to its edge."""
    from build123d import Box, Pos, Sphere

    from mirror_cad.occt.step import Part, write_step

    cap = Pos(0, 0, -950) * Sphere(950) & Box(230, 320, 100)
    write_step(tmp_path / "cap.step", [Part(cap.wrapped, "cap")], "cap")
    reflector = raytrace.load_reflector(tmp_path / "cap.step")
    along = np.concatenate([[0.0], np.geomspace(1e-12, 1.0, 60), np.linspace(1.0, 114.9, 200)])
    beside = np.concatenate([[0.0], np.geomspace(1e-16, 1e-6, 21)])
    x, y = (axis.ravel() for axis in np.meshgrid(np.concatenate([along, -along]), np.concatenate([beside, -beside])))
    down = np.tile([0.0, 0.0, -1.0], (len(x), 1))
    for places in (np.stack([x, y, np.full(len(x), 10.0)], axis=1), np.stack([y, x, np.full(len(x), 10.0)], axis=1)):
        trace = raytrace.reflect(reflector, places, down)
        assert trace.counts() == {"reflected": len(x)}
        assert np.abs(np.linalg.norm(trace.points + [0.0, 0.0, 950.0], axis=1) - 950.0).max() < 1e-9


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_rays_that_start_on_a_quadric_leave_it_or_meet_its_other_side(kind: str) -> None:
    """From a place on it, inwards: a chord of 2R·cos θ, in the plane across the axis; outwards and along it: nothing."""
    rng = np.random.default_rng(3)
    centre, radius = np.array([300.0, -200.0, 50.0]), 40.0
    loop = rectangle(0.0, 2 * np.pi, -0.5 * np.pi, 0.5 * np.pi) if kind == "sphere" else rectangle(0.0, 2 * np.pi, -50.0, 50.0)
    face = QuadricFace(Quadric(kind, centre, np.eye(3), radius), (loop,), one_sided=False)  # type: ignore[arg-type]
    reflector = raytrace.Reflector(face)
    u = rng.uniform(-np.pi, np.pi, 2000)
    normal = np.stack([np.cos(u), np.sin(u), np.zeros(2000)], axis=1)
    across = np.stack([-np.sin(u), np.cos(u), np.zeros(2000)], axis=1)
    on = centre + radius * normal
    angle = np.concatenate([rng.uniform(-1.5, 1.5, 1000), 0.5 * np.pi - np.geomspace(1e-6, 1e-1, 1000)])
    inwards = -np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * across
    trace = raytrace.reflect(reflector, on, inwards)
    assert trace.counts() == {"reflected": 2000}
    # The start is off by the rounding of 300 mm, 6e-14; along the ray that is 1/cos θ as much.
    assert (np.abs(trace.distances - 2.0 * radius * np.cos(angle)) * np.cos(angle)).max() < 3e-13
    leaves = np.einsum("ij,ij->i", trace.directions, trace.normals)
    assert (np.abs(leaves - np.cos(angle)) * np.cos(angle)).max() < 1e-14
    assert raytrace.reflect(reflector, on, -inwards).counts() == {"missed": 2000}
    # A bounce after a bounce is as long.
    again = raytrace.reflect(reflector, trace.points, trace.directions)
    assert (np.abs(again.distances - trace.distances) * np.cos(angle)).max() < 6e-13


def test_a_cone_is_met_beside_its_apex_and_at_it(tmp_path: Path) -> None:
    """x² + y² = (2/3)²·(45 − z)² below the apex (0, 0, 45): a quadratic along the ray."""
    from build123d import Cone

    from mirror_cad.occt.step import Part, write_step

    path = tmp_path / "cone.step"
    write_step(path, [Part(Cone(60, 0, 90).wrapped, "cone")], "cone")
    reflector = raytrace.load_reflector(path)
    eye, k = np.array([300.0, 20.0, 200.0]), (2.0 / 3.0) ** 2
    rng = np.random.default_rng(4)
    size = np.repeat(np.geomspace(1e-6, 1.0, 7), 300)[:, None]
    rays = np.array([0.0, 0.0, 45.0]) + size * rng.normal(size=(2100, 3)) - eye
    d = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    o = eye - [0.0, 0.0, 45.0]
    a = d[:, 0] ** 2 + d[:, 1] ** 2 - k * d[:, 2] ** 2
    b = o[0] * d[:, 0] + o[1] * d[:, 1] - k * o[2] * d[:, 2]
    root = b * b - a * (o[0] ** 2 + o[1] ** 2 - k * o[2] ** 2)
    trace = raytrace.reflect(reflector, eye, rays)
    with np.errstate(invalid="ignore"):
        t = np.sort(np.stack([(-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a], axis=1), axis=1)
        below = eye[2] + t * d[:, 2:] < 45.0
    first = np.where(below[:, 0], t[:, 0], np.where(below[:, 1], t[:, 1], np.nan))
    clear = np.abs(root) > 1e-11 * b * b  # else the quadratic itself does not say
    assert clear.sum() > 1000
    met = trace.status == Status.REFLECTED
    assert np.array_equal(met[clear], np.isfinite(first[clear]))
    assert np.nanmax(np.abs(trace.distances[clear] - first[clear])) < 1e-7  # the root of a difference of 1e-11


def test_results_may_be_the_rays_of_the_next_trace() -> None:
    reflector = raytrace.Reflector.from_mirror(designed("progressive-c"))
    rng = np.random.default_rng(2)
    rays = np.stack([rng.uniform(-130, 130, 3000), rng.uniform(-150, 150, 3000), np.zeros(3000)], axis=1) - EYE
    first = raytrace.reflect(reflector, EYE, rays)
    expected = raytrace.reflect(reflector, first.points.copy(), first.directions.copy())
    again = raytrace.reflect(reflector, first.points, first.directions, out=first)
    assert np.array_equal(again.status, expected.status)
    room = Trace.empty(3000)
    with pytest.raises(raytrace.TraceError, match="same memory"):
        raytrace.reflect(reflector, EYE, rays,
                         out=Trace(room.status, room.points, room.points, room.directions, room.distances))
    with pytest.raises(raytrace.TraceError, match="different lengths"):
        raytrace.reflect(reflector, EYE, [[0.0, 0, -1], [0.0, 1]])


def test_colours_of_an_assembly_are_those_of_its_parts(tmp_path: Path) -> None:
    from build123d import Box, Color, Compound, Pos, export_step

    from mirror_cad.cad_file import read_cad

    red, green = Box(40, 40, 10), Pos(100, 0, 0) * Box(40, 40, 10)
    red.color, green.color = Color(1, 0, 0), Color(0, 1, 0)
    path = tmp_path / "assembly.step"
    export_step(Compound(children=[red, green], label="assembly"), str(path))
    assert [face.colour for face in read_cad(path).faces] == [(255, 0, 0)] * 6 + [(0, 255, 0)] * 6
    assert raytrace.load_reflector(path, (0, 255, 0)).outline()[:, 0].min() == pytest.approx(80.0)
