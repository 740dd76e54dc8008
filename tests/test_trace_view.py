"""What `trace` says of a file's field of view: exact edge rays, whatever reflects."""

import math
from pathlib import Path

import numpy as np
import pytest

import raytrace
from mirror_cad.design_stages import design
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.occt.step import GLASS_COLOUR, Part, write_step
from mirror_cad.spec.file import load_spec
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.edge_rays import h_fov_between_edges
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.reflector import Reflector
from raytrace.viewing.eye import eye_position
from raytrace.viewing.view import box_of
from tests.conftest import constant, face_of, spec_of

BOX = (-115.0, 115.0, -163.45, 163.45)
EYE = eye_position(762.0, "right", BOX)
RADIUS = 950.0


def between(x: tuple[float, float], eye: np.ndarray = EYE) -> float:
    """The angle between the rays off a sphere of RADIUS, touching z = 0 from below, at (x, 0): by hand."""
    out = []
    for at in x:
        normal = np.array([at, 0.0, math.sqrt(RADIUS**2 - at**2)]) / RADIUS
        point = RADIUS * normal - [0.0, 0.0, RADIUS]
        ray = (point - eye) / np.linalg.norm(point - eye)
        out.append(ray - 2.0 * (ray @ normal) * normal)
    return math.acos(out[0] @ out[1])


def test_a_file_of_a_preset_has_the_field_of_view_that_its_own_build_measured(tmp_path: Path) -> None:
    spec = load_spec("sphere-950")
    mirror = design(spec)
    mirror.export_step(tmp_path / "mirror.step")
    reflector = raytrace.load_reflector(tmp_path / "mirror.step")
    box = box_of(reflector)
    eye = ViewingSetup.of(spec, box).eye
    traced = h_fov_between_edges(reflector, eye, box)
    built, _ = traced_fields_of_view(face_of(mirror), ViewingSetup.of(spec, mirror.box).eye, mirror.box, mirror.left_height_mm)
    assert traced == pytest.approx(built, rel=1e-11)
    assert traced == pytest.approx(between((-115.0, 115.0), eye), rel=1e-9)  # 44.6435°, where a row of pixels said 44.6391°


def test_faces_of_another_program_have_it_by_closed_form(tmp_path: Path) -> None:
    from build123d import Box as Block
    from build123d import Pos, Sphere

    cap = Pos(0, 0, -RADIUS) * Sphere(RADIUS) & Block(260, 400, 80)
    write_step(tmp_path / "cap.step", [Part(cap.wrapped, "cap", GLASS_COLOUR)], "cap")
    reflector = raytrace.load_reflector(tmp_path / "cap.step")
    # Trimming polygons leave their pcurves by up to 1e-8 of the face's width (LOOP_CHORD), as arcs do that have as few chords
    # as that allows: 2.6e-6 mm at either edge, where a millimetre is 3.4e-3 rad, is 1e-8 of the field.
    assert h_fov_between_edges(reflector, EYE, box_of(reflector)) == pytest.approx(between((-130.0, 130.0)), rel=1e-8)
    # Two halves of one sphere, the seam between them beside the middle: the same as the whole.
    halves = [Part((cap & (Pos(side * 200 + 7.0, 0, 0) * Block(400, 400, 400))).wrapped, f"half {side}", GLASS_COLOUR)
              for side in (-1, 1)]
    write_step(tmp_path / "halves.step", halves, "halves")
    reflector = raytrace.load_reflector(tmp_path / "halves.step")
    assert h_fov_between_edges(reflector, EYE, box_of(reflector)) == pytest.approx(between((-130.0, 130.0)), rel=1e-8)


def test_a_mesh_has_it_to_its_vertices_and_normals() -> None:
    x, y = np.meshgrid(np.linspace(-115, 115, 231), np.linspace(-160, 160, 321), indexing="ij")
    vertices = np.stack([x, y, np.sqrt(RADIUS**2 - x**2 - y**2) - RADIUS], axis=2).reshape(-1, 3)
    corner = np.arange(x.size).reshape(x.shape)[:-1, :-1].ravel()
    faces = np.concatenate([np.stack([corner, corner + 321, corner + 322], axis=1),
                            np.stack([corner, corner + 322, corner + 1], axis=1)]).astype(np.int32)
    mesh = Reflector.of_mesh(SurfaceMesh(vertices, faces), "interpolated")
    # Interpolated normals of 1 mm facets at the very edge: some 1e-6 rad of each ray.
    assert h_fov_between_edges(mesh, EYE, box_of(mesh)) == pytest.approx(between((-115.0, 115.0)), abs=1e-3)
    facets = Reflector.of_mesh(SurfaceMesh(vertices, faces))
    assert h_fov_between_edges(facets, EYE, box_of(facets)) == pytest.approx(between((-114.5, 114.5)), abs=2e-3)


def test_an_eye_that_sees_nothing_on_the_row_has_no_field_of_view() -> None:
    reflector = Reflector.from_mirror(design(spec_of(constant(1250.0), constant(1250.0))))
    mesh = Reflector.of_mesh(SurfaceMesh(np.array([[-50.0, 20, 0], [50, 20, 0], [0, 90, 0]]), np.array([[0, 1, 2]], np.int32)))
    assert h_fov_between_edges(mesh, EYE, box_of(mesh)) is None
    assert h_fov_between_edges(mesh, -EYE, box_of(mesh)) is None
    assert h_fov_between_edges(reflector, EYE, box_of(reflector)) is not None
