"""Plates and their meshes: straight, flat and sign-changing mirrors, awkward outlines, thick and thin glass."""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Curve2d
from OCP.TopAbs import TopAbs_EDGE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

import mirror_cad
from mirror_cad.grid import Grid
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mesh_deviation import stl_deviation
from mirror_cad.mirror import Mirror
from mirror_cad.occt.shapes import faces_of, solids_of
from mirror_cad.occt.solid import EDGE_TOLERANCE_MM, Plate, is_valid, plate
from mirror_cad.occt.step import read_step
from mirror_cad.outline import Arc, Line, Outline, closed_outline
from mirror_cad.plate_mesh import MAX_FACETS, plate_mesh
from mirror_cad.stl_file import read_stl
from mirror_cad.surfaces.differential import normals, principal_curvatures_of, shape_operator
from mirror_cad.surfaces.offset import offset_surface
from mirror_cad.triangulation import doubled_area, triangles_within
from tests.conftest import constant, designed, spec_of

Array = NDArray[np.float64]
FLAT = constant(np.inf)
WAVY = {"law": "expression", "curvature": "0.001*sin(x/40)"}
ZONES = {"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": 0.5865}
TURN = 2.0 * np.pi * np.arange(1000) / 1000

LAWS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "cylinder across": (constant(1250.0), FLAT),
    "cylinder upright": (FLAT, constant(1250.0)),
    "straight by formula": (constant(1250.0), {"law": "expression", "curvature": "0"}),
    "sign change": (WAVY, constant(1250.0)),
    "sign change and straight": (WAVY, FLAT),
    "sign change upright": (FLAT, WAVY),
    "plane": (FLAT, FLAT),
    "concave": (constant(-2000.0), constant(-1500.0)),
    "concave cylinder": (constant(-1250.0), FLAT),
    "saddle": (constant(-2000.0), constant(1500.0)),
    "nearly straight": (constant(1250.0), constant(1e5)),
    "steep": (constant(130.0), FLAT),
    "progressive": (ZONES, constant(1300.0)),
}


def polygon(points: Array) -> Outline:
    ends = [(float(x), float(y)) for x, y in points]
    return closed_outline([Line(a, b) for a, b in zip(ends, ends[1:] + ends[:1], strict=True)], "test")


def around(radius: Array | float) -> Array:
    """Points at 1,000 even angles."""
    return np.stack([radius * np.cos(TURN), 1.2 * radius * np.sin(TURN)], axis=1)


OUTLINES = {
    "1,000-gon": polygon(around(100.0)),
    "star of 1,000": polygon(around(np.where(np.arange(1000) % 2, 100.0, 90.0))),
    "wavy": polygon(around(100.0 + 3.0 * np.sin(20.0 * TURN))),
    "noise": polygon(around(np.random.default_rng(1).uniform(90.0, 100.0, 1000))),
    "circle": closed_outline([Arc((3.0, 0.0), 90.0, 0.4, 2.0 * np.pi)], "test"),
    "rectangle": polygon(np.array([[-100.0, -150.0], [100.0, -150.0], [100.0, 150.0], [-100.0, 150.0]])),
    "spike": polygon(np.array([[-110.0, -1.0], [110.0, 0.0], [-110.0, 1.0]])),
    "neck of 2 µm": polygon(np.array([[-110.0, -90.0], [-10.0, -90.0], [-10.0, -1e-3], [10.0, -1e-3], [10.0, -90.0],
                                      [110.0, -90.0], [110.0, 90.0], [10.0, 90.0], [10.0, 1e-3], [-10.0, 1e-3], [-10.0, 90.0],
                                      [-110.0, 90.0]])),
}


@cache
def of_law(name: str) -> Mirror:
    """The mirror with the default outline, designed once for all tests."""
    return mirror_cad.design(spec_of(*LAWS[name]))


def mesh_of(mirror: Mirror, deflection_mm: float, outline: Outline, thickness_mm: float = 3.0) -> SurfaceMesh:
    """The mesh of a plate, with corners as STL holds them, without making the solid."""
    back, _ = offset_surface(mirror.surface, outline, thickness_mm)
    mesh = plate_mesh(mirror.surface, back, outline, deflection_mm)
    return SurfaceMesh(mesh.vertices.astype(np.float32).astype(np.float64), mesh.faces.copy())


def plate_volume(mirror: Mirror, outline: Outline, t: float) -> float:
    """∫(t − t²·H + t³/3·K) dA by the cells of the evaluation grid: good to a percent, which tells sign and size."""
    grid = Grid.over(outline)
    inside = grid.weights > 0
    d = mirror.surface.derivatives(grid.x[inside], grid.y[inside])
    k1, k2 = principal_curvatures_of(shape_operator(d))
    element = np.linalg.norm(np.cross(d["u"], d["v"]), axis=1)
    return float(np.mean(element * (t - t**2 * 0.5 * (k1 + k2) + t**3 / 3.0 * k1 * k2))) * outline.area_mm2()


def assert_closed_and_outward(mesh: SurfaceMesh, volume_mm3: float) -> None:
    """Every edge is shared by two facets that run along it in opposite ways, and what they enclose has the volume."""
    places, corner = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = corner[mesh.faces].astype(np.int64)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    edges, turned = start * len(places) + end, end * len(places) + start
    assert len(np.unique(edges)) == len(edges)
    assert np.array_equal(np.sort(edges), np.sort(turned))
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6.0 == pytest.approx(volume_mm3, rel=0.02)


@pytest.mark.parametrize("name", LAWS)
def test_every_smooth_mirror_gets_its_mesh_within_the_deflection(name: str) -> None:
    mirror = of_law(name)
    mesh = mesh_of(mirror, 0.01, mirror.outline)
    reached = stl_deviation(mesh, mirror.surface, mirror.outline)
    assert reached.height_max_mm <= 0.01
    assert reached.facets <= 30_000
    assert_closed_and_outward(mesh, plate_volume(mirror, mirror.outline, 3.0))


@pytest.mark.parametrize(("size", "radii"), [(20.0, (50.0, np.inf)), (20.0, (60.0, -40.0)), (3000.0, (5000.0, np.inf))])
def test_mirrors_of_20_mm_and_of_3_m_too(size: float, radii: tuple[float, float]) -> None:
    outline = {"width_mm": size, "left_height_mm": 0.8 * size, "right_height_mm": size, "corner_radius_mm": 5.0}
    mirror = mirror_cad.design(spec_of(*map(constant, radii), outline=outline, blank={"width_mm": 3000.0, "height_mm": 3000.0},
                                       export={"surface_margin_mm": 0.0}))
    mesh = mesh_of(mirror, 0.01, mirror.outline)
    assert stl_deviation(mesh, mirror.surface, mirror.outline).height_max_mm <= 0.01
    assert_closed_and_outward(mesh, plate_volume(mirror, mirror.outline, 3.0))


def test_back_and_sides_are_within_the_deflection_too() -> None:
    """Thick glass, where the back bends more than the front and the sides twist; straight outline, flat in (u, v)."""
    mirror, outline, t, allowed = of_law("progressive"), OUTLINES["rectangle"], 60.0, 0.01
    back, _ = offset_surface(mirror.surface, outline, t)
    mesh = plate_mesh(mirror.surface, back, outline, allowed)
    front = len(mesh.vertices) // 2
    uv, behind = mesh.vertices[:front, :2], mesh.faces[(mesh.faces >= front).all(axis=1)] - front
    for corners in (behind, behind[:, :2], behind[:, 1:], behind[:, ::2]):
        d = back.derivatives(*uv[corners].mean(axis=1).T)
        off = mesh.vertices[corners + front].mean(axis=1) - d["s"]
        assert np.abs(np.einsum("ni,ni->n", off, normals(d["u"], d["v"]))).max() <= allowed
    sides = mesh.faces[(mesh.faces < front).sum(axis=1) == 1]  # a, a behind, b behind: the other half is a, b behind, b
    a, b = sides[:, sides[0] < front][:, 0], sides[:, 2] - front
    assert (sides[:, 1] == a + front).all()
    d = mirror.surface.derivatives(*(0.5 * (uv[a] + uv[b])).T)
    normal = normals(d["u"], d["v"])
    outward = np.cross(mesh.vertices[b] - mesh.vertices[a], normal)
    off = 0.5 * (mesh.vertices[a] + mesh.vertices[b + front]) - (d["s"] - 0.5 * t * normal)
    assert np.abs(np.einsum("ni,ni->n", off, outward / np.linalg.norm(outward, axis=1, keepdims=True))).max() <= allowed


def test_a_cylinder_is_exported_in_seconds_and_reads_back_within_the_deflection(tmp_path: Path) -> None:
    mirror = of_law("cylinder across")
    start = time.process_time()
    mirror.export_stl(tmp_path / "a.stl")
    assert time.process_time() - start < 10.0
    mesh = read_stl(tmp_path / "a.stl")
    assert stl_deviation(mesh, mirror.surface, mirror.outline).height_max_mm <= 0.01
    assert_closed_and_outward(mesh, mirror.plate.volume_mm3)


def test_a_progressive_mirror_keeps_its_facets(tmp_path: Path) -> None:
    """As many as light needs, and not more: their normals are within 0.25° at 0.01 mm."""
    mirror = designed("progressive-c")
    mirror.export_stl(tmp_path / "c.stl", 0.01)
    reached = stl_deviation(read_stl(tmp_path / "c.stl"), mirror.surface, mirror.outline)
    assert reached.height_max_mm <= 0.01
    assert 4000 <= reached.facets <= 7000
    assert reached.normal_max_deg <= 0.25


@pytest.mark.parametrize("deflection", [0.0, -0.01, float("nan"), float("inf")])
def test_a_deflection_that_cannot_be_is_refused_with_its_number(tmp_path: Path, deflection: float) -> None:
    with pytest.raises(mirror_cad.WriteError, match=rf"a\.stl: a deflection of {deflection:g} mm cannot be held: it must be"):
        designed("sphere-950").export_stl(tmp_path / "a.stl", deflection)
    assert not (tmp_path / "a.stl").exists()


def test_a_deflection_too_fine_for_stl_is_refused_with_the_numbers(tmp_path: Path) -> None:
    mirror = designed("sphere-950")
    with pytest.raises(mirror_cad.WriteError, match=r"1e-06 mm cannot be held: STL rounds .* to 2e-05 mm; ask for 5e-05 mm"):
        mirror.export_stl(tmp_path / "a.stl", 1e-6)
    with pytest.raises(mirror_cad.WriteError, match=rf"some [\d,]+ facets .* more than {MAX_FACETS:,}: ask for [\d.e-]+ mm"):
        plate_mesh(mirror.surface, mirror.plate.back, mirror.outline, 5e-6)


@pytest.mark.parametrize(("law", "thickness"), [("progressive", 20.0), ("cylinder across", 0.5)])
@pytest.mark.parametrize("name", OUTLINES)
def test_awkward_outlines_are_filled(name: str, law: str, thickness: float) -> None:
    mirror, outline = of_law(law), OUTLINES[name]
    mesh = mesh_of(mirror, 0.03, outline, thickness)
    reached = stl_deviation(mesh, mirror.surface, outline)
    assert reached.height_max_mm <= 0.03
    front = mesh.faces[: reached.facets]
    filled = 0.5 * float(doubled_area(mesh.vertices[:, :2], front.astype(np.int64)).sum())
    assert filled == pytest.approx(outline.area_mm2(), abs=0.03 * 700.0)  # the deflection times the length of the edge
    if name != "neck of 2 µm":  # which float32 closes here and there
        assert_closed_and_outward(mesh, plate_volume(mirror, outline, thickness))


@settings(max_examples=60)
@given(st.integers(5, 60), st.integers(0, 200), st.integers(0, 2**32 - 1), st.floats(0.0, 0.95))
def test_triangles_fill_any_star_shaped_loop_and_have_its_edges(corners: int, inner: int, seed: int, depth: float) -> None:
    rng = np.random.default_rng(seed)
    radius = rng.uniform(1.0 - depth, 1.0, corners)
    tips = on_circle(2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.4, 0.4, corners)) / corners) * radius[:, None]
    # Nodes on every edge: in line only to rounding.
    thirds = np.array([0.0, 0.3, 0.7])[:, None, None]
    loop = np.concatenate(np.swapaxes(tips + thirds * (np.roll(tips, -1, axis=0) - tips), 0, 1))
    within = on_circle(rng.uniform(0.0, 7.0, inner)) * rng.uniform(0.0, 0.1 * (1.0 - depth), (inner, 1))
    nodes = np.concatenate([loop, within])
    triangles, lacking = triangles_within(nodes, len(loop))
    assert len(lacking) == 0
    sides = set(zip(triangles.ravel().tolist(), np.roll(triangles, -1, axis=1).ravel().tolist(), strict=True))
    assert {(i, (i + 1) % len(loop)) for i in range(len(loop))} <= sides
    area = 0.5 * float(np.sum(loop[:, 0] * np.roll(loop[:, 1], -1) - loop[:, 1] * np.roll(loop[:, 0], -1)))
    turns = doubled_area(nodes, triangles)
    assert (turns > 0.0).all()
    assert 0.5 * turns.sum() == pytest.approx(area, rel=1e-9)
    assert len(np.unique(triangles)) == len(nodes)


def on_circle(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


# --- the kernel's own fit ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("route", ["occt-interpolate", "occt-approximate"])
def test_kernel_fits_get_plate_step_and_stl(route: str, tmp_path: Path) -> None:
    mirror = mirror_cad.design(spec_of(ZONES, constant(1300.0), surface={"fit": route}))
    assert mirror.plate.back_error_mm <= 1e-4
    mirror.export_step(tmp_path / "a.step")
    mirror.export_stl(tmp_path / "a.stl")
    shape = read_step(tmp_path / "a.step").shape
    assert len(solids_of(shape)) == 1
    assert is_valid(shape)
    assert stl_deviation(read_stl(tmp_path / "a.stl"), mirror.surface, mirror.outline).height_max_mm <= 0.01


def test_a_back_that_misses_on_the_fronts_knots_gets_more() -> None:
    """A cubic, twice differentiable front: its normal has one derivative less than its own knots leave a spline."""
    jump = {"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": 0.5, "blend_to": 0.5004}
    mirror = mirror_cad.design(spec_of(jump, constant(900.0), surface={"fit": "occt-interpolate"}))
    back, error = offset_surface(mirror.surface, mirror.outline, 3.0)
    assert error <= 1e-3
    assert back.poles.shape[0] > mirror.surface.poles.shape[0]


# --- outlines ------------------------------------------------------------------------------------------------------------


def edges_off_the_surface(made: Plate, mirror: Mirror) -> float:
    """Largest distance of the optical face's edges in space from the surface over their trimming curves, mm."""
    worst = 0.0
    edges = TopExp_Explorer(made.optical, TopAbs_EDGE)
    while edges.More():
        edge = TopoDS.Edge_s(edges.Current())
        curve, trim = BRepAdaptor_Curve(edge), BRepAdaptor_Curve2d(edge, made.optical)
        at = np.linspace(curve.FirstParameter(), curve.LastParameter(), 7)
        uv = np.array([trim.Value(float(s)).Coord() for s in at])
        space = np.array([curve.Value(float(s)).Coord() for s in at])
        worst = max(worst, float(np.linalg.norm(mirror.surface.evaluate(*uv.T) - space, axis=1).max()))
        assert BRep_Tool.Tolerance_s(edge) <= 10.0 * EDGE_TOLERANCE_MM
        edges.Next()
    return worst


def test_an_outline_of_a_thousand_lines_is_built_exactly_and_in_seconds(tmp_path: Path) -> None:
    """On a cylinder, where area and volume have closed forms: A = ∮R·asin(x/R) dy, V = (t − t²/2R)·A."""
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 4
    points = around(100.0 + 3.0 * np.sin(20.0 * TURN))
    drawing.modelspace().add_lwpolyline(points.tolist(), close=True)
    drawing.saveas(tmp_path / "wavy.dxf")
    mirror = mirror_cad.design(spec_of(*LAWS["cylinder across"], outline={"file": str(tmp_path / "wavy.dxf")}))
    start = time.process_time()
    made = mirror.plate
    mirror.export_step(tmp_path / "a.step")
    mirror.export_stl(tmp_path / "a.stl")
    assert time.process_time() - start < 20.0  # 7 s here, where it was 60; a shared machine may take twice that
    assert len(faces_of(made.solid)) == 1002
    assert is_valid(made.solid)
    assert edges_off_the_surface(made, mirror) <= EDGE_TOLERANCE_MM
    node, weight = np.polynomial.legendre.leggauss(12)
    start_, end_ = points, np.roll(points, -1, axis=0)
    x = 0.5 * (start_[:, :1] + end_[:, :1]) + 0.5 * (end_[:, :1] - start_[:, :1]) * node
    area = float(np.sum(1250.0 * np.arcsin(x / 1250.0) * weight * 0.5 * (end_[:, 1:] - start_[:, 1:])))
    assert made.area_mm2 == pytest.approx(area, rel=1e-9)
    assert made.volume_mm3 == pytest.approx((3.0 - 9.0 / 2500.0) * area, rel=1e-9)


@pytest.mark.parametrize("law", ["progressive", "cylinder across"])
def test_an_outline_on_the_blanks_edge_gives_a_valid_plate(law: str) -> None:
    """A sheet that ends where the outline does: the whole blank, and one that touches it in places."""
    mirror = mirror_cad.design(spec_of(*LAWS[law], export={"surface_margin_mm": 0.0},
                                       outline={"width_mm": 250.0, "left_height_mm": 380.0, "right_height_mm": 380.0,
                                                "corner_radius_mm": 0.0}))
    touching = polygon(np.array([[-125.0, -100.0], [0.0, -190.0], [125.0, -100.0],
                                 [125.0, 100.0], [0.0, 190.0], [-125.0, 100.0]]))
    for outline in (mirror.outline, touching):
        made = plate(mirror.surface, outline, 3.0)
        assert is_valid(made.solid)
        assert edges_off_the_surface(made, mirror) <= EDGE_TOLERANCE_MM
        assert made.volume_mm3 == pytest.approx(plate_volume(mirror, outline, 3.0), rel=0.01)


@pytest.mark.parametrize("radius", [0.1, 0.01])
def test_a_tiny_corner_radius_gives_a_valid_plate(radius: float, tmp_path: Path) -> None:
    mirror = mirror_cad.design(spec_of(ZONES, constant(1300.0), outline={"corner_radius_mm": radius},
                                       glass={"thickness_mm": 20.0}))
    assert is_valid(mirror.plate.solid)
    assert len(faces_of(mirror.plate.solid)) == 10
    mirror.export_stl(tmp_path / "a.stl")
    assert stl_deviation(read_stl(tmp_path / "a.stl"), mirror.surface, mirror.outline).height_max_mm <= 0.01


# --- thickness -----------------------------------------------------------------------------------------------------------


def test_a_plate_as_thick_as_its_concave_radius_is_refused() -> None:
    mirror = mirror_cad.design(spec_of(constant(-300.0), constant(1250.0)))
    with pytest.raises(mirror_cad.SolidError,
                       match=r"thickness_mm = 310 is not below the smallest concave radius, 29\d\.\d\d mm at .* a block"):
        plate(mirror.surface, mirror.outline, 310.0)
    assert is_valid(plate(mirror.surface, mirror.outline, 290.0).solid)


@pytest.mark.parametrize("law", ["cylinder across", "saddle", "plane"])
@pytest.mark.parametrize("thickness", [0.01, 1e-3])
def test_very_thin_plates_are_built(law: str, thickness: float, tmp_path: Path) -> None:
    mirror = mirror_cad.design(spec_of(*LAWS[law], glass={"thickness_mm": thickness}))
    assert is_valid(mirror.plate.solid)
    assert mirror.plate.back_error_mm <= 0.01 * thickness
    assert mirror.plate.volume_mm3 == pytest.approx(thickness * mirror.plate.area_mm2, rel=1e-4)
    mirror.export_stl(tmp_path / "a.stl")
    mesh = read_stl(tmp_path / "a.stl")
    assert stl_deviation(mesh, mirror.surface, mirror.outline).height_max_mm <= 0.01
    if thickness >= 0.01:
        assert_closed_and_outward(mesh, mirror.plate.volume_mm3)


def test_a_plate_thinner_than_a_micrometre_is_refused() -> None:
    mirror = mirror_cad.design(spec_of(constant(1250.0), constant(1250.0), glass={"thickness_mm": 9e-4}))
    with pytest.raises(mirror_cad.SolidError, match=r"thickness_mm = 0\.0009 is below 0\.001 mm"):
        _ = mirror.plate
