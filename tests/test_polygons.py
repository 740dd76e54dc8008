"""Polygons as triangles: what they cover and nothing else, whatever their shape, place and first corner."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import raytrace
from mirror_cad.errors import FileError
from mirror_cad.mesh import SurfaceMesh
from raytrace.embree import TriangleScene
from raytrace.mesh_files import read_mesh
from raytrace.polygons import triangulated
from raytrace.scene.bodies import read_body
from raytrace.surfaces.mesh import MeshSurface

L_SHAPE = np.array([[3.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
NEAR = 1e-4  # of the polygon's size: rays nearer to its outline may fall on either side, Embree's triangles overlap a little


def obj(corners: np.ndarray) -> bytes:
    return ("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
            + "f " + " ".join(str(k - len(corners)) for k in range(len(corners))) + "\n").encode()  # counted from the end


def off(corners: np.ndarray) -> bytes:
    return (f"OFF\n{len(corners)} 1 0\n" + "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
            + f"{len(corners)} " + " ".join(map(str, range(len(corners)))) + "\n").encode()


def ply(corners: np.ndarray) -> bytes:
    header = (f"ply\nformat binary_big_endian 1.0\nelement vertex {len(corners)}\nproperty double x\nproperty double y\n"
              "property double z\nelement face 1\nproperty list ushort int vertex_index\nend_header\n")
    return (header.encode() + corners.astype(">f8").tobytes() + np.array([len(corners)], dtype=">u2").tobytes()
            + np.arange(len(corners), dtype=">i4").tobytes())


WRITERS: dict[str, Callable[[np.ndarray], bytes]] = {".obj": obj, ".ply": ply, ".off": off}


def shoelace(flat: np.ndarray) -> float:
    x, y = flat.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def area(mesh: SurfaceMesh) -> float:
    corner = mesh.vertices[mesh.faces]
    return 0.5 * float(np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum())


def first_crossing(points: np.ndarray) -> tuple[int, int] | None:
    """Two sides of a closed outline that cross."""
    a, b = points, np.roll(points, -1, axis=0)
    side = b - a

    def turn(corner: np.ndarray) -> np.ndarray:
        """On which side of each row's line each column's corner lies."""
        to = corner[None] - a[:, None]
        return side[:, None, 0] * to[..., 1] - side[:, None, 1] * to[..., 0]

    apart = turn(a) * turn(b) < 0.0
    found = np.argwhere(np.triu(apart & apart.T, 2))
    return (int(found[0, 0]), int(found[0, 1])) if len(found) else None


def simple_polygon(rng: np.random.Generator, n: int) -> np.ndarray:
    """Random points joined to an outline whose crossings are taken out, two sides at a time; counter-clockwise."""
    points = rng.uniform(-1.0, 1.0, (n, 2))
    while (found := first_crossing(points)) is not None:
        i, j = found
        points[i + 1:j + 1] = points[i + 1:j + 1][::-1].copy()
    return points if shoelace(points) > 0.0 else points[::-1].copy()


def with_straight_corners(rng: np.random.Generator, outline: np.ndarray) -> np.ndarray:
    """The outline with one or two more corners on some of its sides."""
    rows = []
    for here, after in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        rows.append(here)
        rows += [here + t * (after - here) for t in np.sort(rng.uniform(0.1, 0.9, rng.integers(0, 3)))]
    return np.array(rows)


def inside(outline: np.ndarray, places: np.ndarray) -> np.ndarray:
    """By counting the sides that a line from each place to the right crosses."""
    a, b = outline, np.roll(outline, -1, axis=0)
    x, y = places[:, :1], places[:, 1:]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return np.asarray((spans & (at > x)).sum(axis=1) % 2 == 1)


def far_from(outline: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Which places keep NEAR from all sides."""
    a, side = outline, np.roll(outline, -1, axis=0) - outline
    t = np.clip(np.einsum("nsc,sc->ns", places[:, None] - a, side) / np.einsum("sc,sc->s", side, side), 0.0, 1.0)
    away = np.linalg.norm(places[:, None] - a - t[..., None] * side, axis=2).min(axis=1)
    return np.asarray(away > NEAR * np.ptp(outline, axis=0).max())


def random_frame(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two axes and a normal as rows, and a place."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return axes * np.linalg.det(axes), rng.uniform(-5.0, 5.0, 3)


def test_random_simple_polygons_cover_what_their_outline_encloses(tmp_path: Path) -> None:
    """200 concave outlines with corners on straight sides, in random planes, as OBJ, PLY and OFF, from any first corner and
    either way round. The area is the shoelace formula's; rays are sorted by counting crossings."""
    rng = np.random.default_rng(14)
    places = rng.uniform(-1.05, 1.05, (300, 2))
    worst, wrong, concave = 0.0, 0, 0
    for number in range(200):
        flat = with_straight_corners(rng, simple_polygon(rng, int(rng.integers(4, 20))))
        flat = np.roll(flat, int(rng.integers(len(flat))), axis=0)
        turn = np.roll(flat, -1, axis=0) - flat
        concave += bool((np.linalg.det(np.stack([np.roll(turn, 1, axis=0), turn], axis=1)) < -1e-9).any())
        axes, origin = random_frame(rng)
        corners = flat @ axes[:2] + origin
        if number % 2:
            corners = corners[::-1]
        judged = far_from(flat, places)
        expected = inside(flat, places)[judged]
        starts = places[judged] @ axes[:2] + origin + 3.0 * axes[2]
        for kind, write in WRITERS.items():
            path = tmp_path / f"polygon{kind}"
            path.write_bytes(write(corners))
            mesh = read_mesh(path)
            worst = max(worst, abs(area(mesh) / shoelace(flat) - 1.0))
            met = TriangleScene(mesh.vertices, mesh.faces).first_hits(starts, np.tile(-axes[2], (len(starts), 1))).triangle >= 0
            wrong += int(np.count_nonzero(met != expected))
            facing = mesh.facet_normals() @ axes[2]
            assert (facing[np.abs(facing) > 0.0] * (-1.0 if number % 2 else 1.0) > 0.0).all()  # none is turned over
            assert len(np.unique(mesh.faces)) == len(corners)  # corners on straight sides are kept
    assert concave > 150
    assert worst < 1e-12
    assert wrong == 0


@pytest.mark.parametrize("first", range(6))
@pytest.mark.parametrize("kind", sorted(WRITERS))
def test_an_l_is_the_same_wall_from_every_first_corner(tmp_path: Path, kind: str, first: int) -> None:
    """Four of the six fans cover the notch. As a mirror and as a body."""
    path = tmp_path / f"wall{kind}"
    path.write_bytes(WRITERS[kind](np.roll(L_SHAPE, first, axis=0)))
    reflector = raytrace.load_reflector(path)
    assert isinstance(reflector.surface, MeshSurface)
    assert area(reflector.surface.mesh) == pytest.approx(5.0, rel=1e-15)
    assert raytrace.reflect(reflector, [2.0, 2.0, 9.0], [[0.0, 0.0, -1.0]]).counts() == {"missed": 1}
    body = read_body(path, unit="m")
    assert area(SurfaceMesh(body.vertices, body.faces)) == pytest.approx(5e6, rel=1e-12)


def cut(points: np.ndarray) -> tuple[np.ndarray, int]:
    found = triangulated(points, np.array([0, len(points)]))
    return points[found.corners], len(found.crossed)


def area_of(triangles: np.ndarray) -> float:
    sides = triangles[:, 1:] - triangles[:, :1]
    return 0.5 * float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum())


@pytest.mark.parametrize("first", range(10))
def test_a_window_is_cut_out_of_a_wall_along_its_seam(first: int) -> None:
    """OBJ, PLY and OFF know holes only as an outline that goes in and comes back on itself."""
    wall = np.array([[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1.0]])
    triangles, crossed = cut(np.column_stack([np.roll(wall, first, axis=0), np.zeros(10)]))
    assert area_of(triangles) == pytest.approx(12.0, rel=1e-15)
    assert crossed == 0
    middles = triangles.mean(axis=1)
    assert not ((np.abs(middles[:, :2] - 2.0) < 1.0).all(axis=1)).any()


def test_a_polygon_with_two_windows_on_one_corner_is_cut() -> None:
    """Both seams begin at the same corner of the wall."""
    wall = np.array([[0, 0], [1, 2], [1, 3], [2, 2], [1, 2], [0, 0], [3, 1], [3, 2], [4, 1], [3, 1], [0, 0], [5, 0], [5, 5],
                     [0, 5.0]])
    for first in range(len(wall)):
        triangles, crossed = cut(np.column_stack([np.roll(wall, first, axis=0), np.zeros(len(wall))]))
        assert area_of(triangles) == pytest.approx(24.0, rel=1e-14)
        assert crossed == 0


def test_a_polygon_that_is_not_plane_is_cut_in_its_least_squares_plane() -> None:
    """An L whose corners are lifted at random: seen along z the triangles still cover the L, and no more."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        lifted = L_SHAPE + np.array([0.0, 0.0, 1.0]) * rng.uniform(-0.2, 0.2, (6, 1))
        triangles, crossed = cut(np.roll(lifted, rng.integers(6), axis=0))
        assert area_of(triangles * [1.0, 1.0, 0.0]) == pytest.approx(5.0, rel=1e-14)
        assert crossed == 0


def test_repeated_corners_and_sides_without_length_change_nothing() -> None:
    doubled = np.repeat(L_SHAPE, [1, 2, 1, 3, 1, 2], axis=0)
    for first in range(len(doubled)):
        triangles, crossed = cut(np.roll(doubled, first, axis=0))
        assert area_of(triangles) == pytest.approx(5.0, rel=1e-15)
        assert crossed == 0


def test_an_outline_that_crosses_itself_is_refused_as_a_mirror_and_said_of_a_body(tmp_path: Path) -> None:
    """What it covers is not defined: a bow tie, and a star of five points."""
    turn = 0.5 * np.pi + np.arange(5) * 4.0 * np.pi / 5.0
    star = np.stack([np.cos(turn), np.sin(turn), np.zeros(5)], axis=1)
    for corners in (np.array([[0.0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]]), star):
        path = tmp_path / "tie.obj"
        path.write_bytes(obj(corners))
        with pytest.raises(FileError, match="the outline of 1 of its polygons crosses itself"):
            read_mesh(path)
        assert read_body(path, unit="m").left_out == "tie.obj: left out: what 1 polygons cover whose outline crosses itself"


@pytest.mark.parametrize("n", [2000])
def test_a_long_spiral_is_cut(n: int) -> None:
    """Two arms of a thousand corners each, the worst kind for cutting ears one at a time."""
    turn = np.linspace(0.0, 12.0 * np.pi, n // 2)
    out, back = (1.0 + turn), (1.2 + turn)[::-1]
    spiral = np.concatenate([np.stack([out * np.cos(turn), out * np.sin(turn)], axis=1),
                             np.stack([back * np.cos(turn[::-1]), back * np.sin(turn[::-1])], axis=1)])
    triangles, crossed = cut(np.column_stack([spiral, np.zeros(n)]))
    assert area_of(triangles) == pytest.approx(abs(shoelace(spiral)), rel=1e-12)
    assert crossed == 0
