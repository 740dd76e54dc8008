"""The curves that bound a face: closed in space, without seams and poles; and what lies between them and the eye."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import raytrace
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.quadric import Quadric
from raytrace.reflector import Reflector
from raytrace.surfaces.quadric import QuadricFace
from raytrace.viewing.bezel import edge_loop
from raytrace.viewing.view import View, box_of
from raytrace.visibility.edge_of import edge_of
from tests.test_magnification import EYE, POSE, quadric

Array = NDArray[np.float64]

R = 150.0


def whole_sphere(low: float = -0.5 * np.pi, start: float = 0.0) -> QuadricFace:
    """Of latitudes from `low` on, its seam at the longitude `start`."""
    loop = np.array([[start, low], [start + 2 * np.pi, low], [start + 2 * np.pi, 0.5 * np.pi], [start, 0.5 * np.pi]])
    return QuadricFace(Quadric("sphere", np.zeros(3), np.eye(3), R), (loop,))


def test_a_whole_sphere_has_no_rim_and_its_box_is_that_of_the_sphere() -> None:
    ball = whole_sphere()
    assert ball.rim == ()
    assert box_of(Reflector(ball)) == pytest.approx((-R, R, -R, R), abs=1e-12)
    assert np.abs(np.linalg.norm(edge_loop(Reflector(ball))[:, :2], axis=1) - R).max() < 1e-9


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_a_cap_is_bounded_by_its_circle_and_not_by_its_seam(start: float) -> None:
    cap = whole_sphere(0.25 * np.pi, start)
    circle, = cap.rim
    assert np.abs(circle.points[:, 2] - R * np.sqrt(0.5)).max() < 1e-9
    assert circle.lengths.sum() == pytest.approx(2 * np.pi * R * np.sqrt(0.5), rel=1e-6)  # chords: (π/4096)²/6
    assert np.array_equal(edge_loop(Reflector(cap)), circle.points)
    edge = edge_of(View(Reflector(cap), POSE, EYE))
    assert edge.beyond
    assert len(edge.crossings(lambda points, directions: directions[:, 2])[0]) == 2


def test_a_tube_is_bounded_by_its_two_circles() -> None:
    loop = np.array([[0.0, -20.0], [2 * np.pi, -20.0], [2 * np.pi, 20.0], [0.0, 20.0]])
    tube = QuadricFace(Quadric("cylinder", np.zeros(3), np.eye(3), R), (loop,))
    assert sorted(float(curve.points[0, 2]) for curve in tube.rim) == [-20.0, 20.0]
    for curve in tube.rim:
        assert np.ptp(curve.points[:, 2]) == 0.0
        assert curve.lengths.sum() == pytest.approx(2 * np.pi * R, rel=1e-6)


def test_rims_of_another_program_s_faces_are_closed_in_space(tmp_path: Path) -> None:
    """Pieces follow each other, over holes in a seam too, and lie on the face's edge in the kernel."""
    from build123d import Box, Cone, Pos, Sphere, Torus

    from mirror_cad.occt.step import Part, write_step

    shapes = {"holed": Sphere(R) - Pos(R, 0, 0) * Box(80, 60, 50) - Pos(0, 0, R) * Box(50, 50, 80),
              "torus": Torus(80, 30), "half": Torus(80, 30) & Pos(0, 0, 50) * Box(300, 300, 100), "cone": Cone(60, 0, 90)}
    seams = [edge for edge in shapes["holed"].edges() if _is_seam(shapes["holed"], edge)]
    around = {"holed": sum(edge.length for edge in shapes["holed"].edges()) - sum(edge.length for edge in seams),
              "torus": 0.0, "half": 2 * np.pi * (110 + 50), "cone": 2 * np.pi * 60}
    rims = {}
    for name, shape in shapes.items():
        path = tmp_path / f"{name}.step"
        write_step(path, [Part(shape.wrapped, name)], name)
        reflector = raytrace.load_reflector(path)
        rims[name] = [face.rim for face in reflector.surface.bounding_faces]
        for face in reflector.surface.bounding_faces:
            for curve in face.rim:
                ends = (face.quadric if isinstance(face, QuadricFace) else face).evaluate(*curve.end.T)
                assert np.linalg.norm(ends - np.roll(curve.points, -1, axis=0), axis=1).max() < 1e-6
        length = sum(float(curve.lengths.sum()) for face in reflector.surface.bounding_faces for curve in face.rim)
        # Every edge of a solid bounds two faces; a seam and a pole bound none.
        assert length == pytest.approx(2.0 * around[name], rel=1e-5)
    assert rims["torus"] == [()]
    assert sorted(len(rim) for rim in rims["cone"]) == [1, 1]
    assert sorted(len(rim) for rim in rims["half"]) == [2, 2]


def _is_seam(shape: object, edge: object) -> bool:
    from OCP.BRep import BRep_Tool

    return any(BRep_Tool.IsClosed_s(edge.wrapped, face.wrapped) for face in shape.faces())  # type: ignore[attr-defined]


def test_a_closed_spline_is_as_large_as_it_bulges(tmp_path: Path) -> None:
    from build123d import Torus

    from mirror_cad.occt.step import Part, write_step

    write_step(tmp_path / "torus.step", [Part(Torus(80, 30).wrapped, "torus")], "torus")
    assert box_of(raytrace.load_reflector(tmp_path / "torus.step")) == pytest.approx((-110, 110, -110, 110), abs=0.3)


# --- what is shown of several faces -----------------------------------------------------------------------------------


def solid() -> tuple[Reflector, Reflector]:
    """A sphere's face alone, and with a plane behind it that reflects as well."""
    alone = quadric("sphere", 950.0)
    loop = np.array([[-60.0, -100.0], [60.0, -100.0], [60.0, 100.0], [-60.0, 100.0]])
    behind = QuadricFace(Quadric("plane", np.array([0.0, 0.0, -25.0]), np.eye(3), 0.0), (loop,), one_sided=False)
    return alone, Reflector.of_faces((behind, alone.surface))


def test_the_edge_of_the_face_that_a_solid_shows_is_that_of_the_face_alone() -> None:
    alone, both = (edge_of(View(reflector, POSE, EYE)) for reflector in solid())
    assert both.beyond
    assert np.array_equal(alone.on_plane, both.on_plane)
    assert np.array_equal(alone.directions, both.directions)


def test_what_stands_before_a_face_is_not_overlooked() -> None:
    """A plate over a corner, 20 mm before the mirror: the edge is looked for, and ends at the plate."""
    corner = np.array([[60.0, 100.0, 20.0], [200.0, 100.0, 20.0], [200.0, 250.0, 20.0], [60.0, 250.0, 20.0]])
    plate = SurfaceMesh(corner, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    view = View(replace(solid()[0], obstacles=plate), POSE, EYE)
    edge = edge_of(view)
    inside = view.on_plane_of(corner[:1])[0]
    assert np.linalg.norm(edge.on_plane - inside, axis=1).min() < 2.0
    # Nothing of the edge lies behind the plate but for rounding.
    assert not ((edge.on_plane > inside + 1e-3).all(axis=1)).any()
