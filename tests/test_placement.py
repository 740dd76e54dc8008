"""Where a mirror stands in its file changes no figure: one part at many places and tilts, moved by other programs' means."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OCP.BRepAlgoAPI import BRepAlgoAPI_Common
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_Transform
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.Geom import Geom_SphericalSurface
from OCP.gp import gp_Ax3, gp_Dir, gp_Pnt, gp_Trsf
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
from OCP.TopoDS import TopoDS_Shape
from scipy.spatial.transform import Rotation

from mirror_cad import load_spec
from mirror_cad.errors import MirrorError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.occt.step import _silence
from mirror_cad.own_files import written_by_us
from mirror_cad.stl_file import write_mesh
from mirror_studio.as_json import placement_as_json, trace_metrics_as_json
from mirror_studio.build.pipeline import trace_file
from mirror_studio.cli import run
from mirror_studio.drive.mirrors import driven_mirror, placements_of
from mirror_studio.drive.run import drive
from mirror_studio.progress import Progress
from mirror_studio.scene_file import load_scene
from raytrace import Placement, Reflector, load_reflector, reflect
from raytrace.errors import TraceError
from raytrace.seating import find_placement, place_from, seated
from raytrace.surfaces.quadric import QuadricFace
from raytrace.viewing.view import box_of
from tests.conftest import designed
from tests.meshes import grid

Array = np.ndarray

RADIUS, HALF_WIDTH, HALF_HEIGHT = 950.0, 115.0, 80.0
FACET_MM = 5.0  # of the sheets of triangles
# Rounding of a frame that is found from an outline at 5 m, whose points a STEP file has to 15 digits and edges to 1e-9 mm.
FRAME_MM, FRAME_RAD = 5e-9, 5e-11
# float32 at 5 m rounds vertices 5 mm apart by 2.4e-4 mm: a hundred of them together say the normal to 2e-5 rad.
FLOAT32_MM, FLOAT32_RAD = 5e-4, 3e-5
# Mirror directions to those of a vehicle with X rearward, Y right and Z up.
IN_VEHICLE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
Motion = tuple[Array, Array]


def motions(count: int, seed: int = 14) -> list[Motion]:
    """Rotations by 30° at most about any axis, of half of them from a vehicle's directions, and places up to 5 m away."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(count):
        axis = random.normal(size=3)
        turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(random.uniform(2.0, 30.0))).as_matrix()
        found.append((turn @ IN_VEHICLE if k % 2 else turn, random.uniform(-5000.0, 5000.0, 3)))
    return found


def step(path: Path, shape: TopoDS_Shape, motion: Motion | None = None) -> Path:
    """A shape moved and written by the kernel alone."""
    if motion is not None:
        moved = gp_Trsf()
        moved.SetValues(*[float(v) for row, shift in zip(*motion, strict=True) for v in (*row, shift)])
        shape = BRepBuilderAPI_Transform(shape, moved, True).Shape()
    _silence()
    writer = STEPControl_Writer()
    writer.Transfer(shape, STEPControl_AsIs)
    writer.Write(str(path))
    return path


def cap_shape() -> TopoDS_Shape:
    """A sphere cap over a rectangle, as a face of the kernel's own sphere, with the seam on its far side."""
    ball = Geom_SphericalSurface(gp_Ax3(gp_Pnt(0.0, 0.0, -RADIUS), gp_Dir(0.0, 1.0, 0.0), gp_Dir(0.0, 0.0, -1.0)), RADIUS)
    box = BRepPrimAPI_MakeBox(gp_Pnt(-HALF_WIDTH, -HALF_HEIGHT, -100.0), gp_Pnt(HALF_WIDTH, HALF_HEIGHT, 100.0)).Solid()
    return BRepAlgoAPI_Common(BRepBuilderAPI_MakeFace(ball, 1e-7).Face(), box).Shape()


def cap_mesh(bend: float = 1.0) -> SurfaceMesh:
    """The same as a sheet of triangles; bend −1 is hollow, 0 flat."""
    x, y, faces = grid(np.linspace(-HALF_WIDTH, HALF_WIDTH, 47), np.linspace(-HALF_HEIGHT, HALF_HEIGHT, 33))
    return SurfaceMesh(np.stack([x, y, bend * (np.sqrt(RADIUS**2 - x**2 - y**2) - RADIUS)], axis=1), faces)


def moved(mesh: SurfaceMesh, motion: Motion) -> SurfaceMesh:
    return SurfaceMesh(mesh.vertices @ motion[0].T + motion[1], mesh.faces)


def ply(path: Path, mesh: SurfaceMesh) -> Path:
    """A PLY file of doubles, to the last digit."""
    head = (f"ply\nformat ascii 1.0\nelement vertex {len(mesh.vertices)}\nproperty double x\nproperty double y\n"
            f"property double z\nelement face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    path.write_text(head + "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in mesh.vertices.tolist())
                    + "".join(f"3 {a} {b} {c}\n" for a, b, c in mesh.faces.tolist()))
    return path


def foreign_stl(path: Path, mesh: SurfaceMesh) -> Path:
    """A binary STL with another program's header."""
    write_mesh(path, mesh)
    data = path.read_bytes()
    path.write_bytes(b"binary STL of a CAD system".ljust(80) + data[80:])
    return path


def off_by(placement: Placement | None, motion: Motion) -> tuple[float, float]:
    """How far a placement's origin and its axes are from those of a motion."""
    assert placement is not None
    return (float(np.abs(placement.origin_mm - motion[1]).max()), float(np.abs(placement.rotation - motion[0].T).max()))


def figures(content: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of nested results, but the placement itself."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list | tuple) else None
    if items is None:
        yield path, content
        return
    for key, value in items:
        if key != "placement":
            yield from figures(value, f"{path}.{key}")


def differences(one: Any, other: Any, relative: float) -> list[tuple[str, Any, Any]]:
    """The figures that differ by more than a share of themselves."""
    a, b = dict(figures(one)), dict(figures(other))
    assert a.keys() == b.keys()
    return [(key, a[key], b[key]) for key in a if not (
        abs(a[key] - b[key]) <= relative * max(abs(a[key]), 1e-6) if isinstance(a[key], int | float)
        and isinstance(b[key], int | float) else a[key] == b[key])]


# --- the frame --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", motions(4))
def test_the_frame_of_a_cap_is_the_motion_that_the_kernel_moved_it_by(tmp_path: Path, motion: Motion) -> None:
    origin, axes = off_by(load_reflector(step(tmp_path / "cap.step", cap_shape(), motion), place="face").placement, motion)
    assert origin < FRAME_MM
    assert axes < FRAME_RAD
    origin, axes = off_by(load_reflector(ply(tmp_path / "cap.ply", moved(cap_mesh(), motion)), place="face").placement, motion)
    assert origin < 1e-6  # Embree's float32 says where on a facet the normal is taken
    assert axes < 1e-8
    origin, axes = off_by(load_reflector(foreign_stl(tmp_path / "cap.stl", moved(cap_mesh(), motion)), place="face").placement,
                          motion)
    assert origin < FLOAT32_MM
    assert axes < FLOAT32_RAD


@pytest.mark.parametrize("motion", motions(2, seed=3))
def test_a_plate_whose_faces_all_reflect_is_seated_by_its_front(tmp_path: Path, motion: Motion) -> None:
    """Its outline is symmetric about its horizontal axis alone. The kernel keeps its edges to 1e-7 mm."""
    mirror = designed("progressive-c")
    placement = load_reflector(step(tmp_path / "plate.step", mirror.plate.solid, motion), place="auto").placement
    assert placement is not None
    assert placement.source == "face"
    origin, axes = off_by(placement, motion)
    assert origin < 2e-7
    assert axes < 5e-9


def test_a_face_in_mirror_coordinates_stays_to_the_last_bit(tmp_path: Path) -> None:
    path = step(tmp_path / "cap.step", cap_shape())
    as_filed, placed = load_reflector(path), load_reflector(path, place="face")
    assert placed.placement is not None
    assert placement_as_json(placed.placement) == {
        "origin_mm": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "up": [0.0, 1.0, 0.0], "from": "face"}
    assert isinstance(as_filed.surface, QuadricFace)
    assert isinstance(placed.surface, QuadricFace)
    assert np.array_equal(as_filed.surface.quadric.centre, placed.surface.quadric.centre)


@pytest.mark.parametrize(("kind", "roll_kept"), [("square", True), ("trapezoid", True), ("irregular", False), ("round", False)])
def test_up_is_the_outline_s_own_axis_where_it_has_one(kind: str, roll_kept: bool) -> None:
    """A roll of 20° about the normal goes along with a symmetric outline; another, and a round one, leave up to the file."""
    angle = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
    outline = {"square": [(-90, -90), (90, -90), (90, 90), (-90, 90)],
               "trapezoid": [(-115, -135), (115, -170), (115, 170), (-115, 135)],
               "irregular": [(-115, -60), (100, -90), (115, 70), (-80, 95)],
               "round": np.stack([100 * np.cos(angle), 100 * np.sin(angle)], axis=1)}[kind]
    rim = np.array(outline, dtype=float)
    vertices = np.concatenate([rim, rim.mean(axis=0)[None]])
    n = len(rim)
    faces = np.stack([np.arange(n), (np.arange(n) + 1) % n, np.full(n, n)], axis=1).astype(np.int32)
    mesh = SurfaceMesh(np.concatenate([vertices, np.zeros((n + 1, 1))], axis=1), faces)
    roll = Rotation.from_euler("z", 20.0, degrees=True).as_matrix()
    up = find_placement(Reflector.of_mesh(moved(mesh, (roll, np.array([300.0, -200.0, 50.0]))))).up
    assert up == pytest.approx(roll[:, 1] if roll_kept else [0.0, 1.0, 0.0], abs=1e-9)


# --- the side ---------------------------------------------------------------------------------------------------------


def test_a_sheet_reflects_where_it_is_convex_whichever_way_its_facets_turn() -> None:
    motion = motions(1)[0]
    mesh = moved(cap_mesh(), motion)
    other = mesh.faces[:, ::-1]
    for faces in (mesh.faces, other, np.where(np.arange(len(other))[:, None] % 2, mesh.faces, other)):
        placement = find_placement(Reflector.of_mesh(SurfaceMesh(mesh.vertices, np.ascontiguousarray(faces))))
        assert off_by(placement, motion)[1] < 1e-8


def test_a_flat_sheet_looks_as_its_facets_do() -> None:
    motion = motions(1)[0]
    flat = moved(cap_mesh(0.0), motion)
    assert find_placement(Reflector.of_mesh(flat)).normal == pytest.approx(motion[0][:, 2], abs=1e-9)
    turned = SurfaceMesh(flat.vertices, np.ascontiguousarray(flat.faces[:, ::-1]))
    assert find_placement(Reflector.of_mesh(turned)).normal == pytest.approx(-motion[0][:, 2], abs=1e-9)


def test_a_hollow_sheet_in_mirror_coordinates_stays_there() -> None:
    assert find_placement(Reflector.of_mesh(cap_mesh(-1.0))).is_identity


# --- whose file it is -------------------------------------------------------------------------------------------------


def test_our_own_files_are_in_mirror_coordinates_until_another_program_writes_them(tmp_path: Path) -> None:
    mirror = designed("progressive-c")
    mirror.export_step(tmp_path / "m.step")
    mirror.export_surface_step(tmp_path / "m-surface.step")
    mirror.export_stl(tmp_path / "m.stl")
    for name in ("m.step", "m-surface.step", "m.stl"):
        (tmp_path / "renamed").with_suffix(Path(name).suffix).write_bytes((tmp_path / name).read_bytes())
        reflector = load_reflector((tmp_path / "renamed").with_suffix(Path(name).suffix), place="auto")
        assert reflector.placement is not None
        assert reflector.placement.source == "file"
        assert reflector.placement.is_identity
    assert not written_by_us(step(tmp_path / "m.step", mirror.plate.solid))
    foreign = (tmp_path / "m-surface.step").read_text().replace("'mirror-cad'", "'another'", 1)
    (tmp_path / "quoted.step").write_text(foreign.replace("FILE_NAME(", "/* 'mirror-cad','' */ FILE_NAME("))
    assert not written_by_us(tmp_path / "quoted.step")


# --- stated -----------------------------------------------------------------------------------------------------------


def test_a_stated_placement_is_the_rigid_motion_of_every_part(tmp_path: Path) -> None:
    """Rays that are moved with the file, and rays in mirror coordinates, are the same rays; obstacles come along."""
    mirror = designed("progressive-c")
    mirror.export_step(tmp_path / "m.step")
    turn, shift = motions(1)[0]
    placement = Placement.of(shift, turn[:, 2], turn[:, 1])
    as_filed, placed = load_reflector(tmp_path / "m.step"), load_reflector(tmp_path / "m.step", place=placement)
    eye = np.array([115.0, 0.0, 750.0])
    rays = np.random.default_rng(0).uniform([-140.0, -190.0, 0.0], [140.0, 190.0, 0.0], (500, 3)) - eye
    there = reflect(as_filed, turn @ eye + shift, rays @ turn.T)
    here = reflect(placed, eye, rays)
    assert np.array_equal(here.status, there.status)
    assert np.nanmax(np.abs(placement.to_file(here.points) - there.points), initial=0.0) < 1e-9
    assert placed.obstacles is not None
    assert as_filed.obstacles is not None
    assert np.abs(placement.to_file(placed.obstacles.vertices) - as_filed.obstacles.vertices).max() < 1e-9
    assert placed.placement is not None
    assert placed.placement.source == "stated"


@pytest.mark.parametrize(("text", "fault"), [
    ("1 2 3", "nine numbers"), ("somewhere", "auto, face, file"), ("0,0,0 0,0,0 0,1,0", "normal is zero"),
    ("0,0,0 0,0,1 0,0,2", "runs along the normal"), ("0,0,nan 0,0,1 0,1,0", "finite"),
    ("1e12,0,0 0,0,1 0,1,0", "farther away")])
def test_what_is_no_placement_is_refused(text: str, fault: str) -> None:
    with pytest.raises(TraceError, match=fault):
        place_from(text)


def test_places_are_said_for_all_files_or_for_one() -> None:
    files = ["a.step", "b.stl", "progressive-c"]
    assert placements_of(files, ["file", "b.stl=face"]) == {"a.step": "file", "b.stl": "face"}
    assert placements_of(files, []) == {}
    for said, fault in ((["c.stl=face"], "none of the mirrors"), (["progressive-c=face"], "designed here"),
                        (["file", "face"], "have a place already")):
        with pytest.raises(MirrorError, match=fault):
            placements_of(files, said)


# --- trace and drive --------------------------------------------------------------------------------------------------


def small() -> Any:
    spec = load_spec("progressive-c")
    return spec.model_copy(update={"view": spec.view.model_copy(update={"width_px": 200})})


def test_trace_gives_one_answer_wherever_the_part_stands(tmp_path: Path) -> None:
    """STEP and PLY to rounding; float32 to that of its vertices: each is off by half the spacing of numbers where the part
    stands, 2.4e-4 mm at 5 m, which turns a facet of 5 mm by twice that over 5 mm at most, and either edge's ray by twice as
    much again."""
    home: dict[str, dict[str, Any]] = {}
    for motion in ((np.eye(3), np.zeros(3)), *motions(2, seed=5)):
        files = (step(tmp_path / "cap.step", cap_shape(), motion), ply(tmp_path / "cap.ply", moved(cap_mesh(), motion)),
                 foreign_stl(tmp_path / "cap.stl", moved(cap_mesh(), motion)))
        for file in files:
            found = trace_metrics_as_json(trace_file(file, small(), tmp_path / "out", Progress(True)))
            first = home.setdefault(file.name, found)
            assert np.linalg.norm(found["eye_mm"]) == pytest.approx(762.0, rel=1e-12)
            if file.suffix == ".stl":
                turned = 2.0 * (0.5 * float(np.spacing(np.float32(np.abs(motion[1]).max() + HALF_WIDTH)))) / FACET_MM
                assert abs(found["h_fov_deg"]["traced"] - first["h_fov_deg"]["traced"]) <= math.degrees(2.0 * 2.0 * turned)
            else:
                assert differences(first, found, 1e-9) == []


def test_drive_aims_and_sees_alike_wherever_the_part_stands(tmp_path: Path) -> None:
    scene = load_scene("motorway")
    home = driven_mirror(str(step(tmp_path / "home.step", cap_shape())), scene)
    for motion in motions(2, seed=5):
        there = driven_mirror(str(step(tmp_path / "there.step", cap_shape(), motion)), scene)
        assert there.pose.yaw == pytest.approx(home.pose.yaw, rel=1e-9)
        assert there.pose.pitch == pytest.approx(home.pose.pitch, rel=1e-9)
        assert box_of(there.reflector) == pytest.approx(box_of(home.reflector), rel=1e-9)


def test_a_picture_of_nothing_is_no_result(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "m.step"
    designed("progressive-c").export_step(path)
    assert run(["trace", str(path), "--place", "0,0,0 0,0,-1 0,1,0", "--out", str(tmp_path / "out")]) == 2
    assert "no ray from the eye is reflected" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


def test_trace_says_where_it_took_the_mirror_to_be(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = ply(tmp_path / "cap.ply", moved(cap_mesh(), (np.eye(3), np.array([0.0, 0.0, -3000.0]))))
    assert run(["trace", str(path), "--out", str(tmp_path / "out")]) == 0
    assert "placement: origin (0, 0, -3000) mm, normal (0, 0, 1), up (0, 1, 0): found from the face" in capfd.readouterr().err
    placement = json.loads((tmp_path / "out" / "metrics.json").read_text())["placement"]
    assert placement["from"] == "face"
    assert placement["origin_mm"] == pytest.approx([0.0, 0.0, -3000.0], abs=1e-6)


def test_what_has_no_extent_is_refused() -> None:
    line = SurfaceMesh(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), np.array([[0, 1, 2]], dtype=np.int32))
    with pytest.raises(TraceError, match="a point or a line"):
        seated(Reflector.of_mesh(line), ours=False)


# A difference of differences of rays over a thousandth of the width: it keeps half of the digits.
RATE = "max_rate_percent_per_mm"
# Where a smooth function is largest is known to the root of its rounding: a motion's 1e-13, over some 100 mm.
PLACE = re.compile(r"_at_mm\.[01]$")
PLACE_MM = 3e-5
# Pictures ask for more rays where neighbours differ: of a mesh, which those are follows from its facets' rounding.
RAYS = 1e-3


@pytest.mark.long
def test_every_figure_of_trace_and_drive_at_twenty_places(tmp_path: Path) -> None:
    spec, scene = load_spec("progressive-c"), load_scene("motorway")
    home: dict[str, tuple[Any, Any]] = {}
    for motion in ((np.eye(3), np.zeros(3)), *motions(20)):
        for file in (step(tmp_path / "cap.step", cap_shape(), motion), ply(tmp_path / "cap.ply", moved(cap_mesh(), motion))):
            traced = trace_metrics_as_json(trace_file(file, spec, tmp_path / "trace", Progress(True)))
            driven = drive([str(file)], scene, tmp_path / "drive", Progress(True))
            first = home.setdefault(file.name, (traced, driven))
            assert differences(first[0], traced, 1e-9) == []
            left = differences(first[1], driven, 1e-9)
            assert [key for key, one, other in left if not (key.endswith(RATE) and abs(one - other) < 1e-6 * abs(one)) and not (
                PLACE.search(key) and abs(one - other) < PLACE_MM) and not (
                file.suffix == ".ply" and ".rays." in key and abs(one - other) < RAYS * one)] == []
